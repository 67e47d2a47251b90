#include "granular/pair_blocks.h"

#include <algorithm>

namespace granopt {
namespace {

// to += k, n entries, always the first two in one register: a load of two that
// follows two stores of one would have to wait for them to reach the cache.
template <int n>
void AddColumn(const double* k, double* to) {
  typedef double Two __attribute__((vector_size(16), aligned(8), may_alias));
  if constexpr (n == 1) {
    *to += *k;
  } else {
    *reinterpret_cast<Two*>(to) += Two{k[0], k[1]};
    for (int r = 2; r < n; ++r) to[r] += k[r];
  }
}

// The lower triangle of a block to two of them, column by column.
template <int D, int c = 0>
void AddDiagonal(const double (&k)[D][D],
                 const int* start_i,
                 const int* start_j,
                 double* values) {
  if constexpr (c < D) {
    AddColumn<D - c>(k[c] + c, values + start_i[c]);
    AddColumn<D - c>(k[c] + c, values + start_j[c]);
    AddDiagonal<D, c + 1>(k, start_i, start_j, values);
  }
}

// Blocks of pairs, long enough to be worked on by registers.
constexpr int kBlock = 128;

// `kShared`: several pairs may share a block, and `values` are zero; else each
// block below the diagonal is written once, and only diagonals are zero.
template <int D, bool kShared>
void AddBlocks(const PairView& pairs,
               const PairStates& states,
               const double* first,
               const double* second,
               double theta,
               const int* rank,
               const int* column_start,
               double* values) {
  double normal[kBlock], tangential[kBlock];
  for (int at = 0; at < pairs.num_pairs; at += kBlock) {
    const int count = std::min(kBlock, pairs.num_pairs - at);
    for (int q = 0; q < count; ++q) {
      const double distance = states.distance[at + q];
      // Centres that coincide have no direction: no block.
      const double is_apart = distance == 0.0 ? 0.0 : 1.0;
      tangential[q] =
          is_apart * theta * second[at + q] / (distance + (1.0 - is_apart));
      normal[q] = is_apart * first[at + q] + tangential[q];
    }
    for (int q = 0; q < count; ++q) {
      const int p = at + q;
      const int at_i = pairs.at_i[p], at_j = pairs.at_j[p];
      if (rank[p] < 0 || at_j == at_i) continue;
      double n[D];
      for (int c = 0; c < D; ++c) n[c] = states.normal[c][p];
      double k[D][D];
      for (int c = 0; c < D; ++c) {
        for (int r = 0; r < D; ++r) {
          k[c][r] = normal[q] * n[r] * n[c];
          if (r == c) k[c][r] -= tangential[q];
        }
        double* below = values + column_start[at_i + c] + (D - c) + D * rank[p];
        for (int r = 0; r < D; ++r) {
          below[r] = kShared ? below[r] - k[c][r] : -k[c][r];
        }
      }
      AddDiagonal<D>(k, column_start + at_i, column_start + at_j, values);
    }
  }
}

template <int D>
void WriteBlocks(int num_grains,
                 const PairView& pairs,
                 const PairStates& states,
                 const double* first,
                 const double* second,
                 double theta,
                 const BlockPattern& pattern,
                 double* values) {
  const int* const start = pattern.column_start;
  if (pattern.has_shared_blocks) {
    std::fill(values, values + start[D * num_grains], 0.0);
    return AddBlocks<D, true>(
        pairs, states, first, second, theta, pattern.rank, start, values);
  }
  for (int column = 0; column < D * num_grains; column += D) {
    for (int c = 0; c < D; ++c) {
      for (int r = c; r < D; ++r) values[start[column + c] + r - c] = 0.0;
    }
  }
  AddBlocks<D, false>(
      pairs, states, first, second, theta, pattern.rank, start, values);
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

void WritePairBlocks(int dimension,
                     int num_grains,
                     const PairView& pairs,
                     const PairStates& states,
                     const double* first,
                     const double* second,
                     double theta,
                     const BlockPattern& pattern,
                     double* values) {
  (dimension == 2 ? WriteBlocks<2> : WriteBlocks<3>)(num_grains,
                                                     pairs,
                                                     states,
                                                     first,
                                                     second,
                                                     theta,
                                                     pattern,
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
