// When a run ends, and with which words.

#include "solvers/monitor.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

const Scales kUnits = {1.0, 1.0};

// Accepts a point of one variable; true if the run must stop.
bool Accept(Monitor* monitor, double x, double cost, double gradient) {
  return monitor->Accept(&x, cost, &gradient, kUnits);
}

StopReason ReasonOf(Monitor* monitor) {
  double x;
  return monitor->Finish(&x).reason;
}

// A point above the least cost seen is not returned, and so its gradient does
// not end the run.
TEST(Monitor, NothingConvergesAboveTheBestPoint) {
  Quadratic f(1);
  for (const double last : {0.9, 0.5}) {
    Monitor monitor(&f, SolveOptions(), "test");
    EXPECT_FALSE(Accept(&monitor, 0.0, 1.0, 1.0));
    EXPECT_FALSE(Accept(&monitor, 1.0, 0.5, 0.1));
    EXPECT_FALSE(Accept(&monitor, 2.0, 0.9, 1e-11));
    EXPECT_EQ(Accept(&monitor, 3.0, last, 1e-11), last == 0.5);
    double x;
    const Summary summary = monitor.Finish(&x);
    EXPECT_EQ(summary.Succeeded(), last == 0.5) << summary.message;
    EXPECT_EQ(summary.max_gradient, last == 0.5 ? 1e-11 : 0.1);
    EXPECT_EQ(x, last == 0.5 ? 3.0 : 1.0);
  }
}

// All of a message, however long.
TEST(Monitor, MessagesAreNotCut) {
  Quadratic f(1);
  Monitor monitor(&f, SolveOptions(), "test");
  Accept(&monitor, 0.0, 1.0, 1.0);
  monitor.GiveUp(std::string(2000, 'a') + "z");
  double x;
  EXPECT_TRUE(Contains(monitor.Finish(&x).BriefReport(), "az"));
}

// What the methods share keeps the best point, whatever comes after it.
TEST(Monitor, FinishGivesTheBestPoint) {
  Quadratic quadratic(2);
  SolveOptions options;
  Monitor monitor(
      &quadratic, options, "a method", Monitor::Cache::LAST_EVALUATION);
  const auto accept = [&](std::vector<double> x) {
    double cost;
    const double* gradient;
    Scales scales;
    EXPECT_TRUE(monitor.EvaluateCached(x.data(), &cost, &gradient, &scales));
    EXPECT_FALSE(monitor.Accept(x.data(), cost, gradient, scales));
  };
  const std::vector<double> best = {0.5, 0.5};
  accept({0.0, 0.0});
  accept(best);
  accept({8.0, 8.0});
  monitor.GiveUp("out of ideas");
  Result result = {{}, {8.0, 8.0}};
  result.summary = monitor.Finish(result.x.data());
  EXPECT_EQ(result.x, best);
  EXPECT_EQ(result.summary.reason, StopReason::NO_PROGRESS);
  EXPECT_EQ(result.summary.solver, "a method");
  EXPECT_EQ(result.summary.counters.iterations, 2);
  ExpectHonest(quadratic, result);
  ExpectBothNumbers(result.summary, "iterations", 2);
}

// Also where the origin has moved since.
TEST(Monitor, RebaseMovesTheBestPoint) {
  Quadratic quadratic(2);
  Offset offset(&quadratic, 4.0, /*can_rebase=*/true);
  SolveOptions options;
  Monitor monitor(
      &offset, options, "a method", Monitor::Cache::LAST_EVALUATION);
  std::vector<double> x = {4.5, 4.5};
  double cost;
  const double* gradient;
  Scales scales;
  ASSERT_TRUE(monitor.EvaluateCached(x.data(), &cost, &gradient, &scales));
  EXPECT_FALSE(monitor.Accept(x.data(), cost, gradient, scales));
  std::vector<double> elsewhere = {12.0, 20.0};
  EXPECT_TRUE(monitor.Rebase(elsewhere.data()));
  EXPECT_EQ(elsewhere, (std::vector<double>{0.0, 0.0}));
  Result result = {{}, elsewhere};
  result.summary = monitor.Finish(result.x.data());
  EXPECT_EQ(result.x, (std::vector<double>{-7.5, -15.5}));
  EXPECT_EQ(result.summary.counters.rebases, 1);
  ExpectHonest(offset, result);
}

// A budget that ran out on the way to a point that has converged.
TEST(Monitor, ConvergenceOutweighsABudget) {
  Quadratic f(1);
  SolveOptions options;
  options.max_evaluations = 2;
  for (const double gradient : {1e-11, 1e-3}) {
    Monitor monitor(&f, options, "test");
    const double start = 0.0;
    double cost, g;
    Scales scales;
    EXPECT_TRUE(monitor.Evaluate(&start, &cost, &g, &scales));
    EXPECT_FALSE(Accept(&monitor, 0.0, 1.0, 1.0));
    EXPECT_FALSE(monitor.BudgetSpent());
    EXPECT_TRUE(monitor.Evaluate(&start, &cost, &g, &scales));
    EXPECT_TRUE(monitor.BudgetSpent());
    EXPECT_TRUE(Accept(&monitor, 1.0, 0.5, gradient));
    EXPECT_EQ(
        ReasonOf(&monitor),
        gradient < 1e-10 ? StopReason::CONVERGED : StopReason::MAX_EVALUATIONS);
  }
}

// A function that does not get better: after 200 iterations where the gradient
// is its roundoff, after 10000 where it is not.
TEST(Monitor, PatienceHasAnEnd) {
  Quadratic f(1);
  SolveOptions options;
  options.relative_tolerance = 0.0;
  for (const double gradient : {1e-16, 1e-3}) {
    const int patience = gradient < 1e-14 ? 200 : 10000;
    Monitor monitor(&f, options, "test");
    EXPECT_FALSE(Accept(&monitor, 0.0, 1.0, 1.0));
    EXPECT_FALSE(Accept(&monitor, 0.0, 1.0, gradient));
    for (int k = 1; k < patience; ++k) {
      ASSERT_FALSE(Accept(&monitor, 0.0, 1.0, 2.0 * gradient)) << k;
    }
    EXPECT_TRUE(Accept(&monitor, 0.0, 1.0, 2.0 * gradient));
    double x;
    const Summary summary = monitor.Finish(&x);
    EXPECT_EQ(summary.reason, StopReason::NO_PROGRESS);
    EXPECT_TRUE(Contains(summary.message, std::to_string(patience)))
        << summary.message;
    EXPECT_TRUE(Contains(summary.message, "|g| = ")) << summary.message;
    EXPECT_EQ(summary.max_gradient, gradient);
  }
}

// One better point, and patience begins anew.
TEST(Monitor, PatienceBeginsAnewWithABetterPoint) {
  Quadratic f(1);
  SolveOptions options;
  options.relative_tolerance = 0.0;
  Monitor monitor(&f, options, "test");
  EXPECT_FALSE(Accept(&monitor, 0.0, 1.0, 4e-16));
  for (int k = 0; k < 10; ++k) {
    for (int i = 0; i < 150; ++i) {
      ASSERT_FALSE(Accept(&monitor, 0.0, 1.0, 5e-16));
    }
    ASSERT_FALSE(Accept(&monitor, 0.0, 1.0, 3e-16 - 1e-17 * k));
  }
}

// Far from the origin, gradients carry the rounding of x.
TEST(Monitor, RoundoffGrowsWithTheVariables) {
  Quadratic f(1);
  Monitor monitor(&f, SolveOptions(), "test");
  Accept(&monitor, 0.0, 1.0, 1.0);
  const double at_zero = monitor.Roundoff();
  EXPECT_NEAR(at_zero, 20.0 * 0x1p-52, 1e-18);
  Accept(&monitor, -1e6, 1.0, 1.0);
  EXPECT_NEAR(monitor.Roundoff(), 1e6 * at_zero, 1.01 * at_zero);
  // No scales, no roundoff that is known.
  const double x = 1.0, g = 1.0;
  monitor.Accept(&x, 1.0, &g, Scales());
  EXPECT_EQ(monitor.Roundoff(), 0.0);
}

// A new origin is wanted when rounding of x is a twentieth of a step; shorter
// steps want it sooner; and not for an evaluation that is not left.
TEST(Monitor, WantsANewOriginInTime) {
  Quadratic f(1);
  SolveOptions options;
  options.relative_tolerance = 0.0;
  options.max_evaluations = 2;
  Monitor monitor(&f, options, "test");
  const double eps = 0x1p-52;
  Accept(&monitor, 1.0, 1.0, 30.0 * eps);
  EXPECT_FALSE(monitor.WantsRebase());
  EXPECT_TRUE(monitor.WantsRebase(0.5));
  Accept(&monitor, 1.0, 1.0, 10.0 * eps);
  EXPECT_TRUE(monitor.WantsRebase());
  const double x = 0.0;
  double cost, g;
  Scales scales;
  monitor.Evaluate(&x, &cost, &g, &scales);
  EXPECT_TRUE(monitor.WantsRebase());
  monitor.Evaluate(&x, &cost, &g, &scales);
  EXPECT_FALSE(monitor.WantsRebase());
}

}  // namespace
}  // namespace granopt
