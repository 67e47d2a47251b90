// granopt: factorization of sparse symmetric positive definite matrices.

#ifndef GRANOPT_SOLVERS_SPARSE_CHOLESKY_H_
#define GRANOPT_SOLVERS_SPARSE_CHOLESKY_H_

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "solvers/second_order.h"

namespace granopt {

class MultifrontalCholesky;

// Which permutation keeps the factor sparse.
enum class Ordering {
  AMD,    // approximate minimum degree
  METIS,  // nested dissection; CHOLMOD only
  RCM,    // reverse Cuthill-McKee: a band
};

// Who factors.
enum class Factorizer {
  FASTEST,       // MULTIFRONTAL with AMD for blocks of 2 or 3 and all but the
                 // largest matrices, else LIBRARY
  MULTIFRONTAL,  // MultifrontalCholesky; AMD only
  LIBRARY,       // CHOLMOD or, in a build without, Eigen
};

// L L^T = P (A + shift 1) P^T with a fill-reducing permutation P, by our own
// multifrontal factor, by CHOLMOD or, if built with -DGRANOPT_CHOLMOD=OFF, by
// Eigen's SimplicialLDLT (MPL2).
// The symbolic analysis is kept as long as the pattern version stays the same,
// and the last one of our own factor in a thread serves any object that is
// given the same pattern next.
//
// The matrix is normalized by a power of two first: 2^a A with 2^a shift and
// 2^c b give bitwise 2^(c-a) x.
class SparseCholesky {
 public:
  // False for an ordering that this build is without.
  static bool Has(Ordering ordering);

  // Drops this thread's last analysis, so that the next one is made whatever
  // was solved before: for measurements.
  static void ForgetAnalysis();

  explicit SparseCholesky(Ordering ordering = Ordering::AMD,
                          Factorizer factorizer = Factorizer::FASTEST);
  ~SparseCholesky();
  SparseCholesky(const SparseCholesky&) = delete;
  SparseCholesky& operator=(const SparseCholesky&) = delete;

  // `lower` is the lower triangle as SecondOrderFunction::EvaluateHessian()
  // writes it; `pattern_version` names its pattern
  // (SecondOrderFunction::PatternVersion()). Returns false if A + shift 1 is
  // not positive definite or not finite: an ordinary situation, after which
  // Solve() must not be called. Nor is anything factored while Bytes() exceeds
  // the limit.
  bool Factorize(const SparseMatrix& lower,
                 std::int64_t pattern_version,
                 double shift = 0.0);

  // x = (A + shift 1)^-1 b for `columns` right-hand sides, interleaved: entry i
  // of column c is b[columns * i + c]. b and x may be the same array.
  void Solve(const double* b, double* x, int columns = 1);

  // What the factor of the pattern last analyzed takes at its largest, known
  // before it is made. Factorize() makes none above the limit, which is none at
  // first.
  double Bytes() const { return bytes_; }
  void set_memory_limit(double bytes) { memory_limit_ = bytes; }
  double memory_limit() const { return memory_limit_; }
  bool ExceedsMemory() const { return bytes_ > memory_limit_; }

  // Symbolic analyses so far, those among them that were there from the last
  // object, and entries of the last factor.
  std::int64_t num_analyses() const { return num_analyses_; }
  std::int64_t num_recalled() const { return num_recalled_; }
  std::int64_t num_nonzeros() const { return num_nonzeros_; }

  // "CHOLMOD 3.0.14" or "Eigen 3.4.0 SimplicialLDLT".
  static std::string Library();

 private:
  class Backend;
  bool Analyze(const SparseMatrix& lower);

  std::unique_ptr<Backend> backend_;
  // Null unless it factors.
  std::unique_ptr<MultifrontalCholesky> multifrontal_;
  const Ordering ordering_;
  const Factorizer wanted_;
  std::vector<double> values_;  // of the normalized matrix, scale_ * A
  double scale_ = 1.0;
  // Right-hand sides, no longer interleaved, and solutions.
  std::vector<double> columns_, solution_;
  std::int64_t analyzed_version_ = -1;
  std::int64_t num_analyses_ = 0;
  std::int64_t num_recalled_ = 0;
  std::int64_t num_nonzeros_ = 0;
  int size_ = -1;
  double bytes_ = 0.0;
  double memory_limit_ = std::numeric_limits<double>::infinity();
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SPARSE_CHOLESKY_H_
