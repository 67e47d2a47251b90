#include "solvers/solver_sequence.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

// Wherever it stands, and the one before has done what it could.
TEST(SolverSequence, PassesOverWhatCannotServe) {
  Quadratic quadratic(20);
  const std::vector<double> start(20, 0.0);
  for (const char* spec : {"newton|lbfgs", "lbfgs|newton"}) {
    SCOPED_TRACE(spec);
    const Result run = Minimize(spec, &quadratic, start, Tolerance(1e-8));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED);
    ExpectHonest(quadratic, run);
    const Result more = Minimize(spec, &quadratic, start, Tolerance(1e-30));
    EXPECT_EQ(more.summary.reason, StopReason::NO_PROGRESS)
        << more.summary.BriefReport();
    EXPECT_TRUE(Contains(more.summary.message, "lbfgs: |g| = "));
    EXPECT_LT(more.summary.max_gradient, run.summary.max_gradient);
    ExpectHonest(quadratic, more);
  }
  const Result none = Minimize("newton|interior_point", &quadratic, start);
  EXPECT_EQ(none.summary.reason, StopReason::UNSUPPORTED);
  EXPECT_TRUE(SameBits(none.x, start));
}

// The best point of the first is still what is returned, and what is said of it
// is still true.
TEST(SolverSequence, ASecondThatCannotBeginLosesNothing) {
  Quadratic quadratic(20);
  const std::vector<double> start(20, 0.0);
  Spy spy(&quadratic,
          [](int evaluation, double*, double*) { return evaluation <= 30; });
  const Result run = Minimize("lbfgs|fire", &spy, start, Tolerance(1e-10));
  EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
  EXPECT_LT(run.summary.cost, run.summary.initial_cost);
  EXPECT_GT(run.summary.scales.gradient, 0.0);
  ExpectHonest(quadratic, run);
}

TEST(SolverSequence, BudgetsAreForAllOfThem) {
  Quadratic quadratic(20);
  const std::vector<double> start(20, 0.0);
  for (const int budget : {1, 5, 20, 60}) {
    SolveOptions options = Tolerance(1e-30);
    options.max_evaluations = budget;
    const Result run = Minimize("lbfgs|ncg|fire", &quadratic, start, options);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_EVALUATIONS);
    EXPECT_EQ(run.summary.counters.evaluations, budget);
  }
}

}  // namespace
}  // namespace granopt
