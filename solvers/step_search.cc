#include "solvers/step_search.h"

#include <utility>

#include "solvers/vector_loops.h"

namespace granopt {

LineSearchResult StepSearch::Search(const LineSearchOptions& options,
                                    const Eigen::VectorXd& x0,
                                    const Eigen::VectorXd& d,
                                    const LinePoint& start,
                                    double first_step,
                                    Monitor* monitor) {
  double last_step = 0.0;
  double kept_cost = start.value;
  Scales kept_scales;
  const auto swap_kept = [&]() {
    std::swap(x_kept_, x);
    std::swap(g_kept_, g);
    std::swap(kept_cost, cost);
    std::swap(kept_scales, scales);
  };
  const auto evaluate = [&](double step, LinePoint* p) {
    if (monitor->BudgetSpent()) return LineEvaluation::STOP;
    if (p->step > 0.0 && p->step == last_step) swap_kept();
    last_step = step;
    const int n = static_cast<int>(d.size());
    Combine(n, 1.0, x0.data(), step, d.data(), x.data());
    if (!monitor->Evaluate(x.data(), &cost, g.data(), &scales)) {
      return LineEvaluation::NOT_FINITE;
    }
    *p = {step, cost, Dot(n, g.data(), d.data())};
    return LineEvaluation::OK;
  };
  LineSearchOptions here = options;
  here.epsilon = monitor->scales().epsilon;
  const LineSearchResult found = SearchLine(evaluate, start, first_step, here);
  if (found.point.step > 0.0 && !found.is_last) swap_kept();
  return found;
}

}  // namespace granopt
