// Newton's method in a trust region of PETSc's optimizers (TAO bntr), with the
// exact sparse Hessian, on one process. Each step is one of conjugate gradients
// that end at the edge of the region (Steihaug & Toint).
//
// A change of the cost below 1e-6 in the library's units counts as predicted
// exactly, so that as is steps pass that should not where energies are small:
// scaled=1 makes the cost of an active term one.
//
// Deviations: the diagonal is shifted by a tiny `shift` as in tao_nls.

#include "solvers/methods/petsc/tao_method.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class TaoBntr : public TaoNewton {
 public:
  explicit TaoBntr(Parameters* parameters)
      : TaoNewton(parameters, TAOBNTR, "-tao_bnk_", "icc", /*trust=*/true) {}
};

}  // namespace

REGISTER_SOLVER(
    tao_bntr,
    TaoBntr,
    "PETSc TAO's Newton method in a trust region",
    "Nocedal, Wright, Numerical Optimization, 2nd ed. (2006), ch. 4; Balay "
    "et al., PETSc/TAO 3.18");

}  // namespace granopt
