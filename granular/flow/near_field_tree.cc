#include "granular/flow/near_field_tree.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "granular/flow/taylor_indices.h"
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

using CellPairs = std::vector<std::pair<int, int>>;

// Cells that act on cell c: in `list` from start[c] to start[c + 1].
struct Sources {
  std::vector<int> start, list;
  void Set(const CellPairs& pairs, int cells) {
    start.assign(cells + 1, 0);
    for (const auto& [a, b] : pairs) {
      ++start[a + 1];
      if (a != b) ++start[b + 1];
    }
    for (int c = 0; c < cells; ++c) start[c + 1] += start[c];
    list.resize(start.back());
    std::vector<int> next(start.begin(), start.end() - 1);
    for (const auto& [a, b] : pairs) {
      list[next[a]++] = b;
      if (a != b) list[next[b]++] = a;
    }
  }
};

// y^-beta; the exponents of most runs are small integers.
double InversePower(double y, double beta) {
  return beta == 1.0   ? 1.0 / y
         : beta == 2.0 ? 1.0 / (y * y)
                       : std::pow(y, -beta);
}

}  // namespace

class NearFieldTree::Impl {
 public:
  Impl(const RadialLaw& law,
       int n,
       const std::vector<double>& weights,
       double accuracy)
      : law_(law),
        n_(n),
        stride_(FlowStride(n)),
        accuracy_(accuracy),
        weights_(weights),
        // Measured to be about the cheapest for exponents 1 and 2: half of the
        // time for far cells, a third for near ones.
        taylor_(accuracy >= 1e-3 ? 8 : kMaxOrder),
        terms_(taylor_.terms()),
        loops_(FastestNearFieldLoops(law, false)) {}

  void Forces(const double* x,
              double* force,
              double* energy,
              double* least_distance,
              double* bound) {
    Sort(x);
    Divide();
    FindMoments();
    PairCells();
    SumFarCells();
    SumLeaves(energy != nullptr);
    std::fill(force, force + 3 * static_cast<std::size_t>(stride_), 0.0);
    for (int i = 0; i < n_; ++i) {
      for (int k = 0; k < 3; ++k) {
        force[k * stride_ + order_[i].second] = f_[k][i];
      }
    }
    double least = std::numeric_limits<double>::infinity();
    double near = 0.0, far = 0.0, far_weight = 0.0, squares = 0.0;
    for (const TaskSums& sums : task_sums_) {
      least = std::min(least, sums.near.least_square);
      near += sums.near.energy;
      far += sums.far_energy;
      far_weight -= sums.near_weight;
    }
    *least_distance = std::sqrt(least);
    *bound = worst_;
    if (energy == nullptr) return;
    // Of ordered pairs, so far. ln d = ln side + ln (d / side).
    *energy = 0.5 * (near + side_ * far);
    for (int i = 0; i < n_; ++i) squares += weights_[i] * weights_[i];
    far_weight += cells_[0].weight * cells_[0].weight - squares;
    for (int k = 0; k < 2; ++k) {
      if (law_.exponent[k] != 1.0) continue;
      *energy += (k == 0 ? 0.5 : -0.5) * law_.strength[k] * std::log(side_) *
                 far_weight;
    }
  }

 private:
  // Of the leaves of a task.
  struct TaskSums {
    NearFieldSums near;
    double far_energy = 0.0;
    double near_weight = 0.0;  // sum of w_i w_j over its near pairs
  };

  int NumTasks() const {
    return (static_cast<int>(cells_.size()) + kTaskCells - 1) / kTaskCells;
  }
  // f(task, cell) for all cells, by tasks on all threads.
  template <typename Function>
  void ForCells(const Function& f) {
    const int cells = static_cast<int>(cells_.size());
    ForEach(NumTasks(), [&](int task) {
      const int end = std::min(cells, (task + 1) * kTaskCells);
      for (int c = task * kTaskCells; c < end; ++c) f(task, c);
    });
  }
  // f(child, y) for the children of a cell, y = (sign d)^n / n! for d = c' - c.
  template <typename Function>
  void ForChildren(int c, double sign, const Function& f) {
    const Cell& cell = cells_[c];
    std::vector<double> y(terms_);
    for (int b = 0; b < cell.children; ++b) {
      const int child = cell.first_child + b;
      double d[3];
      for (int k = 0; k < 3; ++k) {
        d[k] = sign * (cells_[child].centre[k] - cell.centre[k]);
      }
      taylor_.Monomials(d, y.data());
      f(child, y);
    }
  }
  // f(l, k, k + l) for all terms l, k with |k| + |l| <= order.
  template <typename Function>
  void ForTerms(const Function& f) {
    for (int l = 0; l < terms_; ++l) {
      for (int q = taylor_.pair_start[l]; q < taylor_.pair_start[l + 1]; ++q) {
        f(l, taylor_.pair_k[q], taylor_.pair_sum[q]);
      }
    }
  }
  double* MomentsOf(int c) {
    return &moments_[static_cast<std::size_t>(c) * terms_];
  }
  double* LocalOf(int c) {
    return &local_[static_cast<std::size_t>(c) * terms_];
  }
  double* AbsoluteOf(int c) {
    return &absolute_[static_cast<std::size_t>(c) * (taylor_.order + 1)];
  }

  // Grains in the order of a Morton curve, lengths in units of the side of a
  // cube around all, so that powers of lengths stay in range.
  void Sort(const double* x) {
    const double* const at[3] = {x, x + stride_, x + 2 * stride_};
    double low[3];
    side_ = 0.0;
    for (int k = 0; k < 3; ++k) {
      const auto ends = std::minmax_element(at[k], at[k] + n_);
      low[k] = *ends.first;
      side_ = std::max(side_, *ends.second - *ends.first);
    }
    if (!(side_ > 0.0) || !std::isfinite(side_)) side_ = 1.0;
    scaled_law_ = law_;
    for (int k = 0; k < 2; ++k) {
      scaled_law_.strength[k] *= std::pow(side_, -law_.exponent[k]);
    }
    order_.resize(n_);
    for (int i = 0; i < n_; ++i) {
      double y[3];
      for (int k = 0; k < 3; ++k) {
        y[k] = std::clamp((at[k][i] - low[k]) / side_, 0.0, 1.0);
      }
      order_[i] = {MortonCode(y, 3), i};
    }
    std::sort(order_.begin(), order_.end());
    for (int k = 0; k < 3; ++k) {
      x_[k].resize(n_);
      raw_[k].resize(n_);
      f_[k].resize(n_);
      for (int i = 0; i < n_; ++i) {
        raw_[k][i] = at[k][order_[i].second];
        x_[k][i] = (raw_[k][i] - low[k]) / side_;
      }
    }
    weight_.resize(n_);
    for (int i = 0; i < n_; ++i) weight_[i] = weights_[order_[i].second];
  }

  // Cells, parents before children.
  void Divide() {
    cells_.clear();
    cells_.push_back({});
    cells_[0].end = n_;
    std::vector<int> level = {0};
    for (std::size_t c = 0; c < cells_.size(); ++c) {
      Cell cell = cells_[c];
      if (cell.size() > kLeafGrains && level[c] < kLevels) {
        const int shift = kLevels - 1 - level[c];
        cell.first_child = static_cast<int>(cells_.size());
        for (int i = cell.begin; i < cell.end;) {
          const std::uint64_t half = order_[i].first >> shift;
          Cell child;
          child.begin = i;
          while (i < cell.end && order_[i].first >> shift == half) ++i;
          child.end = i;
          cells_.push_back(child);
          level.push_back(level[c] + 1);
          ++cell.children;
        }
      }
      for (int k = 0; k < 3; ++k) {
        const auto ends = std::minmax_element(x_[k].begin() + cell.begin,
                                              x_[k].begin() + cell.end);
        cell.centre[k] = 0.5 * (*ends.first + *ends.second);
      }
      for (int i = cell.begin; i < cell.end; ++i) {
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
          const double d = x_[k][i] - cell.centre[k];
          square += d * d;
        }
        cell.radius = std::max(cell.radius, std::sqrt(square));
        cell.weight += weight_[i];
      }
      cells_[c] = cell;
    }
  }

  // Of leaves from grains, of others from their children: for centres d = c' -
  // c apart, s = d + s'.
  void FindMoments() {
    const int cells = static_cast<int>(cells_.size());
    const int p = taylor_.order;
    moments_.assign(static_cast<std::size_t>(cells) * terms_, 0.0);
    absolute_.assign(static_cast<std::size_t>(cells) * (p + 1), 0.0);
    ForCells([&](int, int c) {
      std::vector<double> y(terms_);
      const Cell& cell = cells_[c];
      double* const moments = MomentsOf(c);
      double* const absolute = AbsoluteOf(c);
      for (int i = cell.begin; i < cell.end; ++i) {
        double s[3], square = 0.0;
        for (int k = 0; k < 3; ++k) {
          s[k] = x_[k][i] - cell.centre[k];
          square += s[k] * s[k];
        }
        double power = weight_[i];
        const double length = std::sqrt(square);
        for (int m = 0; m <= p; ++m, power *= length) absolute[m] += power;
        if (!cell.is_leaf()) continue;
        taylor_.Monomials(s, y.data());
        for (int n = 0; n < terms_; ++n) moments[n] += weight_[i] * y[n];
      }
    });
    for (int c = cells - 1; c >= 0; --c) {
      double* const to = MomentsOf(c);
      ForChildren(c, 1.0, [&](int child, const std::vector<double>& y) {
        const double* const from = MomentsOf(child);
        ForTerms([&](int l, int k, int sum) { to[sum] += y[l] * from[k]; });
      });
    }
  }

  // By the bound of the header, which is kept in worst_.
  bool IsFar(int a, int b) {
    const Cell &A = cells_[a], &B = cells_[b];
    const int p = taylor_.order;
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
      const double beta = scaled_law_.exponent[t];
      if (scaled_law_.strength[t] == 0.0) continue;
      const double ratio = q * (beta + p) / (p + 1.0);
      if (ratio >= 1.0) return false;
      double factor = 1.0;  // (beta)_P / P! / D^P
      for (int m = 0; m < p; ++m) {
        factor *= (beta + m) / (m + 1.0) / distance;
      }
      const double size =
          scaled_law_.strength[t] * InversePower(distance, beta);
      tail[t] = size * factor / (1.0 - ratio);
      least[t] = size * InversePower(1.0 + q, beta);
    }
    double most = 0.0;
    for (const auto& [target, source] : {std::pair{a, b}, std::pair{b, a}}) {
      // sum_j w_j (R_t + |s_j|)^P
      double sum = 0.0, reach_power = 1.0;
      const double* const absolute = AbsoluteOf(source);
      for (int m = p; m >= 0; --m, reach_power *= cells_[target].radius) {
        sum += taylor_.binomial[m] * reach_power * absolute[m];
      }
      most = std::max(most,
                      (tail[0] + tail[1]) * sum /
                          ((least[0] + least[1]) * cells_[source].weight));
    }
    if (!(most <= accuracy_)) return false;
    worst_ = std::max(worst_, most);
    return true;
  }

  // Who is far from whom, who is near.
  void PairCells() {
    worst_ = 0.0;
    CellPairs far, near, open = {{0, 0}};
    while (!open.empty()) {
      const auto [a, b] = open.back();
      open.pop_back();
      const Cell &A = cells_[a], &B = cells_[b];
      if (a == b) {
        if (A.is_leaf()) {
          near.push_back({a, a});
          continue;
        }
        for (int i = 0; i < A.children; ++i) {
          for (int j = i; j < A.children; ++j) {
            open.push_back({A.first_child + i, A.first_child + j});
          }
        }
        continue;
      }
      if (IsFar(a, b)) {
        far.push_back({a, b});
      } else if (A.is_leaf() && B.is_leaf()) {
        near.push_back({a, b});
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
    far_.Set(far, static_cast<int>(cells_.size()));
    near_.Set(near, static_cast<int>(cells_.size()));
  }

  // Far cells into each cell's own series, and those down to the leaves: -t =
  // -d - t' for centres d = c' - c apart.
  void SumFarCells() {
    const int cells = static_cast<int>(cells_.size());
    local_.assign(static_cast<std::size_t>(cells) * terms_, 0.0);
    const TaylorView view = taylor_.View();
    ForCells([&](int, int c) {
      const int begin = far_.start[c], count = far_.start[c + 1] - begin;
      if (count == 0) return;
      std::vector<const double*> moments(count);
      std::vector<double> offset(3 * static_cast<std::size_t>(count));
      double* const offsets[3] = {
          &offset[0], &offset[count], &offset[2 * count]};
      for (int s = 0; s < count; ++s) {
        const int source = far_.list[begin + s];
        moments[s] = MomentsOf(source);
        for (int k = 0; k < 3; ++k) {
          offsets[k][s] = cells_[c].centre[k] - cells_[source].centre[k];
        }
      }
      loops_.far(scaled_law_, view, count, offsets, moments.data(), LocalOf(c));
    });
    for (int c = 0; c < cells; ++c) {
      const double* const from = LocalOf(c);
      ForChildren(c, -1.0, [&](int child, const std::vector<double>& y) {
        double* const to = LocalOf(child);
        ForTerms([&](int l, int k, int sum) { to[l] += y[k] * from[sum]; });
      });
    }
  }

  // Near grains pair by pair, and the leaves' series at each grain.
  void SumLeaves(bool with_energy) {
    task_sums_.assign(NumTasks(), {});
    for (TaskSums& sums : task_sums_) {
      sums.near.least_square = std::numeric_limits<double>::infinity();
    }
    ForCells([&](int task, int c) {
      if (!cells_[c].is_leaf()) return;
      SumNearGrains(c, with_energy, &task_sums_[task]);
      AddSeries(c, &task_sums_[task]);
    });
  }

  void SumNearGrains(int c, bool with_energy, TaskSums* sums) {
    const Cell& cell = cells_[c];
    // Targets first.
    std::vector<const Cell*> sources = {&cell};
    int count = cell.size();
    for (int s = near_.start[c]; s < near_.start[c + 1]; ++s) {
      if (near_.list[s] == c) continue;
      sources.push_back(&cells_[near_.list[s]]);
      count += sources.back()->size();
    }
    const std::size_t stride = FlowStride(count);
    std::vector<double> cloud(3 * stride, 0.0), weight(stride, 0.0);
    int to = 0;
    for (const Cell* from : sources) {
      for (int k = 0; k < 3; ++k) {
        std::copy(raw_[k].begin() + from->begin,
                  raw_[k].begin() + from->end,
                  cloud.begin() + k * stride + to);
      }
      std::copy(weight_.begin() + from->begin,
                weight_.begin() + from->end,
                weight.begin() + to);
      to += from->size();
    }
    NearFieldView view;
    view.n = count;
    for (int k = 0; k < 3; ++k) view.x[k] = cloud.data() + k * stride;
    view.weight = weight.data();
    double* const parts[3] = {f_[0].data() + cell.begin,
                              f_[1].data() + cell.begin,
                              f_[2].data() + cell.begin};
    const NearFieldSums found =
        loops_.cloud(law_, view, cell.size(), with_energy, parts);
    sums->near.energy += found.energy;
    sums->near.least_square =
        std::min(sums->near.least_square, found.least_square);
    double all = 0.0;
    for (int i = 0; i < count; ++i) all += weight[i];
    for (int i = 0; i < cell.size(); ++i) {
      sums->near_weight += weight[i] * (all - weight[i]);
    }
  }

  void AddSeries(int c, TaskSums* sums) {
    const Cell& cell = cells_[c];
    const double* const local = LocalOf(c);
    std::vector<double> y(terms_);
    for (int i = cell.begin; i < cell.end; ++i) {
      double t[3];
      for (int k = 0; k < 3; ++k) t[k] = cell.centre[k] - x_[k][i];
      taylor_.Monomials(t, y.data());
      // V = sum local[l] (-t)^l / l!, and -dV/dt.
      double v = local[0], f[3] = {};
      for (int l = 1; l < terms_; ++l) {
        v += local[l] * y[l];
        for (int k = 0; k < 3; ++k) {
          const int less = taylor_.less_one[3 * l + k];
          if (less >= 0) f[k] += local[l] * y[less];
        }
      }
      sums->far_energy += weight_[i] * v;
      for (int k = 0; k < 3; ++k) f_[k][i] += weight_[i] * f[k];
    }
  }

  const RadialLaw law_;
  const int n_, stride_;
  const double accuracy_;
  const std::vector<double> weights_;
  const TaylorIndices taylor_;
  const int terms_;
  const NearFieldLoops loops_;

  // Of one Forces().
  double side_ = 1.0;
  RadialLaw scaled_law_;                              // of lengths over side_
  std::vector<std::pair<std::uint64_t, int>> order_;  // code and grain
  // In the order of the tree: places over side_, as they are, weights, forces.
  std::vector<double> x_[3], raw_[3], weight_, f_[3];
  std::vector<Cell> cells_;
  // By cell: moments sum w s^k / k!, sums of w |s|^m, local[l] of (-t)^l / l!.
  std::vector<double> moments_, absolute_, local_;
  Sources far_, near_;
  double worst_ = 0.0;  // bound of the errors of forces
  std::vector<TaskSums> task_sums_;
};

NearFieldTree::NearFieldTree(std::unique_ptr<Impl> impl)
    : impl_(std::move(impl)) {}
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
  return std::unique_ptr<NearFieldTree>(
      new NearFieldTree(std::make_unique<Impl>(law, n, weights, accuracy)));
}

void NearFieldTree::Forces(const double* x,
                           double* force,
                           double* energy,
                           double* least_distance,
                           double* bound) const {
  impl_->Forces(x, force, energy, least_distance, bound);
}

}  // namespace granopt
