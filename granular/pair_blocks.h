// granopt: the Hessian's blocks from the states of pairs.

#ifndef GRANOPT_GRANULAR_PAIR_BLOCKS_H_
#define GRANOPT_GRANULAR_PAIR_BLOCKS_H_

#include "granular/pair_loops.h"

namespace granopt {

// Adds, for each pair p with rank[p] >= 0, the d x d block
//   K = first[p] n (x) n - theta (second[p] / l) (1 - n (x) n)
// to the lower triangle of a column-compressed matrix with one block row and
// column a grain: K to the diagonal blocks of i and j, -K to block (j, i).
// first = f', second = f and theta = 1 make the Hessian (9). `rank[p]` is the
// place of pair p's block below the diagonal of its column, `column_start` has
// one entry per scalar column. `values` must be zero before. An image of a
// grain moves with it: pairs with i = j add nothing.
void AddPairBlocks(int dimension,
                   const PairView& pairs,
                   const PairStates& states,
                   const double* first,
                   const double* second,
                   double theta,
                   const int* rank,
                   const int* column_start,
                   double* values);

// hv = H v.
void PairHessianTimes(int dimension,
                      const PairView& pairs,
                      const PairStates& states,
                      const double* v,
                      double* hv);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PAIR_BLOCKS_H_
