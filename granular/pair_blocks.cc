#include "granular/pair_blocks.h"

#include <algorithm>

namespace granopt {
namespace {

template <int D>
void AddBlocks(const PairView& pairs,
               const PairStates& states,
               const double* first,
               const double* second,
               double theta,
               const int* rank,
               const int* column_start,
               double* values) {
  for (int p = 0; p < pairs.num_pairs; ++p) {
    const int at_i = pairs.at_i[p], at_j = pairs.at_j[p];
    if (rank[p] < 0 || at_j == at_i || states.distance[p] == 0.0) continue;
    const double tangential = theta * second[p] / states.distance[p];
    const double normal = first[p] + tangential;
    double n[D];
    for (int c = 0; c < D; ++c) n[c] = states.normal[c][p];
    for (int c = 0; c < D; ++c) {
      double* diagonal_i = values + column_start[at_i + c];
      double* diagonal_j = values + column_start[at_j + c];
      double* below = diagonal_i + (D - c) + D * rank[p];
      for (int r = 0; r < D; ++r) {
        const double k = normal * n[r] * n[c] - (r == c ? tangential : 0.0);
        if (r >= c) {
          diagonal_i[r - c] += k;
          diagonal_j[r - c] += k;
        }
        below[r] -= k;
      }
    }
  }
}

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

void AddPairBlocks(int dimension,
                   const PairView& pairs,
                   const PairStates& states,
                   const double* first,
                   const double* second,
                   double theta,
                   const int* rank,
                   const int* column_start,
                   double* values) {
  (dimension == 2 ? AddBlocks<2> : AddBlocks<3>)(pairs,
                                                 states,
                                                 first,
                                                 second,
                                                 theta,
                                                 rank,
                                                 column_start,
                                                 values);
}

void PairHessianTimes(int dimension,
                      const PairView& pairs,
                      const PairStates& states,
                      const double* v,
                      double* hv) {
  (dimension == 2 ? Times<2> : Times<3>)(pairs, states, v, hv);
}

}  // namespace granopt
