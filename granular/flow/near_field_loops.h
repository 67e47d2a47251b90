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

// The force of all other grains on grain i if it were at `at`; `energy` (may be
// null) is its sum of w_i w_j V(d).
using NearFieldRow = NearFieldSums (*)(const RadialLaw& law,
                                       const NearFieldView& view,
                                       int i,
                                       const double* at,
                                       bool with_energy,
                                       double* force);

struct NearFieldLoops {
  NearFieldTriangle triangle = nullptr;
  NearFieldRow row = nullptr;
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
