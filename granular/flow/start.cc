#include "granular/flow/start.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "granular/contact_energy.h"
#include "solvers/format.h"
#include "solvers/random.h"

namespace granopt {

namespace {

constexpr double kPi = 3.14159265358979323846;

// Equal grains in a cube around 0, in cells of a diameter or more: some eight a
// grain at most, however small the grains.
class PlacedGrains {
 public:
  PlacedGrains(const FlowStart& start, double radius)
      : side_(start.side), period_(start.period), radius_(radius) {
    const double most = std::ceil(std::cbrt(8.0 * start.particles));
    cells_ = static_cast<int>(
        std::clamp(side_ / (2.0 * radius), 1.0, std::min(400.0, most)));
    // Periodic, a cell and its two neighbours must be three.
    if (period_ > 0.0 && cells_ < 3) cells_ = 1;
    first_.assign(static_cast<std::size_t>(cells_) * cells_ * cells_, -1);
  }

  // No grain overlaps one at that place.
  bool IsFree(const double* at) const {
    for (int offset = 0; offset < 27; ++offset) {
      const int shift[3] = {offset / 9 - 1, offset / 3 % 3 - 1, offset % 3 - 1};
      int index = 0;
      bool is_inside = true;
      for (int k = 0; k < 3; ++k) {
        int c = CellOf(at[k]) + shift[k];
        if (period_ > 0.0 && cells_ >= 3) {
          c = (c + cells_) % cells_;
        } else if (c < 0 || c >= cells_) {
          is_inside = false;
        }
        index = index * cells_ + c;
      }
      if (!is_inside) continue;
      for (int j = first_[index]; j >= 0; j = next_[j]) {
        if (Overlaps(places_[j], at)) return false;
      }
    }
    return true;
  }

  void Add(const double* at) {
    int index = 0;
    for (int k = 0; k < 3; ++k) index = index * cells_ + CellOf(at[k]);
    next_.push_back(first_[index]);
    first_[index] = static_cast<int>(places_.size());
    places_.push_back({at[0], at[1], at[2]});
  }

 private:
  int CellOf(double y) const {
    return std::clamp(
        static_cast<int>((y / side_ + 0.5) * cells_), 0, cells_ - 1);
  }
  bool Overlaps(const std::array<double, 3>& place, const double* at) const {
    double square = 0.0;
    for (int k = 0; k < 3; ++k) {
      double d = place[k] - at[k];
      if (period_ > 0.0) d -= period_ * std::nearbyint(d / period_);
      square += d * d;
    }
    return square < 4.0 * radius_ * radius_;
  }

  const double side_, period_, radius_;
  int cells_;
  std::vector<std::array<double, 3>> places_;
  std::vector<int> first_, next_;  // lists of the grains of each cell
};

}  // namespace

bool MakeStart(const FlowStart& start,
               Grains* grains,
               FlowState* state,
               std::string* error) {
  const int n = start.particles;
  const int stride = FlowStride(n);
  const double radius = start.length_ratio * start.side / std::cbrt(1.0 * n);
  const double mass =
      start.density * (4.0 / 3.0) * kPi * radius * radius * radius;
  grains->mass.assign(n, mass);
  grains->radius.assign(n, radius);
  grains->is_pinned.clear();
  state->x.assign(3 * static_cast<std::size_t>(stride), 0.0);
  state->v = state->x;
  UniformRandom random(start.seed);
  PlacedGrains placed(start, radius);
  for (int i = 0; i < n; ++i) {
    bool is_free = false;
    double at[3];
    for (int attempt = 0; attempt < std::max(1, start.attempts) && !is_free;
         ++attempt) {
      for (double& y : at) y = start.side * (random() - 0.5);
      is_free = start.attempts == 0 || placed.IsFree(at);
    }
    if (!is_free) {
      *error = Format(
          "placement impossible: no place for grain %d of %d after %d attempts "
          "(volume fraction %.3g; random placement ends near 0.38)",
          i + 1,
          n,
          start.attempts,
          n * GrainVolume(3, radius) / std::pow(start.side, 3));
      return false;
    }
    placed.Add(at);
    for (int k = 0; k < 3; ++k) state->x[k * stride + i] = at[k];
  }
  double sum[3] = {};
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < 3; ++k) {
      const double v = start.perturbation[k] * (2.0 * random() - 1.0);
      state->v[k * stride + i] = v;
      sum[k] += v;
    }
  }
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < 3; ++k) {
      double& v = state->v[k * stride + i];
      v = start.mean[k] + (v - sum[k] / n);
    }
  }
  return true;
}

bool RelaxOverlaps(const Grains& grains,
                   const Domain& domain,
                   const Solver& solver,
                   FlowState* state,
                   std::string* report,
                   std::string* error) {
  const int n = grains.size();
  const int stride = grains.stride();
  // Radii a little larger, so that the end, whose overlaps are small but not 0,
  // has gaps. A domain without images is a cell that none reaches across.
  constexpr double kMargin = 1e-3;
  const double largest =
      *std::max_element(grains.radius.begin(), grains.radius.end());
  double length = 0.0;
  for (int k = 0; k < 3; ++k) {
    const auto ends = std::minmax_element(state->x.begin() + k * stride,
                                          state->x.begin() + k * stride + n);
    length = std::max(length, *ends.second - *ends.first);
  }
  const bool is_periodic = domain.period() > 0.0;
  Packing packing;
  packing.box =
      Box::Cube(3, is_periodic ? domain.side : 2.0 * length + 16.0 * largest);
  packing.positions.resize(3, n);
  packing.radii.resize(n);
  for (int i = 0; i < n; ++i) {
    packing.radii[i] = grains.radius[i] * (1.0 + kMargin);
    for (int k = 0; k < 3; ++k) {
      packing.positions(k, i) = state->x[k * stride + i];
    }
  }
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, {}, error);
  if (energy == nullptr) return false;
  std::vector<double> u(3 * static_cast<std::size_t>(n), 0.0);
  SolveOptions options;
  options.relative_tolerance = 1e-6;
  const Summary summary = solver.Minimize(energy.get(), options, u.data());
  const Packing end = energy->Configuration(u.data());
  double moved = 0.0;
  for (int i = 0; i < n; ++i) {
    double square = 0.0;
    for (int k = 0; k < 3; ++k) {
      double& x = state->x[k * stride + i];
      const double d = end.positions(k, i) - x;
      square += d * d;
      x += d;
    }
    moved = std::max(moved, std::sqrt(square) / grains.radius[i]);
  }
  ContactSearch search;
  std::vector<ClosePair> pairs;
  search.Find(n,
              stride,
              state->x.data(),
              grains.radius.data(),
              domain.period(),
              &pairs);
  if (!pairs.empty()) {
    *error = Format(
        "overlapping start: %zu pairs overlap still after %s (%s): the grains "
        "jam",
        pairs.size(),
        solver.name().c_str(),
        StopReasonName(summary.reason));
    return false;
  }
  *report =
      Format("%s, %lld evaluations, no grain moved by more than %.3g radii",
             solver.name().c_str(),
             static_cast<long long>(summary.counters.evaluations),
             moved);
  return true;
}

}  // namespace granopt
