#include "granular/damped_motion.h"

#include <cmath>
#include <memory>
#include <string>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// Two equal discs, overlapping by delta: a damped oscillator of the reduced
// mass m / 2 and stiffness k, whose contact opens (it cannot pull).
TEST(DampedMotion, TwoDiscsAreAnOscillator) {
  Eigen::MatrixXd x(2, 2);
  x << 0.4, 0.6 - 1e-4, 0.5, 0.5;
  const Packing packing = MakePacking(Box::Cube(2, 1.0), x, {0.1, 0.1});
  DampedMotionOptions options;
  // Overdamped: the overlap decays as a sum of two exponentials and the discs
  // do not part; after so many steps
  options.damping = 4.0;
  options.time_step = 0.02;
  options.tolerance = 0.0;
  options.vanishing_tolerance = 0.0;
  options.max_steps = 500;
  Relaxation result;
  std::string error;
  ASSERT_TRUE(RelaxByDampedMotion(packing, options, &result, &error)) << error;
  EXPECT_EQ(result.summary.counters.iterations, 500);
  EXPECT_EQ(result.summary.counters.evaluations, 501);
  // delta'' = -2 delta - 4 delta', from rest.
  const double t = 500 * 0.02;
  const double a = -2.0 + std::sqrt(2.0), b = -2.0 - std::sqrt(2.0);
  const double exact =
      1e-4 * (a * std::exp(b * t) - b * std::exp(a * t)) / (a - b);
  ASSERT_EQ(result.contacts.size(), 1u);
  EXPECT_NEAR(result.contacts[0].overlap, exact, 6e-3 * exact);
}

// Halving the time step quarters the error: Verlet is of second order.
TEST(DampedMotion, IsOfSecondOrder) {
  Eigen::MatrixXd x(2, 2);
  x << 0.4, 0.6 - 1e-4, 0.5, 0.5;
  const Packing packing = MakePacking(Box::Cube(2, 1.0), x, {0.1, 0.1});
  std::vector<double> errors;
  for (const int steps : {20, 40, 80}) {
    DampedMotionOptions options;
    options.damping = 3.0;
    options.time_step = 1.0 / steps;
    options.tolerance = options.vanishing_tolerance = 0.0;
    options.max_steps = steps;
    Relaxation result;
    std::string error;
    ASSERT_TRUE(RelaxByDampedMotion(packing, options, &result, &error));
    ASSERT_EQ(result.contacts.size(), 1u);
    // delta'' = -2 delta - 3 delta': rates 1 and 2.
    const double exact = 1e-4 * (2.0 * std::exp(-1.0) - std::exp(-2.0));
    errors.push_back(std::abs(result.contacts[0].overlap - exact));
  }
  EXPECT_NEAR(errors[0] / errors[1], 4.0, 0.3);
  EXPECT_NEAR(errors[1] / errors[2], 4.0, 0.2);
}

// Masses are areas or volumes, every velocity decays alike, and the unit of
// time is that of the mean mass on the stiffest contact: the relative motion is
// an oscillator of the reduced mass, and the centre of mass stays.
TEST(DampedMotion, UnequalGrainsHaveTheirMassesAndStiffnesses) {
  for (const int d : {2, 3}) {
    SCOPED_TRACE(d);
    Eigen::MatrixXd x = Eigen::MatrixXd::Constant(d, 2, 0.5);
    x(0, 0) = 0.3;
    x(0, 1) = 0.6 - 1e-4;
    Packing packing = MakePacking(Box::Cube(d, 1.0), x, {0.1, 0.2});
    packing.stiffness.resize(2);
    packing.stiffness << 1.0, 2.0;
    DampedMotionOptions options;
    options.energy.stiffness = 3.0;
    options.damping = 5.0;
    options.time_step = 0.002;
    options.tolerance = options.vanishing_tolerance = 0.0;
    options.max_steps = 500;
    Relaxation result;
    std::string error;
    ASSERT_TRUE(RelaxByDampedMotion(packing, options, &result, &error));
    // In units of m / (3 * 2): delta'' = -w2 delta - 5 delta' from rest with
    // k_01 = 3 * (1 + 2) / 2.
    const double m0 = 1.0, m1 = std::pow(2.0, d);
    const double w2 = 4.5 / 6.0 * 0.5 * (m0 + m1) * (1.0 / m0 + 1.0 / m1);
    const double root = std::sqrt(6.25 - w2);
    const double a = -2.5 + root, b = -2.5 - root;
    const double exact = 1e-4 * (a * std::exp(b) - b * std::exp(a)) / (a - b);
    ASSERT_EQ(result.contacts.size(), 1u);
    EXPECT_NEAR(result.contacts[0].overlap, exact, 2e-5 * exact);
    const auto moved = [&](int i) {
      return (result.packing.Position(i, 0) - packing.Position(i, 0)).Value();
    };
    EXPECT_LT(moved(0), -1e-6);
    EXPECT_NEAR(m0 * moved(0), -m1 * moved(1), 1e-12 * moved(1));
  }
}

// Remark 1.1 for a small load: the same state as by minimization.
TEST(DampedMotion, ComesToRestWhereAMinimizerDoes) {
  Packing packing = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  packing.Deform(PureShear(2, 1e-7));
  DampedMotionOptions options;
  options.tolerance = 1e-9;
  Relaxation motion, minimum;
  std::string error;
  ASSERT_TRUE(RelaxByDampedMotion(packing, options, &motion, &error)) << error;
  EXPECT_EQ(motion.summary.reason, StopReason::CONVERGED)
      << motion.summary.message;
  SolveOptions solve;
  solve.relative_tolerance = 1e-9;
  ASSERT_TRUE(Relax(packing,
                    options.energy,
                    *CreateSolver("newton", &error),
                    solve,
                    &minimum,
                    &error));
  const Observables& a = motion.observables;
  const Observables& b = minimum.observables;
  EXPECT_NEAR(a.energy, b.energy, 1e-8 * b.energy);
  EXPECT_LE((a.stress - b.stress).cwiseAbs().maxCoeff(), 1e-6 * b.pressure);
  EXPECT_LE((a.fabric - b.fabric).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_EQ(a.rigid_contacts, b.rigid_contacts);
}

TEST(DampedMotion, SaysWhyItEnds) {
  const Packing loose = RandomPacking(2, 16, 0.05, 3);
  DampedMotionOptions options;
  Relaxation result;
  std::string error;
  ASSERT_TRUE(RelaxByDampedMotion(loose, options, &result, &error));
  EXPECT_EQ(result.summary.reason, StopReason::VANISHED);
  options.max_steps = 3;
  ASSERT_TRUE(RelaxByDampedMotion(
      RandomPacking(2, 64, 0.9, 3), options, &result, &error));
  EXPECT_EQ(result.summary.reason, StopReason::MAX_ITERATIONS);
  // The last point where the energy is defined is what is left.
  options.time_step = 1e12;
  ASSERT_TRUE(RelaxByDampedMotion(
      RandomPacking(2, 64, 0.9, 3), options, &result, &error));
  EXPECT_EQ(result.summary.reason, StopReason::EVALUATION_FAILED);
  EXPECT_TRUE(result.packing.IsValid(&error)) << error;
  EXPECT_EQ(result.summary.counters.iterations, 1);
  options.time_step = 0.0;
  EXPECT_FALSE(RelaxByDampedMotion(loose, options, &result, &error));
  EXPECT_NE(error.find("time_step = 0"), std::string::npos) << error;
}

}  // namespace
}  // namespace granopt
