#include "experiments/comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Comparison, NumbersAreWrittenAsPeopleWriteThem) {
  EXPECT_EQ(Neat(5e-5), "5e-5");
  EXPECT_EQ(Neat(1e-4), "1e-4");
  EXPECT_EQ(Neat(0.01), "1e-2");
  EXPECT_EQ(Neat(0.8438), "0.8438");
  EXPECT_EQ(Neat(1e-13), "1e-13");
  EXPECT_EQ(Neat(4096), "4096");
  for (const double value : {0.1 + 0.2, 1.0 / 3.0, 1e-300, 6.02e23, 1e6}) {
    EXPECT_EQ(std::stod(Neat(value)), value);
  }
}

TEST(Comparison, MethodsAreSeparatedBySemicolonsAndMayHaveLabels) {
  std::vector<Method> methods;
  std::string error;
  ASSERT_TRUE(ParseMethods(
      "P-L-BFGS (A = 0)@lbfgs:memory=5,A=0; fire", &methods, &error));
  ASSERT_EQ(methods.size(), 2u);
  EXPECT_EQ(methods[0].label, "P-L-BFGS (A = 0)");
  EXPECT_EQ(methods[0].spec, "lbfgs:memory=5,A=0");
  EXPECT_EQ(methods[1].label, "fire");
  EXPECT_EQ(methods[1].spec, "fire");
  EXPECT_FALSE(ParseMethods("a;;b", &methods, &error));
  EXPECT_FALSE(ParseMethods("a@", &methods, &error));
  EXPECT_FALSE(ParseMethods("a;a", &methods, &error));
  EXPECT_NE(error.find("given twice"), std::string::npos);
}

TEST(Comparison, CasesMayHaveValuesAndDistances) {
  std::vector<Case> cases;
  std::string error;
  ASSERT_TRUE(ParseCases("growth,random=2e-4,near_jamming,user",
                         {1e-2, 1e-3},
                         1e-6,
                         &cases,
                         &error))
      << error;
  ASSERT_EQ(cases.size(), 5u);
  EXPECT_EQ(cases[0].id, "growth=5e-5");
  EXPECT_EQ(cases[1].id, "random=2e-4");
  EXPECT_EQ(cases[1].value, 2e-4);
  EXPECT_EQ(cases[3].id, "near_jamming=1e-6 at 1e-3");
  EXPECT_EQ(cases[3].distance, 1e-3);
  EXPECT_EQ(cases[4].id, "user");
  ASSERT_TRUE(ParseCases(
      "near_jamming=1e-6,near_jamming=0.3x", {1e-4}, 1e-5, &cases, &error))
      << error;
  ASSERT_EQ(cases.size(), 2u);
  EXPECT_FALSE(cases[0].relative);
  EXPECT_EQ(StrainOf(cases[0]), 1e-6);
  EXPECT_EQ(cases[1].id, "near_jamming=0.3x at 1e-4");
  EXPECT_TRUE(cases[1].relative);
  EXPECT_DOUBLE_EQ(StrainOf(cases[1]), 3e-5);
  for (const char* bad : {"near_jamming=-1x",
                          "near_jamming=0x",
                          "near_jamming=x",
                          "near_jamming=0.3xx",
                          "near_jamming=infx",
                          "near_jamming=101x",
                          "growth=0.3x",
                          "magic",
                          "",
                          "growth=",
                          "growth=-1",
                          "growth=many",
                          "growth=nan",
                          "user=1",
                          "growth,growth=5e-5"}) {
    EXPECT_FALSE(ParseCases(bad, {1e-2}, 1e-6, &cases, &error)) << bad;
  }
}

TEST(Comparison, SeedsAreNumbersAndRanges) {
  std::vector<std::uint64_t> seeds;
  std::string error;
  ASSERT_TRUE(ParseSeeds("1-3,7", &seeds, &error));
  EXPECT_EQ(seeds, (std::vector<std::uint64_t>{1, 2, 3, 7}));
  for (const char* bad : {"", "1-", "-1", "3-1", "a", "1,1", "1-99999999999"}) {
    EXPECT_FALSE(ParseSeeds(bad, &seeds, &error)) << bad;
  }
}

// Every repetition runs every method once; the first places differ, and so do
// the predecessors.
TEST(Comparison, TheOrderIsRotatedAndReversed) {
  for (int n = 1; n <= 6; ++n) {
    std::set<int> first;
    for (int r = 0; r < n; ++r) {
      const std::vector<int> order = MethodOrder(n, r);
      EXPECT_EQ(std::set<int>(order.begin(), order.end()).size(),
                static_cast<std::size_t>(n));
      first.insert(order[0]);
    }
    EXPECT_EQ(first.size(), static_cast<std::size_t>(n));
  }
  EXPECT_EQ(MethodOrder(4, 0), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(MethodOrder(4, 1), (std::vector<int>{1, 0, 3, 2}));
  EXPECT_EQ(MethodOrder(4, 2), (std::vector<int>{2, 3, 0, 1}));
  EXPECT_EQ(MethodOrder(4, 6), MethodOrder(4, 2));
}

TEST(Comparison, QuantilesAreLinearBetweenValuesAndKnowInfinity) {
  Quantiles q = QuantilesOf({4.0, 1.0, 2.0, 3.0, 5.0, 6.0});
  EXPECT_DOUBLE_EQ(q.low, 2.0);
  EXPECT_DOUBLE_EQ(q.median, 3.5);
  EXPECT_DOUBLE_EQ(q.high, 5.0);
  q = QuantilesOf({3.0, 1.0, 2.0});
  EXPECT_DOUBLE_EQ(q.low, 1.4);
  EXPECT_DOUBLE_EQ(q.median, 2.0);
  EXPECT_DOUBLE_EQ(q.high, 2.6);
  // One failure of three: the median is known, the upper end is not.
  q = QuantilesOf({kInfinity, 1.0, 2.0});
  EXPECT_DOUBLE_EQ(q.median, 2.0);
  EXPECT_TRUE(std::isinf(q.high));
  q = QuantilesOf({kInfinity, kInfinity, 2.0});
  EXPECT_TRUE(std::isinf(q.median));
  EXPECT_TRUE(std::isnan(QuantilesOf({}).median));
}

TEST(Comparison, MedianAndWorstKnowInfinity) {
  MedianWorst value = MedianAndWorst({4.0, 1.0, 3.0});
  EXPECT_EQ(value.median, 3.0);
  EXPECT_EQ(value.worst, 4.0);
  value = MedianAndWorst({1.0, kInfinity, 3.0});
  EXPECT_EQ(value.median, 3.0);
  EXPECT_TRUE(std::isinf(value.worst));
  value = MedianAndWorst({1.0, kInfinity});
  EXPECT_TRUE(std::isinf(value.median));
  EXPECT_TRUE(std::isnan(MedianAndWorst({}).worst));
}

// Its ends solve (p - k/n)^2 = z^2 p (1 - p) / n.
TEST(Comparison, WilsonsInterval) {
  const double z2 = 1.959963984540054 * 1.959963984540054;
  for (const int n : {1, 7, 30, 1000}) {
    for (const int k : {0, 1, n / 2, n}) {
      const Interval interval = Wilson(k, n);
      EXPECT_LE(0.0, interval.low);
      EXPECT_LE(interval.low, static_cast<double>(k) / n);
      EXPECT_LE(static_cast<double>(k) / n, interval.high);
      EXPECT_LE(interval.high, 1.0);
      for (const double p : {interval.low, interval.high}) {
        const double off = p - static_cast<double>(k) / n;
        EXPECT_NEAR(off * off, z2 * p * (1.0 - p) / n, 1e-12) << k << " " << n;
      }
    }
  }
  EXPECT_EQ(Wilson(0, 10).low, 0.0);
  EXPECT_NEAR(Wilson(0, 10).high, z2 / (10.0 + z2), 1e-15);
  EXPECT_EQ(Wilson(10, 10).high, 1.0);
  EXPECT_EQ(Wilson(0, 0).low, 0.0);
  EXPECT_EQ(Wilson(0, 0).high, 1.0);
}

TEST(Comparison, RigidDistanceLeavesOutTranslationsAndRattlers) {
  const std::vector<bool> first = {false, false, true, false};
  const std::vector<bool> second = {false, false, false, true};
  const std::vector<double> zero(8, 0.0);
  EXPECT_EQ(RigidDistance({1, 2, 1, 2, 9, 9, 9, 9}, first, zero, second), 0.0);
  EXPECT_EQ(RigidDistance({1, 2, 1.5, 2, 9, 9, 9, 9}, first, zero, second),
            0.25);
  EXPECT_EQ(RigidDistance({}, {}, {}, {}), 0.0);
}

TEST(Comparison, ReservedLettersAreNotGivenAgain) {
  Minima minima;
  const std::vector<bool> rigid = {false};
  EXPECT_EQ(minima.Tag(1.0, 0.0, 1.0, 1e-3, {0, 0}, rigid), "A");
  minima.Reserve(3);
  EXPECT_EQ(minima.Tag(1.0, 0.0, 1.0, 1e-3, {0, 0}, rigid), "A");
  EXPECT_EQ(minima.Tag(2.0, 0.0, 1.0, 1e-3, {0, 0}, rigid), "D");
}

TEST(Comparison, CrossingsAreNotedOnce) {
  Crossings crossings({{false, 1e-1}, {false, 1e-2}, {true, 1e-3}}, 2.0);
  std::vector<Event> events;
  // Relative bounds 1 and 0.1 at a mean force of 10, absolute 2e-3.
  EXPECT_FALSE(crossings.Due(5.0, 10.0));
  EXPECT_TRUE(crossings.Due(1.0, 10.0));
  crossings.Note({}, 1.0, 10.0, {}, 0.0, &events);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].level.value, 1e-1);
  EXPECT_FALSE(crossings.Due(0.5, 10.0));
  crossings.Note({}, 1e-3, 10.0, {}, 0.0, &events);
  ASSERT_EQ(events.size(), 3u);
  EXPECT_FALSE(crossings.Due(0.0, 10.0));
}

TEST(Comparison, ThinnedTraceKeepsEndsAndExtremes) {
  std::vector<double> residuals;
  for (int i = 0; i < 10000; ++i) residuals.push_back(1.0 / (1 + i));
  residuals[4321] = 1e-9;
  residuals[7000] = 50.0;
  const std::vector<int> kept = ThinTrace(residuals, 95);
  EXPECT_LE(kept.size(), 400u);
  EXPECT_EQ(kept.front(), 0);
  EXPECT_EQ(kept.back(), 9999);
  EXPECT_NE(std::find(kept.begin(), kept.end(), 4321), kept.end());
  EXPECT_NE(std::find(kept.begin(), kept.end(), 7000), kept.end());
  EXPECT_EQ(ThinTrace({1.0}, 95), std::vector<int>{0});
  EXPECT_TRUE(ThinTrace({}, 95).empty());
}

TEST(Comparison, MinimaAreToldApartByEnergyAndDisplacement) {
  Minima minima;
  const std::vector<bool> rigid = {false, false, true};
  const auto tag = [&](double energy,
                       const std::vector<double>& u,
                       double residual = 1e-10,
                       double vanishing = 1e-3) {
    return minima.Tag(energy, residual, vanishing, 1e-3, u, rigid);
  };
  EXPECT_EQ(tag(1.0, {0, 0, 0, 0, 0, 0}), "A");
  // A translation, and a rattler anywhere.
  EXPECT_EQ(tag(1.0 + 1e-8, {.1, .2, .1, .2, 5, 5}), "A");
  // Elsewhere at the same energy; the same place cannot be at another one.
  EXPECT_EQ(tag(1.0, {1e-2, 0, 0, 0, 0, 0}), "B");
  EXPECT_EQ(tag(1.1, {0, 0, 0, 0, 0, 0}), "C");
  EXPECT_EQ(tag(1.0, {0, 0, 0, 0, 0, 0}), "A");
  EXPECT_EQ(tag(1.0, {0, 0, 0, 0, 0, 0}, 1e-2), "-");
  EXPECT_EQ(tag(0.0, {0, 0, 0, 0, 0, 0}, 0.0), "0");
  EXPECT_EQ(tag(1e-30, {0, 0, 0, 0, 0, 0}, 1.0, 1e-13), "0");
}

// Two methods, one case, three repetitions; the second method fails once at the
// tight level.
class HandMade : public testing::Test {
 protected:
  HandMade() {
    setup_.what = "hand-made";
    setup_.cases = {{"growth=5e-5", "growth", 5e-5, 0.0}};
    setup_.methods = {{"L-BFGS", "a:b=1,c=2"}, {"FR-CG", "d"}};
    setup_.seeds = {1};
    setup_.repetitions = 3;
    setup_.levels = {{false, 1e-10}, {false, 1e-5}};
    setup_.baseline = "L-BFGS";
    for (int r = 1; r <= 3; ++r) {
      Add("L-BFGS", r, 100, 1.0 * r, true);
      Add("FR-CG", r, 300, 4.0 * r, r < 3);
    }
  }

  void Add(const std::string& label,
           int repetition,
           std::int64_t iterations,
           double seconds,
           bool converged) {
    RunRecord run;
    run.key = {"growth=5e-5", 1, repetition, label, "spec, \"quoted\""};
    run.converged = converged;
    run.stop_reason = converged ? "CONVERGED" : "NO_PROGRESS";
    run.message = converged ? "fine" : "gave up, \"really\"";
    run.minimum = label == "L-BFGS" ? "A" : "B";
    run.energy = 0.1;
    run.quad_residual = converged ? 1e-11 : 1e-7;
    run.work.iterations = iterations;
    run.work.evaluations = iterations + 1;
    run.work.cpu_seconds = seconds;
    run.work.function_share = 0.25;
    run.work.linear_share = 0.5;
    runs_.push_back(run);
    Event event{run.key, {false, 1e-5}, run.work, 0.1};
    event.work.iterations /= 2;
    event.work.cpu_seconds /= 2;
    events_.push_back(event);
    if (converged) events_.push_back({run.key, {false, 1e-10}, run.work, 0.1});
  }

  ComparisonSetup setup_;
  std::vector<Event> events_;
  std::vector<RunRecord> runs_;
};

TEST_F(HandMade, MediansQuantilesAndRatios) {
  const std::vector<Table> tables = Tabulate(setup_, events_, runs_);
  ASSERT_EQ(tables.size(), 2u);
  const TableRow& base = tables[0].rows[0];
  EXPECT_EQ(base.runs, 3);
  EXPECT_EQ(base.reached, 3);
  EXPECT_EQ(base.iterations.median, 100);
  EXPECT_DOUBLE_EQ(base.cpu_seconds.low, 1.4);
  EXPECT_DOUBLE_EQ(base.cpu_seconds.median, 2.0);
  EXPECT_DOUBLE_EQ(base.cpu_seconds.high, 2.6);
  EXPECT_EQ(base.ratio.median, 1.0);
  const TableRow& other = tables[0].rows[1];
  EXPECT_EQ(other.reached, 2);
  EXPECT_DOUBLE_EQ(other.cpu_seconds.median, 8.0);
  EXPECT_TRUE(std::isinf(other.cpu_seconds.high));
  EXPECT_DOUBLE_EQ(other.ratio.low, 4.0);
  EXPECT_DOUBLE_EQ(other.ratio.median, 4.0);
  EXPECT_EQ(other.end, "NO_PROGRESS 1, converged 2");
  EXPECT_EQ(other.minima, "B");
  EXPECT_EQ(other.residual, 1e-7);
  const TableRow& loose = tables[1].rows[1];
  EXPECT_EQ(loose.reached, 3);
  EXPECT_EQ(loose.iterations.median, 150);
  EXPECT_DOUBLE_EQ(loose.cpu_seconds.high, 5.2);
  EXPECT_EQ(loose.function_share, 0.25);
  EXPECT_EQ(loose.paper, nullptr);
}

TEST_F(HandMade, ThePaperStandsBesideItsOwnLabels) {
  setup_.paper = "table1";
  const std::vector<Table> tables = Tabulate(setup_, events_, runs_);
  ASSERT_NE(tables[0].rows[0].paper, nullptr);
  EXPECT_EQ(tables[0].rows[0].paper->iterations, 2003);
  EXPECT_EQ(tables[0].rows[1].paper->seconds, 58.9);
  EXPECT_EQ(PaperTable1("random", "P-L-BFGS (A = 3)")->iterations, 432);
  EXPECT_EQ(PaperTable1("start", "L-BFGS"), nullptr);
}

TEST_F(HandMade, FailuresAreSaid) {
  const std::vector<Table> tables = Tabulate(setup_, events_, runs_);
  for (const bool markdown : {false, true}) {
    const std::string text = TablesText(setup_, tables, runs_, markdown);
    EXPECT_NE(text.find("(2 of 3 got there)"), std::string::npos) << text;
    EXPECT_NE(text.find("! FR-CG: NO_PROGRESS, gave up, \"really\" (repetition "
                        "3)"),
              std::string::npos)
        << text;
    EXPECT_NE(text.find("seed 1: minimum A with E = 0.1 (L-BFGS); minimum B "
                        "with E = 0.1 (FR-CG)"),
              std::string::npos)
        << text;
  }
}

TEST_F(HandMade, VanishedRunsHaveReachedEveryLevel) {
  for (RunRecord& run : runs_) run.stop_reason = "VANISHED";
  const std::vector<Table> tables = Tabulate(setup_, {}, runs_);
  EXPECT_EQ(tables[0].rows[1].reached, 3);
  EXPECT_EQ(tables[0].rows[1].iterations.median, 300);
}

TEST_F(HandMade, UnequalCountsAreSaid) {
  runs_[0].work.evaluations += 1;
  const std::string text =
      TablesText(setup_, Tabulate(setup_, events_, runs_), runs_, false);
  EXPECT_NE(text.find("! L-BFGS: counts differ"), std::string::npos) << text;
}

// Three steps of two seeds; the last step of seed 2 rearranges. "good" costs
// 10 x step iterations with repetitions of different times, "bad" never gets
// there in the first steps and ends elsewhere in the one that rearranges.
class Steps : public testing::Test {
 protected:
  static constexpr char kCase[] = "near_jamming=0.3x at 1e-4";

  Steps() {
    setup_.cases = {{kCase, "near_jamming", 0.3, 1e-4, true}};
    setup_.methods = {{"good", "g"}, {"bad", "b"}};
    setup_.seeds = {1, 2};
    setup_.repetitions = 3;
    setup_.steps = 3;
    setup_.levels = {{false, 1e-7}};
    setup_.baseline = "good";
    for (int seed = 1; seed <= 2; ++seed) {
      for (int step = 1; step <= 3; ++step) {
        const bool rearranges = seed == 2 && step == 3;
        StepRecord record;
        record.case_id = kCase;
        record.seed = seed;
        record.step = step;
        record.strain = 3e-5;
        record.kind = rearranges ? kRearranging : kNonRearranging;
        record.energy = 1.0;
        record.minimum = "A";
        steps_.push_back(record);
        for (int r = 1; r <= 3; ++r) {
          // The second repetition is the slow one.
          const double seconds = step * (r == 2 ? 9.0 : 1.0);
          Add("good", seed, step, r, 10 * step, seconds, true, "A", 1.0);
          Add("bad",
              seed,
              step,
              r,
              100,
              5.0,
              step > 1,
              rearranges  ? "B"
              : step == 1 ? "-"
                          : "A",
              rearranges ? 0.5 : 1.0 + 1e-12);
        }
      }
    }
  }

  void Add(const std::string& label,
           int seed,
           int step,
           int repetition,
           std::int64_t iterations,
           double seconds,
           bool reached,
           const std::string& minimum,
           double energy) {
    RunRecord run;
    run.key = {kCase,
               static_cast<std::uint64_t>(seed),
               repetition,
               label,
               "spec",
               step};
    run.converged = reached;
    run.stop_reason = reached ? "CONVERGED" : "MAX_EVALUATIONS";
    run.minimum = minimum;
    run.energy = energy;
    run.distance = 1e-4;
    run.work.iterations = iterations;
    run.work.cpu_seconds = seconds;
    runs_.push_back(run);
    if (reached) events_.push_back({run.key, {false, 1e-7}, run.work, energy});
  }

  ComparisonSetup setup_;
  std::vector<Event> events_;
  std::vector<RunRecord> runs_;
  std::vector<StepRecord> steps_;
};

TEST_F(Steps, MedianWorstAndFailures) {
  const std::vector<StepTable> tables =
      TabulateSteps(setup_, events_, runs_, steps_);
  ASSERT_EQ(tables.size(), 2u);
  EXPECT_EQ(tables[0].kind, kNonRearranging);
  EXPECT_EQ(tables[0].steps, 5);
  EXPECT_EQ(tables[1].kind, "all");
  EXPECT_EQ(tables[1].steps, 6);
  EXPECT_EQ(tables[1].distance, 1e-4);
  // Steps 1 1 2 2 3, and 1 1 2 2 3 3; times are medians of repetitions.
  const StepRow& plain = tables[0].rows[0];
  EXPECT_EQ(plain.steps, 5);
  EXPECT_EQ(plain.failed, 0);
  EXPECT_EQ(plain.iterations.median, 20.0);
  EXPECT_EQ(plain.iterations.worst, 30.0);
  EXPECT_EQ(plain.cpu_seconds.median, 2.0);
  EXPECT_EQ(plain.cpu_seconds.worst, 3.0);
  EXPECT_EQ(plain.same, 5);
  EXPECT_EQ(plain.judged, 5);
  EXPECT_EQ(plain.difference, 0.0);
  // Two of five, two of six failed.
  const StepRow& bad = tables[0].rows[1];
  EXPECT_EQ(bad.failed, 2);
  EXPECT_EQ(bad.iterations.median, 100.0);
  EXPECT_TRUE(std::isinf(bad.iterations.worst));
  EXPECT_EQ(bad.spent_iterations.worst, 100.0);
  EXPECT_EQ(bad.judged, 3);
  EXPECT_EQ(bad.same, 3);
  EXPECT_EQ(bad.lower + bad.higher, 0);
  const StepRow& all = tables[1].rows[1];
  EXPECT_EQ(all.failed, 2);
  EXPECT_EQ(all.judged, 4);
  EXPECT_EQ(all.same, 3);
  EXPECT_EQ(all.lower, 1);
  EXPECT_EQ(all.higher, 0);
  EXPECT_DOUBLE_EQ(all.difference, -0.5);
  // A step that fails in one repetition has failed.
  runs_[0].stop_reason = "MAX_SECONDS";
  events_.erase(events_.begin());
  EXPECT_EQ(TabulateSteps(setup_, events_, runs_, steps_)[0].rows[0].failed, 1);
  // Without knowledge of the steps, over all of them; half of a comparison.
  runs_.resize(6);
  const std::vector<StepTable> unknown =
      TabulateSteps(setup_, events_, runs_, {});
  ASSERT_EQ(unknown.size(), 1u);
  EXPECT_EQ(unknown[0].kind, "all");
  EXPECT_EQ(unknown[0].steps, 1);
  EXPECT_EQ(unknown[0].rows[0].judged, 0);
  EXPECT_TRUE(std::isnan(unknown[0].rows[0].difference));
}

TEST_F(Steps, TheReferenceMayBeAMethod) {
  EXPECT_TRUE(TabulateBasins(setup_, runs_, steps_).empty());
  setup_.reference = "bad";
  const std::vector<StepTable> tables =
      TabulateSteps(setup_, events_, runs_, steps_);
  EXPECT_EQ(tables[1].rows[0].judged, 4);
  EXPECT_EQ(tables[1].rows[0].same, 3);
  EXPECT_EQ(tables[1].rows[0].higher, 1);
  std::vector<BasinRow> rows = TabulateBasins(setup_, runs_, steps_);
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_EQ(rows[0].kind, "all");
  EXPECT_EQ(rows[0].differ, 1);
  EXPECT_EQ(rows[0].judged, 4);
  EXPECT_EQ(rows[0].unknown, 2);
  EXPECT_EQ(rows[1].kind, kNonRearranging);
  EXPECT_EQ(rows[1].differ, 0);
  EXPECT_EQ(rows[1].judged, 3);
  EXPECT_EQ(rows[2].kind, kRearranging);
  EXPECT_EQ(rows[2].differ, 1);
  EXPECT_EQ(rows[2].judged, 1);
  setup_.reference = "good";
  rows = TabulateBasins(setup_, runs_, steps_);
  EXPECT_EQ(rows[0].judged, 4);
  EXPECT_EQ(rows[0].nowhere, 2);
  EXPECT_EQ(rows[0].unknown, 0);
  const std::string text = BasinsText(setup_, rows, false);
  EXPECT_NE(text.find("1 of 4 (5-70 %)"), std::string::npos) << text;
}

TEST_F(Steps, FilesAreReadBackAsTheyWere) {
  steps_[0].apart = kInfinity;
  std::string error;
  std::vector<StepRecord> steps;
  ASSERT_TRUE(ParseSteps(StepsCsv(steps_), "s", &steps, &error)) << error;
  EXPECT_EQ(StepsCsv(steps), StepsCsv(steps_));
  std::string broken = StepsCsv(steps_);
  broken.replace(broken.find("non-re"), 3, "");
  broken.replace(broken.find("rearr"), 5, "Rearr");
  EXPECT_FALSE(ParseSteps(broken, "s.csv", &steps, &error));
  EXPECT_EQ(error.substr(0, 8), "s.csv:2:");
  std::vector<RunRecord> runs;
  ASSERT_TRUE(ParseRuns(RunsCsv(runs_), "r", &runs, &error)) << error;
  EXPECT_EQ(runs.back().key.step, 3);
  ComparisonSetup setup;
  setup_.reference = "bad";
  setup_.conditions = "prepared by good";
  ASSERT_TRUE(ParseSetup(FormatSetup(setup_), "s", &setup, &error)) << error;
  EXPECT_EQ(FormatSetup(setup), FormatSetup(setup_));
  EXPECT_TRUE(setup.cases[0].relative);
  EXPECT_EQ(setup.steps, 3);
}

TEST_F(HandMade, FilesOfEarlierComparisonsHaveNoSteps) {
  std::string text = RunsCsv(runs_), error;
  text.replace(text.find(",step,"), 6, ",other,");
  std::vector<RunRecord> runs;
  ASSERT_TRUE(ParseRuns(text, "r", &runs, &error)) << error;
  EXPECT_EQ(runs[0].key.step, 1);
}

TEST_F(HandMade, FilesAreReadBackAsTheyWere) {
  std::string error;
  std::vector<Event> events;
  ASSERT_TRUE(ParseEvents(EventsCsv(events_), "e", &events, &error)) << error;
  EXPECT_EQ(EventsCsv(events), EventsCsv(events_));
  EXPECT_EQ(events[0].key.spec, "spec, \"quoted\"");
  std::vector<RunRecord> runs;
  ASSERT_TRUE(ParseRuns(RunsCsv(runs_), "r", &runs, &error)) << error;
  EXPECT_EQ(RunsCsv(runs), RunsCsv(runs_));
  EXPECT_EQ(runs[5].message, "gave up, \"really\"");
  setup_.assumptions = {{"a", "b"}};
  ComparisonSetup setup;
  ASSERT_TRUE(ParseSetup(FormatSetup(setup_), "s", &setup, &error)) << error;
  EXPECT_EQ(FormatSetup(setup), FormatSetup(setup_));

  EXPECT_FALSE(ParseEvents("", "e", &events, &error));
  EXPECT_FALSE(ParseEvents("case,seed\nx,1\n", "e.csv", &events, &error));
  EXPECT_EQ(error, "e.csv:1: no column repetition");
  std::string broken = EventsCsv(events_);
  broken.replace(broken.find("relative"), 8, "relation");
  EXPECT_FALSE(ParseEvents(broken, "e.csv", &events, &error));
  EXPECT_EQ(error.substr(0, 8), "e.csv:2:");
  EXPECT_FALSE(ParseSetup("{}", "setup.json", &setup, &error));
  EXPECT_FALSE(ParseSetup("not json", "setup.json", &setup, &error));
}

}  // namespace
}  // namespace granopt
