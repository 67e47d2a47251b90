// granopt: the diagonal of a sparse symmetric matrix.

#ifndef GRANOPT_SOLVERS_DIAGONAL_H_
#define GRANOPT_SOLVERS_DIAGONAL_H_

#include "solvers/second_order.h"

namespace granopt {

// Where among the values of a lower triangle, as
// SecondOrderFunction::EvaluateHessian() writes it, the diagonal entry of
// column j is: the first of its column. -1 if the pattern is without it.
inline int DiagonalPlace(const SparseMatrix& lower, int j) {
  const int first = lower.outerIndexPtr()[j];
  return first < lower.outerIndexPtr()[j + 1] &&
                 lower.innerIndexPtr()[first] == j
             ? first
             : -1;
}

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_DIAGONAL_H_
