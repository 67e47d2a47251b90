#include "solvers/line_search_method.h"

#include <algorithm>
#include <utility>

#include "Eigen/Core"
#include "solvers/monitor.h"
#include "solvers/step_search.h"

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
  VectorXd g(n), d(n), s(preconditioned ? n : 0);
  StepSearch search(n);
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
  // After a rebase.
  const auto refresh = [&]() {
    if (!monitor.Evaluate(x.data(), &cost, g.data(), &scales)) {
      monitor.FailEvaluation();
      return false;
    }
    if (preconditioned) solve(g.data(), z_own.data());
    return true;
  };
  bool is_fresh = true;  // nothing is known but the gradient

  while (!monitor.stopped()) {
    const double* z = preconditioned ? z_own.data() : g.data();
    const double unit = preconditioned ? 1.0 : monitor.StepUnit();
    DirectionRule::Outlook ahead = rule->Direction(g.data(), z, unit, d.data());
    if (!(ahead.slope < 0.0) && !is_fresh) {
      rule->Forget();
      ++monitor.counters().restarts;
      is_fresh = true;
      ahead = rule->Direction(g.data(), z, unit, d.data());
    }
    if (!(ahead.slope < 0.0)) {
      monitor.GiveUp("steepest descent does not descend");
      break;
    }

    const LinePoint start{0.0, cost, ahead.slope};
    const LineSearchResult found =
        search.Search(line_search_, x, d, start, ahead.first_step, &monitor);
    // A stop inside the line search may leave a better point behind.
    if (monitor.stopped() && found.point.step == 0.0) break;
    // Neither is a step that rounding takes away.
    if (found.point.step == 0.0 ||
        std::equal(x.data(), x.data() + n, search.x.data())) {
      if (monitor.LastEvaluationFailed()) {
        monitor.FailEvaluation();
      } else if (monitor.Refine(x.data())) {
        if (!refresh()) break;
      } else if (is_fresh) {
        monitor.GiveUp("no step along the steepest descent lowers the cost");
      } else {
        rule->Forget();
        ++monitor.counters().restarts;
        is_fresh = true;
      }
      continue;
    }
    std::swap(x, search.x);  // search.x is now the point before
    std::swap(g, search.g);  // and search.g its gradient
    cost = search.cost;
    scales = search.scales;
    if (monitor.Accept(x.data(), cost, g.data(), scales)) break;

    if (preconditioned) solve(g.data(), z_new_own.data());
    rule->Taken({search.x.data(),
                 x.data(),
                 search.g.data(),
                 z,
                 g.data(),
                 preconditioned ? z_new_own.data() : g.data(),
                 start,
                 found.point});
    is_fresh = false;
    if (preconditioned) {
      s = x - search.x;
      if (preconditioner->Update(
              {x.data(), cost, g.data(), scales}, s.data(), &monitor)) {
        rule->PreconditionerChanged(solve);
        solve(g.data(), z_own.data());
      } else {
        std::swap(z_own, z_new_own);
      }
    }
    monitor.Recenter(x.data());
    if (monitor.WantsRebase() && monitor.Rebase(x.data()) && !refresh()) break;
  }
  return monitor.Finish(x_out);
}

}  // namespace granopt
