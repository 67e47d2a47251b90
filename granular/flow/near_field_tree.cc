#include "granular/flow/near_field_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "granular/spatial_order.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

// Grains of a cell that is not divided further.
constexpr int kLeafGrains = 32;
constexpr int kLevels = 60;  // bits of MortonCode()
// Target cells that one task of a thread takes.
constexpr int kTaskCells = 32;

struct Cell {
  int begin = 0, end = 0;  // grains, in the order of the tree
  int first_child = -1, children = 0;
  double centre[3] = {};
  double radius = 0.0;
  double weight = 0.0;
  bool is_leaf() const { return children == 0; }
  int size() const { return end - begin; }
};

}  // namespace

struct NearFieldTree::Workspace {
  std::vector<std::pair<std::uint64_t, int>> order;  // code and grain
  // In the order of the tree: places over `side`, as they are, weights.
  std::vector<double> x[3], raw[3], weight;
  std::vector<double> f[3];
  std::vector<Cell> cells;
  // By cell: moments sum w s^k / k!, sums of w |s|^m, local[l] of (-t)^l / l!.
  std::vector<double> moments, absolute, local;
  std::vector<std::pair<int, int>> far, near;
  std::vector<int> far_start, far_list, near_start, near_list;
};

NearFieldTree::NearFieldTree() = default;
NearFieldTree::~NearFieldTree() = default;

std::unique_ptr<NearFieldTree> NearFieldTree::Create(
    const RadialLaw& law,
    int n,
    const std::vector<double>& weights,
    double accuracy) {
  if (law.form != RadialLaw::Form::POWERS) return nullptr;
  for (int k = 0; k < 2; ++k) {
    if (law.strength[k] != 0.0 && law.exponent[k] < 1.0) return nullptr;
  }
  std::unique_ptr<NearFieldTree> tree(new NearFieldTree);
  tree->law_ = law;
  tree->n_ = n;
  tree->stride_ = FlowStride(n);
  tree->accuracy_ = accuracy;
  tree->weights_ = weights;
  // Measured to be about the cheapest for exponents 1 and 2: half of the time
  // for far cells, a third for near ones.
  const int order = accuracy >= 1e-3 ? 8 : kMaxOrder;
  tree->taylor_ = std::make_unique<TaylorIndices>(order);
  tree->workspace_ = std::make_unique<Workspace>();
  return tree;
}

void NearFieldTree::Forces(const double* x,
                           double* force,
                           double* energy,
                           double* least_distance,
                           double* bound) const {
  Workspace& w = *workspace_;
  const TaylorIndices& taylor = *taylor_;
  const int terms = taylor.terms();
  const int p = taylor.order;
  const double* const at[3] = {x, x + stride_, x + 2 * stride_};

  // Lengths in units of the side of a cube around all, so that powers of
  // lengths stay in range.
  double low[3], side = 0.0;
  for (int k = 0; k < 3; ++k) {
    const auto ends = std::minmax_element(at[k], at[k] + n_);
    low[k] = *ends.first;
    side = std::max(side, *ends.second - *ends.first);
  }
  if (!(side > 0.0) || !std::isfinite(side)) side = 1.0;
  RadialLaw law = law_;
  for (int k = 0; k < 2; ++k) {
    law.strength[k] *= std::pow(side, -law.exponent[k]);
  }
  const NearFieldLoops loops = FastestNearFieldLoops(law, false);

  // The order of grains, along a Morton curve.
  w.order.resize(n_);
  for (int i = 0; i < n_; ++i) {
    double y[3];
    for (int k = 0; k < 3; ++k) {
      y[k] = std::clamp((at[k][i] - low[k]) / side, 0.0, 1.0);
    }
    w.order[i] = {MortonCode(y, 3), i};
  }
  std::sort(w.order.begin(), w.order.end());
  for (int k = 0; k < 3; ++k) {
    w.x[k].resize(stride_);
    w.raw[k].resize(stride_);
    w.f[k].assign(stride_, 0.0);
    for (int i = 0; i < n_; ++i) {
      w.raw[k][i] = at[k][w.order[i].second];
      w.x[k][i] = (w.raw[k][i] - low[k]) / side;
    }
  }
  w.weight.resize(stride_);
  for (int i = 0; i < n_; ++i) w.weight[i] = weights_[w.order[i].second];

  // Cells, parents before children.
  w.cells.clear();
  w.cells.push_back({});
  w.cells[0].end = n_;
  std::vector<int> level = {0};
  for (std::size_t c = 0; c < w.cells.size(); ++c) {
    Cell cell = w.cells[c];
    if (cell.size() > kLeafGrains && level[c] < kLevels) {
      const int shift = kLevels - 1 - level[c];
      cell.first_child = static_cast<int>(w.cells.size());
      for (int i = cell.begin; i < cell.end;) {
        const std::uint64_t half = w.order[i].first >> shift;
        Cell child;
        child.begin = i;
        while (i < cell.end && w.order[i].first >> shift == half) ++i;
        child.end = i;
        w.cells.push_back(child);
        level.push_back(level[c] + 1);
        ++cell.children;
      }
    }
    for (int k = 0; k < 3; ++k) {
      const auto ends = std::minmax_element(w.x[k].begin() + cell.begin,
                                            w.x[k].begin() + cell.end);
      cell.centre[k] = 0.5 * (*ends.first + *ends.second);
    }
    for (int i = cell.begin; i < cell.end; ++i) {
      double square = 0.0;
      for (int k = 0; k < 3; ++k) {
        const double d = w.x[k][i] - cell.centre[k];
        square += d * d;
      }
      cell.radius = std::max(cell.radius, std::sqrt(square));
      cell.weight += w.weight[i];
    }
    w.cells[c] = cell;
  }
  const int cells = static_cast<int>(w.cells.size());

  // Moments, of leaves from grains, of others from their children: for centres
  // d = c' - c apart, s = d + s'.
  w.moments.assign(static_cast<std::size_t>(cells) * terms, 0.0);
  w.absolute.assign(static_cast<std::size_t>(cells) * (p + 1), 0.0);
  w.local.assign(static_cast<std::size_t>(cells) * terms, 0.0);
  const auto tasks = [](int count) {
    return (count + kTaskCells - 1) / kTaskCells;
  };
  ForEach(tasks(cells), [&](int task) {
    std::vector<double> y(terms);
    for (int c = task * kTaskCells;
         c < std::min(cells, (task + 1) * kTaskCells);
         ++c) {
      const Cell& cell = w.cells[c];
      double* const moments = &w.moments[static_cast<std::size_t>(c) * terms];
      double* const absolute =
          &w.absolute[static_cast<std::size_t>(c) * (p + 1)];
      for (int i = cell.begin; i < cell.end; ++i) {
        double s[3], square = 0.0;
        for (int k = 0; k < 3; ++k) {
          s[k] = w.x[k][i] - cell.centre[k];
          square += s[k] * s[k];
        }
        double power = w.weight[i];
        const double length = std::sqrt(square);
        for (int m = 0; m <= p; ++m, power *= length) absolute[m] += power;
        if (!cell.is_leaf()) continue;
        taylor.Monomials(s, y.data());
        for (int n = 0; n < terms; ++n) moments[n] += w.weight[i] * y[n];
      }
    }
  });
  {
    std::vector<double> y(terms);
    for (int c = cells - 1; c >= 0; --c) {
      const Cell& cell = w.cells[c];
      double* const to = &w.moments[static_cast<std::size_t>(c) * terms];
      for (int b = 0; b < cell.children; ++b) {
        const int child = cell.first_child + b;
        const double* const from =
            &w.moments[static_cast<std::size_t>(child) * terms];
        double d[3];
        for (int k = 0; k < 3; ++k) {
          d[k] = w.cells[child].centre[k] - cell.centre[k];
        }
        taylor.Monomials(d, y.data());
        for (int l = 0; l < terms; ++l) {
          for (int q = taylor.pair_start[l]; q < taylor.pair_start[l + 1];
               ++q) {
            to[taylor.pair_sum[q]] += y[l] * from[taylor.pair_k[q]];
          }
        }
      }
    }
  }

  // Who is far from whom.
  // y^-beta; the exponents of most runs are small integers.
  const auto power = [](double y, double beta) {
    return beta == 1.0   ? 1.0 / y
           : beta == 2.0 ? 1.0 / (y * y)
                         : std::pow(y, -beta);
  };
  double worst = 0.0;
  const auto is_far = [&](int a, int b) {
    const Cell &A = w.cells[a], &B = w.cells[b];
    double square = 0.0;
    for (int k = 0; k < 3; ++k) {
      const double d = A.centre[k] - B.centre[k];
      square += d * d;
    }
    const double reach = A.radius + B.radius;
    // At q = 0.7 no order in use reaches any accuracy in use.
    if (!(reach * reach < 0.49 * square)) return false;
    const double distance = std::sqrt(square);
    const double q = reach / distance;
    // Of each power, over D^-beta: what the tail and what the forces amount to.
    double tail[2] = {}, least[2] = {};
    for (int t = 0; t < 2; ++t) {
      const double beta = law.exponent[t];
      if (law.strength[t] == 0.0) continue;
      const double ratio = q * (beta + p) / (p + 1.0);
      if (ratio >= 1.0) return false;
      double factor = 1.0;  // (beta)_P / P! / D^P
      for (int m = 0; m < p; ++m) {
        factor *= (beta + m) / (m + 1.0) / distance;
      }
      const double size = law.strength[t] * power(distance, beta);
      tail[t] = size * factor / (1.0 - ratio);
      least[t] = size * power(1.0 + q, beta);
    }
    double most = 0.0;
    for (const auto& [target, source] : {std::pair{a, b}, std::pair{b, a}}) {
      // sum_j w_j (R_t + |s_j|)^P
      double sum = 0.0, reach_power = 1.0;
      const double* const absolute =
          &w.absolute[static_cast<std::size_t>(source) * (p + 1)];
      for (int m = p; m >= 0; --m, reach_power *= w.cells[target].radius) {
        sum += taylor.binomial[m] * reach_power * absolute[m];
      }
      most = std::max(most,
                      (tail[0] + tail[1]) * sum /
                          ((least[0] + least[1]) * w.cells[source].weight));
    }
    if (!(most <= accuracy_)) return false;
    worst = std::max(worst, most);
    return true;
  };
  w.far.clear();
  w.near.clear();
  std::vector<std::pair<int, int>> open = {{0, 0}};
  while (!open.empty()) {
    const auto [a, b] = open.back();
    open.pop_back();
    const Cell &A = w.cells[a], &B = w.cells[b];
    if (a == b) {
      if (A.is_leaf()) {
        w.near.push_back({a, a});
        continue;
      }
      for (int i = 0; i < A.children; ++i) {
        for (int j = i; j < A.children; ++j) {
          open.push_back({A.first_child + i, A.first_child + j});
        }
      }
      continue;
    }
    if (is_far(a, b)) {
      w.far.push_back({a, b});
    } else if (A.is_leaf() && B.is_leaf()) {
      w.near.push_back({a, b});
    } else if (B.is_leaf() || (!A.is_leaf() && A.radius >= B.radius)) {
      for (int i = 0; i < A.children; ++i) {
        open.push_back({A.first_child + i, b});
      }
    } else {
      for (int i = 0; i < B.children; ++i) {
        open.push_back({a, B.first_child + i});
      }
    }
  }
  // By target.
  const auto by_target = [cells](const std::vector<std::pair<int, int>>& pairs,
                                 std::vector<int>* start,
                                 std::vector<int>* list) {
    start->assign(cells + 1, 0);
    for (const auto& [a, b] : pairs) {
      ++(*start)[a + 1];
      if (a != b) ++(*start)[b + 1];
    }
    for (int c = 0; c < cells; ++c) (*start)[c + 1] += (*start)[c];
    list->resize(start->back());
    std::vector<int> next(start->begin(), start->end() - 1);
    for (const auto& [a, b] : pairs) {
      (*list)[next[a]++] = b;
      if (a != b) (*list)[next[b]++] = a;
    }
  };
  by_target(w.far, &w.far_start, &w.far_list);
  by_target(w.near, &w.near_start, &w.near_list);

  // Far cells into each cell's own series.
  const TaylorView view = taylor.View();
  ForEach(tasks(cells), [&](int task) {
    std::vector<double> offset[3];
    std::vector<const double*> moments;
    for (int c = task * kTaskCells;
         c < std::min(cells, (task + 1) * kTaskCells);
         ++c) {
      const int begin = w.far_start[c], count = w.far_start[c + 1] - begin;
      if (count == 0) continue;
      moments.resize(count);
      for (int k = 0; k < 3; ++k) offset[k].resize(count);
      for (int s = 0; s < count; ++s) {
        const int source = w.far_list[begin + s];
        moments[s] = &w.moments[static_cast<std::size_t>(source) * terms];
        for (int k = 0; k < 3; ++k) {
          offset[k][s] = w.cells[c].centre[k] - w.cells[source].centre[k];
        }
      }
      const double* const offsets[3] = {
          offset[0].data(), offset[1].data(), offset[2].data()};
      loops.far(law,
                view,
                count,
                offsets,
                moments.data(),
                &w.local[static_cast<std::size_t>(c) * terms]);
    }
  });
  // Down to the leaves: -t = -d - t' for centres d = c' - c apart.
  {
    std::vector<double> y(terms);
    for (int c = 0; c < cells; ++c) {
      const Cell& cell = w.cells[c];
      const double* const from = &w.local[static_cast<std::size_t>(c) * terms];
      for (int b = 0; b < cell.children; ++b) {
        const int child = cell.first_child + b;
        double* const to = &w.local[static_cast<std::size_t>(child) * terms];
        double d[3];
        for (int k = 0; k < 3; ++k) {
          d[k] = cell.centre[k] - w.cells[child].centre[k];
        }
        taylor.Monomials(d, y.data());
        for (int l = 0; l < terms; ++l) {
          for (int q = taylor.pair_start[l]; q < taylor.pair_start[l + 1];
               ++q) {
            to[l] += y[taylor.pair_k[q]] * from[taylor.pair_sum[q]];
          }
        }
      }
    }
  }

  // Leaves: their series at each grain, and near grains pair by pair.
  const int num_tasks = tasks(cells);
  std::vector<NearFieldSums> sums(num_tasks);
  std::vector<double> far_energy(num_tasks, 0.0), near_weight(num_tasks, 0.0);
  ForEach(num_tasks, [&](int task) {
    std::vector<double> y(terms), cloud, weight;
    sums[task].least_square = std::numeric_limits<double>::infinity();
    for (int c = task * kTaskCells;
         c < std::min(cells, (task + 1) * kTaskCells);
         ++c) {
      const Cell& cell = w.cells[c];
      if (!cell.is_leaf()) continue;
      const int targets = cell.size();
      int count = targets;
      for (int s = w.near_start[c]; s < w.near_start[c + 1]; ++s) {
        if (w.near_list[s] != c) count += w.cells[w.near_list[s]].size();
      }
      const int stride = FlowStride(count);
      cloud.assign(3 * static_cast<std::size_t>(stride), 0.0);
      weight.assign(stride, 0.0);
      int to = 0;
      const auto append = [&](const Cell& from) {
        for (int k = 0; k < 3; ++k) {
          std::copy(w.raw[k].begin() + from.begin,
                    w.raw[k].begin() + from.end,
                    cloud.begin() + static_cast<std::size_t>(k) * stride + to);
        }
        std::copy(w.weight.begin() + from.begin,
                  w.weight.begin() + from.end,
                  weight.begin() + to);
        to += from.size();
      };
      append(cell);
      for (int s = w.near_start[c]; s < w.near_start[c + 1]; ++s) {
        if (w.near_list[s] != c) append(w.cells[w.near_list[s]]);
      }
      NearFieldView near;
      near.n = count;
      for (int k = 0; k < 3; ++k) {
        near.x[k] = cloud.data() + static_cast<std::size_t>(k) * stride;
      }
      near.weight = weight.data();
      double* const parts[3] = {w.f[0].data() + cell.begin,
                                w.f[1].data() + cell.begin,
                                w.f[2].data() + cell.begin};
      const NearFieldSums s =
          loops.cloud(law_, near, targets, energy != nullptr, parts);
      sums[task].energy += s.energy;
      double all = 0.0;
      for (int i = 0; i < count; ++i) all += weight[i];
      for (int i = 0; i < targets; ++i) {
        near_weight[task] += weight[i] * (all - weight[i]);
      }
      sums[task].least_square =
          std::min(sums[task].least_square, s.least_square);
      const double* const local = &w.local[static_cast<std::size_t>(c) * terms];
      for (int i = cell.begin; i < cell.end; ++i) {
        double t[3];
        for (int k = 0; k < 3; ++k) t[k] = cell.centre[k] - w.x[k][i];
        taylor.Monomials(t, y.data());
        // V = sum local[l] (-t)^l / l!, and -dV/dt.
        double v = local[0], f[3] = {};
        for (int l = 1; l < terms; ++l) {
          v += local[l] * y[l];
          for (int k = 0; k < 3; ++k) {
            const int less = taylor.less_one[3 * l + k];
            if (less >= 0) f[k] += local[l] * y[less];
          }
        }
        far_energy[task] += w.weight[i] * v;
        for (int k = 0; k < 3; ++k) w.f[k][i] += w.weight[i] * f[k];
      }
    }
  });
  std::fill(force, force + 3 * static_cast<std::size_t>(stride_), 0.0);
  for (int i = 0; i < n_; ++i) {
    for (int k = 0; k < 3; ++k) {
      force[k * stride_ + w.order[i].second] = w.f[k][i];
    }
  }
  double least = std::numeric_limits<double>::infinity();
  double near = 0.0, far = 0.0, far_weight = 0.0, squares = 0.0;
  for (int task = 0; task < num_tasks; ++task) {
    least = std::min(least, sums[task].least_square);
    near += sums[task].energy;
    far += far_energy[task];
    far_weight -= near_weight[task];
  }
  *least_distance = std::sqrt(least);
  *bound = worst;
  if (energy == nullptr) return;
  // Of ordered pairs, so far. ln d = ln side + ln (d / side).
  *energy = 0.5 * (near + side * far);
  for (int i = 0; i < n_; ++i) squares += weights_[i] * weights_[i];
  far_weight += w.cells[0].weight * w.cells[0].weight - squares;
  for (int k = 0; k < 2; ++k) {
    if (law_.exponent[k] != 1.0) continue;
    *energy +=
        (k == 0 ? 0.5 : -0.5) * law_.strength[k] * std::log(side) * far_weight;
  }
}

}  // namespace granopt
