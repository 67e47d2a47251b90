// granopt: linear systems with a sparse symmetric positive definite matrix.

#ifndef GRANOPT_SOLVERS_LINEAR_SOLVER_H_
#define GRANOPT_SOLVERS_LINEAR_SOLVER_H_

#include <cstdint>
#include <memory>
#include <string>

#include "solvers/registry.h"
#include "solvers/second_order.h"

namespace granopt {

// Solves (A + shift 1) x = b many times with one matrix. The matrix is
// normalized by a power of two before anything else sees it, so that systems in
// other units give bitwise the scaled solutions.
class LinearSolver {
 public:
  virtual ~LinearSolver() = default;

  // `lower` is the lower triangle as SecondOrderFunction::EvaluateHessian()
  // writes it; analyses of its pattern are kept while `pattern_version` and the
  // size stay the same. Returns false if A + shift 1 was found not positive
  // definite or not finite: an ordinary situation, after which Solve() must not
  // be called.
  virtual bool Factorize(const SparseMatrix& lower,
                         std::int64_t pattern_version,
                         double shift) = 0;

  // `columns` right-hand sides, interleaved: entry i of column c is
  // b[columns * i + c]. b and x are not the same array.
  virtual void Solve(const double* b, double* x, int columns) = 0;

  // Why Factorize() returned false if no shift will help, with both numbers;
  // empty if that is not so.
  const std::string& refusal() const { return refusal_; }

  // Work so far: factorizations (or set-ups), solves (one a column), iterations
  // inside them, symbolic analyses.
  std::int64_t factorizations() const { return factorizations_; }
  std::int64_t solves() const { return solves_; }
  std::int64_t iterations() const { return iterations_; }
  std::int64_t analyses() const { return analyses_; }

 protected:
  std::int64_t factorizations_ = 0;
  std::int64_t solves_ = 0;
  std::int64_t iterations_ = 0;
  std::int64_t analyses_ = 0;
  std::string refusal_;
};

// Reads the options
//   linear=cholesky|pcg|amg      direct (SparseCholesky), conjugate gradients
//                                preconditioned by the diagonal (Eigen), those
//                                preconditioned by algebraic multigrid (hypre
//                                BoomerAMG; refused in a build without)
//   ordering=amd|metis|rcm       of the direct one
//   factor=multifrontal|library  of the direct one: MultifrontalCholesky where
//                                SparseCholesky finds that the fastest (blocks,
//                                amd), or CHOLMOD
//   linear_tolerance=1e-8        of the iterative ones, |b - A x| / |b|
//   factor_memory=0              GB that a factor may take; known, and refused,
//                                before it is made. 0: half of the machine's
std::unique_ptr<LinearSolver> MakeLinearSolver(Parameters* parameters);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_LINEAR_SOLVER_H_
