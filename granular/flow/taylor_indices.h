// granopt: the terms of Taylor series in three variables.

#ifndef GRANOPT_GRANULAR_FLOW_TAYLOR_INDICES_H_
#define GRANOPT_GRANULAR_FLOW_TAYLOR_INDICES_H_

#include <array>
#include <map>
#include <vector>

#include "granular/flow/near_field_loops.h"

namespace granopt {

// Multi-indices up to the order, see TaylorView.
struct TaylorIndices {
  explicit TaylorIndices(int p) : order(p) {
    std::map<std::array<int, 3>, int> rank;
    for (int m = 0; m <= p; ++m) {
      for (int a = m; a >= 0; --a) {
        for (int b = m - a; b >= 0; --b) {
          const std::array<int, 3> n = {a, b, m - a - b};
          rank[n] = static_cast<int>(index.size());
          index.push_back(n);
          degree.push_back(m);
        }
      }
    }
    const auto find = [&](std::array<int, 3> n, int axis, int less) {
      n[axis] -= less;
      return n[axis] < 0 ? -1 : rank.at(n);
    };
    double f[kMaxOrder + 1] = {1.0};
    for (int m = 1; m <= kMaxOrder; ++m) f[m] = m * f[m - 1];
    for (const auto& n : index) {
      for (int axis = 0; axis < 3; ++axis) {
        less_one.push_back(find(n, axis, 1));
        less_two.push_back(find(n, axis, 2));
      }
      factorial.push_back(f[n[0]] * f[n[1]] * f[n[2]]);
    }
    const int terms = static_cast<int>(index.size());
    for (int l = 0; l < terms; ++l) {
      pair_start.push_back(static_cast<int>(pair_k.size()));
      for (int k = 0; k < terms; ++k) {
        if (degree[k] + degree[l] > p) break;
        pair_k.push_back(k);
        pair_sum.push_back(rank.at({index[k][0] + index[l][0],
                                    index[k][1] + index[l][1],
                                    index[k][2] + index[l][2]}));
      }
    }
    pair_start.push_back(static_cast<int>(pair_k.size()));
    for (int m = 0; m <= p; ++m) {
      binomial.push_back(f[p] / (f[m] * f[p - m]));
    }
  }
  int terms() const { return static_cast<int>(index.size()); }
  TaylorView View() const {
    return {order,
            terms(),
            degree.data(),
            less_one.data(),
            less_two.data(),
            factorial.data(),
            pair_start.data(),
            pair_k.data(),
            pair_sum.data()};
  }
  // y^n / n! for all n.
  void Monomials(const double* y, double* to) const {
    to[0] = 1.0;
    for (int n = 1; n < terms(); ++n) {
      const int axis = less_one[3 * n] >= 0       ? 0
                       : less_one[3 * n + 1] >= 0 ? 1
                                                  : 2;
      to[n] = to[less_one[3 * n + axis]] * y[axis] / index[n][axis];
    }
  }

  const int order;
  std::vector<std::array<int, 3>> index;
  std::vector<int> degree, less_one, less_two, pair_start, pair_k, pair_sum;
  std::vector<double> factorial, binomial;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_TAYLOR_INDICES_H_
