#include "granular/pair_blocks.h"

#include <algorithm>

namespace granopt {
namespace {

template <int D>
void Times(const PairView& pairs,
           const PairStates& states,
           const double* v,
           double* hv) {
  std::fill(hv, hv + D * pairs.end_grain, 0.0);
  for (int p = 0; p < pairs.num_pairs; ++p) {
    if (!(states.delta[p] > 0.0) || states.distance[p] == 0.0) continue;
    const int at_i = pairs.at_i[p], at_j = pairs.at_j[p];
    const double tangential = states.force[p] / states.distance[p];
    double dv[D];
    double along = 0.0;
    for (int c = 0; c < D; ++c) {
      dv[c] = v[at_i + c] - v[at_j + c];
      along += states.normal[c][p] * dv[c];
    }
    along *= states.stiffness[p] + tangential;
    for (int c = 0; c < D; ++c) {
      const double h = along * states.normal[c][p] - tangential * dv[c];
      hv[at_i + c] += h;
      hv[at_j + c] -= h;
    }
  }
}

}  // namespace

void PairHessianTimes(int dimension,
                      const PairView& pairs,
                      const PairStates& states,
                      const double* v,
                      double* hv) {
  (dimension == 2 ? Times<2> : Times<3>)(pairs, states, v, hv);
}

}  // namespace granopt
