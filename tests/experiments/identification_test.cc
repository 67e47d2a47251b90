#include "experiments/identification.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "experiments/statistics.h"
#include "granular/flow/energy_misfit.h"
#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// int_0^1 |t - 1/4| dt = (1/16 + 9/16) / 2, whatever the two grids.
TEST(Identification, IntegralsOfPiecewiseLinearCurvesAreExact) {
  const std::vector<double> level_time = {0.0, 1.0}, level = {0.25, 0.25};
  for (const std::vector<double>& time :
       {std::vector<double>{0.0, 1.0},
        std::vector<double>{0.0, 0.1, 0.2, 0.7, 1.0},
        std::vector<double>{0.0, 0.25, 1.0}}) {
    EXPECT_NEAR(
        IntegrateDifference(time, time, level_time, level, 1.0), 0.3125, 1e-15);
    EXPECT_NEAR(
        IntegrateDifference(level_time, level, time, time, 1.0), 0.3125, 1e-15);
  }
  // Up to an end between the times.
  EXPECT_NEAR(
      IntegrateDifference({0.0, 1.0}, {0.0, 1.0}, level_time, level, 0.5),
      0.0625,
      1e-15);
}

// (8.2)-(8.5) of curves whose parts are off by 10, 20 and 50 %.
TEST(Identification, MisfitIsTheWeightedSumOfItsParts) {
  const EnergyCurve target = ConstantTarget(1.0, 0.5, 0.5, 2.0);
  const EnergyCurve curve = {
      {0.0, 0.3, 2.0}, {1.1, 1.1, 1.1}, {0.4, 0.4, 0.4}, {0.75, 0.75, 0.75}};
  const Misfit even = ComputeMisfit(curve, target, {1.0, 1.0, 1.0}, 2.0);
  EXPECT_NEAR(even.total, 0.1, 1e-14);
  EXPECT_NEAR(even.bulk, 0.2, 1e-14);
  EXPECT_NEAR(even.relative, 0.5, 1e-14);
  EXPECT_NEAR(even.value, 0.8 / 3.0, 1e-14);
  EXPECT_NEAR(ComputeMisfit(curve, target, {2.0, 0.0, 1.0}, 2.0).value,
              0.7 / 3.0,
              1e-14);
  EXPECT_EQ(ComputeMisfit(target, target, {1.0, 1.0, 1.0}, 2.0).value, 0.0);
  // A flow without a value, as one that ended too early.
  EXPECT_EQ(ComputeMisfit({{0.0, 2.0}, {1.0, NAN}, {0.5, 0.5}, {0.5, 0.5}},
                          target,
                          {1.0, 1.0, 1.0},
                          2.0)
                .value,
            kInfinity);
  EXPECT_EQ(ComputeMisfit(curve, target, {1.0, 1.0, 1.0}, 2.5).value,
            kInfinity);
}

// Errors: T* = 1 with 1 / s = 1 + t, T = T* + 0.1 t until 2:
//   P_E = int 0.1 t (1 + t) dt / int (1 + t) dt = 0.4666... / 4,
// and for T - T* = t - 1, which changes its sign, 2 / 4.
TEST(Identification, ErrorsWeighTimes) {
  EnergyCurve target = ConstantTarget(1.0, 0.5, 0.5, 2.0);
  const MisfitWeights total = {1.0, 0.0, 0.0};
  target.total_error = {1.0, 1.0 / 3.0};
  EXPECT_TRUE(HasErrors(target, total));
  EXPECT_FALSE(HasErrors(target, {1.0, 1.0, 0.0}));
  const EnergyCurve curve = {
      {0.0, 0.7, 2.0}, {1.0, 1.07, 1.2}, {0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}};
  const Misfit misfit = ComputeMisfit(curve, target, total, 2.0);
  EXPECT_NEAR(misfit.total, 1.4 / 12.0, 1e-14);
  EXPECT_NEAR(misfit.value, 1.4 / 12.0, 1e-14);
  EXPECT_NEAR(misfit.total_errors, 0.7 / 3.0, 1e-14);
  const EnergyCurve crossing = {{0.0, 2.0}, {0.0, 2.0}, {0.5, 0.5}, {0.5, 0.5}};
  EXPECT_NEAR(ComputeMisfit(crossing, target, total, 2.0).value, 0.5, 1e-14);
}

// What is known ten times better counts ten times as much; errors of one size
// relative to the target are none.
TEST(Identification, ErrorsWeighEnergies) {
  EnergyCurve target = ConstantTarget(1.0, 0.5, 0.5, 2.0);
  const EnergyCurve curve = {
      {0.0, 0.3, 2.0}, {1.1, 1.1, 1.1}, {0.4, 0.4, 0.4}, {0.75, 0.75, 0.75}};
  const auto value = [&](double total, double bulk, double relative) {
    target.total_error.assign(2, total);
    target.bulk_error.assign(2, bulk);
    target.relative_error.assign(2, relative);
    return ComputeMisfit(curve, target, {2.0, 1.0, 1.0}, 2.0).value;
  };
  EXPECT_NEAR(value(0.1, 0.05, 0.05), 0.9 / 4.0, 1e-14);
  EXPECT_NEAR(value(0.01, 0.005, 0.005), 0.9 / 4.0, 1e-14);
  EXPECT_NEAR(value(0.1, 0.005, 0.05),
              (2.0 * 10.0 * 0.1 + 100.0 * 0.2 + 10.0 * 0.5) / 130.0,
              1e-14);
  // 0.1, 0.1 and 0.25 off.
  const Misfit misfit = ComputeMisfit(curve, target, {}, 2.0);
  EXPECT_NEAR(misfit.total_errors, 1.0, 1e-13);
  EXPECT_NEAR(misfit.bulk_errors, 20.0, 1e-13);
  EXPECT_NEAR(misfit.relative_errors, 5.0, 1e-13);
}

// |mean_(E+1) - mean_E| <= TOL |mean_(E+1)|.
TEST(Identification, EnsemblesStopByThePapersRule) {
  EnsembleRule rule;
  rule.least = 2;
  rule.most = 6;
  rule.tolerance = 0.1;
  EXPECT_FALSE(IsSettled(rule, {}));
  EXPECT_FALSE(IsSettled(rule, {1.0}));
  EXPECT_TRUE(IsSettled(rule, {1.0, 1.2}));   // 1.1 - 1 = 0.1 <= 0.11
  EXPECT_FALSE(IsSettled(rule, {1.0, 1.3}));  // 0.15 > 0.115
  EXPECT_TRUE(IsSettled(rule, {1.0, 1.3, 1.0}));
  EXPECT_TRUE(IsSettled(rule, {1.0, 9.0, 1.0, 99.0, 1.0, 999.0}));  // most
  EXPECT_TRUE(IsSettled(rule, {1.0, kInfinity}));
  rule.least = 5;
  EXPECT_FALSE(IsSettled(rule, {1.0, 1.0, 1.0, 1.0}));
  EXPECT_TRUE(IsSettled(rule, {1.0, 1.0, 1.0, 1.0, 1.0}));
}

TEST(Identification, StartsDiffer) {
  EnsembleRule fresh, common;
  common.is_common = true;
  common.stream = 1;
  std::set<std::uint64_t> seeds;
  for (int string = 0; string < 50; ++string) {
    for (int run = 0; run < 50; ++run) {
      seeds.insert(StartSeed(1, fresh, string, run));
      EXPECT_EQ(StartSeed(1, common, string, run),
                StartSeed(1, common, 0, run));
    }
  }
  EXPECT_EQ(seeds.size(), 2500u);
  for (int run = 0; run < 50; ++run) {
    seeds.insert(StartSeed(1, common, 0, run));
    seeds.insert(StartSeed(2, common, 0, run));
  }
  EXPECT_EQ(seeds.size(), 2600u);
}

TEST(Identification, MeansAndTheirErrors) {
  const Ensemble e = {{}, {1.0, 2.0, 3.0, 4.0}};
  EXPECT_NEAR(e.mean(), 2.5, 1e-15);
  EXPECT_NEAR(e.error(), std::sqrt(5.0 / 3.0 / 4.0), 1e-15);
  EXPECT_EQ((Ensemble{{}, {1.0, kInfinity}}).mean(), kInfinity);
  double mean, error;
  PairedDifference({1.0, 2.0, 4.0}, {0.5, 1.5, 3.5}, &mean, &error);
  EXPECT_NEAR(mean, 0.5, 1e-15);
  EXPECT_NEAR(error, 0.0, 1e-15);
  // Student's t of 5, 10, 60 values.
  EXPECT_NEAR(ConfidenceFactor(5), 2.776, 0.03);
  EXPECT_NEAR(ConfidenceFactor(10), 2.262, 0.003);
  EXPECT_NEAR(ConfidenceFactor(60), 2.001, 0.001);
}

// Ten values of deviation 1 about 0.7: t = 2.21 < 2.26. Both signs are alike.
TEST(Identification, EqualIsWhatTheErrorDoesNotTell) {
  const double error = 1.0 / std::sqrt(10.0);
  EXPECT_TRUE(AreEqual(0.7, error, 10));
  EXPECT_TRUE(AreEqual(-0.7, error, 10));
  EXPECT_FALSE(AreEqual(0.73, error, 10));
  EXPECT_FALSE(AreEqual(-0.73, error, 10));
  EXPECT_TRUE(AreEqual(0.0, 0.0, 10));
  EXPECT_FALSE(AreEqual(kInfinity, kInfinity, 1));
}

TEST(Identification, SearchedFlagsAreParsed) {
  std::vector<SearchedFlag> flags;
  std::string error;
  ASSERT_TRUE(ParseSearched("alpha1:0:1,mu_s:0.1:0.5", &flags, &error));
  ASSERT_EQ(flags.size(), 2u);
  EXPECT_EQ(flags[1].name, "mu_s");
  EXPECT_EQ(flags[1].low, 0.1);
  EXPECT_EQ(flags[1].high, 0.5);
  for (const char* text : {"",
                           "alpha1",
                           "alpha1:0",
                           "alpha1:1:0",
                           "alpha1:0:inf",
                           "alpha1:0:x",
                           ":0:1",
                           "a:0:1,a:0:2"}) {
    std::vector<SearchedFlag> none;
    EXPECT_FALSE(ParseSearched(text, &none, &error)) << text;
  }
}

// Strings along a line a + b = const of the unit box: their narrow axis is
// (1, 1) / sqrt 2.
TEST(Identification, ValleyNamesTheCombination) {
  std::vector<std::vector<double>> strings;
  for (int k = 0; k < 9; ++k) {
    const double t = 0.05 * k;
    strings.push_back({2.0 * (0.3 + t), 0.7 - t + (k % 2 == 0 ? 0.01 : 0.0)});
  }
  const Valley valley =
      DescribeValley(strings, {{"a", 0.0, 2.0}, {"b", 0.0, 1.0}});
  ASSERT_EQ(valley.axis.size(), 2u);
  EXPECT_LT(valley.deviation[0], 0.01);
  EXPECT_GT(valley.deviation[1], 0.15);
  EXPECT_NEAR(std::fabs(valley.axis[0][0] / valley.axis[0][1]), 1.0, 0.05);
  EXPECT_GT(valley.axis[0][0] * valley.axis[0][1], 0.0);
  EXPECT_NEAR(valley.low[0], 0.6, 1e-12);
  EXPECT_NEAR(valley.high[0], 1.4, 1e-12);
}

class TargetFile : public testing::Test {
 protected:
  void TearDown() override { std::remove(path_.c_str()); }
  // What ReadTarget() says of a file with that text; empty: it is fine.
  std::string Read(const std::string& text,
                   const MisfitWeights& weights = MisfitWeights()) {
    std::ofstream(path_) << text;
    std::string error;
    target_ = EnergyCurve();
    return ReadTarget(path_, 1.0, weights, &target_, &error) ? "" : error;
  }
  const std::string path_ =
      testing::TempDir() + "/granopt_target_" +
      testing::UnitTest::GetInstance()->current_test_info()->name() + ".csv";
  EnergyCurve target_;
};

TEST_F(TargetFile, IsReadBack) {
  const EnergyCurve curve = {
      {0.0, 0.1, 1.0}, {1.0, 2.0, 1.5}, {0.5, 1.0, 0.75}, {0.5, 1.0, 0.75}};
  EXPECT_EQ(Read(FormatCurve(curve)), "");
  EXPECT_EQ(target_.time, curve.time);
  EXPECT_EQ(target_.total, curve.total);
  EXPECT_EQ(target_.bulk, curve.bulk);
  EXPECT_EQ(target_.relative, curve.relative);
  EXPECT_TRUE(target_.total_error.empty());
  EnergyCurve measured = curve;
  measured.total_error = {0.1, 0.2, 0.3};
  measured.bulk_error = {0.1, 0.1, 0.3};
  measured.relative_error = {0.01, 0.2, 0.3};
  EXPECT_EQ(Read(FormatCurve(measured)), "");
  EXPECT_EQ(target_.relative, curve.relative);
  EXPECT_EQ(target_.total_error, measured.total_error);
  EXPECT_EQ(target_.bulk_error, measured.bulk_error);
  EXPECT_EQ(target_.relative_error, measured.relative_error);
  EXPECT_EQ(Read("time,T,T_error\n0,1,0.1\n1,2,0.1\n", {1.0, 0.0, 0.0}), "");
  // A signal of T alone.
  EXPECT_EQ(Read("time,T\n0,1\n1,2\n", {1.0, 0.0, 0.0}), "");
}

TEST_F(TargetFile, BadOnesAreRefusedByLine) {
  const struct {
    const char* text;
    const char* words;
  } cases[] = {
      {"", "empty"},
      {"time,T\n0,1\n1,1\n", "no column T_b"},
      {"time,T,T_b,T_r\n0,1,1,x\n", ":2: T_r: 'x' is not a number"},
      {"time,T,T_b,T_r\n0,1,1,1\n0.5,1,1\n", ":3: 3 columns, expected 4"},
      {"time,T,T_b,T_r\n0,1,1,1\n1,nan,1,1\n", ":3: T = nan is no energy"},
      {"time,T,T_b,T_r\n0,1,1,1\n1,1,-1,1\n", ":3: T_b = -1 is no energy"},
      {"time,T,T_b,T_r\n0.1,1,1,1\n1,1,1,1\n", ":2: the first time is 0.1"},
      {"time,T,T_b,T_r\n0,1,1,1\n0,1,1,1\n", ":3: time 0 does not exceed"},
      {"time,T,T_b,T_r\n0,1,1,1\ninf,1,1,1\n", ":3: time is not finite"},
      {"time,T,T_b,T_r\n0,1,1,1\n", "at least two rows"},
      {"time,T,T_b,T_r,T_error\n0,1,1,1,1\n1,1,1,1,1\n",
       ":1: no column T_b_error: errors are given of all"},
      {"time,T,T_b,T_r,T_error,T_b_error,T_r_error\n0,1,1,1,1,1,1\n"
       "1,1,1,1,1,0,1\n",
       ":3: T_b_error = 0 must be positive"},
      {"time,T,T_b,T_r\n0,1,1,1\n0.9,1,1,1\n", "ends at time 0.9"},
      {"time,T,T_b,T_r\n0,1,0,1\n1,1,0,1\n", "column T_b is 0 everywhere"}};
  for (const auto& c : cases) {
    const std::string error = Read(c.text);
    EXPECT_NE(error.find(c.words), std::string::npos)
        << c.text << "\n got: " << error;
  }
}

}  // namespace
}  // namespace granopt
