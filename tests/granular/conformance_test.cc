// What every registered method must do, whatever it is (method_table.h excuses
// some from some of it): end where it should, for the reason that it states,
// with the best point that it has seen, within its budgets, and whatever the
// function does. On packings: conformance_packings_test.cc.

#include "tests/granular/conformance.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// ---- functions --------------------------------------------------------------

// What a Watch may do to an evaluation (1, 2, ...): change it, or refuse it.
using Meddle = std::function<bool(
    int evaluation, const double* x, double* cost, double* gradient)>;

// Counts, and checks that a method asks for nothing absurd. Passes everything
// else on.
template <typename Base>
class WatchBase : public Base {
 public:
  WatchBase(Base* f, Meddle meddle) : f_(f), meddle_(std::move(meddle)) {}

  int NumParameters() const override { return f_->NumParameters(); }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    ++evaluations_;
    for (int i = 0; i < NumParameters(); ++i) {
      EXPECT_TRUE(std::isfinite(x[i])) << "x[" << i << "]";
      // Cached values do not survive a new origin.
      EXPECT_TRUE(!is_rebased_ || x[i] == 0.0) << "x[" << i << "]";
    }
    is_rebased_ = false;
    if (!f_->EvaluateWithScales(x, cost, gradient, scales)) return false;
    if (meddle_ && !meddle_(evaluations_, x, cost, gradient)) return false;
    if (std::isfinite(*cost)) least_cost_ = std::min(least_cost_, *cost);
    return true;
  }
  bool Recenter(const double* x) override {
    const bool moved = f_->Recenter(x);
    recenters_ += moved ? 1 : 0;
    return moved;
  }
  bool Rebase(double* x) override {
    const bool moved = f_->Rebase(x);
    rebases_ += moved ? 1 : 0;
    is_rebased_ = moved;
    return moved;
  }

  int evaluations() const { return evaluations_; }
  int recenters() const { return recenters_; }
  int rebases() const { return rebases_; }
  double least_cost() const { return least_cost_; }

 protected:
  Base* f_;

 private:
  const Meddle meddle_;
  mutable int evaluations_ = 0;
  mutable double least_cost_ = kInfinity;
  int recenters_ = 0;
  int rebases_ = 0;
  mutable bool is_rebased_ = false;
};

using WatchFirst = WatchBase<FirstOrderFunction>;

class WatchSecond : public WatchBase<SecondOrderFunction> {
 public:
  using WatchBase::WatchBase;
  bool EvaluateHessian(const double* x, SparseMatrix* h) const override {
    ++hessians_;
    return f_->EvaluateHessian(x, h);
  }
  int BlockSize() const override { return f_->BlockSize(); }
  std::int64_t PatternVersion() const override { return f_->PatternVersion(); }
  bool HessianTimes(const double* x,
                    const double* v,
                    double* hv) const override {
    return f_->HessianTimes(x, v, hv);
  }
  int hessians() const { return hessians_; }

 private:
  mutable int hessians_ = 0;
};

// c.x with or without scales: no minimum.
class Linear : public FirstOrderFunction {
 public:
  explicit Linear(bool has_scales) : has_scales_(has_scales) {}
  int NumParameters() const override { return 3; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    *cost = x[0] - 2.0 * x[1] + 0.5 * x[2];
    if (gradient != nullptr) {
      gradient[0] = 1.0;
      gradient[1] = -2.0;
      gradient[2] = 0.5;
    }
    if (scales != nullptr) {
      *scales = Scales();
      if (has_scales_) scales->gradient = scales->length = 1.0;
    }
    return true;
  }

 private:
  const bool has_scales_;
};

// f without its scales.
class Unscaled : public Wrapper {
 public:
  using Wrapper::Wrapper;
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    if (scales != nullptr) *scales = Scales();
    return f_->EvaluateWithScales(x, cost, gradient, nullptr);
  }
};

// ---- runs -------------------------------------------------------------------

template <typename Watch>
void ExpectCounted(const Watch& watch, const Summary& s) {
  // A point that is not finite is counted, and not shown to the function.
  EXPECT_GE(s.counters.evaluations, watch.evaluations());
  if (s.reason != StopReason::EVALUATION_FAILED) {
    EXPECT_EQ(s.counters.evaluations, watch.evaluations());
  }
  EXPECT_EQ(s.counters.recenters, watch.recenters());
  EXPECT_EQ(s.counters.rebases, watch.rebases());
}

class WatchedConformance : public Conformance {
 protected:
  // Runs on f under watch, with second derivatives if f has them.
  Result Watched(FirstOrderFunction* f,
                 const std::vector<double>& start,
                 const SolveOptions& options,
                 const Meddle& meddle = nullptr) {
    auto* second = dynamic_cast<SecondOrderFunction*>(f);
    Result run;
    if (second != nullptr) {
      WatchSecond watch(second, meddle);
      run = Minimize(spec(), &watch, start, options);
      ExpectCounted(watch, run.summary);
      EXPECT_EQ(run.summary.counters.hessians, watch.hessians());
      least_cost_ = watch.least_cost();
    } else {
      WatchFirst watch(f, meddle);
      run = Minimize(spec(), &watch, start, options);
      ExpectCounted(watch, run.summary);
      least_cost_ = watch.least_cost();
    }
    return run;
  }

  double least_cost_ = 0.0;
};

INSTANTIATE_TEST_SUITE_P(Methods,
                         WatchedConformance,
                         testing::ValuesIn(MethodSpecs(true)),
                         TestName);

// ---- functions with a formula -----------------------------------------------

TEST_P(WatchedConformance, ConvexQuadratic) {
  for (const double condition : {1e3, 1e6}) {
    SCOPED_TRACE(condition);
    if (condition > traits().condition) continue;
    const int n = 40;
    Chain chain(n, condition);
    const std::vector<double> start(n, 0.0);
    if (!Supports(spec(), chain)) {
      // Says so, and leaves x alone.
      const Result run = Minimize(spec(), &chain, start);
      EXPECT_EQ(run.summary.reason, StopReason::UNSUPPORTED);
      EXPECT_FALSE(run.summary.message.empty());
      EXPECT_TRUE(SameBits(run.x, start));
      EXPECT_EQ(run.summary.counters.evaluations, 0);
      return;
    }
    const Result run = Watched(&chain, start, Tolerance(1e-8));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    ExpectSound(chain, start, run);
    EXPECT_LE(run.summary.cost, least_cost_ + 1e-9 * run.summary.initial_cost);
    // |x - s| <= |g| / lambda_min, lambda_min >= 1.
    EXPECT_LE(
        (Eigen::Map<const Eigen::VectorXd>(run.x.data(), n) - chain.solution())
            .norm(),
        std::sqrt(n) * run.summary.max_gradient);
  }
}

TEST_P(WatchedConformance, Rosenbrock) {
  Rosenbrock f;
  if (!Supports(spec(), f)) return;
  const Result run = Watched(&f, kRosenbrockStart, Tolerance(1e-8));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  ExpectSound(f, kRosenbrockStart, run);
  EXPECT_NEAR(run.x[0], 1.0, 1e-4);
  EXPECT_NEAR(run.x[1], 1.0, 1e-4);
}

// Without scales a length is not known; an absolute tolerance ends the run.
TEST_P(WatchedConformance, FunctionWithoutScales) {
  Quadratic quadratic(20, 1e2);
  Unscaled f(&quadratic);
  if (!Supports(spec(), f)) return;
  SolveOptions options = Tolerance(1e-8);
  options.absolute_tolerance = 1e-5;
  const std::vector<double> start(20, 0.0);
  const Result run = Watched(&f, start, options);
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  ExpectSound(f, start, run);
}

// The relative tolerance of such a function is 0.
TEST_P(WatchedConformance, FunctionWithoutScalesNorTolerance) {
  Quadratic quadratic(20, 1e2);
  Unscaled f(&quadratic);
  if (!Supports(spec(), f)) return;
  SolveOptions options;
  options.max_evaluations = 3000;
  const std::vector<double> start(20, 0.0);
  const Result run = Watched(&f, start, options);
  ExpectSound(f, start, run);
  EXPECT_LE(run.summary.max_gradient, 1e-6);
}

TEST_P(WatchedConformance, UnboundedFunctionEndsByBudget) {
  for (const bool has_scales : {true, false}) {
    Linear f(has_scales);
    if (!Supports(spec(), f)) return;
    for (const int budget : {50, 1000}) {
      SolveOptions options;
      options.max_evaluations = budget;
      const std::vector<double> start = {0.5, 0.25, 1.0};
      // Not Watched(): points beyond the largest number are counted, too.
      const Result run = Minimize(spec(), &f, start, options);
      EXPECT_FALSE(run.summary.Succeeded()) << run.summary.BriefReport();
      ExpectSound(f, start, run);
      EXPECT_LE(run.summary.counters.evaluations, budget);
      if (traits().foreign) continue;
      EXPECT_LT(run.summary.cost, run.summary.initial_cost);
    }
  }
}

// Variables far from zero: the origin moves, and nothing else does.
TEST_P(WatchedConformance, RebasesWhereRoundingLimits) {
  Quadratic quadratic(20, 1e2);
  Offset f(&quadratic, 1e8, /*can_rebase=*/true);
  if (!Supports(spec(), f)) return;
  const std::vector<double> start(20, 1e8);
  const Result run = Watched(&f, start, Tolerance(1e-12));
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  EXPECT_GE(run.summary.counters.rebases, 1);
  EXPECT_LE(run.summary.counters.rebases, 3);
  ExpectSound(f, run.x, run);
  if (traits().foreign) return;
  // Histories are kept: not many more iterations than from an origin of zero,
  // but for those that the rounding of 1e8 makes before.
  const Result plain = Minimize(
      spec(), &quadratic, std::vector<double>(20, 0.0), Tolerance(1e-12));
  EXPECT_LE(run.summary.counters.iterations,
            1.3 * plain.summary.counters.iterations + 30);
}

TEST_P(WatchedConformance, NoRebaseWhereNoneIsPossible) {
  Quadratic quadratic(20, 1e2);
  Offset f(&quadratic, 1e8);
  if (!Supports(spec(), f)) return;
  const std::vector<double> start(20, 1e8);
  SolveOptions options = Tolerance(1e-12);
  options.max_evaluations = 5000;
  const Result run = Watched(&f, start, options);
  EXPECT_EQ(run.summary.counters.rebases, 0);
  ExpectSound(f, start, run);
  EXPECT_LE(run.summary.max_gradient, 1e-5 * run.summary.scales.gradient);
}

// ---- functions that misbehave -----------------------------------------------

// NaN in one evaluation: taken back, or said.
TEST_P(WatchedConformance, NanOnce) {
  for (int bad = 2; bad <= 9; ++bad) {
    SCOPED_TRACE(bad);
    Chain chain(20, 1e2);
    if (!Supports(spec(), chain)) return;
    const std::vector<double> start(20, 0.0);
    const Result run = Watched(
        &chain,
        start,
        Tolerance(1e-8),
        [bad](int evaluation, const double*, double* cost, double* gradient) {
          if (evaluation != bad) return true;
          if (bad % 2 == 0) *cost = kNan;
          if (gradient != nullptr) gradient[7] = kNan;
          return true;
        });
    ExpectSound(chain, start, run);
    if (run.summary.Succeeded()) continue;
    EXPECT_TRUE(traits().foreign) << run.summary.BriefReport();
    EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
  }
}

// NaN from the third evaluation on.
TEST_P(WatchedConformance, NanFromTheThirdEvaluationOn) {
  Chain chain(20, 1e2);
  if (!Supports(spec(), chain)) return;
  const std::vector<double> start(20, 0.0);
  SolveOptions options = Tolerance(1e-8);
  options.max_evaluations = 2000;
  const Result run =
      Watched(&chain,
              start,
              options,
              [](int evaluation, const double*, double*, double* gradient) {
                if (evaluation >= 3 && gradient != nullptr) gradient[17] = kNan;
                return true;
              });
  ExpectSound(chain, start, run);
  if (traits().solves_quadratics && run.summary.counters.evaluations < 3) {
    EXPECT_TRUE(run.summary.Succeeded());
    return;
  }
  EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED)
      << run.summary.BriefReport();
  EXPECT_EQ(run.summary.message, "gradient[17] = nan at evaluation 3");
}

TEST_P(WatchedConformance, NanAtTheStart) {
  Chain chain(20, 1e2);
  if (!Supports(spec(), chain)) return;
  const std::vector<double> start(20, 0.25);
  const Result run = Watched(
      &chain, start, {}, [](int, const double*, double*, double* gradient) {
        if (gradient != nullptr) gradient[5] = -kInfinity;
        return true;
      });
  EXPECT_EQ(run.summary.reason, StopReason::EVALUATION_FAILED);
  EXPECT_EQ(run.summary.message, "gradient[5] = -inf at evaluation 1");
  EXPECT_TRUE(SameBits(run.x, start));
}

// f whose scales say that it is softer than it is: first steps are too long.
class Soft : public Chain {
 public:
  using Chain::Chain;
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    Chain::EvaluateWithScales(x, cost, gradient, scales);
    if (scales != nullptr) scales->length *= 1e4;
    return true;
  }
};

// Not defined, or infinite, outside of a valley that the start is at the rim
// of. Every descent stays inside; a step that is too long does not.
TEST_P(WatchedConformance, RegionThatIsNotDefined) {
  for (const bool refuses : {true, false}) {
    SCOPED_TRACE(refuses ? "refuses" : "infinite");
    Soft f(20, 1e2);
    if (!Supports(spec(), f)) return;
    const std::vector<double> start(20, 0.0);
    const double rim = CostAt(f, start) * (1.0 + 1e-6);
    int hits = 0;
    const Result run = Watched(&f,
                               start,
                               Tolerance(1e-8),
                               [&](int, const double*, double* cost, double*) {
                                 if (*cost <= rim) return true;
                                 ++hits;
                                 *cost = kInfinity;
                                 return !refuses;
                               });
    ExpectSound(f, start, run);
    if (Contains(spec(), "preconditioner=none") &&
        !traits().solves_quadratics) {
      EXPECT_GT(hits, 0);
    }
    if (traits().foreign) continue;
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
  }
}

// A wall across the way down: the best point before it is returned.
TEST_P(WatchedConformance, WallAcrossTheWay) {
  Chain chain(20, 1e2);
  if (!Supports(spec(), chain)) return;
  const std::vector<double> start(20, 0.0);
  SolveOptions options = Tolerance(1e-8);
  options.max_evaluations = 30000;
  const Result run = Watched(
      &chain, start, options, [&](int, const double* x, double*, double*) {
        return x[0] < 0.5 * chain.solution()[0];
      });
  ExpectSound(chain, start, run);
  EXPECT_FALSE(run.summary.Succeeded());
  if (traits().foreign) return;
  EXPECT_LT(run.x[0], 0.5 * chain.solution()[0]);
  EXPECT_LT(run.summary.cost, run.summary.initial_cost);
}

// ---- budgets ----------------------------------------------------------------

TEST_P(WatchedConformance, EvaluationsAreNotExceeded) {
  Chain chain(20, 1e4);
  if (!Supports(spec(), chain)) return;
  const std::vector<double> start(20, 0.0);
  for (const int budget : {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 15, 20, 33}) {
    SCOPED_TRACE(budget);
    SolveOptions options;
    options.relative_tolerance = 1e-14;
    options.max_evaluations = budget;
    const Result run = Watched(&chain, start, options);
    if (run.summary.Succeeded()) break;
    EXPECT_EQ(run.summary.reason, StopReason::MAX_EVALUATIONS);
    EXPECT_EQ(run.summary.counters.evaluations, budget);
    ExpectSound(chain, start, run);
    if (traits().foreign) continue;
    EXPECT_EQ(SameBits(run.x, start), budget == 1) << run.summary.BriefReport();
  }
}

// Also where preconditioners and new origins take evaluations.
TEST_P(WatchedConformance, EvaluationsAreNotExceededOnAPacking) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(1.001);
  for (int budget = 1; budget <= 40; ++budget) {
    SCOPED_TRACE(budget);
    const auto energy = MakeEnergy(packing, 2.0);
    if (!Supports(spec(), *energy)) return;
    SolveOptions options;
    options.relative_tolerance = 1e-15;
    options.max_evaluations = budget;
    const std::vector<double> start(energy->NumParameters(), 0.0);
    const Result run = Minimize(spec(), energy.get(), start, options);
    EXPECT_LE(run.summary.counters.evaluations, budget);
    ExpectSound(*energy, start, run);
    if (traits().small_loads_only &&
        run.summary.reason == StopReason::NO_PROGRESS) {
      break;
    }
    EXPECT_EQ(run.summary.reason, StopReason::MAX_EVALUATIONS);
  }
}

TEST_P(WatchedConformance, IterationsAreNotExceeded) {
  Chain chain(20, 1e4);
  if (!Supports(spec(), chain)) return;
  const std::vector<double> start(20, 0.0);
  for (const int budget : {0, 1, 2, 5}) {
    SolveOptions options;
    options.relative_tolerance = 1e-15;
    options.max_iterations = budget;
    const Result run = Watched(&chain, start, options);
    if (run.summary.Succeeded()) break;
    EXPECT_EQ(run.summary.reason, StopReason::MAX_ITERATIONS);
    EXPECT_EQ(run.summary.counters.iterations, budget);
    ExpectSound(chain, start, run);
    EXPECT_EQ(SameBits(run.x, start), budget == 0);
  }
}

TEST_P(WatchedConformance, NoTimeAtAll) {
  Chain chain(20, 1e4);
  if (!Supports(spec(), chain)) return;
  SolveOptions options;
  options.max_seconds = 0.0;
  const std::vector<double> start(20, 0.0);
  const Result run = Watched(&chain, start, options);
  EXPECT_EQ(run.summary.reason, StopReason::MAX_SECONDS);
  EXPECT_EQ(run.summary.counters.evaluations, 1);
  EXPECT_TRUE(SameBits(run.x, start));
  ExpectSound(chain, start, run);
}

TEST_P(WatchedConformance, CallbackStopsAndSeesWhatThereIs) {
  Chain chain(20, 1e4);
  if (!Supports(spec(), chain)) return;
  for (const int stop : {0, 1, 4}) {
    SolveOptions options;
    options.relative_tolerance = 1e-15;
    int calls = 0;
    options.callback = [&](const IterationState& state) {
      EXPECT_EQ(state.counters.iterations, calls);
      const std::vector<double> x(state.x, state.x + state.num_parameters);
      EXPECT_TRUE(SameBits(state.cost, CostAt(chain, x)));
      EXPECT_TRUE(SameBits(state.max_gradient, MaxGradientAt(chain, x)));
      return ++calls <= stop;
    };
    const std::vector<double> start(20, 0.0);
    const Result run = Watched(&chain, start, options);
    if (traits().solves_quadratics && run.summary.Succeeded()) break;
    EXPECT_EQ(run.summary.reason, StopReason::CALLBACK)
        << run.summary.BriefReport();
    EXPECT_EQ(run.summary.counters.iterations, stop);
    EXPECT_EQ(calls, stop + 1);
    ExpectSound(chain, start, run);
  }
}

}  // namespace
}  // namespace granopt
