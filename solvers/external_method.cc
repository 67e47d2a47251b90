#include "solvers/external_method.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "solvers/power_of_two.h"

namespace granopt {

ExternalMethod::Problem::Problem(Monitor* monitor,
                                 const Scales& scales,
                                 double length,
                                 double cost,
                                 bool rescales,
                                 const double* x)
    : monitor_(monitor),
      length_unit_(length),
      cost_unit_(cost),
      least_length_(rescales ? std::exp2(-10) * scales.length : 0.0),
      least_gradient_(rescales ? std::exp2(-10) * scales.gradient : 0.0),
      x_(monitor->n()),
      accepted_(x, x + monitor->n()) {}

void ExternalMethod::Problem::SetX(const double* y) {
  for (int i = 0; i < n(); ++i) x_[i] = length_unit_ * y[i];
}

bool ExternalMethod::Problem::Evaluate(const double* y,
                                       double* cost,
                                       double* gradient) {
  if (interruption_ != Interruption::NONE) return false;
  SetX(y);
  for (const double v : x_) {
    if (!std::isfinite(v)) return Interrupt(Interruption::LOST);
  }
  if (!monitor_->IsCached(x_.data()) && monitor_->BudgetSpent()) {
    return Interrupt(Interruption::STOPPED);
  }
  const double* g;
  Scales scales;
  if (!monitor_->EvaluateCached(x_.data(), cost, &g, &scales)) {
    monitor_->FailEvaluation();
    return Interrupt(Interruption::STOPPED);
  }
  *cost *= cost_unit_;
  const double factor = cost_unit_ * length_unit_;
  for (int i = 0; i < n(); ++i) gradient[i] = factor * g[i];
  return true;
}

bool ExternalMethod::Problem::Accept(const double* y) {
  if (interruption_ != Interruption::NONE) return false;
  SetX(y);
  if (!monitor_->IsCached(x_.data()) && monitor_->BudgetSpent()) {
    return Interrupt(Interruption::STOPPED);
  }
  double cost;
  const double* gradient;
  Scales scales;
  if (!monitor_->EvaluateCached(x_.data(), &cost, &gradient, &scales)) {
    monitor_->FailEvaluation();
    return Interrupt(Interruption::STOPPED);
  }
  accepted_ = x_;
  if (monitor_->Accept(x_.data(), cost, gradient, scales)) {
    return Interrupt(Interruption::STOPPED);
  }
  if (monitor_->WantsRebase() && monitor_->Rebase(accepted_.data())) {
    return Interrupt(Interruption::REBASE);
  }
  if (scales.length > 0.0 && scales.gradient > 0.0 &&
      (scales.length < least_length_ || scales.gradient < least_gradient_)) {
    return Interrupt(Interruption::RESCALE);
  }
  monitor_->Recenter(x_.data());
  return true;
}

bool ExternalMethod::Problem::Fail(const char* what) {
  monitor_->FailEvaluation(what);
  return Interrupt(Interruption::STOPPED);
}

bool ExternalMethod::Problem::EvaluateHessian(const double* y,
                                              SparseMatrix* hessian) {
  if (interruption_ != Interruption::NONE) return false;
  SetX(y);
  ++monitor_->counters().hessians;
  const Monitor::LinearTimer timer(monitor_);
  const auto* function =
      dynamic_cast<const SecondOrderFunction*>(monitor_->function());
  if (function == nullptr || !function->EvaluateHessian(x_.data(), hessian)) {
    return Fail("the function refused its Hessian");
  }
  const double factor = cost_unit_ * length_unit_ * length_unit_;
  double probe = 0.0;
  for (int k = 0; k < hessian->nonZeros(); ++k) {
    hessian->valuePtr()[k] *= factor;
    probe += hessian->valuePtr()[k] - hessian->valuePtr()[k];
  }
  return probe == 0.0 || Fail("the Hessian is not finite");
}

// C k (L d)^alpha / alpha: the closure d in units of L takes a stiffness
// C k L^alpha, and its derivatives stay what they are.
bool ExternalMethod::Problem::EvaluateGaps(const double* y, Gaps* gaps) {
  if (interruption_ != Interruption::NONE) return false;
  SetX(y);
  const Monitor::LinearTimer timer(monitor_);
  const auto* function =
      dynamic_cast<const UnilateralFunction*>(monitor_->function());
  if (function == nullptr || !function->EvaluateGaps(x_.data(), gaps)) {
    return Fail("the function refused its gaps");
  }
  gaps->delta /= length_unit_;
  gaps->stiffness *= cost_unit_ * std::pow(length_unit_, function->Exponent());
  return (gaps->delta.allFinite() && gaps->stiffness.allFinite()) ||
         Fail("a gap is not finite");
}

ExternalMethod::ExternalMethod(Parameters* parameters)
    : scaled_(parameters->Bool(
          "scaled", false, "cost and lengths by powers of two")),
      restarts_(parameters->Int("restarts",
                                0,
                                0,
                                "how often to start afresh where the library "
                                "gives up, while that helps")) {}

Summary ExternalMethod::Minimize(FirstOrderFunction* function,
                                 const SolveOptions& options,
                                 double* x) const {
  using Interruption = Problem::Interruption;
  Monitor monitor(function, options, name(), Monitor::Cache::LAST_EVALUATION);
  const int n = monitor.n();
  double cost;
  const double* gradient;
  Scales scales;
  if (!monitor.BeginCached(*this, x, &cost, &gradient, &scales)) {
    return monitor.Finish(x);
  }
  monitor.Recenter(x);

  std::vector<double> y(n);
  int restarts_left = restarts_;
  double residual_before = std::numeric_limits<double>::infinity();
  while (!monitor.stopped()) {
    double length_unit = 1.0, cost_unit = 1.0;
    if (scaled_ && scales.gradient > 0.0 && scales.length > 0.0) {
      const double tolerance =
          std::max(monitor.Tolerance(scales) / scales.gradient, 1e-15);
      length_unit = PowerOfTwo(scales.length * RelativeLengthUnit(tolerance));
      cost_unit = PowerOfTwo(scales.length / scales.gradient) / length_unit /
                  length_unit;
    }
    for (int i = 0; i < n; ++i) y[i] = x[i] / length_unit;
    Problem problem(&monitor, scales, length_unit, cost_unit, scaled_, x);
    std::string words = Run(&problem, y.data());

    // It may have returned, after a last step that its own tests accepted,
    // before it told us.
    if (problem.interruption_ == Interruption::NONE) {
      problem.SetX(y.data());
      if (problem.x_ != problem.accepted_) problem.Accept(y.data());
    }
    if (monitor.stopped()) break;
    // Zero after a rebase.
    std::copy(problem.accepted_.begin(), problem.accepted_.end(), x);
    if (problem.interruption_ == Interruption::LOST) {
      words = "it asks for a point that is not finite";
    }
    if (problem.interruption_ == Interruption::NONE ||
        problem.interruption_ == Interruption::LOST) {
      // A fresh history helps only while it still gains something.
      const double residual = monitor.max_gradient();
      if (!monitor.Refine(x)) {
        if (restarts_left == 0 || residual > 0.5 * residual_before) {
          monitor.GiveUp(std::string(library()) + ": " + words);
          break;
        }
        --restarts_left;
        residual_before = residual;
      }
    }
    ++monitor.counters().restarts;
    monitor.Recenter(x);
    if (!monitor.EvaluateCached(x, &cost, &gradient, &scales)) {
      monitor.FailEvaluation();
    }
  }
  return monitor.Finish(x);
}

}  // namespace granopt
