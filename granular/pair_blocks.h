// granopt: the Hessian's blocks from the states of pairs.

#ifndef GRANOPT_GRANULAR_PAIR_BLOCKS_H_
#define GRANOPT_GRANULAR_PAIR_BLOCKS_H_

#include "granular/pair_loops.h"

namespace granopt {

// The lower triangle of a column-compressed matrix with one block row and
// column a grain.
struct BlockPattern {
  // The place of each pair's block below the diagonal of its column, -1 for
  // none; each block is some pair's.
  const int* rank = nullptr;
  const int* column_start = nullptr;  // one entry per scalar column, and an end
  // Do several pairs, images of one, share a block?
  bool has_shared_blocks = false;
};

// The sum over pairs p with rank[p] >= 0 of the d x d blocks
//   K = first[p] n (x) n - theta (second[p] / l) (1 - n (x) n):
// K in the diagonal blocks of i and j, -K in block (j, i). first = f', second =
// f and theta = 1 make the Hessian (9). An image of a grain moves with it:
// pairs with i = j add nothing.
void WritePairBlocks(int dimension,
                     int num_grains,
                     const PairView& pairs,
                     const PairStates& states,
                     const double* first,
                     const double* second,
                     double theta,
                     const BlockPattern& pattern,
                     double* values);

// hv = H v.
void PairHessianTimes(int dimension,
                      const PairView& pairs,
                      const PairStates& states,
                      const double* v,
                      double* hv);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PAIR_BLOCKS_H_
