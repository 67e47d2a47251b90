// The matrix of an interior point, as a preconditioner.

#include "solvers/barrier.h"

#include <string>

#include "Eigen/Core"
#include "solvers/matrix_preconditioner.h"
#include "solvers/registry.h"
#include "solvers/unilateral.h"

namespace granopt {
namespace {

// P = sum_c W_c grad(delta_c) grad(delta_c)^T + shift kappa 1 with the weights
// that an interior point has on its central path at x,
//   W = k phi' phi / (phi + s phi'),   phi(e) = e^(alpha-1),
//   e - s = delta,  phi(e) s = length^alpha.
// Gaps that are open by less than the length have part of the stiffness of a
// closed one, so that P foresees them: for length -> 0 only the closed ones are
// left. The second derivatives of the gaps are left out, so that P is positive
// semidefinite as it is.
class Barrier : public StiffnessPreconditioner {
 public:
  explicit Barrier(Parameters* parameters)
      : StiffnessPreconditioner(parameters),
        length_(parameters->Double(
            "length", 0.1, 1e-6, 1e6, "of (B), in units of the mean closure")) {
    ReadPolicy(parameters, 1e-3, 1e-12);
  }

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const UnilateralFunction*>(&function) != nullptr) {
      return true;
    }
    *error = "preconditioner barrier needs a sum of one-sided power laws";
    return false;
  }

 protected:
  bool EvaluateMatrix(const SecondOrderFunction& second,
                      const Iterate& at,
                      SparseMatrix* lower) override {
    const auto& function = dynamic_cast<const UnilateralFunction&>(second);
    if (!function.EvaluateGaps(at.x, &gaps_)) return false;
    const auto m = static_cast<int>(gaps_.ids.size());
    Eigen::VectorXd e(m), s(m), phi(m), dphi(m), weight(m);
    CentralClosures(function,
                    m,
                    gaps_.delta.data(),
                    length_ * at.scales.length * (function.Exponent() - 1.0),
                    e.data(),
                    s.data());
    function.EvaluateLaw(m, e.data(), phi.data(), dphi.data());
    for (int c = 0; c < m; ++c) {
      // Of those that are further away little is left, and the pattern is
      // without them.
      weight[c] = gaps_.delta[c] > -gaps_.margin
                      ? gaps_.stiffness[c] *
                            (dphi[c] * (phi[c] / (phi[c] + s[c] * dphi[c])))
                      : 0.0;
    }
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(m);
    return function.EvaluateWeightedHessian(
        at.x, weight.data(), zero.data(), lower);
  }

 private:
  const double length_;
  Gaps gaps_;
};

}  // namespace

REGISTER_PRECONDITIONER(
    barrier,
    Barrier,
    "matrix of an interior point: closed and near gaps, no second derivatives",
    "Nocedal, Wright, Numerical Optimization, 2nd ed. (2006), 19.3");

}  // namespace granopt
