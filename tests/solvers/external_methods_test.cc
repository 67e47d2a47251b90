// First-order methods of other libraries behind our interface: whatever a
// library does inside, counts, stops and points are ours. Those that were not
// found when this was configured are skipped.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "Eigen/Core"
#include "gtest/gtest.h"
#include "solvers/solver.h"
#include "tests/solvers/external_specs.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

class ExternalMethods : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!IsRegistered(spec())) GTEST_SKIP() << "built without it";
  }
  const std::string& spec() const { return GetParam(); }
};

INSTANTIATE_TEST_SUITE_P(Ceres,
                         ExternalMethods,
                         testing::ValuesIn(CeresSpecs()),
                         TestName);
INSTANTIATE_TEST_SUITE_P(Competitors,
                         ExternalMethods,
                         testing::ValuesIn(CompetitorSpecs()),
                         TestName);

// ---- success ----------------------------------------------------------------

TEST_P(ExternalMethods, ConvexQuadratic) {
  Quadratic quadratic(50);
  const Result run = Minimize(
      spec(), &quadratic, std::vector<double>(50, 0.0), Tolerance(1e-6));
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  ExpectHonest(quadratic, run);
  // |x - s|_2 <= |g|_2 / lambda_min with lambda_min = 1.
  const Eigen::Map<const Eigen::VectorXd> x(run.x.data(), 50);
  EXPECT_LE((x - quadratic.solution()).norm(),
            std::sqrt(50.0) * run.summary.max_gradient);
  EXPECT_LT(run.summary.counters.iterations,
            Contains(spec(), "ceres") ? 1500 : 1000);
  EXPECT_EQ(run.summary.counters.restarts, 0);
  EXPECT_EQ(run.summary.counters.hessians, 0);
}

// In the units of the function, and instead of the relative test.
TEST_P(ExternalMethods, AbsoluteTolerance) {
  Quadratic quadratic(50);
  SolveOptions options = Tolerance(1e-300);
  options.absolute_tolerance = 0.125;
  const Result run =
      Minimize(spec(), &quadratic, std::vector<double>(50, 0.0), options);
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED);
  EXPECT_EQ(run.summary.tolerance, 0.125);
  EXPECT_LE(run.summary.max_gradient, 0.125);
  EXPECT_GT(run.summary.max_gradient, 1e-4);
  ExpectHonest(quadratic, run);
}

TEST_P(ExternalMethods, OneVariable) {
  Quadratic parabola(1);
  const Result run = Minimize(spec(), &parabola, {0.0}, Tolerance(1e-10));
  ExpectHonest(parabola, run);
  if (!IsReliable(spec())) return;
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_NEAR(run.x[0], parabola.solution()[0], 1e-9);
}

TEST_P(ExternalMethods, StartAtTheMinimum) {
  Rosenbrock rosenbrock;
  const Result run = Minimize(spec(), &rosenbrock, {1.0, 1.0});
  EXPECT_EQ(run.summary.reason, StopReason::VANISHED);
  EXPECT_EQ(run.summary.message, "cost = 0 exactly after 0 iterations");
  EXPECT_EQ(run.summary.counters.iterations, 0);
  EXPECT_EQ(run.summary.counters.evaluations, 1);
  EXPECT_EQ(run.x, (std::vector<double>{1.0, 1.0}));
  ExpectHonest(rosenbrock, run);
}

TEST_P(ExternalMethods, StartWithinTheTolerance) {
  Quadratic quadratic(50);
  std::vector<double> start(quadratic.solution().begin(),
                            quadratic.solution().end());
  start[7] += 1e-12;
  const Result run = Minimize(spec(), &quadratic, start);
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED);
  EXPECT_EQ(run.summary.counters.iterations, 0);
  EXPECT_TRUE(SameBits(run.x, start));
  ExpectHonest(quadratic, run);
}

TEST_P(ExternalMethods, ZeroAtTheStartHasVanished) {
  Nothing nothing;
  const std::vector<double> start = {0.5, -0.5, 3.0};
  const Result run = Minimize(spec(), &nothing, start);
  EXPECT_EQ(run.summary.reason, StopReason::VANISHED);
  EXPECT_EQ(run.summary.message, "cost = 0 exactly after 0 iterations");
  EXPECT_EQ(run.summary.cost, 0.0);
  EXPECT_EQ(run.summary.counters.evaluations, 1);
  EXPECT_TRUE(SameBits(run.x, start));
}

TEST_P(ExternalMethods, TwoRunsAreBitwiseEqual) {
  Rosenbrock rosenbrock;
  SolveOptions options = Tolerance(1e-8);
  options.record_trace = true;
  const Result a = Minimize(spec(), &rosenbrock, kRosenbrockStart, options);
  const Result b = Minimize(spec(), &rosenbrock, kRosenbrockStart, options);
  EXPECT_TRUE(SameBits(a.x, b.x));
  EXPECT_EQ(a.summary.message, b.summary.message);
  EXPECT_EQ(a.summary.counters.evaluations, b.summary.counters.evaluations);
  ASSERT_EQ(a.summary.trace.size(), b.summary.trace.size());
  for (std::size_t i = 0; i < a.summary.trace.size(); ++i) {
    EXPECT_TRUE(SameBits(a.summary.trace[i].cost, b.summary.trace[i].cost));
    EXPECT_TRUE(SameBits(a.summary.trace[i].max_gradient,
                         b.summary.trace[i].max_gradient));
  }
}

// 2^a f(2^20 x) is f in other units. With scaled=1 a method takes bitwise the
// same iterations.
TEST_P(ExternalMethods, ScaledIsIndependentOfUnits) {
  if (!Contains(spec(), "scaled=1")) return;
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  const Result a = Minimize(spec(), &quadratic, start, Tolerance(1e-6));
  EXPECT_EQ(a.summary.reason, StopReason::CONVERGED);
  for (const int exponent : {-60, 60}) {
    InOtherUnits other(&quadratic, exponent, 20);
    const Result b = Minimize(spec(), &other, start, Tolerance(1e-6));
    const double unit = std::exp2(exponent + 20);
    EXPECT_EQ(b.summary.reason, a.summary.reason);
    EXPECT_EQ(b.summary.counters.iterations, a.summary.counters.iterations);
    EXPECT_EQ(b.summary.counters.evaluations, a.summary.counters.evaluations);
    EXPECT_EQ(b.summary.max_gradient, unit * a.summary.max_gradient);
    EXPECT_EQ(b.summary.tolerance, unit * a.summary.tolerance);
    for (int i = 0; i < 50; ++i) EXPECT_EQ(b.x[i], 0x1p-20 * a.x[i]) << i;
  }
}

// ---- budgets and callbacks --------------------------------------------------

TEST_P(ExternalMethods, IterationsExhausted) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  for (const int budget : {0, 1, 7}) {
    SolveOptions options;
    options.max_iterations = budget;
    const Result run = Minimize(spec(), &quadratic, start, options);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_ITERATIONS);
    EXPECT_EQ(run.summary.counters.iterations, budget);
    if (budget == 0) {
      EXPECT_EQ(run.summary.counters.evaluations, 1);
    }
    ExpectBothNumbers(run.summary, "iterations", budget);
    ExpectHonest(quadratic, run);
    EXPECT_EQ(SameBits(run.x, start), budget == 0);
    EXPECT_EQ(run.summary.cost<run.summary.initial_cost, budget> 0);
  }
}

// Inside a line search, too.
TEST_P(ExternalMethods, EvaluationsExhausted) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  for (int budget = 1; budget <= 40; ++budget) {
    SCOPED_TRACE(budget);
    Spy spy(&quadratic);
    SolveOptions options;
    options.max_evaluations = budget;
    const Result run = Minimize(spec(), &spy, start, options);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_EVALUATIONS);
    EXPECT_EQ(spy.evaluations(), budget);
    EXPECT_EQ(run.summary.counters.evaluations, budget);
    EXPECT_EQ(run.summary.initial_cost, CostAt(quadratic, start));
    ExpectBothNumbers(run.summary, "evaluations", budget);
    ExpectHonest(quadratic, run);
    EXPECT_LE(run.summary.cost, run.summary.initial_cost);
    if (budget >= (Contains(spec(), "ceres") ? 20 : 30)) {
      EXPECT_LT(run.summary.cost, run.summary.initial_cost);
    }
  }
}

TEST_P(ExternalMethods, SecondsExhausted) {
  Quadratic quadratic(50);
  SolveOptions options;
  options.max_seconds = 0.0;
  const std::vector<double> start(50, 0.0);
  const Result run = Minimize(spec(), &quadratic, start, options);
  EXPECT_EQ(run.summary.reason, StopReason::MAX_SECONDS);
  EXPECT_TRUE(SameBits(run.x, start));
}

TEST_P(ExternalMethods, CallbackStops) {
  Quadratic quadratic(50);
  SolveOptions options;
  int calls = 0;
  options.callback = [&](const IterationState& state) {
    EXPECT_EQ(state.counters.iterations, calls);
    EXPECT_EQ(state.num_parameters, 50);
    const std::vector<double> x(state.x, state.x + 50);
    EXPECT_TRUE(SameBits(state.cost, CostAt(quadratic, x)));
    EXPECT_TRUE(SameBits(state.max_gradient, MaxGradientAt(quadratic, x)));
    double largest = 0.0;
    for (int i = 0; i < 50; ++i) {
      largest = std::max(largest, std::abs(state.gradient[i]));
    }
    EXPECT_EQ(largest, state.max_gradient);
    return ++calls < 4;
  };
  const Result run =
      Minimize(spec(), &quadratic, std::vector<double>(50, 0.0), options);
  EXPECT_EQ(calls, 4);
  EXPECT_EQ(run.summary.reason, StopReason::CALLBACK);
  EXPECT_EQ(run.summary.counters.iterations, 3);
  EXPECT_FALSE(run.summary.Succeeded());
  EXPECT_TRUE(Contains(run.summary.message, "stopped by the caller"));
  ExpectBothNumbers(run.summary, "iterations", 3);
  EXPECT_LT(run.summary.cost, run.summary.initial_cost);
  ExpectHonest(quadratic, run);
}

// ---- failure ----------------------------------------------------------------

TEST_P(ExternalMethods, NanAtTheStart) {
  Quadratic quadratic(50);
  Spy spy(&quadratic, [](int, double*, double* gradient) {
    if (gradient != nullptr) gradient[17] = kNan;
    return true;
  });
  const std::vector<double> start(50, 0.25);
  const Result run = Minimize(spec(), &spy, start);
  EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
  EXPECT_EQ(run.summary.message, "gradient[17] = nan at evaluation 1");
  EXPECT_EQ(spy.evaluations(), 1);
  EXPECT_TRUE(SameBits(run.x, start));

  const Result bad_start =
      Minimize(spec(), &quadratic, std::vector<double>(50, kNan));
  EXPECT_EQ(bad_start.summary.reason, StopReason::EVALUATION_FAILED);
  EXPECT_EQ(bad_start.summary.message, "x[0] = nan at evaluation 1");
}

// Some libraries throw their result away then (Ceres' trap T6, ceres_test).
TEST_P(ExternalMethods, BestPointSurvivesAFunctionThatRefuses) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  Spy spy(&quadratic,
          [](int evaluation, double*, double*) { return evaluation <= 60; });
  const Result run = Minimize(spec(), &spy, start, Tolerance(1e-10));
  EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
  EXPECT_EQ(run.summary.message, "the function refused evaluation 61");
  ExpectHonest(quadratic, run);
  EXPECT_FALSE(SameBits(run.x, start));
  // Not a worse point than the last trial points of the line search, of which
  // one may be a little better than the last accepted.
  EXPECT_LT(run.summary.cost, 0.1 * run.summary.initial_cost);
  EXPECT_LE(run.summary.cost, 2.0 * spy.least_cost());
}

}  // namespace
}  // namespace granopt
