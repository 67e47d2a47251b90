// The Hessian itself, shifted until it is positive definite.

#include <string>

#include "solvers/matrix_preconditioner.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class HessianPreconditioner : public StiffnessPreconditioner {
 public:
  explicit HessianPreconditioner(Parameters* parameters)
      : StiffnessPreconditioner(parameters) {
    ReadPolicy(parameters, 1e-2, 0.0);
  }

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const SecondOrderFunction*>(&function) != nullptr) {
      return true;
    }
    *error = "preconditioner hessian needs a function with second derivatives";
    return false;
  }

 protected:
  bool EvaluateMatrix(const SecondOrderFunction& function,
                      const Iterate& at,
                      SparseMatrix* lower) override {
    return function.EvaluateHessian(at.x, lower);
  }
};

}  // namespace

REGISTER_PRECONDITIONER(
    hessian,
    HessianPreconditioner,
    "the second derivatives, shifted until positive definite",
    "Nocedal, Wright, Numerical Optimization, 2nd ed. (2006), 3.4");

}  // namespace granopt
