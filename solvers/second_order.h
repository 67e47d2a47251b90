// granopt: functions with a sparse Hessian.

#ifndef GRANOPT_SOLVERS_SECOND_ORDER_H_
#define GRANOPT_SOLVERS_SECOND_ORDER_H_

#include <cstdint>

#include "Eigen/SparseCore"
#include "solvers/first_order.h"

namespace granopt {

using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

// Adds second derivatives to a FirstOrderFunction. The Hessian is sparse from
// end to end: it is never formed densely.
class SecondOrderFunction : public FirstOrderFunction {
 public:
  // Writes the lower triangle (n x n, compressed, columns sorted) of the second
  // derivatives at x, the form that CHOLMOD (stype -1) and
  // Eigen::selfadjointView<Lower> read. Entries that happen to be zero are
  // kept, so that the pattern depends on PatternVersion() alone. Storage of
  // `hessian` is reused while the version stays the same. Returns false where
  // the function is not defined.
  virtual bool EvaluateHessian(const double* x,
                               SparseMatrix* hessian) const = 0;

  // Variables come in blocks of this many (the coordinates of a point), which a
  // method may keep together.
  virtual int BlockSize() const { return 1; }

  // Changes whenever the pattern that EvaluateHessian() writes has changed, so
  // that a symbolic factorization can be kept. Valid after EvaluateHessian().
  virtual std::int64_t PatternVersion() const = 0;

  // hv = H(x) v without forming H. Both vectors have NumParameters() entries.
  virtual bool HessianTimes(const double* x,
                            const double* v,
                            double* hv) const = 0;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SECOND_ORDER_H_
