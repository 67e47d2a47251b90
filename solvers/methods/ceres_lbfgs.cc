// L-BFGS of Ceres Solver (two-loop recursion, strong Wolfe line search with
// cubic interpolation). See solvers/ceres_line_search.h for what `scaled` does.

#include "solvers/ceres_line_search.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class CeresLbfgs : public CeresLineSearch {
 public:
  explicit CeresLbfgs(Parameters* parameters) : CeresLineSearch(parameters) {
    ceres_options().line_search_direction_type = ceres::LBFGS;
    ceres_options().max_lbfgs_rank =
        parameters->Int("memory", 20, 1, "number of stored (s, y) pairs");
  }
};

}  // namespace

REGISTER_SOLVER(
    ceres_lbfgs,
    CeresLbfgs,
    "Ceres' limited-memory BFGS with its strong Wolfe line search",
    "Nocedal, Math. Comp. 35 (1980) 773; Agarwal, Mierle, The Ceres "
    "Solver Team, Ceres Solver 2.1");

}  // namespace granopt
