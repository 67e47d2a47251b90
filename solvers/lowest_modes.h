// granopt: the lowest eigenpairs of a sparse symmetric matrix.

#ifndef GRANOPT_SOLVERS_LOWEST_MODES_H_
#define GRANOPT_SOLVERS_LOWEST_MODES_H_

#include <cstdint>
#include <string>

#include "Eigen/Core"
#include "solvers/second_order.h"

namespace granopt {

struct LowestModesOptions {
  // Eigenpairs wanted; fewer are returned if the space has fewer dimensions.
  int count = 1;
  // Largest |A v - lambda v| accepted, in units of the matrix' norm (below).
  double tolerance = 1e-10;
  // Of the Lanczos method, each a few dozen solves.
  int max_restarts = 300;
  // Columns span a space that is left out, n x q with q < n and of full rank;
  // empty: none. Meant for vectors known to be null vectors. For others the
  // eigenpairs are those of A restricted to the orthogonal complement, as long
  // as A itself, shifted by as little as possible, is positive definite.
  Eigen::MatrixXd left_out;
};

struct LowestModes {
  // False if A is not finite or the method ended without all pairs: then
  // `message` says why, and the pairs are what there was, maybe none.
  bool converged = false;
  std::string message;
  Eigen::VectorXd values;     // increasing
  Eigen::MatrixXd vectors;    // n x count, orthonormal
  Eigen::VectorXd residuals;  // |A v - lambda v|, within the complement
  // An upper bound of |A|: the largest sum of magnitudes in a row.
  double norm = 0.0;
  double shift = 0.0;  // s, see below; 0 if a dense method was used
  std::int64_t factorizations = 0;
  std::int64_t solves = 0;
};

// The lowest eigenvalues of the symmetric A by the Lanczos method for
// (A + s 1)^-1, implicitly restarted (Spectra), with A + s 1 = L L^T. `lower`
// is the lower triangle as SecondOrderFunction::EvaluateHessian() writes it.
//
// s is 1e-10 |A| if A + s 1 is then positive definite (A positive definite or
// with null vectors only), else 16 times as large until it is; a rough lowest
// eigenvalue l then gives s = -l + (l + s) / 100, as close as is safe, so that
// the inverse separates the lowest eigenvalues. The complement of Q is exact:
// with K = (A + s 1)^-1 the operator is K - K Q (Q^T K Q)^-1 Q^T K, the inverse
// of A + s 1 restricted to it. A single Krylov space may hold one vector only
// of a multiple eigenvalue; if count > 1, further runs in the complement of
// what was found continue until they find nothing lower.
//
// Values come from a Rayleigh-Ritz step with A itself and are good to roundoff,
// eps |A|, where the residual is small. Deterministic; A in units of 2^a gives
// bitwise the scaled result. The largest entry of a vector is positive.
//
// Sources: Sorensen, SIAM J. Matrix Anal. Appl. 13 (1992) 357; Ericsson, Ruhe,
// Math. Comp. 35 (1980) 1251.
LowestModes ComputeLowestModes(const SparseMatrix& lower,
                               const LowestModesOptions& options);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_LOWEST_MODES_H_
