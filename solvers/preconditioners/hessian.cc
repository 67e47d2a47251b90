// The Hessian itself, shifted until it is positive definite.

#include <memory>
#include <string>

#include "solvers/matrix_preconditioner.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class HessianPreconditioner : public MatrixPreconditioner {
 public:
  explicit HessianPreconditioner(Parameters* parameters)
      : MatrixPreconditioner(parameters),
        shift_(parameters->Double(
            "shift",
            1e-2,
            0.0,
            1e6,
            "added to the diagonal, in units of the stiffness scale")),
        every_(parameters->Int(
            "every", 20, 1, "iterations between two factorizations")) {}

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const SecondOrderFunction*>(&function) != nullptr) {
      return true;
    }
    *error = "preconditioner hessian needs a function with second derivatives";
    return false;
  }

 protected:
  bool Assemble(const Iterate& at, Monitor* monitor, Matrix* matrix) override {
    const auto* function =
        dynamic_cast<const SecondOrderFunction*>(monitor->function());
    if (!(at.scales.length > 0.0)) return false;
    const Monitor::LinearTimer timer(monitor);
    if (!function->EvaluateHessian(at.x, &matrix->lower)) return false;
    ++monitor->counters().hessians;
    matrix->pattern_version = function->PatternVersion();
    matrix->shift = shift_ * (at.scales.gradient / at.scales.length);
    return true;
  }

  bool IsStale(const Iterate& /*at*/, const Age& age) const override {
    return age.steps >= every_;
  }

  int BlockSize(const FirstOrderFunction& function) const override {
    return dynamic_cast<const SecondOrderFunction&>(function).BlockSize();
  }

 private:
  const double shift_;
  const int every_;
};

}  // namespace

REGISTER_PRECONDITIONER(
    hessian,
    HessianPreconditioner,
    "the second derivatives, shifted until positive definite",
    "Nocedal, Wright, Numerical Optimization, 2nd ed. (2006), 3.4");

}  // namespace granopt
