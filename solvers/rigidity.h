// granopt: which objects of a sum of one-sided terms hold each other in place.

#ifndef GRANOPT_SOLVERS_RIGIDITY_H_
#define GRANOPT_SOLVERS_RIGIDITY_H_

#include <vector>

#include "Eigen/Core"
#include "solvers/unilateral.h"

namespace granopt {

// True for each object that is left when those with fewer than `least` closed
// gaps have been taken away, again and again.
std::vector<bool> HeldObjects(const Gaps& gaps, int num_objects, int least);

// The Hessian of `function` at x without the second part of gaps that an object
// takes part in which is not held by BlockSize() + 1 others: fewer cannot
// balance, and the second part alone then makes the matrix indefinite, though
// nothing but the freedom of that object is behind it. What is left of such an
// object is positive semidefinite, with g in its range. As EvaluateHessian()
// otherwise; `gaps` and `weights` are work spaces.
struct RigidHessian {
  bool Evaluate(const UnilateralFunction& function,
                const double* x,
                SparseMatrix* hessian);

  Gaps gaps;
  Eigen::VectorXd first, second;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_RIGIDITY_H_
