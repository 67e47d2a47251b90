// granopt: unilateral terms, smoothed by a relaxed complementarity.

#ifndef GRANOPT_SOLVERS_BARRIER_H_
#define GRANOPT_SOLVERS_BARRIER_H_

#include "solvers/unilateral.h"

namespace granopt {

// A term k (delta v 0)^alpha / alpha is the least of k e^alpha / alpha over all
// e >= delta, e >= 0. With the slack s = e - delta its solution obeys
//   phi(e) s = 0,   phi(e) = e^(alpha-1),
// which an interior point relaxes to
//   phi(e) s = mu = length^alpha.                                           (B)
// Gaps that are wider than the length, open or closed, are then as they were,
// others are smoothed: for alpha = 2, e = (delta + (delta^2 + 4 mu)^(1/2)) / 2.

// The closures e of (B) and the slacks mu / phi(e), for n gaps.
void CentralClosures(const UnilateralFunction& function,
                     int n,
                     const double* delta,
                     double length,
                     double* closure,
                     double* slack);

// mu of a length.
double ComplementarityOf(const UnilateralFunction& function, double length);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_BARRIER_H_
