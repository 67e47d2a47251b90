// granopt: the loops that first-order methods spend their time in, compiled for
// each instruction set.

#ifndef GRANOPT_GRANULAR_PAIR_LOOPS_H_
#define GRANOPT_GRANULAR_PAIR_LOOPS_H_

#include <cstdint>

namespace granopt {

// Arrays over pairs end with this many more entries, a multiple of which is
// worked on at a time: grains 0 and 0 with r0 = d0 = 1 and delta0 = -1.
constexpr int kPairPadding = 8;

// r0, d0 and delta0 of PairView, and w of the sweep, divided by `unit`, a power
// of two near the radii (squares of lengths must be far from the ends of
// float's range), and rounded once more.
struct SinglePairs {
  const float* r0[3] = {};
  const float* d0 = nullptr;
  const float* delta0 = nullptr;
  double unit = 1.0;
  const float* w = nullptr;  // by Narrow
};

// Pairs in increasing order of (i, j), at the reference configuration:
// separation r0 = x_i - x_j + H image, its length d0 > 0 and the overlap
// delta0 = r_i + r_j - d0, each rounded once from double-double. `stiffness`
// may be null (all 1). Arrays go on for kPairPadding valid entries.
struct PairView {
  int num_pairs = 0;
  // Forces are those on grains first_grain ... end_grain - 1. `is_guarded` must
  // be set where a pair has another grain, or i = j.
  int first_grain = 0;
  int end_grain = 0;
  bool is_guarded = false;
  // Where the coordinates of the two grains begin, d i and d j: ready for
  // addresses.
  const int* at_i = nullptr;
  const int* at_j = nullptr;
  const double* r0[3] = {};
  const double* d0 = nullptr;
  const double* delta0 = nullptr;
  const double* stiffness = nullptr;
  SinglePairs single;  // for PairLoops::single_sweep, which reads no other
};

struct ContactSums {
  double energy = 0.0;   // sum k delta^alpha / alpha
  double force = 0.0;    // sum f
  double overlap = 0.0;  // sum delta
  double virial = 0.0;   // sum f l
  std::int64_t contacts = 0;
};

// Sums over all pairs at w = u - u_ref; dE/du is added to `gradient` (d entries
// a grain), which may be null. With s = w_i - w_j a pair is evaluated by
// differences,
//   delta = delta0 - (2 r0.s + s.s) / (d + d0),   d = |r0 + s|,
// which loses nothing to cancellation while |s| stays of the order of the
// overlaps: the error is about eps |s|, against eps d for plain positions.
//
// Bitwise the same for every list that holds the contacts (an open gap adds
// nothing, and contacts are added up in order) and for every instruction set.
using PairSweep = ContactSums (*)(const PairView& pairs,
                                  double alpha,
                                  const double* w,
                                  double* gradient);

// w divided by a unit and rounded, n entries.
using Narrow = void (*)(int n, double per_unit, const double* w, float* to);

// The largest changes of a coordinate; `is_finite`: all of them are.
struct Displacement {
  bool is_finite = true;
  double from_reference = 0.0;
  double from_list = 0.0;
};

// w = u - u_ref for n entries.
using Displace = Displacement (*)(int n,
                                  const double* u,
                                  const double* u_reference,
                                  const double* u_list,
                                  double* w);

// Pair by pair, arrays as long as those of PairView with their padding.
struct PairStates {
  double* delta = nullptr;      // overlap, negative where open
  double* distance = nullptr;   // l
  double* normal[3] = {};       // n = (x_i - x_j) / l; 0 where centres coincide
  double* force = nullptr;      // f(delta), 0 where open
  double* stiffness = nullptr;  // f'(delta), 0 where open
};
using FindStates = void (*)(const PairView& pairs,
                            double alpha,
                            const double* w,
                            const PairStates& states);

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
// pairs with i = j add nothing. `pairs` are those of all grains.
using WriteBlocks = void (*)(const PairView& pairs,
                             const PairStates& states,
                             const double* first,
                             const double* second,
                             double theta,
                             const BlockPattern& pattern,
                             double* values);

// Force and stiffness of m overlaps >= 0 at k = 1.
using ApplyLaw = void (*)(
    double alpha, int m, const double* delta, double* force, double* stiffness);

struct PairLoops {
  PairSweep sweep = nullptr;
  // With w rounded to float, gaps and directions are found in single precision:
  // the error of a gap is about eps32 (|w_i| + |w_j| + delta0). The law, forces
  // and sums are in double, and the guarantees are the same.
  PairSweep single_sweep = nullptr;
  Narrow narrow = nullptr;
  FindStates states = nullptr;
  WriteBlocks blocks = nullptr;
  ApplyLaw law = nullptr;
  Displace displace = nullptr;
};

// All but `displace` and `narrow` are null for a dimension other than 2 or 3 or
// an alpha that no law handles.
PairLoops PortablePairLoops(int dimension, double alpha);
#ifdef __x86_64__
PairLoops Avx2PairLoops(int dimension, double alpha);
PairLoops Avx512PairLoops(int dimension, double alpha);
#endif
// For the widest instructions that this machine runs.
PairLoops FastestPairLoops(int dimension, double alpha);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PAIR_LOOPS_H_
