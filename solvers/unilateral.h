// granopt: sums of one-sided power laws of gaps.

#ifndef GRANOPT_SOLVERS_UNILATERAL_H_
#define GRANOPT_SOLVERS_UNILATERAL_H_

#include <array>
#include <vector>

#include "Eigen/Core"
#include "Eigen/SparseCore"
#include "solvers/second_order.h"

namespace granopt {

// Names a gap for good: the objects i <= j and the lattice image of j relative
// to i. Survives the rebuilding of whatever list the function keeps.
struct GapId {
  int i = 0;
  int j = 0;
  std::array<int, 3> image = {0, 0, 0};

  friend bool operator==(const GapId& a, const GapId& b) {
    return a.i == b.i && a.j == b.j && a.image == b.image;
  }
  friend bool operator<(const GapId& a, const GapId& b) {
    if (a.i != b.i) return a.i < b.i;
    if (a.j != b.j) return a.j < b.j;
    return a.image < b.image;
  }
};

// All gaps that are closed at x or could close nearby (a superset of the active
// terms), in increasing order of id.
struct Gaps {
  std::vector<GapId> ids;
  Eigen::VectorXd delta;      // closure; negative where the gap is open
  Eigen::VectorXd stiffness;  // k of each term
  Eigen::VectorXd curvature;  // norm of the second derivatives of delta
  // Gaps that are open by less than this are in the pattern of the Hessian
  // when it is made.
  double margin = 0.0;
  // d(delta)/dx, one row a gap.
  Eigen::SparseMatrix<double, Eigen::RowMajor, int> jacobian;
};

// E(x) = sum over gaps c of k_c (delta_c(x) v 0)^alpha / alpha, the form that
// an interior point, a least-squares method or a ray search can take apart.
// With the force f_c = k_c (delta_c v 0)^(alpha-1) of a gap,
//   gradient = sum f_c grad(delta_c),
//   Hessian  = sum f_c' grad(delta_c) grad(delta_c)^T + f_c Hess(delta_c).
class UnilateralFunction : public SecondOrderFunction {
 public:
  // alpha >= 2.
  virtual double Exponent() const = 0;

  // The force f / k and its derivative of n closures, none of them negative:
  //   e^(alpha-1),  (alpha - 1) e^(alpha-2).
  virtual void EvaluateLaw(int n,
                           const double* closure,
                           double* force,
                           double* stiffness) const = 0;

  // Returns false where the function is not defined.
  virtual bool EvaluateGaps(const double* x, Gaps* gaps) const = 0;

  // The Hessian with its second part times theta: 1 is EvaluateHessian(), 0 the
  // matrix of Gauss and Newton, which is positive semidefinite. As
  // EvaluateHessian() otherwise.
  virtual bool EvaluateStiffness(const double* x,
                                 double theta,
                                 SparseMatrix* hessian) const = 0;

  // sum first_c grad(delta_c) grad(delta_c)^T + second_c Hess(delta_c) with
  // weights of the gaps that EvaluateGaps() listed at the same x; nothing else
  // may have been evaluated since. Gaps whose first weight is zero need not be
  // in the pattern, and their second weight must be zero, too. Returns false if
  // the list is no longer the same. As EvaluateHessian() otherwise.
  virtual bool EvaluateWeightedHessian(const double* x,
                                       const double* first,
                                       const double* second,
                                       SparseMatrix* hessian) const = 0;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_UNILATERAL_H_
