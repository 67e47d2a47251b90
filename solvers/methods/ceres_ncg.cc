// Nonlinear conjugate gradients of Ceres Solver. See
// solvers/ceres_line_search.h for what `scaled` does.

#include "solvers/ceres_line_search.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class CeresNcg : public CeresLineSearch {
 public:
  explicit CeresNcg(Parameters* parameters) : CeresLineSearch(parameters) {
    constexpr ceres::NonlinearConjugateGradientType kBeta[] = {
        ceres::FLETCHER_REEVES, ceres::POLAK_RIBIERE, ceres::HESTENES_STIEFEL};
    constexpr ceres::LineSearchType kLineSearch[] = {ceres::WOLFE,
                                                     ceres::ARMIJO};
    ceres_options().line_search_direction_type =
        ceres::NONLINEAR_CONJUGATE_GRADIENT;
    const int beta = parameters->Choice("beta",
                                        "fr",
                                        "fr|pr|hs",
                                        "Fletcher-Reeves, Polak-Ribiere or "
                                        "Hestenes-Stiefel");
    const int line_search = parameters->Choice(
        "line_search", "wolfe", "wolfe|armijo", "rule that accepts a step");
    ceres_options().nonlinear_conjugate_gradient_type = kBeta[beta];
    ceres_options().line_search_type = kLineSearch[line_search];
  }
};

}  // namespace

REGISTER_SOLVER(
    ceres_ncg,
    CeresNcg,
    "Ceres' nonlinear conjugate gradients",
    "Fletcher, Reeves, Comput. J. 7 (1964) 149; Agarwal, Mierle, The "
    "Ceres Solver Team, Ceres Solver 2.1");

}  // namespace granopt
