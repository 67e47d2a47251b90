// granopt: how well does one symmetric matrix precondition another?

#ifndef GRANOPT_SOLVERS_CONDITION_H_
#define GRANOPT_SOLVERS_CONDITION_H_

#include <string>

#include "Eigen/Core"
#include "solvers/second_order.h"

namespace granopt {

struct ConditionOptions {
  // Relative accuracy of the extreme eigenvalues.
  double accuracy = 1e-4;
  int max_restarts = 20;
  // Eigenvalues outside of [low, high] are counted.
  double low = 0.5;
  double high = 2.0;
};

struct Condition {
  // False with one line in `message` if P is not positive definite or the
  // extreme eigenvalues were not found.
  bool found = false;
  std::string message;
  int dimensions = 0;  // eigenvalues there are, without those left out
  double lowest = 0.0;
  double highest = 0.0;
  int negative = 0;  // below zero, by 1e-3 of the lowest at least
  int below = 0;     // below options.low, the negative ones included
  int above = 0;     // above options.high

  // highest / lowest; infinity unless all are positive.
  double Number() const;
};

// The extreme eigenvalues of P^-1 A, A v = lambda P v, for a symmetric A and a
// symmetric positive definite P, both as lower triangles (see
// SecondOrderFunction::EvaluateHessian()), without those that belong to
// `null_space`, n x q, of full rank, whose columns A maps to zero. The other
// eigenvectors are P-orthogonal to it. That is what a method preconditioned by
// P sees: P itself, not its restriction to some complement.
//
// Lanczos methods in the inner product of P (Spectra): for P^-1 A, and for
// (A + s P)^-1 P with an s that makes A + s P positive definite. What they find
// is checked by counting signs of pivots (Sylvester's law of inertia): no
// eigenvalue may lie outside of [lowest, highest], widened by options.accuracy,
// and one must lie within that of each end. Where they fail, which they do
// where almost all eigenvalues are alike, the ends are bisected by such counts.
// Null vectors become coordinates of their own first, so that rounding cannot
// make eigenvalues of them.
//
// Source: Parlett, The Symmetric Eigenvalue Problem (1998), 3.3, 15.
Condition ComputeCondition(const SparseMatrix& a,
                           const SparseMatrix& p,
                           const Eigen::MatrixXd& null_space,
                           const ConditionOptions& options);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_CONDITION_H_
