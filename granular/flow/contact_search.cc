#include "granular/flow/contact_search.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace granopt {
namespace {

// Fewer grains are compared pair by pair.
constexpr int kFew = 96;

}  // namespace

void ContactSearch::Find(int n,
                         int stride,
                         const double* x,
                         const double* radius,
                         double period,
                         std::vector<ClosePair>* pairs) {
  pairs->clear();
  const double* const at[3] = {x, x + stride, x + 2 * stride};
  const auto compare = [&](int i, int j) {
    double d[3];
    double square = 0.0;
    for (int k = 0; k < 3; ++k) {
      d[k] = at[k][j] - at[k][i];
      if (period > 0.0) d[k] -= period * std::nearbyint(d[k] / period);
      square += d[k] * d[k];
    }
    const double range = radius[i] + radius[j];
    if (!(square < range * range)) return;
    ClosePair pair;
    pair.i = i;
    pair.j = j;
    pair.distance = std::sqrt(square);
    if (square > 0.0) {
      for (int k = 0; k < 3; ++k) pair.normal[k] = d[k] / pair.distance;
    }
    pairs->push_back(pair);
  };
  const auto compare_all = [&] {
    for (int i = 0; i < n; ++i) {
      for (int j = i + 1; j < n; ++j) compare(i, j);
    }
  };
  if (n <= kFew) {
    compare_all();
    return;
  }
  const double width = 2.0 * *std::max_element(radius, radius + n);
  double low[3], cell[3];
  int count[3];
  std::int64_t cells = 1;
  // Not many more cells than grains, however far those are apart.
  const int most = static_cast<int>(std::cbrt(8.0 * n));
  for (int k = 0; k < 3; ++k) {
    double extent = period;
    low[k] = -0.5 * period;
    if (period <= 0.0) {
      const auto ends = std::minmax_element(at[k], at[k] + n);
      low[k] = *ends.first;
      extent = *ends.second - *ends.first;
    }
    if (!std::isfinite(extent)) return;  // no grid
    count[k] = static_cast<int>(
        std::clamp(std::floor(extent / width), 1.0, 1.0 * most));
    cell[k] = extent / count[k];
    cells *= count[k];
  }
  // Periodic, a cell and its two neighbours must be three.
  if (period > 0.0 && *std::min_element(count, count + 3) < 3) {
    compare_all();
    return;
  }
  cell_.resize(n);
  start_.assign(cells + 1, 0);
  sorted_.resize(n);
  for (int i = 0; i < n; ++i) {
    int index = 0;
    for (int k = 0; k < 3; ++k) {
      double y = at[k][i] - low[k];
      if (period > 0.0) y -= period * std::floor(y / period);
      // In this order NaN (0 / 0 of a flat cloud) is cell 0.
      const double c = std::min(std::max(0.0, y / cell[k]), count[k] - 1.0);
      index = index * count[k] + static_cast<int>(c);
    }
    cell_[i] = index;
    ++start_[index + 1];
  }
  for (std::int64_t c = 0; c < cells; ++c) start_[c + 1] += start_[c];
  {
    std::vector<int> next(start_.begin(), start_.end() - 1);
    for (int i = 0; i < n; ++i) sorted_[next[cell_[i]]++] = i;
  }
  for (int i = 0; i < n; ++i) {
    const int own[3] = {cell_[i] / (count[1] * count[2]),
                        cell_[i] / count[2] % count[1],
                        cell_[i] % count[2]};
    for (int offset = 0; offset < 27; ++offset) {
      const int shift[3] = {offset / 9 - 1, offset / 3 % 3 - 1, offset % 3 - 1};
      int index = 0;
      bool is_inside = true;
      for (int k = 0; k < 3; ++k) {
        int c = own[k] + shift[k];
        if (period > 0.0) {
          c = (c + count[k]) % count[k];
        } else if (c < 0 || c >= count[k]) {
          is_inside = false;
        }
        index = index * count[k] + c;
      }
      if (!is_inside) continue;
      for (int s = start_[index]; s < start_[index + 1]; ++s) {
        if (sorted_[s] > i) compare(i, sorted_[s]);
      }
    }
  }
  std::sort(
      pairs->begin(), pairs->end(), [](const ClosePair& a, const ClosePair& b) {
        return a.i != b.i ? a.i < b.i : a.j < b.j;
      });
}

}  // namespace granopt
