#include "solvers/line_search_method.h"

#include <cmath>
#include <utility>

#include "Eigen/Core"
#include "solvers/monitor.h"

namespace granopt {

LineSearchMethod::LineSearchMethod(Parameters* parameters,
                                   const LineSearchOptions& line_search)
    : line_search_(line_search), preconditioner_(parameters) {}

bool LineSearchMethod::Supports(const FirstOrderFunction& function,
                                std::string* error) const {
  return preconditioner_.Supports(function, error);
}

Summary LineSearchMethod::Minimize(FirstOrderFunction* function,
                                   const SolveOptions& options,
                                   double* x_out) const {
  using Eigen::VectorXd;
  Monitor monitor(function, options, name());
  const int n = monitor.n();
  const std::unique_ptr<Preconditioner> preconditioner = preconditioner_.Make();
  const bool preconditioned = preconditioner != nullptr;
  const std::unique_ptr<DirectionRule> rule = MakeRule(n, preconditioned);

  VectorXd x = Eigen::Map<const VectorXd>(x_out, n);
  VectorXd g(n), d(n), s(n), x_trial(n), g_trial(n), x_kept(n), g_kept(n);
  VectorXd z_own(preconditioned ? n : 0), z_new_own(preconditioned ? n : 0);
  double cost = 0.0;
  Scales scales;
  if (!monitor.Begin(*this, x.data(), &cost, g.data(), &scales)) {
    return monitor.Finish(x_out);
  }
  monitor.Recenter(x.data());
  const auto solve = [&](const double* r, double* z) {
    preconditioner->Solve(r, z, &monitor);
  };
  if (preconditioned) {
    preconditioner->Update(
        {x.data(), cost, g.data(), scales}, nullptr, &monitor);
    solve(g.data(), z_own.data());
  }
  bool is_fresh = true;  // nothing is known but the gradient

  while (!monitor.stopped()) {
    const double* z = preconditioned ? z_own.data() : g.data();
    const double unit = preconditioned ? 1.0 : monitor.StepUnit();
    double first_step = rule->Direction(g.data(), z, unit, d.data());
    LinePoint start{0.0, cost, g.dot(d)};
    if (!(start.slope < 0.0) && !is_fresh) {
      rule->Forget();
      ++monitor.counters().restarts;
      is_fresh = true;
      first_step = rule->Direction(g.data(), z, unit, d.data());
      start.slope = g.dot(d);
    }
    if (!(start.slope < 0.0)) {
      monitor.GiveUp("steepest descent does not descend");
      break;
    }

    // The last trial, and the one that the search may come back to.
    double trial_step = 0.0, trial_cost = cost, kept_cost = cost;
    Scales trial_scales = scales, kept_scales = scales;
    const auto evaluate = [&](double step, LinePoint* p) {
      if (monitor.BudgetSpent()) return LineEvaluation::STOP;
      if (p->step > 0.0 && p->step == trial_step) {
        std::swap(x_kept, x_trial);
        std::swap(g_kept, g_trial);
        kept_cost = trial_cost;
        kept_scales = trial_scales;
      }
      trial_step = step;
      x_trial = x + step * d;
      if (!monitor.Evaluate(
              x_trial.data(), &trial_cost, g_trial.data(), &trial_scales)) {
        return LineEvaluation::NOT_FINITE;
      }
      *p = {step, trial_cost, g_trial.dot(d)};
      return LineEvaluation::OK;
    };
    const LineSearchResult found =
        SearchLine(evaluate, start, first_step, line_search_);
    // A stop inside the line search may leave a better point behind.
    if (monitor.stopped() && found.point.step == 0.0) break;
    if (found.point.step > 0.0 && !found.is_last) {
      std::swap(x_kept, x_trial);
      std::swap(g_kept, g_trial);
      trial_cost = kept_cost;
      trial_scales = kept_scales;
    }
    // Neither is a step that rounding takes away.
    if (found.point.step == 0.0 || x_trial == x) {
      if (monitor.LastEvaluationFailed()) {
        monitor.FailEvaluation();
      } else if (is_fresh) {
        monitor.GiveUp("no step along the steepest descent lowers the cost");
      } else {
        rule->Forget();
        ++monitor.counters().restarts;
        is_fresh = true;
      }
      continue;
    }
    s = x_trial - x;
    std::swap(x, x_trial);
    std::swap(g, g_trial);  // g_trial is now the gradient before
    cost = trial_cost;
    scales = trial_scales;
    if (monitor.Accept(x.data(), cost, g.data(), scales)) break;

    if (preconditioned) solve(g.data(), z_new_own.data());
    rule->Taken({s.data(),
                 g_trial.data(),
                 z,
                 g.data(),
                 preconditioned ? z_new_own.data() : g.data(),
                 start,
                 found.point});
    is_fresh = false;
    if (preconditioned) {
      if (preconditioner->Update(
              {x.data(), cost, g.data(), scales}, s.data(), &monitor)) {
        rule->PreconditionerChanged(solve);
        solve(g.data(), z_own.data());
      } else {
        std::swap(z_own, z_new_own);
      }
    }
    monitor.Recenter(x.data());
    if (monitor.WantsRebase() && monitor.Rebase(x.data())) {
      if (!monitor.Evaluate(x.data(), &cost, g.data(), &scales)) {
        monitor.FailEvaluation();
        break;
      }
      if (preconditioned) solve(g.data(), z_own.data());
    }
  }
  return monitor.Finish(x_out);
}

}  // namespace granopt
