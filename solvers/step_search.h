// granopt: a step along a direction, and everything known at its end.

#ifndef GRANOPT_SOLVERS_STEP_SEARCH_H_
#define GRANOPT_SOLVERS_STEP_SEARCH_H_

#include "Eigen/Core"
#include "solvers/line_search.h"
#include "solvers/monitor.h"
#include "solvers/solver.h"

namespace granopt {

// SearchLine() on the function of a run: keeps the point that the search may
// come back to, so that none is evaluated twice.
class StepSearch {
 public:
  explicit StepSearch(int n) : x(n), g(n), x_kept_(n), g_kept_(n) {}

  // Searches from x0, with cost and gradient slope start.slope < 0 along d. If
  // the result has a step > 0 the members below belong to its end.
  LineSearchResult Search(const LineSearchOptions& options,
                          const Eigen::VectorXd& x0,
                          const Eigen::VectorXd& d,
                          const LinePoint& start,
                          double first_step,
                          Monitor* monitor);

  Eigen::VectorXd x, g;
  double cost = 0.0;
  Scales scales;

 private:
  Eigen::VectorXd x_kept_, g_kept_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_STEP_SEARCH_H_
