// NLopt, libLBFGS and PETSc behind our interface: what goes beyond
// external_methods_test.cc. Those that were not found when this was configured
// are skipped.

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "Eigen/SparseCore"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "solvers/second_order.h"
#include "solvers/solver.h"
#include "tests/solvers/external_specs.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

class Competitors : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!IsRegistered(spec())) GTEST_SKIP() << "built without it";
  }
  const std::string& spec() const { return GetParam(); }
};

INSTANTIATE_TEST_SUITE_P(All,
                         Competitors,
                         testing::ValuesIn(CompetitorSpecs()),
                         TestName);

TEST_P(Competitors, Rosenbrock) {
  Rosenbrock rosenbrock;
  const Result run =
      Minimize(spec(), &rosenbrock, kRosenbrockStart, Tolerance(1e-10));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  ExpectHonest(rosenbrock, run);
  EXPECT_NEAR(run.x[0], 1.0, 1e-6);
  EXPECT_NEAR(run.x[1], 1.0, 1e-6);
}

// ---- Counts -----------------------------------------------------------------

TEST_P(Competitors, CountsAreRight) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  std::vector<std::vector<double>> evaluated;
  // Where the function was evaluated, in order.
  class Recorder : public Spy {
   public:
    Recorder(const FirstOrderFunction* f,
             std::vector<std::vector<double>>* points)
        : Spy(f), points_(points) {}
    bool EvaluateWithScales(const double* x,
                            double* cost,
                            double* gradient,
                            Scales* scales) const override {
      points_->emplace_back(x, x + NumParameters());
      return Spy::EvaluateWithScales(x, cost, gradient, scales);
    }

   private:
    std::vector<std::vector<double>>* points_;
  } recorder(&quadratic, &evaluated);

  std::vector<std::vector<double>> iterates;
  std::vector<std::int64_t> evaluations;
  SolveOptions options = Tolerance(1e-6);
  options.record_trace = true;
  options.callback = [&](const IterationState& state) {
    iterates.emplace_back(state.x, state.x + 50);
    evaluations.push_back(state.counters.evaluations);
    return true;
  };
  const Result run = Minimize(spec(), &recorder, start, options);
  const Summary& summary = run.summary;
  ASSERT_EQ(summary.reason, StopReason::CONVERGED) << summary.BriefReport();
  EXPECT_EQ(recorder.evaluations(), summary.counters.evaluations);
  ASSERT_EQ(summary.trace.size(),
            static_cast<std::size_t>(summary.counters.iterations) + 1);
  EXPECT_EQ(summary.trace.front().evaluations, 1);
  EXPECT_EQ(summary.trace.back().evaluations, summary.counters.evaluations);
  EXPECT_EQ(summary.trace.back().cost, summary.cost);
  // Each iterate is a point that was just evaluated, at lower cost than the one
  // before (nothing is evaluated twice, nothing is counted that is no iterate).
  ASSERT_EQ(iterates.size(), summary.trace.size() - 1);
  for (std::size_t i = 0; i < iterates.size(); ++i) {
    EXPECT_TRUE(SameBits(iterates[i], evaluated[evaluations[i] - 1])) << i;
    if (i == 0) continue;
    EXPECT_GT(evaluations[i], evaluations[i - 1]);
    EXPECT_LT(summary.trace[i].cost, summary.trace[i - 1].cost);
  }
  // Trial points between two iterates lie on one line with both; the first
  // trial point after an iterate does not lie on the line before it.
  const auto off_line = [](const std::vector<double>& a,
                           const std::vector<double>& b,
                           const std::vector<double>& c) {
    const Eigen::Map<const Eigen::VectorXd> x(a.data(), 50), y(b.data(), 50),
        z(c.data(), 50);
    const Eigen::VectorXd d = (y - x).normalized();
    return ((z - x) - d.dot(z - x) * d).norm() / (z - x).norm();
  };
  for (std::size_t i = 1; i < iterates.size(); ++i) {
    for (std::int64_t e = evaluations[i - 1]; e < evaluations[i]; ++e) {
      EXPECT_LT(off_line(iterates[i - 1], iterates[i], evaluated[e]), 1e-6)
          << "iterate " << i << ", evaluation " << e + 1;
    }
    if (evaluations[i] < summary.counters.evaluations) {
      EXPECT_GT(
          off_line(iterates[i - 1], iterates[i], evaluated[evaluations[i]]),
          1e-6)
          << i;
    }
  }
}

// One after another, and one inside the callback of another.
TEST(Competitors, InSequenceAndNested) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  const auto run = [&](const std::string& spec, auto callback) {
    SolveOptions options = Tolerance(1e-6);
    options.callback = callback;
    const Result result = Minimize(spec, &quadratic, start, options);
    EXPECT_EQ(result.summary.reason, StopReason::CONVERGED)
        << result.summary.BriefReport();
    return result.x;
  };
  const auto go_on = [](const IterationState&) { return true; };
  for (const std::string outer : kCompetitors) {
    if (!IsRegistered(outer)) continue;
    const std::vector<double> alone = run(outer, go_on);
    for (const std::string inner : kCompetitors) {
      if (!IsRegistered(inner)) continue;
      const std::vector<double> inside = run(inner, go_on);
      const std::vector<double> x = run(outer, [&](const IterationState& s) {
        if (s.counters.iterations == 3) {
          EXPECT_TRUE(SameBits(run(inner, go_on), inside));
        }
        return true;
      });
      EXPECT_TRUE(SameBits(x, alone)) << inner << " inside " << outer;
    }
  }
}

// ---- Failure ----------------------------------------------------------------

// The run ends there, and gives back the best point from before.
TEST_P(Competitors, NanLaterOn) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  for (const int bad : {2, 3, 4, 5, 40}) {
    for (const bool cost_too : {false, true}) {
      SCOPED_TRACE(bad);
      Spy spy(&quadratic,
              [bad, cost_too](int evaluation, double* cost, double* gradient) {
                if (evaluation != bad) return true;
                if (gradient != nullptr) gradient[17] = kNan;
                if (cost_too) *cost = kNan;
                return true;
              });
      const Result run = Minimize(spec(), &spy, start, Tolerance(1e-10));
      EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
      EXPECT_EQ(run.summary.message,
                (cost_too ? "cost = nan at evaluation "
                          : "gradient[17] = nan at evaluation ") +
                    std::to_string(bad));
      EXPECT_EQ(spy.evaluations(), bad);
      ExpectHonest(quadratic, run);
      if (bad == 2) {
        EXPECT_TRUE(SameBits(run.x, start));
      }
      if (bad == 40) {
        EXPECT_LT(run.summary.cost, run.summary.initial_cost);
      }
    }
  }
}

// Where no step lowers the cost it says so in its own words, and restarts are
// counted.
TEST_P(Competitors, GivesUpInItsOwnWords) {
  Quadratic quadratic(50);
  for (const int restarts : {0, 5}) {
    // The cost goes up from now on, whatever the gradient says.
    Spy spy(&quadratic, [](int evaluation, double* cost, double*) {
      if (evaluation > 40) *cost = 1e6 + evaluation;
      return true;
    });
    const Result run =
        Minimize(spec() + ",restarts=" + std::to_string(restarts),
                 &spy,
                 std::vector<double>(50, 0.0),
                 Tolerance(1e-6));
    EXPECT_EQ(run.summary.reason, StopReason::NO_PROGRESS);
    ExpectHonest(quadratic, run);
    EXPECT_LT(run.summary.cost, run.summary.initial_cost);
    EXPECT_EQ(run.summary.counters.restarts, restarts > 0);
    EXPECT_EQ(run.summary.counters.evaluations, spy.evaluations());
    const std::string& message = run.summary.message;
    if (Contains(spec(), "nlopt")) {
      EXPECT_TRUE(Contains(message, ": NLopt: FAILURE")) << message;
    } else if (Contains(spec(), "tao")) {
      EXPECT_TRUE(Contains(message, ": TAO: DIVERGED_LS_FAILURE")) << message;
    } else {
      EXPECT_TRUE(Contains(message, ": libLBFGS: LBFGSERR_")) << message;
    }
  }
}

// At the end of its digits a library may go on for ever, or divide by zero; the
// point that is returned is good all the same.
TEST_P(Competitors, BelowRoundoff) {
  Quadratic quadratic(50);
  Raised raised(&quadratic);
  const Result run =
      Minimize(spec(), &raised, std::vector<double>(50, 0.0), Tolerance(1e-30));
  EXPECT_TRUE(run.summary.reason == StopReason::NO_PROGRESS ||
              run.summary.reason == StopReason::MAX_ITERATIONS)
      << run.summary.BriefReport();
  EXPECT_LT(run.summary.max_gradient, 1e-4 * run.summary.scales.gradient)
      << run.summary.BriefReport();
  ExpectHonest(raised, run);
}

// ---- The function's own reference -------------------------------------------

TEST_P(Competitors, RebasesWhereRoundingOfTheVariablesLimits) {
  Quadratic quadratic(50);
  Offset offset(&quadratic, 1e8, /*can_rebase=*/true);
  const Result run =
      Minimize(spec(), &offset, std::vector<double>(50, 1e8), Tolerance(1e-8));
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  EXPECT_EQ(run.summary.counters.rebases, 1);
  EXPECT_EQ(run.summary.counters.restarts, 1);
  EXPECT_LT(std::abs(run.x[0]), 1.0);
  ExpectHonest(offset, run);
}

// Between iterations only: never while a line search is under way.
class Recentered : public Quadratic {
 public:
  Recentered() : Quadratic(50) {}
  bool Recenter(const double* x) override {
    at_.assign(x, x + 50);
    ++recenters_;
    return true;
  }
  const std::vector<double>& at() const { return at_; }
  int recenters() const { return recenters_; }

 private:
  std::vector<double> at_;
  int recenters_ = 0;
};

TEST_P(Competitors, RecentersAtEachIterate) {
  Recentered quadratic;
  SolveOptions options = Tolerance(1e-6);
  std::vector<double> last;
  int calls = 0;
  options.callback = [&](const IterationState& state) {
    EXPECT_EQ(quadratic.recenters(), calls);
    EXPECT_EQ(quadratic.at(), last);
    last.assign(state.x, state.x + 50);
    ++calls;
    return true;
  };
  const Result run =
      Minimize(spec(), &quadratic, std::vector<double>(50, 0.0), options);
  EXPECT_TRUE(run.summary.Succeeded());
  EXPECT_EQ(run.summary.counters.recenters, run.summary.counters.iterations);
}

// ---- Newton's methods -------------------------------------------------------

// A chain of hard springs, sum (d^2 / 2 + d^4 / 4) of the differences d of
// neighbours, held at both ends, and one variable that nothing depends on. The
// pattern of its Hessian changes each time, and need not have all of the
// diagonal.
class HardChain : public SecondOrderFunction {
 public:
  explicit HardChain(int n) : n_(n) {}
  int NumParameters() const override { return n_; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    ++evaluations;
    *cost = 0.0;
    if (gradient != nullptr) std::fill(gradient, gradient + n_, 0.0);
    for (int i = 0; i < n_; ++i) {
      const double d = Difference(x, i);
      *cost += 0.5 * d * d + 0.25 * d * d * d * d;
      const double g = d + d * d * d;
      if (gradient == nullptr) continue;
      if (i < n_ - 1) gradient[i] += g;
      if (i > 0) gradient[i - 1] -= g;
    }
    if (scales != nullptr) {
      *scales = Scales();
      scales->gradient = scales->length = 1.0;
    }
    return std::isfinite(*cost);
  }
  bool EvaluateHessian(const double* x, SparseMatrix* hessian) const override {
    if (++hessians == refuse_from) return false;
    std::vector<Eigen::Triplet<double>> entries;
    for (int i = 0; i < n_; ++i) {
      const double d = Difference(x, i);
      const double h = hessians == nan_from ? kNan : 1.0 + 3.0 * d * d;
      if (i < n_ - 1) entries.emplace_back(i, i, h);
      if (i > 0) entries.emplace_back(i - 1, i - 1, h);
      if (i > 0 && i < n_ - 1) entries.emplace_back(i, i - 1, -h);
      // Zeros in other places each time, more or fewer.
      const int zeros = hessians % 3;
      for (int k = 2; k < 2 + 2 * zeros && i + k < n_; ++k) {
        entries.emplace_back(i + k, i, 0.0);
      }
    }
    hessian->resize(n_, n_);
    hessian->setFromTriplets(entries.begin(), entries.end());
    return true;
  }
  std::int64_t PatternVersion() const override { return hessians; }
  bool HessianTimes(const double*, const double*, double*) const override {
    return false;
  }

  mutable int evaluations = 0, hessians = 0;
  int refuse_from = -1, nan_from = -1;

 private:
  // To its left neighbour; both ends are at 0 and 3.
  double Difference(const double* x, int i) const {
    return (i < n_ - 1 ? x[i] : 3.0) - (i > 0 ? x[i - 1] : 0.0);
  }
  const int n_;
};

std::vector<double> HardStart(int n) {
  std::vector<double> start(n);
  for (int i = 0; i < n; ++i) start[i] = 3.0 * std::sin(1.0 + i);
  return start;
}

class Newton : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!IsRegistered(spec())) GTEST_SKIP() << "built without it";
    std::string error;
    if (CreateSolver(spec(), &error) == nullptr) {
      // PETSc need not have MUMPS.
      EXPECT_TRUE(Contains(error, "MUMPS")) << error;
      GTEST_SKIP() << error;
    }
  }
  const std::string& spec() const { return GetParam(); }
};

INSTANTIATE_TEST_SUITE_P(All,
                         Newton,
                         testing::Values("tao_nls:linear=mumps",
                                         "tao_nls:linear=icc,scaled=1",
                                         "tao_nls:linear=jacobi",
                                         "tao_bntr:linear=mumps,scaled=1",
                                         "tao_bntr:linear=icc",
                                         "tao_bntr:linear=jacobi,scaled=1"),
                         TestName);

// The pattern is another one each time: what was made for the last one must not
// be used again.
TEST_P(Newton, ConvergesAndCounts) {
  HardChain f(60);
  const Result run = Minimize(spec(), &f, HardStart(60), Tolerance(1e-12));
  ASSERT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  // Ends 0 and 3 in 60 equal steps.
  for (int i = 0; i < 59; ++i) EXPECT_NEAR(run.x[i], 0.05 * (i + 1), 1e-9);
  EXPECT_EQ(run.x[59], HardStart(60)[59]);
  const Counters& c = run.summary.counters;
  EXPECT_EQ(c.evaluations, f.evaluations);
  EXPECT_EQ(c.hessians, f.hessians);
  EXPECT_GT(c.hessians, 2);
  EXPECT_LE(c.iterations, 60);
  EXPECT_GT(c.factorizations, 0);
  EXPECT_LE(c.factorizations, c.hessians);
  EXPECT_GE(c.solves, c.factorizations);
  EXPECT_EQ(c.linear_iterations == 0, Contains(spec(), "tao_nls:linear=mumps"));
}

TEST_P(Newton, FirstDerivativesAreNotEnough) {
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  const Result run = Minimize(spec(), &quadratic, start);
  EXPECT_EQ(run.summary.reason, StopReason::UNSUPPORTED);
  EXPECT_TRUE(Contains(run.summary.message, "second derivatives"));
  EXPECT_EQ(run.summary.counters.evaluations, 0);
  EXPECT_TRUE(SameBits(run.x, start));
}

TEST_P(Newton, HessianThatFails) {
  for (const int at : {1, 2, 3}) {
    HardChain refuses(60), nan(60);
    refuses.refuse_from = nan.nan_from = at;
    const Result a = Minimize(spec(), &refuses, HardStart(60));
    EXPECT_EQ(a.summary.reason, StopReason::EVALUATION_FAILED);
    EXPECT_EQ(a.summary.message, "the function refused its Hessian");
    EXPECT_EQ(a.summary.counters.hessians, at);
    EXPECT_LE(a.summary.cost, a.summary.initial_cost);
    const Result b = Minimize(spec(), &nan, HardStart(60));
    EXPECT_EQ(b.summary.reason, StopReason::EVALUATION_FAILED);
    EXPECT_EQ(b.summary.message, "the Hessian is not finite");
  }
}

TEST_P(Newton, BudgetsAreKept) {
  HardChain f(60);
  for (const int budget : {0, 1, 2}) {
    SolveOptions options;
    options.max_iterations = budget;
    const Result run = Minimize(spec(), &f, HardStart(60), options);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_ITERATIONS);
    EXPECT_EQ(run.summary.counters.iterations, budget);
    ExpectBothNumbers(run.summary, "iterations", budget);
  }
  for (int budget = 1; budget <= 6; ++budget) {
    SolveOptions options;
    options.relative_tolerance = 1e-300;
    options.max_evaluations = budget;
    const Result run = Minimize(spec(), &f, HardStart(60), options);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_EVALUATIONS);
    EXPECT_EQ(run.summary.counters.evaluations, budget);
  }
}

TEST_P(Newton, TwoRunsAreBitwiseEqual) {
  HardChain f(60), g(60);
  const Result a = Minimize(spec(), &f, HardStart(60), Tolerance(1e-8));
  const Result b = Minimize(spec(), &g, HardStart(60), Tolerance(1e-8));
  EXPECT_TRUE(SameBits(a.x, b.x));
  EXPECT_EQ(a.summary.message, b.summary.message);
}

TEST(Petsc, NewtonsMethodsAreSilent) {
  if (!IsRegistered("tao_nls")) GTEST_SKIP();
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  for (const std::string name : {"tao_nls", "tao_bntr"}) {
    std::string error;
    if (CreateSolver(name, &error) == nullptr) continue;
    HardChain good(60), bad(60);
    bad.refuse_from = 2;
    Minimize(name, &good, HardStart(60));
    Minimize(name, &bad, HardStart(60));
  }
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// ---- Traps of the libraries (third_party_notes) -----------------------------

// The gradient that ends it is absolute; what is tight in other units passes.
TEST(Nlopt, AsIsEndsAtAnAbsoluteGradient) {
  if (!IsRegistered("nlopt_lbfgs")) GTEST_SKIP();
  Quadratic quadratic(50);
  InOtherUnits small(&quadratic, -40, 0);
  const std::vector<double> start(50, 0.0);
  const Result as_is = Minimize("nlopt_lbfgs", &small, start, Tolerance(1e-6));
  EXPECT_EQ(as_is.summary.reason, StopReason::NO_PROGRESS);
  EXPECT_TRUE(Contains(as_is.summary.message, "NLopt: SUCCESS"))
      << as_is.summary.message;
  const Result scaled =
      Minimize("nlopt_lbfgs:scaled=1", &small, start, Tolerance(1e-6));
  EXPECT_EQ(scaled.summary.reason, StopReason::CONVERGED);
}

TEST(Nlopt, MemoryThatOverflowsItIsRefused) {
  if (!IsRegistered("nlopt_lbfgs")) GTEST_SKIP();
  Quadratic quadratic(50);
  const std::vector<double> start(50, 0.0);
  const Result run =
      Minimize("nlopt_lbfgs:memory=1000000000", &quadratic, start);
  EXPECT_EQ(run.summary.reason, StopReason::NO_PROGRESS);
  EXPECT_TRUE(Contains(run.summary.message, "memory=1000000000"));
  EXPECT_TRUE(SameBits(run.x, start));
}

// It leaves the process as it was: silent, signals and environment untouched.
TEST(Petsc, LeavesTheProcessAlone) {
  if (!IsRegistered("tao_lmvm")) GTEST_SKIP();
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  Quadratic quadratic(50);
  // A failure and a success.
  Spy spy(&quadratic, [](int e, double*, double*) { return e < 5; });
  Minimize("tao_lmvm", &spy, std::vector<double>(50, 0.0));
  Minimize("tao_lmvm", &quadratic, std::vector<double>(50, 0.0));
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  for (const int signal : {SIGSEGV, SIGFPE, SIGABRT, SIGBUS, SIGILL, SIGTERM}) {
    struct sigaction action;
    ASSERT_EQ(sigaction(signal, nullptr, &action), 0);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    EXPECT_EQ(action.sa_handler, SIG_DFL) << signal;
#endif
  }
  for (const char* name : {"OMPI_MCA_btl",
                           "OMPI_MCA_opal_signal",
                           "OMPI_MCA_ess_singleton_isolated"}) {
    EXPECT_EQ(std::getenv(name), nullptr) << name;
  }
}

// No option is read and then forgotten.
TEST(Competitors, EachOptionLeadsToAnotherRun) {
  const auto evaluations = [](const std::string& spec) {
    Quadratic quadratic(50);
    const Result run = Minimize(
        spec, &quadratic, std::vector<double>(50, 0.0), Tolerance(1e-6));
    EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
    return run.summary.counters.evaluations;
  };
  for (const std::string name : kCompetitors) {
    if (!IsRegistered(name)) continue;
    EXPECT_LT(evaluations(name + ":memory=50"),
              evaluations(name + ":memory=2"));
  }
  if (IsRegistered("liblbfgs")) {
    EXPECT_NE(evaluations("liblbfgs:line_search=strong_wolfe"),
              evaluations("liblbfgs:line_search=more_thuente"));
  }
  if (IsRegistered("tao_lmvm")) {
    EXPECT_NE(evaluations("tao_lmvm:scaling=scalar"),
              evaluations("tao_lmvm:scaling=diagonal"));
    EXPECT_NE(evaluations("tao_lmvm:scaling=scalar"),
              evaluations("tao_lmvm:scaling=none"));
  }
}

}  // namespace
}  // namespace granopt
