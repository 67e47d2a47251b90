#include "solvers/ceres_line_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "ceres/gradient_problem.h"
#include "ceres/iteration_callback.h"
#include "ceres/version.h"
#include "solvers/line_search.h"
#include "solvers/monitor.h"
#include "solvers/power_of_two.h"
#include "solvers/quiet_log.h"

namespace granopt {
namespace {

// Why our callback made Ceres return.
enum class Interruption { NONE, STOPPED, REBASE, RESCALE };

struct Units {
  double cost = 1.0;    // C
  double length = 1.0;  // L
};

// C f(L y), counted by the monitor; with an anchor, C (f(L y) - f(start)), see
// `differences` in the header.
class ScaledFunction : public ceres::FirstOrderFunction {
 public:
  ScaledFunction(Monitor* monitor, const Units& units, const CostAnchor* anchor)
      : monitor_(monitor), units_(units), anchor_(anchor), x_(monitor->n()) {}

  bool Evaluate(const double* const y,
                double* cost,
                double* gradient) const override {
    const int n = monitor_->n();
    for (int i = 0; i < n; ++i) x_[i] = units_.length * y[i];
    // A line search cannot be interrupted but by a point that does not exist.
    if (!monitor_->IsCached(x_.data()) &&
        (monitor_->stopped() || monitor_->BudgetSpent())) {
      return false;
    }
    const double* g;
    Scales scales;
    if (!monitor_->EvaluateCached(x_.data(), cost, &g, &scales)) return false;
    if (anchor_ != nullptr) {
      const double change =
          anchor_->Change(x_.data(), *cost, g, scales.epsilon);
      *cost = anchor_->told + change * units_.cost;
    } else {
      *cost *= units_.cost;
    }
    if (gradient != nullptr) {
      const double factor = units_.cost * units_.length;
      for (int i = 0; i < n; ++i) gradient[i] = factor * g[i];
    }
    return true;
  }

  int NumParameters() const override { return monitor_->n(); }

 private:
  Monitor* monitor_;
  const Units units_;
  const CostAnchor* anchor_;  // may be null
  mutable std::vector<double> x_;
};

class Callback : public ceres::IterationCallback {
 public:
  Callback(Monitor* monitor,
           const Units& units,
           const double* y,
           CostAnchor* anchor,
           bool rescales)
      : monitor_(monitor),
        units_(units),
        y_(y),
        anchor_(anchor),
        rescales_(rescales),
        x_(monitor->n()) {
    for (int i = 0; i < monitor->n(); ++i) x_[i] = units.length * y[i];
  }

  ceres::CallbackReturnType operator()(
      const ceres::IterationSummary& summary) override {
    // The start, which is no new iterate.
    if (summary.iteration == 0) return ceres::SOLVER_CONTINUE;
    if (AcceptCurrent()) return Interrupt(Interruption::STOPPED);
    if (monitor_->WantsRebase() && monitor_->Rebase(x_.data())) {
      return Interrupt(Interruption::REBASE);
    }
    // In these units the active terms are about one length unit each.
    if (rescales_ && monitor_->scales().length > 0.0 &&
        monitor_->scales().length < std::exp2(-10) * units_.length) {
      return Interrupt(Interruption::RESCALE);
    }
    monitor_->Recenter(x_.data());
    if (anchor_ != nullptr) anchor_->told = summary.cost;
    return ceres::SOLVER_CONTINUE;
  }

  // Hands Ceres' current point to the monitor; true if the run must stop.
  bool AcceptCurrent() {
    for (int i = 0; i < monitor_->n(); ++i) x_[i] = units_.length * y_[i];
    double cost;
    const double* gradient;
    Scales scales;
    if (!monitor_->EvaluateCached(x_.data(), &cost, &gradient, &scales)) {
      monitor_->FailEvaluation();
      return true;
    }
    if (anchor_ != nullptr) {
      anchor_->x = x_;
      anchor_->gradient.assign(gradient, gradient + monitor_->n());
      anchor_->cost = cost;
    }
    return monitor_->Accept(x_.data(), cost, gradient, scales);
  }

  // True if Ceres' current point is not the last one accepted.
  bool HasMoved() const {
    for (int i = 0; i < monitor_->n(); ++i) {
      if (units_.length * y_[i] != x_[i]) return true;
    }
    return false;
  }

  Interruption interruption() const { return interruption_; }

 private:
  ceres::CallbackReturnType Interrupt(Interruption why) {
    interruption_ = why;
    return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }

  Monitor* monitor_;
  const Units units_;
  const double* y_;     // kept current by update_state_every_iteration
  CostAnchor* anchor_;  // may be null
  const bool rescales_;
  std::vector<double> x_;
  Interruption interruption_ = Interruption::NONE;
};

// Ceres 2.1 and 2.2 take ownership of a raw pointer, later versions of a
// unique_ptr.
std::unique_ptr<ceres::GradientProblem> MakeProblem(
    std::unique_ptr<ceres::FirstOrderFunction> function) {
#if CERES_VERSION_MAJOR > 2 || \
    (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 3)
  return std::make_unique<ceres::GradientProblem>(std::move(function));
#else
  return std::make_unique<ceres::GradientProblem>(function.release());
#endif
}

// See the header for what these units are for.
Units ChooseUnits(const Monitor& monitor, const Scales& scales) {
  Units units;
  units.length = PowerOfTwo(scales.length);
  const double target = monitor.Tolerance(scales);
  units.cost = PowerOfTwo(1.0 / std::max(target, 1e-15 * scales.gradient)) /
               units.length;
  return units;
}

}  // namespace

CeresLineSearch::CeresLineSearch(Parameters* parameters)
    : scaled_(parameters->Bool(
          "scaled",
          false,
          "cost and lengths by powers of two, eigenvalue scaling on")),
      differences_(parameters->Bool(
          "differences",
          false,
          "small cost differences from gradients; wants restarts > 0")),
      restarts_(parameters->Int(
          "restarts",
          0,
          0,
          "how often to start afresh where Ceres gives up, while that helps")) {
  ceres_options_.logging_type = ceres::SILENT;
  ceres_options_.max_num_iterations = std::numeric_limits<int>::max();
  ceres_options_.max_solver_time_in_seconds =
      std::numeric_limits<double>::max();
  ceres_options_.function_tolerance = 0.0;
  ceres_options_.gradient_tolerance = 0.0;
  ceres_options_.parameter_tolerance = 0.0;
  ceres_options_.update_state_every_iteration = true;
  if (scaled_) {
    ceres_options_.use_approximate_eigenvalue_bfgs_scaling = true;
    // Must be positive; the default 1e-9 is absolute.
    ceres_options_.min_line_search_step_size = 1e-300;
  }
}

Summary CeresLineSearch::Minimize(FirstOrderFunction* function,
                                  const SolveOptions& options,
                                  double* x) const {
  Monitor monitor(function, options, name(), Monitor::Cache::LAST_EVALUATION);
  const int n = monitor.n();
  const QuietLog quiet;

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
    const Units units = scaled_ ? ChooseUnits(monitor, scales) : Units();
    for (int i = 0; i < n; ++i) y[i] = x[i] / units.length;
    CostAnchor anchor;
    if (differences_) {
      anchor.x.assign(x, x + n);
      anchor.gradient.assign(gradient, gradient + n);
      anchor.cost = cost;
    }
    CostAnchor* const used_anchor = differences_ ? &anchor : nullptr;
    Callback callback(&monitor, units, y.data(), used_anchor, scaled_);
    ceres::GradientProblemSolver::Options run_options = ceres_options_;
    run_options.callbacks.push_back(&callback);
    const std::unique_ptr<ceres::GradientProblem> problem = MakeProblem(
        std::make_unique<ScaledFunction>(&monitor, units, used_anchor));
    ceres::GradientProblemSolver::Summary ceres_summary;
    ceres::Solve(run_options, *problem, y.data(), &ceres_summary);

    // Ceres may have returned, with a last step that its own tests accepted,
    // before it called back.
    if (callback.interruption() == Interruption::NONE && !monitor.stopped()) {
      if (ceres_summary.IsSolutionUsable() && callback.HasMoved()) {
        callback.AcceptCurrent();
      }
    }
    if (monitor.stopped()) break;

    const double residual = monitor.max_gradient();
    for (int i = 0; i < n; ++i) x[i] = units.length * y[i];
    switch (callback.interruption()) {
      case Interruption::REBASE:
        std::fill(x, x + n, 0.0);
        break;
      case Interruption::RESCALE:
        break;
      default:
        if (monitor.LastEvaluationFailed()) {
          monitor.FailEvaluation();
          return monitor.Finish(x);
        }
        if (monitor.Refine(x)) break;
        // A fresh history helps only while it still gains something.
        if (restarts_left == 0 || residual > 0.5 * residual_before) {
          monitor.GiveUp("Ceres: " + ceres_summary.message);
          return monitor.Finish(x);
        }
        --restarts_left;
        residual_before = residual;
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
