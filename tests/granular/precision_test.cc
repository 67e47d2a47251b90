// The energy in single precision: how far it is from double, and how methods
// end with it.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "granular/quad_residual.h"
#include "granular/relaxation.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kSingle = std::numeric_limits<float>::epsilon();

ContactEnergyOptions With(Precision precision, double alpha) {
  ContactEnergyOptions options;
  options.precision = precision;
  options.alpha = alpha;
  return options;
}

// The largest difference of two gradients in mean contact forces / eps32.
double ForceError(const Evaluation& a, const Evaluation& b) {
  double most = 0.0;
  for (std::size_t v = 0; v < a.gradient.size(); ++v) {
    most = std::max(most, std::abs(a.gradient[v] - b.gradient[v]));
  }
  return most / (kSingle * b.scales.gradient);
}

// At a start, and `overlaps` mean overlaps away from it.
void ExpectNearDouble(const Packing& packing, double alpha, double bound) {
  const auto exact = MakeEnergy(packing, With(Precision::DOUBLE, alpha));
  const auto single = MakeEnergy(packing, With(Precision::FLOAT, alpha));
  const double length =
      Evaluate(*exact).scales.length * std::max(1.0, alpha - 1.0);
  for (const double overlaps : {0.0, 1.0}) {
    std::vector<double> u(exact->NumParameters());
    for (std::size_t v = 0; v < u.size(); ++v) {
      u[v] = overlaps * length * std::sin(1.0 + 7.0 * v);
    }
    const Evaluation a = Evaluate(*single, u), b = Evaluate(*exact, u);
    EXPECT_EQ(a.scales.epsilon, kSingle);
    EXPECT_EQ(b.scales.epsilon, kEps);
    EXPECT_NEAR(a.energy, b.energy, 4.0 * alpha * kSingle * b.energy);
    EXPECT_NEAR(a.scales.gradient,
                b.scales.gradient,
                4.0 * alpha * kSingle * b.scales.gradient);
    EXPECT_LE(ForceError(a, b), bound);
    // Not double in disguise.
    EXPECT_GT(ForceError(a, b), 0.01);
  }
}

TEST(Precision, SingleForcesAreWithinAFewRoundingErrors) {
  for (const double alpha : {2.0, 2.5, 3.3}) {
    for (const int d : {2, 3}) {
      SCOPED_TRACE(testing::Message() << d << "D, alpha " << alpha);
      // Some of these overlaps are ten times the mean.
      ExpectNearDouble(RandomPacking(d, 200, 0.95, 3), alpha, 50.0 * alpha);
    }
  }
}

TEST(Precision, SingleForcesKeepTheirDigitsNearJamming) {
  for (const double alpha : {2.0, 2.5, 3.3, 10.0}) {
    SCOPED_TRACE(testing::Message() << "alpha " << alpha);
    // Overlaps of 1e-8 radii: plain coordinates would have no digit.
    // At alpha = 10 the largest force is dozens of mean ones.
    ExpectNearDouble(ReadData("n1024_a2_p1e-08.xyz"),
                     alpha,
                     alpha == 10.0 ? 2000.0 : 12.0 * alpha);
  }
}

// Squares of lengths, of overlaps or of k would leave the range of float.
TEST(Precision, PowersOfTwoScaleBitForBit) {
  const Packing packing = RandomPacking(2, 60, 0.9, 5);
  const Evaluation unit =
      Evaluate(*MakeEnergy(packing, With(Precision::FLOAT, 2.0)));
  for (const int a : {-200, 0, 200}) {
    for (const int b : {-120, 1, 120}) {
      const Packing other = WithLengths(b, packing);
      ContactEnergyOptions options = With(Precision::FLOAT, 2.0);
      options.stiffness = std::ldexp(1.0, a);
      const Evaluation e = Evaluate(*MakeEnergy(other, options));
      EXPECT_EQ(e.energy, std::ldexp(unit.energy, a + 2 * b));
      for (std::size_t v = 0; v < e.gradient.size(); ++v) {
        EXPECT_EQ(e.gradient[v], std::ldexp(unit.gradient[v], a + b));
      }
    }
  }
}

TEST(Precision, CoincidentCentresHaveEnergyButNoForce) {
  Eigen::MatrixXd x(2, 2);
  x << 4.0, 4.0, 5.0, 5.0;
  const Packing packing = MakePacking(Box::Cube(2, 16.0), x, {0.5, 0.75});
  const auto energy = MakeEnergy(packing, With(Precision::FLOAT, 2.0));
  const Evaluation e = Evaluate(*energy);
  EXPECT_FLOAT_EQ(static_cast<float>(e.energy), 0.5f * 1.25f * 1.25f);
  for (const double g : e.gradient) EXPECT_EQ(g, 0.0);
  // A hair apart.
  for (const double apart : {1e-8, 1e-15, 1e-20, 1e-24, 1e-30, 1e-200}) {
    const Evaluation near = Evaluate(*energy, {apart, 0.0, 0.0, 0.0});
    EXPECT_NEAR(near.energy, e.energy, 1e-6 * e.energy) << apart;
    for (const double g : near.gradient) EXPECT_TRUE(std::isfinite(g)) << apart;
  }
}

TEST(Precision, RefineIsForMixedAndForGood) {
  const Packing packing = RandomPacking(2, 60, 0.9, 5);
  for (const Precision precision :
       {Precision::DOUBLE, Precision::MIXED, Precision::FLOAT}) {
    SCOPED_TRACE(PrecisionName(precision));
    const bool is_mixed = precision == Precision::MIXED;
    const auto energy = MakeEnergy(packing, With(precision, 2.0));
    EXPECT_EQ(Evaluate(*energy).scales.refine_below > 0.0, is_mixed);
    EXPECT_EQ(energy->Refine(), is_mixed);
    EXPECT_FALSE(energy->Refine());
    const Evaluation now = Evaluate(*energy);
    EXPECT_EQ(now.scales.refine_below, 0.0);
    EXPECT_EQ(now.scales.epsilon,
              precision == Precision::FLOAT ? kSingle : kEps);
    if (is_mixed) {
      const Evaluation exact =
          Evaluate(*MakeEnergy(packing, With(Precision::DOUBLE, 2.0)));
      EXPECT_EQ(now.energy, exact.energy);
      EXPECT_EQ(now.gradient, exact.gradient);
    }
  }
}

Relaxation RelaxWith(const std::string& method,
                     const Packing& start,
                     const ContactEnergyOptions& options,
                     double tolerance) {
  std::string error;
  const auto solver = CreateSolver(method, &error);
  EXPECT_NE(solver, nullptr) << error;
  SolveOptions solve;
  solve.relative_tolerance = tolerance;
  solve.max_evaluations = 200000;
  Relaxation result;
  EXPECT_TRUE(Relax(start, options, *solver, solve, &result, &error)) << error;
  return result;
}

double JudgedResidual(const Packing& packing, ContactEnergyOptions options) {
  QuadResidual judge;
  std::string error;
  EXPECT_TRUE(EvaluateQuad(packing, options, nullptr, &judge, &error)) << error;
  return judge.Relative();
}

class PrecisionMethods : public testing::TestWithParam<const char*> {};

TEST_P(PrecisionMethods, MixedReachesWhatDoubleReaches) {
  for (const double alpha : {2.0, 2.5}) {
    SCOPED_TRACE(alpha);
    const ContactEnergyOptions mixed = With(Precision::MIXED, alpha);
    const Packing start = RandomPacking(2, 128, 0.9, 7);
    const Relaxation result = RelaxWith(GetParam(), start, mixed, 1e-12);
    EXPECT_EQ(result.summary.reason, StopReason::CONVERGED)
        << result.summary.BriefReport();
    EXPECT_GE(result.summary.counters.rebases, 1);
    EXPECT_LE(JudgedResidual(result.packing, mixed), 1.01e-12);
  }
}

TEST_P(PrecisionMethods, MixedWorksNearJamming) {
  const ContactEnergyOptions mixed = With(Precision::MIXED, 2.0);
  Packing start = ReadData("n1024_a2_p1e-08.xyz");
  start.Perturb(1e-9, 7);
  const Relaxation result = RelaxWith(GetParam(), start, mixed, 1e-10);
  EXPECT_EQ(result.summary.reason, StopReason::CONVERGED)
      << result.summary.BriefReport();
  EXPECT_LE(JudgedResidual(result.packing, mixed), 1.01e-10);
}

// The residual of the summary is that of double, and what was out of reach is
// not called converged.
TEST_P(PrecisionMethods, FloatSaysHowFarItCame) {
  const ContactEnergyOptions single = With(Precision::FLOAT, 2.0);
  const Packing start = RandomPacking(2, 128, 0.9, 7);
  const Relaxation loose = RelaxWith(GetParam(), start, single, 1e-5);
  EXPECT_EQ(loose.summary.reason, StopReason::CONVERGED)
      << loose.summary.BriefReport();
  const Relaxation tight = RelaxWith(GetParam(), start, single, 1e-12);
  EXPECT_EQ(tight.summary.reason, StopReason::NO_PROGRESS)
      << tight.summary.BriefReport();
  EXPECT_NE(tight.summary.message.find("--precision=mixed"), std::string::npos)
      << tight.summary.message;
  for (const Relaxation& r : {loose, tight}) {
    const double residual = r.summary.max_gradient / r.summary.scales.gradient;
    EXPECT_NEAR(residual, JudgedResidual(r.packing, single), 1e-13);
    EXPECT_LE(residual, 1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(Methods,
                         PrecisionMethods,
                         testing::Values("lbfgs",
                                         "ncg",
                                         "fire",
                                         "heavy_ball",
                                         "newton",
                                         "ceres_lbfgs:scaled=1,differences=1,"
                                         "restarts=10"));

}  // namespace
}  // namespace granopt
