// Newton's method with the line search of More and Thuente of PETSc's
// optimizers (TAO nls), with the exact sparse Hessian, on one process. Where
// the Newton step does not go downhill it takes the gradient and shifts the
// next Hessian (by 1e-4 to 1e2 in the library's units: scaled=1 makes
// curvatures one).
//
// Deviations: the diagonal is shifted by a tiny `shift`, since variables that
// no active term depends on leave rows of zeros, and translations a null space,
// which a factorization ends at.

#include "solvers/methods/petsc/tao_method.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class TaoNls : public TaoNewton {
 public:
  explicit TaoNls(Parameters* parameters)
      : TaoNewton(parameters, TAONLS, "-tao_nls_", "mumps", /*trust=*/false) {}
};

}  // namespace

REGISTER_SOLVER(
    tao_nls,
    TaoNls,
    "PETSc TAO's Newton method with a line search",
    "Nocedal, Wright, Numerical Optimization, 2nd ed. (2006), ch. 3; Balay "
    "et al., PETSc/TAO 3.18");

}  // namespace granopt
