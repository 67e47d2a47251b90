// granopt: sums over all pairs of grains, compiled for each instruction set.

#ifndef GRANOPT_GRANULAR_FLOW_NEAR_FIELD_LOOPS_H_
#define GRANOPT_GRANULAR_FLOW_NEAR_FIELD_LOOPS_H_

#include "granular/flow/near_field_law.h"

namespace granopt {

// Vectors of a flow are stored component by component: coordinate k of grain i
// is entry k stride + i, stride = FlowStride(n); what is left over is 0.
constexpr int kFlowLanes = 8;
constexpr int FlowStride(int n) {
  return (n + kFlowLanes - 1) / kFlowLanes * kFlowLanes;
}

struct NearFieldView {
  int n = 0;
  const double* x[3] = {};         // positions, FlowStride(n) entries each
  const double* weight = nullptr;  // w, the same
  double period = 0.0;             // of the cube; 0: no images
};

struct NearFieldSums {
  double energy = 0.0;        // sum over pairs of w_i w_j V(d)
  double least_square = 0.0;  // min d^2; infinity without a pair
};

// Pairs (i, j), i < j, with first <= i < end, `first` a multiple of kFlowLanes:
// w_i w_j f(d) n_ij is added to force[k][i] and taken from force[k][j]. The
// energy is left alone unless asked for.
//
// Bitwise the same for every instruction set, and exactly antisymmetric.
using NearFieldTriangle = NearFieldSums (*)(const RadialLaw& law,
                                            const NearFieldView& view,
                                            int first,
                                            int end,
                                            bool with_energy,
                                            double* const* force);

// The force of all other grains on grain i if it were at `at`; the energy is
// its sum of w_i w_j V(d).
using NearFieldRow = NearFieldSums (*)(const RadialLaw& law,
                                       const NearFieldView& view,
                                       int i,
                                       const double* at,
                                       bool with_energy,
                                       double* force);

// The forces of all grains of the view on its first `targets` ones, written to
// so many entries of force[k] and to no others. The energy is that of ordered
// pairs: each pair of two targets counts twice.
using NearFieldCloud = NearFieldSums (*)(const RadialLaw& law,
                                         const NearFieldView& view,
                                         int targets,
                                         bool with_energy,
                                         double* const* force);

// Multi-indices n = (a, b, c) of degree a + b + c <= order, by degree, and how
// they follow from each other.
constexpr int kMaxOrder = 10;
constexpr int kMaxTerms =
    (kMaxOrder + 1) * (kMaxOrder + 2) * (kMaxOrder + 3) / 6;
struct TaylorView {
  int order = 0;
  int terms = 0;
  const int* degree = nullptr;
  const int* less_one = nullptr;  // 3 an index: that of n - e_i, -1 for none
  const int* less_two = nullptr;  // of n - 2 e_i
  const double* factorial = nullptr;  // n! = a! b! c!
  // Pairs (k, l), |k| + |l| <= order, l by l: k = 0, 1, ... and k + l.
  const int* pair_start = nullptr;
  const int* pair_k = nullptr;
  const int* pair_sum = nullptr;
};

// local[l] += sum over sources and k of moment[k] D^(k + l) V(R), D^n the n-th
// derivatives by -R of V = sum of the terms of (2.3), R = centre of the targets
// less that of the source: `offset[c]` has `sources` entries, `moments` as many
// pointers. Strengths and exponents >= 1 as in RadialLaw.
using NearFieldFar = void (*)(const RadialLaw& law,
                              const TaylorView& taylor,
                              int sources,
                              const double* const* offset,
                              const double* const* moments,
                              double* local);

struct NearFieldLoops {
  NearFieldTriangle triangle = nullptr;
  NearFieldRow row = nullptr;
  NearFieldCloud cloud = nullptr;
  NearFieldFar far = nullptr;
};

NearFieldLoops PortableNearFieldLoops(const RadialLaw& law, bool has_images);
#ifdef __x86_64__
NearFieldLoops Avx2NearFieldLoops(const RadialLaw& law, bool has_images);
NearFieldLoops Avx512NearFieldLoops(const RadialLaw& law, bool has_images);
#endif
// For the widest instructions that this machine runs.
NearFieldLoops FastestNearFieldLoops(const RadialLaw& law, bool has_images);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_NEAR_FIELD_LOOPS_H_
