// granopt: matrices and vectors in units of their own.

#ifndef GRANOPT_SOLVERS_NORMALIZE_H_
#define GRANOPT_SOLVERS_NORMALIZE_H_

#include <algorithm>
#include <cmath>

#include "solvers/diagonal.h"
#include "solvers/second_order.h"

namespace granopt {

// The power of two s for which s * largest is in [1, 2); 1 where `largest` is
// zero or not finite.
inline double NormalizingPower(double largest) {
  if (!(largest > 0.0) || !std::isfinite(largest)) return 1.0;
  return std::ldexp(1.0, std::clamp(-std::ilogb(largest), -1022, 1023));
}

// s such that the largest diagonal entry of s (A + shift 1) is in [1, 2). A
// matrix in other units, 2^a A with 2^a shift, is then bitwise the same:
// factorizations take square roots, which keep that for even a only.
inline double NormalizingPower(const SparseMatrix& lower, double shift) {
  double largest = lower.cols() > 0 ? std::abs(shift) : 0.0;
  for (int j = 0; j < lower.cols(); ++j) {
    const int place = DiagonalPlace(lower, j);
    if (place < 0) continue;
    largest = std::max(largest, std::abs(lower.valuePtr()[place] + shift));
  }
  return NormalizingPower(largest);
}

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_NORMALIZE_H_
