// granopt: products with the Hessian from the states of pairs.

#ifndef GRANOPT_GRANULAR_PAIR_BLOCKS_H_
#define GRANOPT_GRANULAR_PAIR_BLOCKS_H_

#include "granular/pair_loops.h"

namespace granopt {

// hv = H v.
void PairHessianTimes(int dimension,
                      const PairView& pairs,
                      const PairStates& states,
                      const double* v,
                      double* hv);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PAIR_BLOCKS_H_
