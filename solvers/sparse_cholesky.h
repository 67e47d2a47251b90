// granopt: factorization of sparse symmetric positive definite matrices.

#ifndef GRANOPT_SOLVERS_SPARSE_CHOLESKY_H_
#define GRANOPT_SOLVERS_SPARSE_CHOLESKY_H_

#include <cstdint>
#include <memory>
#include <string>

#include "solvers/second_order.h"

namespace granopt {

// L L^T = P (A + shift 1) P^T with a fill-reducing permutation P, by CHOLMOD
// or, if built with -DGRANOPT_CHOLMOD=OFF, by Eigen's SimplicialLDLT (MPL2).
// The symbolic analysis is kept as long as the pattern version stays the same.
class SparseCholesky {
 public:
  SparseCholesky();
  ~SparseCholesky();
  SparseCholesky(const SparseCholesky&) = delete;
  SparseCholesky& operator=(const SparseCholesky&) = delete;

  // `lower` is the lower triangle as SecondOrderFunction::EvaluateHessian()
  // writes it; `pattern_version` names its pattern
  // (SecondOrderFunction::PatternVersion()). Returns false if A + shift 1 is
  // not positive definite or not finite: an ordinary situation, after which
  // Solve() must not be called.
  bool Factorize(const SparseMatrix& lower,
                 std::int64_t pattern_version,
                 double shift = 0.0);

  // x = (A + shift 1)^-1 b; n entries each, may be the same array.
  void Solve(const double* b, double* x);

  // Symbolic analyses so far, and entries of the last factor.
  int size() const { return size_; }
  std::int64_t num_analyses() const { return num_analyses_; }
  std::int64_t num_nonzeros() const { return num_nonzeros_; }

  // "CHOLMOD 3.0.14" or "Eigen 3.4.0 SimplicialLDLT".
  static std::string Library();

 private:
  class Backend;
  std::unique_ptr<Backend> backend_;
  std::int64_t analyzed_version_ = -1;
  std::int64_t num_analyses_ = 0;
  std::int64_t num_nonzeros_ = 0;
  int size_ = -1;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SPARSE_CHOLESKY_H_
