// What is Ceres' own behind our interface (external_methods_test.cc has what
// all libraries must do), and the traps of Ceres that the interface is there to
// avoid, as the installed version has them (third_party_notes/ceres.md).

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ceres/gradient_problem.h"
#include "ceres/gradient_problem_solver.h"
#include "ceres/iteration_callback.h"
#include "ceres/version.h"
#include "glog/logging.h"
#include "gtest/gtest.h"
#include "solvers/solver.h"
#include "tests/solvers/external_specs.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

class CeresMethods : public testing::TestWithParam<std::string> {
 protected:
  const std::string& spec() const { return GetParam(); }
};

INSTANTIATE_TEST_SUITE_P(All,
                         CeresMethods,
                         testing::ValuesIn(CeresSpecs()),
                         TestName);

TEST_P(CeresMethods, Rosenbrock) {
  Rosenbrock rosenbrock;
  const Result run =
      Minimize(spec(), &rosenbrock, kRosenbrockStart, Tolerance(1e-6));
  ExpectHonest(rosenbrock, run);
  EXPECT_LT(run.summary.cost, 1e-3 * run.summary.initial_cost);
  if (!IsReliable(spec())) return;
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  EXPECT_NEAR(run.x[0], 1.0, 1e-3);
  EXPECT_NEAR(run.x[1], 1.0, 1e-3);
}

// ---- Failure ----------------------------------------------------------------

// One bad trial point is the line search's business, if it is the first of its
// line. A point between two good ones Ceres does not do without; then the run
// says so, and keeps what it has.
TEST_P(CeresMethods, NanOnce) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  for (int bad = 2; bad <= 12; ++bad) {
    SCOPED_TRACE(bad);
    Spy spy(&quadratic, [bad](int evaluation, double* cost, double* gradient) {
      if (evaluation != bad) return true;
      if (gradient != nullptr) gradient[3] = kNan;
      if (bad % 2 == 0) *cost = std::numeric_limits<double>::infinity();
      return true;
    });
    const Result run = Minimize(spec(), &spy, start, Tolerance(1e-6));
    ExpectHonest(quadratic, run);
    if (run.summary.Succeeded() || !IsReliable(spec())) continue;
    EXPECT_NE(bad, 2);
    EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
    EXPECT_EQ(run.summary.message,
              (bad % 2 == 0 ? "cost = inf at evaluation "
                            : "gradient[3] = nan at evaluation ") +
                  std::to_string(bad));
    EXPECT_LE(run.summary.cost, run.summary.initial_cost);
  }
}

// NaN for good, from the second evaluation (the first trial point) or later on:
// the run ends, says why, and gives back the best point from before.
TEST_P(CeresMethods, NanFromNowOn) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  for (const int first : {2, 3, 40}) {
    SCOPED_TRACE(first);
    Spy spy(&quadratic, [first](int evaluation, double*, double* gradient) {
      if (evaluation >= first && gradient != nullptr) gradient[17] = kNan;
      return true;
    });
    const Result run = Minimize(spec(), &spy, start, Tolerance(1e-10));
    EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
    EXPECT_EQ(run.summary.message,
              "gradient[17] = nan at evaluation " + std::to_string(first));
    ExpectHonest(quadratic, run);
    if (first == 2) {
      EXPECT_TRUE(SameBits(run.x, start));
    }
    if (first == 40) {
      EXPECT_LT(run.summary.cost, run.summary.initial_cost);
    }
  }
}

// A function that cannot be rebased is not stopped for it: Ceres keeps its
// history.
TEST_P(CeresMethods, NoRestartWhereNoRebaseIsPossible) {
  Quadratic quadratic(50);
  Offset offset(&quadratic, 1e7);
  const Result run =
      Minimize(spec(), &offset, std::vector<double>(50, 1e7), Tolerance(1e-8));
  EXPECT_EQ(run.summary.counters.restarts, 0);
  EXPECT_EQ(run.summary.counters.rebases, 0);
  ExpectHonest(offset, run);
}

// ---- Records ----------------------------------------------------------------

TEST_P(CeresMethods, TraceAgreesWithTheCounters) {
  Quadratic quadratic(50);
  Spy spy(&quadratic);
  SolveOptions options = Tolerance(1e-6);
  options.record_trace = true;
  const std::vector<double> start(50, 0.0);
  const Result run = Minimize(spec(), &spy, start, options);
  const Summary& summary = run.summary;
  EXPECT_EQ(spy.evaluations(), summary.counters.evaluations);
  ASSERT_EQ(summary.trace.size(),
            static_cast<std::size_t>(summary.counters.iterations) + 1);
  EXPECT_EQ(summary.trace.front().cost, CostAt(quadratic, start));
  EXPECT_EQ(summary.trace.front().cost, summary.initial_cost);
  EXPECT_EQ(summary.trace.back().cost, summary.cost);
  EXPECT_EQ(summary.trace.back().max_gradient, summary.max_gradient);
  EXPECT_EQ(summary.trace.back().evaluations, summary.counters.evaluations);
  double least = summary.initial_cost;
  for (std::size_t i = 0; i < summary.trace.size(); ++i) {
    const TraceRow& row = summary.trace[i];
    EXPECT_EQ(row.iteration, static_cast<std::int64_t>(i));
    EXPECT_EQ(row.gradient_scale, summary.scales.gradient);
    least = std::min(least, row.cost);
    if (i == 0) continue;
    EXPECT_GT(row.evaluations, summary.trace[i - 1].evaluations);
    EXPECT_GE(row.seconds, summary.trace[i - 1].seconds);
  }
  EXPECT_LE(summary.cost, least * (1 + 1e-9));
  EXPECT_GE(summary.seconds, summary.function_seconds);

  options.record_trace = false;
  EXPECT_TRUE(Minimize(spec(), &spy, start, options).summary.trace.empty());
}

// ---- Units: what scaled=1 is for --------------------------------------------

// Ceres as it is does not get there: s.y <= 1e-14 freezes L-BFGS, g.d > -1e-12
// makes NCG start afresh at each step, so that both are gradient descent with
// steps of at most one (traps T2, T3 below). The tenfold of the iterations is
// not enough.
TEST_P(CeresMethods, AsIsFailsInSmallUnits) {
  if (!Contains(spec(), "scaled=0") || !IsReliable(spec())) return;
  Quadratic quadratic(50);
  InOtherUnits other(&quadratic, -60, 20);
  const std::vector<double> start(50, 0.0);
  const Result a = Minimize(spec(), &quadratic, start, Tolerance(1e-6));
  ASSERT_EQ(a.summary.reason, StopReason::CONVERGED);
  SolveOptions options = Tolerance(1e-6);
  options.max_iterations = 10 * a.summary.counters.iterations;
  const Result b = Minimize(spec(), &other, start, options);
  EXPECT_FALSE(b.summary.Succeeded()) << b.summary.BriefReport();
  EXPECT_GT(b.summary.max_gradient, 1e-2 * b.summary.scales.gradient);
  ExpectHonest(other, b);
}

// No option is read and then forgotten.
TEST(CeresOptions, EachLeadsToAnotherRun) {
  std::vector<std::int64_t> evaluations;
  const auto run = [&](const std::string& spec) {
    Quadratic quadratic(50);
    const Result result = Minimize(
        spec, &quadratic, std::vector<double>(50, 0.0), Tolerance(1e-6));
    EXPECT_TRUE(result.summary.Succeeded()) << result.summary.BriefReport();
    evaluations.push_back(result.summary.counters.evaluations);
    return result.summary.counters.iterations;
  };
  for (const char* beta : {"fr", "pr", "hs"}) {
    for (const char* search : {"wolfe", "armijo"}) {
      run(std::string("ceres_ncg:beta=") + beta + ",line_search=" + search);
    }
  }
  EXPECT_LT(run("ceres_lbfgs:scaled=1,memory=50"),
            run("ceres_lbfgs:scaled=1,memory=2"));
  std::sort(evaluations.begin(), evaluations.end());
  EXPECT_EQ(std::unique(evaluations.begin(), evaluations.end()),
            evaluations.end());
}

// Even in units of order one, Ceres as it is stops learning once s.y <= 1e-14.
TEST(CeresLbfgs, ScaledGoesOnWhereAsIsEnds) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  const Result as_is =
      Minimize("ceres_lbfgs:scaled=0", &quadratic, start, Tolerance(1e-13));
  EXPECT_FALSE(as_is.summary.Succeeded()) << as_is.summary.BriefReport();
  ExpectHonest(quadratic, as_is);
  const Result scaled =
      Minimize("ceres_lbfgs:scaled=1", &quadratic, start, Tolerance(1e-13));
  EXPECT_EQ(scaled.summary.reason, StopReason::CONVERGED)
      << scaled.summary.BriefReport();
  EXPECT_LT(scaled.summary.counters.iterations,
            as_is.summary.counters.iterations);
  ExpectHonest(quadratic, scaled);
}

TEST(CeresLbfgs, DifferencesReachBelowTheRoundoffOfTheCost) {
  Quadratic quadratic(50);
  Raised raised(&quadratic);
  const std::vector<double> start(50, 0.0);
  const Result costs = Minimize(
      "ceres_lbfgs:scaled=1,restarts=9", &raised, start, Tolerance(1e-13));
  EXPECT_EQ(costs.summary.reason, StopReason::NO_PROGRESS);
  EXPECT_GT(costs.summary.max_gradient, 1e-10 * costs.summary.scales.gradient);
  ExpectHonest(raised, costs);
  const Result differences =
      Minimize("ceres_lbfgs:scaled=1,differences=1,restarts=9",
               &raised,
               start,
               Tolerance(1e-13));
  EXPECT_EQ(differences.summary.reason, StopReason::CONVERGED)
      << differences.summary.BriefReport();
  ExpectHonest(raised, differences);
}

// A function with an origin is rebased where the rounding of x limits the
// gradient, and the run goes on from zero.
TEST(CeresLbfgs, RebasesWhereRoundingOfTheVariablesLimits) {
  for (const char* spec : {"ceres_lbfgs:scaled=0", "ceres_lbfgs:scaled=1"}) {
    Quadratic quadratic(50);
    Offset offset(&quadratic, 1e8, /*can_rebase=*/true);
    const Result run =
        Minimize(spec, &offset, std::vector<double>(50, 1e8), Tolerance(1e-6));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    EXPECT_EQ(run.summary.counters.rebases, 1);
    EXPECT_EQ(run.summary.counters.restarts, 1);
    EXPECT_LT(std::abs(run.x[0]), 1.0);
    ExpectHonest(offset, run);
  }
}

// ---- Traps of Ceres itself --------------------------------------------------

// A run of Ceres without anything of ours in between.
struct CeresRun {
  ceres::GradientProblemSolver::Summary summary;
  std::vector<double> x;
  std::vector<double> costs;  // at each iterate that was accepted
};

class RecordCosts : public ceres::IterationCallback {
 public:
  explicit RecordCosts(std::vector<double>* costs) : costs_(costs) {}
  ceres::CallbackReturnType operator()(
      const ceres::IterationSummary& summary) override {
    costs_->push_back(summary.cost);
    return ceres::SOLVER_CONTINUE;
  }

 private:
  std::vector<double>* costs_;
};

CeresRun RunCeres(const FirstOrderFunction& f,
                  ceres::GradientProblemSolver::Options options,
                  std::vector<double> x) {
  // Ceres takes ownership; a Spy that meddles with nothing is a copy.
  auto copy = std::make_unique<Spy>(&f);
#if CERES_VERSION_MAJOR > 2 || \
    (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 2)
  const ceres::GradientProblem problem(std::move(copy));
#else
  const ceres::GradientProblem problem(copy.release());
#endif
  CeresRun run;
  RecordCosts record(&run.costs);
  options.callbacks.push_back(&record);
  options.logging_type = ceres::SILENT;
  const int level = FLAGS_minloglevel;
  FLAGS_minloglevel = google::GLOG_ERROR;  // trap T16
  ceres::Solve(options, problem, x.data(), &run.summary);
  FLAGS_minloglevel = level;
  run.x = std::move(x);
  return run;
}

ceres::GradientProblemSolver::Options OpenTolerances() {
  ceres::GradientProblemSolver::Options options;
  options.max_num_iterations = 1000;
  options.function_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  return options;
}

// T6: on FAILURE the iterates are thrown away; with
// update_state_every_iteration the last accepted one is kept.
TEST(CeresTraps, T6ResultIsThrownAwayOnFailure) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  for (const bool update : {false, true}) {
    Spy spy(&quadratic,
            [](int evaluation, double*, double*) { return evaluation <= 60; });
    ceres::GradientProblemSolver::Options options = OpenTolerances();
    options.update_state_every_iteration = update;
    const CeresRun run = RunCeres(spy, options, start);
    EXPECT_EQ(run.summary.termination_type, ceres::FAILURE);
    ASSERT_GT(run.costs.size(), 10u);
    EXPECT_LT(run.costs.back(), 0.1 * run.costs.front());
    EXPECT_EQ(SameBits(run.x, start), !update);
    if (update) {
      EXPECT_EQ(CostAt(quadratic, run.x), run.costs.back());
    }
  }
}

// 1 + 1e-20 x: the slope is there, the change of the cost is lost in roundoff.
class FlatSlope : public FirstOrderFunction {
 public:
  int NumParameters() const override { return 1; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* /*scales*/) const override {
    *cost = 1.0 + 1e-20 * x[0];
    if (gradient != nullptr) gradient[0] = 1e-20;
    return true;
  }
};

// T9: function_tolerance = 0 still reports convergence, at a slope that is not
// zero, when the cost did not change.
TEST(CeresTraps, T9ZeroFunctionToleranceReportsConvergence) {
  FlatSlope slope;
  ceres::GradientProblemSolver::Options options = OpenTolerances();
  options.line_search_direction_type = ceres::STEEPEST_DESCENT;
  options.line_search_type = ceres::ARMIJO;
  const CeresRun run = RunCeres(slope, options, {0.0});
  EXPECT_EQ(run.summary.termination_type, ceres::CONVERGENCE);
  EXPECT_TRUE(Contains(run.summary.message, "Function tolerance reached"))
      << run.summary.message;
  EXPECT_GT(MaxGradientAt(slope, run.x), options.gradient_tolerance);
}

// T2, T3: in small units NCG and L-BFGS of Ceres take bitwise the steps of
// gradient descent, in units of order one they do not.
TEST(CeresTraps, T2T3SmallUnitsMakeEveryMethodGradientDescent) {
  Quadratic quadratic(50);
  InOtherUnits small(&quadratic, -60, 20);
  const std::vector<double> start(50, 0.0);
  ceres::GradientProblemSolver::Options options = OpenTolerances();
  options.max_num_iterations = 50;
  const auto run = [&](const FirstOrderFunction& f,
                       ceres::LineSearchDirectionType direction) {
    options.line_search_direction_type = direction;
    return RunCeres(f, options, start);
  };
  for (const auto direction :
       {ceres::LBFGS, ceres::NONLINEAR_CONJUGATE_GRADIENT}) {
    const CeresRun descent = run(small, ceres::STEEPEST_DESCENT);
    const CeresRun same = run(small, direction);
    ASSERT_EQ(same.costs.size(), 51u);
    EXPECT_TRUE(SameBits(same.costs, descent.costs));
    EXPECT_TRUE(SameBits(same.x, descent.x));
    const CeresRun descent_in_ours = run(quadratic, ceres::STEEPEST_DESCENT);
    const CeresRun better = run(quadratic, direction);
    EXPECT_LT(better.costs.back(), 0.5 * descent_in_ours.costs.back());
  }
}

// T8: the shortest step of a line search is an absolute length, and zero is
// refused.
TEST(CeresTraps, T8ShortestStepMustBePositive) {
  ceres::GradientProblemSolver::Options options = OpenTolerances();
  std::string error;
  EXPECT_EQ(options.min_line_search_step_size, 1e-9);
  options.min_line_search_step_size = 0.0;
  EXPECT_FALSE(options.IsValid(&error));
  options.min_line_search_step_size = 1e-300;
  EXPECT_TRUE(options.IsValid(&error)) << error;
}

}  // namespace
}  // namespace granopt
