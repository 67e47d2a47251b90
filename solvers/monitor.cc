#include "solvers/monitor.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "glog/logging.h"
#include "solvers/format.h"
#include "solvers/vector_loops.h"

namespace granopt {
namespace {

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// Costs that agree to 1e-10, or so many Scales::epsilon, are told apart by
// their gradients: the relative roundoff of a sum of n positive terms is far
// below that, and no method gains more than that by staying at the point of
// larger gradient.
constexpr double kCostRoundoff = 1e-10;
constexpr double kCostRoundoffs = 16.0;

// Entries of a gradient are off by so many Scales::epsilon of its scale at most
// where the function is evaluated with care; what has converged shall have so
// for a judge of more digits, too.
constexpr double kGradientRoundoff = 16.0;

// A run has got all there is when it has found no better point in so many
// iterations, and the gradient is so many rounding errors of its terms ...
constexpr std::int64_t kPatienceAtRoundoff = 200;
constexpr double kRoundoff = 20.0;
// ... or, whatever the gradient is, in so many.
constexpr std::int64_t kPatience = 10000;

// Index of the first entry that is not finite.
int FirstNotFinite(const double* v, int n) {
  int i = 0;
  while (i < n - 1 && std::isfinite(v[i])) ++i;
  return i;
}

}  // namespace

const char* StopReasonName(StopReason reason) {
  switch (reason) {
    case StopReason::CONVERGED:
      return "CONVERGED";
    case StopReason::VANISHED:
      return "VANISHED";
    case StopReason::MAX_ITERATIONS:
      return "MAX_ITERATIONS";
    case StopReason::MAX_EVALUATIONS:
      return "MAX_EVALUATIONS";
    case StopReason::MAX_SECONDS:
      return "MAX_SECONDS";
    case StopReason::MAX_MEMORY:
      return "MAX_MEMORY";
    case StopReason::CALLBACK:
      return "CALLBACK";
    case StopReason::NO_PROGRESS:
      return "NO_PROGRESS";
    case StopReason::EVALUATION_FAILED:
      return "EVALUATION_FAILED";
    case StopReason::UNSUPPORTED:
      return "UNSUPPORTED";
  }
  return "UNKNOWN";
}

std::string Summary::BriefReport() const {
  return Format("%s: %s after %lld iterations, %lld evaluations, %.3g s: %s",
                solver.c_str(),
                StopReasonName(reason),
                static_cast<long long>(counters.iterations),
                static_cast<long long>(counters.evaluations),
                seconds,
                message.c_str());
}

std::string Summary::FullReport() const {
  const auto relation = [](double left, double right) {
    return left <= right ? "<=" : "> ";
  };
  std::string report = Format("%s: %s\n  %s\n",
                              solver.c_str(),
                              StopReasonName(reason),
                              message.c_str());
  report += Format("  |g|            %.3e %s %.3e\n",
                   max_gradient,
                   relation(max_gradient, tolerance),
                   tolerance);
  if (scales.gradient > 0) {
    report += Format("  |g| / scale    %.3e   (scale %.3e)\n",
                     max_gradient / scales.gradient,
                     scales.gradient);
  }
  report +=
      Format("  cost           %.10e   (from %.10e)\n", cost, initial_cost);
  report += Format(
      "  work           %lld iterations, %lld evaluations, %lld Hessians, "
      "%lld factorizations\n",
      static_cast<long long>(counters.iterations),
      static_cast<long long>(counters.evaluations),
      static_cast<long long>(counters.hessians),
      static_cast<long long>(counters.factorizations));
  report += Format(
      "  time           %.3g s, %.0f %% of it in the function, %.0f %% in "
      "linear "
      "algebra\n",
      seconds,
      seconds > 0 ? 100.0 * function_seconds / seconds : 0.0,
      seconds > 0 ? 100.0 * linear_seconds / seconds : 0.0);
  return report;
}

Monitor::Monitor(FirstOrderFunction* function,
                 const SolveOptions& options,
                 std::string solver_name,
                 Cache cache)
    : function_(function),
      options_(options),
      n_(function->NumParameters()),
      start_(std::chrono::steady_clock::now()),
      solver_name_(std::move(solver_name)),
      cache_(cache),
      cache_x_(cache == Cache::NONE ? 0 : n_),
      cache_gradient_(cache == Cache::NONE ? 0 : n_),
      best_x_(n_) {}

double Monitor::Seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() -
                                       start_)
      .count();
}

double Monitor::Tolerance(const Scales& scales) const {
  return options_.absolute_tolerance > 0.0
             ? options_.absolute_tolerance
             : options_.relative_tolerance * scales.gradient;
}

bool Monitor::Begin(const Solver& solver,
                    const double* x,
                    double* cost,
                    double* gradient,
                    Scales* scales) {
  std::string why;
  if (!solver.Supports(*function_, &why)) {
    Refuse(why);
    return false;
  }
  if (!Evaluate(x, cost, gradient, scales)) {
    FailEvaluation();
    return false;
  }
  return !Accept(x, *cost, gradient, *scales);
}

bool Monitor::BeginCached(const Solver& solver,
                          const double* x,
                          double* cost,
                          const double** gradient,
                          Scales* scales) {
  std::string why;
  if (!solver.Supports(*function_, &why)) {
    Refuse(why);
    return false;
  }
  if (!EvaluateCached(x, cost, gradient, scales)) {
    FailEvaluation();
    return false;
  }
  return !Accept(x, *cost, *gradient, *scales);
}

bool Monitor::Evaluate(const double* x,
                       double* cost,
                       double* gradient,
                       Scales* scales) {
  ++counters_.evaluations;
  // Of failures in a row the first is named.
  const auto fail = [this](const std::string& what) {
    if (not_finite_.empty()) not_finite_ = what;
    return false;
  };
  const auto named = [&](const char* what, double value) {
    return fail(Format("%s = %g at evaluation %lld",
                       what,
                       value,
                       static_cast<long long>(counters_.evaluations)));
  };
  evaluated_ = {};
  const double max_x = MaxNorm(n_, x);
  if (!std::isfinite(max_x)) {
    const int bad = FirstNotFinite(x, n_);
    return named(Format("x[%d]", bad).c_str(), x[bad]);
  }

  const double before = Seconds();
  Scales here;
  const bool defined = function_->EvaluateWithScales(x, cost, gradient, &here);
  function_seconds_ += Seconds() - before;
  if (scales != nullptr) *scales = here;
  if (gradient != nullptr) {
    cache_valid_ = false;
  }
  if (!defined) {
    return fail(Format("the function refused evaluation %lld",
                       static_cast<long long>(counters_.evaluations)));
  }
  if (!std::isfinite(*cost)) return named("cost", *cost);
  if (gradient != nullptr) {
    const double max_gradient = MaxNorm(n_, gradient);
    if (!std::isfinite(max_gradient)) {
      const int bad = FirstNotFinite(gradient, n_);
      return named(Format("gradient[%d]", bad).c_str(), gradient[bad]);
    }
    evaluated_ = {x, gradient, max_x, max_gradient};
  }
  not_finite_.clear();
  if (gradient == nullptr || cache_ == Cache::NONE) return true;
  std::copy(x, x + n_, cache_x_.begin());
  std::copy(gradient, gradient + n_, cache_gradient_.begin());
  cache_cost_ = *cost;
  cache_scales_ = here;
  cache_valid_ = true;
  return true;
}

bool Monitor::IsCached(const double* x) const {
  return cache_valid_ &&
         std::memcmp(x, cache_x_.data(), sizeof(double) * n_) == 0;
}

bool Monitor::EvaluateCached(const double* x,
                             double* cost,
                             const double** gradient,
                             Scales* scales) {
  CHECK(cache_ != Cache::NONE) << solver_name_ << " keeps no evaluation";
  if (!IsCached(x)) {
    scratch_.resize(n_);
    if (!Evaluate(x, cost, scratch_.data(), scales)) return false;
  }
  *cost = cache_cost_;
  *gradient = cache_gradient_.data();
  *scales = cache_scales_;
  return true;
}

double Monitor::CostRoundoff() const {
  return std::max(kCostRoundoff, kCostRoundoffs * last_scales_.epsilon) *
         std::abs(least_cost_);
}

bool Monitor::IsAbove(double cost) const {
  return cost > least_cost_ + CostRoundoff();
}

bool Monitor::IsBetter(double cost, double max_gradient) {
  if (cost < least_cost_ - CostRoundoff()) return true;
  return !IsAbove(cost) && max_gradient < best_max_gradient_;
}

bool Monitor::Accept(const double* x,
                     double cost,
                     const double* gradient,
                     const Scales& scales) {
  const double max_gradient = gradient == evaluated_.gradient
                                  ? evaluated_.max_gradient
                                  : MaxNorm(n_, gradient);
  if (started_) ++counters_.iterations;
  last_max_gradient_ = max_gradient;
  last_max_x_ = x == evaluated_.x ? evaluated_.max_x : MaxNorm(n_, x);
  last_scales_ = scales;
  if (!(scales.gradient > 0.0 && scales.length > 0.0)) {
    double square = 0.0;
    for (int i = 0; i < n_; ++i) square += gradient[i] * gradient[i];
    const double unit = std::abs(cost) / square;
    last_step_unit_ = unit > 0.0 && std::isfinite(unit) ? unit : 1.0;
  }
  if (!started_) initial_cost_ = cost;
  const bool is_first = !started_ || is_refined_;
  is_refined_ = false;
  if (is_first || IsBetter(cost, max_gradient)) {
    CopyVector(n_, x, best_x_.data());
    best_cost_ = cost;
    best_max_gradient_ = max_gradient;
    best_scales_ = scales;
    best_iteration_ = counters_.iterations;
  }
  least_cost_ = is_first ? cost : std::min(least_cost_, cost);
  started_ = true;
  if (options_.record_trace) {
    trace_.push_back({counters_.iterations,
                      counters_.evaluations,
                      cost,
                      max_gradient,
                      scales.gradient,
                      scales.vanishing,
                      Seconds(),
                      /*method=*/{}});
  }

  const auto iterations = static_cast<long long>(counters_.iterations);
  const double tolerance = Tolerance(scales);
  const double margin =
      options_.absolute_tolerance > 0.0
          ? 0.0
          : std::min(kGradientRoundoff * scales.epsilon * scales.gradient,
                     0.1 * tolerance);
  if (cost == 0.0 && max_gradient == 0.0) {
    Stop(StopReason::VANISHED,
         Format("cost = 0 exactly after %lld iterations", iterations));
  } else if (scales.vanishing <= options_.vanishing_tolerance) {
    Stop(StopReason::VANISHED,
         Format("dimensionless size = %.2e <= %.2e after %lld iterations",
                scales.vanishing,
                options_.vanishing_tolerance,
                iterations));
  } else if (max_gradient <= tolerance - margin && !IsAbove(cost)) {
    Stop(StopReason::CONVERGED,
         Format("|g| = %.2e <= %.2e after %lld iterations",
                max_gradient,
                tolerance,
                iterations));
  } else if (options_.callback && !options_.callback({x,
                                                      gradient,
                                                      n_,
                                                      cost,
                                                      max_gradient,
                                                      scales,
                                                      counters_,
                                                      Seconds(),
                                                      function_seconds_,
                                                      linear_seconds_})) {
    Stop(
        StopReason::CALLBACK,
        Format("stopped by the caller, |g| = %.2e > %.2e after %lld iterations",
               max_gradient,
               tolerance,
               iterations));
  } else if (counters_.iterations >= options_.max_iterations) {
    Stop(
        StopReason::MAX_ITERATIONS,
        Format("|g| = %.2e > %.2e after %lld iterations, all that were allowed",
               max_gradient,
               tolerance,
               iterations));
  } else if (!BudgetSpent()) {
    const std::int64_t since = counters_.iterations - best_iteration_;
    const bool at_roundoff =
        since >= kPatienceAtRoundoff && best_max_gradient_ <= Roundoff();
    if ((at_roundoff || since >= kPatience) && scales.refine_below > 0.0) {
      last_scales_.refine_below = std::numeric_limits<double>::infinity();
    } else if (at_roundoff) {
      GiveUp(
          Format("none of the last %lld was better, and |g| is within its "
                 "roundoff, %.1e",
                 static_cast<long long>(since),
                 Roundoff()));
    } else if (since >= kPatience) {
      GiveUp(Format("none of the last %lld was better",
                    static_cast<long long>(since)));
    }
  }
  return stopped_;
}

double Monitor::Roundoff() const {
  const Scales& s = last_scales_;
  if (!(s.gradient > 0.0 && s.length > 0.0)) return 0.0;
  return kRoundoff * (s.epsilon * s.gradient +
                      kEpsilon * last_max_x_ * (s.gradient / s.length));
}

bool Monitor::BudgetSpent() {
  if (stopped_) return true;
  if (counters_.evaluations >= options_.max_evaluations) {
    Stop(StopReason::MAX_EVALUATIONS,
         Format(
             "|g| = %.2e > %.2e after %lld evaluations, all that were allowed",
             last_max_gradient_,
             Tolerance(last_scales_),
             static_cast<long long>(counters_.evaluations)));
  } else if (Seconds() >= options_.max_seconds) {
    Stop(StopReason::MAX_SECONDS,
         Format("|g| = %.2e > %.2e after %.3g s >= %.3g s",
                last_max_gradient_,
                Tolerance(last_scales_),
                Seconds(),
                options_.max_seconds));
  }
  return stopped_;
}

void Monitor::GiveUp(const std::string& why) {
  Stop(StopReason::NO_PROGRESS,
       Format("|g| = %.2e > %.2e after %lld iterations: ",
              best_max_gradient_,
              Tolerance(best_scales_),
              static_cast<long long>(counters_.iterations)) +
           why);
}

void Monitor::Refuse(const std::string& why) {
  Stop(StopReason::UNSUPPORTED, why);
}

void Monitor::RunOutOfMemory(const std::string& why) {
  Stop(StopReason::MAX_MEMORY,
       Format("|g| = %.2e > %.2e after %lld iterations: ",
              best_max_gradient_,
              Tolerance(best_scales_),
              static_cast<long long>(counters_.iterations)) +
           why);
}

void Monitor::FailEvaluation(const std::string& what) {
  Stop(StopReason::EVALUATION_FAILED,
       !not_finite_.empty() ? not_finite_
       : !what.empty()      ? what
                            : "the function could not be evaluated");
}

double Monitor::StepUnit() const {
  const Scales& s = last_scales_;
  return s.gradient > 0.0 && s.length > 0.0 ? s.length / s.gradient
                                            : last_step_unit_;
}

void Monitor::Stop(StopReason reason, std::string message) {
  // A budget that ran out on the way to a point that has converged did not
  // matter.
  const bool success =
      reason == StopReason::CONVERGED || reason == StopReason::VANISHED;
  if (stopped_ && !success) return;
  stopped_ = true;
  reason_ = reason;
  message_ = std::move(message);
}

void Monitor::Recenter(const double* x) {
  if (function_->Recenter(x)) ++counters_.recenters;
}

bool Monitor::WantsRefinement() const {
  return last_max_gradient_ < last_scales_.refine_below * last_scales_.gradient;
}

bool Monitor::WantsRebase(double step) const {
  if (!can_rebase_ || !(last_scales_.gradient > 0.0)) return false;
  // Rebasing costs an evaluation.
  if (counters_.evaluations >= options_.max_evaluations) return false;
  if (WantsRefinement()) return true;
  const double residual = last_max_gradient_ / last_scales_.gradient;
  return kEpsilon * last_max_x_ > 0.05 * step * residual * last_scales_.length;
}

bool Monitor::Rebase(double* x) {
  const std::vector<double> before(x, x + n_);
  if (!function_->Rebase(x)) {
    can_rebase_ = false;
    return false;
  }
  ++counters_.rebases;
  if (WantsRefinement() && function_->Refine()) {
    is_refined_ = true;
    last_scales_.epsilon = kEpsilon;
    last_scales_.refine_below = 0.0;
  }
  cache_valid_ = false;
  evaluated_ = {};
  last_max_x_ = 0.0;
  for (int i = 0; i < n_; ++i) best_x_[i] -= before[i];
  return true;
}

bool Monitor::Refine(double* x) {
  if (stopped_ || last_scales_.refine_below == 0.0) return false;
  last_scales_.refine_below = std::numeric_limits<double>::infinity();
  return Rebase(x);
}

Summary Monitor::Finish(double* x) {
  Summary summary;
  summary.solver = solver_name_;
  if (!stopped_) GiveUp("the method ended without a reason");
  if (started_) std::copy(best_x_.begin(), best_x_.end(), x);
  summary.reason = reason_;
  summary.message = message_;
  summary.initial_cost = initial_cost_;
  summary.cost = best_cost_;
  summary.max_gradient = best_max_gradient_;
  summary.scales = best_scales_;
  summary.tolerance = Tolerance(best_scales_);
  summary.counters = counters_;
  summary.seconds = Seconds();
  summary.function_seconds = function_seconds_;
  summary.linear_seconds = linear_seconds_;
  summary.trace = std::move(trace_);
  return summary;
}

}  // namespace granopt
