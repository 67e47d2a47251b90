#include "granular/flow/flow.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "granular/contact_energy.h"
#include "solvers/format.h"
#include "solvers/random.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

bool InRange(const char* what,
             double value,
             double low,
             double high,
             std::string* error) {
  if (value >= low && value <= high) return true;
  *error = Format("%s = %g must be in [%g, %g]", what, value, low, high);
  return false;
}

// f(entry, grain) for all coordinates of all grains.
template <typename Function>
void ForEntries(int n, int stride, const Function& f) {
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < n; ++i) f(k * stride + i, i, k);
  }
}

bool CheckImpact(const ImpactOptions& impact, std::string* error) {
  const FrictionOptions& friction = impact.friction;
  constexpr double kMost = 1e6;
  if (!InRange("restitution e", impact.restitution, 0.0, 1.0, error) ||
      !InRange(
          "least restitution e-", impact.least_restitution, 0.0, 1.0, error) ||
      !InRange("impact duration gamma", impact.duration, 0.0, 1.0, error) ||
      !InRange("mu_s", friction.mu_static, 0.0, kMost, error) ||
      !InRange("mu_d", friction.mu_dynamic, 0.0, kMost, error)) {
    return false;
  }
  if (impact.is_velocity_dependent && !(impact.velocity_scale > 0.0)) {
    *error = Format("velocity scale v* = %g must be positive",
                    impact.velocity_scale);
    return false;
  }
  if (friction.mu_dynamic > friction.mu_static) {
    *error =
        Format("mu_d = %g > mu_s = %g: sliding grains would be reversed (5.12)",
               friction.mu_dynamic,
               friction.mu_static);
    return false;
  }
  return true;
}

}  // namespace

void ExternalForce::At(double time, double* acceleration) const {
  const double sine = std::sin(frequency * time + phase);
  for (int k = 0; k < 3; ++k) {
    acceleration[k] = constant[k] + amplitude[k] * sine;
  }
}

const char* WeightName(FlowSceneOptions::Weight weight) {
  switch (weight) {
    case FlowSceneOptions::Weight::MASS:
      return "mass";
    case FlowSceneOptions::Weight::AREA:
      return "area";
    case FlowSceneOptions::Weight::ONE:
      return "one";
  }
  return "";
}

std::unique_ptr<FlowScene> FlowScene::Create(const FlowSceneOptions& options,
                                             std::string* error) {
  const Grains& grains = options.grains;
  const int n = grains.size();
  if (n < 1) {
    *error = "a flow needs at least one grain";
    return nullptr;
  }
  if (static_cast<int>(grains.radius.size()) != n ||
      (!grains.is_pinned.empty() &&
       static_cast<int>(grains.is_pinned.size()) != n)) {
    *error = Format("%d masses, %zu radii", n, grains.radius.size());
    return nullptr;
  }
  for (int i = 0; i < n; ++i) {
    for (const double value : {grains.mass[i], grains.radius[i]}) {
      if (!(value > 0.0 && std::isfinite(value))) {
        *error = Format("grain %d: mass %g and radius %g must be positive",
                        i,
                        grains.mass[i],
                        grains.radius[i]);
        return nullptr;
      }
    }
  }
  if (options.impact && options.soft_contact) {
    *error = "impacts and soft contacts exclude each other";
    return nullptr;
  }
  if (options.impact && !CheckImpact(*options.impact, error)) return nullptr;
  if (options.soft_contact) {
    if (!InRange("contact stiffness",
                 options.soft_contact->stiffness,
                 0.0,
                 std::numeric_limits<double>::max(),
                 error) ||
        !InRange("contact exponent alpha",
                 options.soft_contact->alpha,
                 2.0,
                 10.0,
                 error)) {
      return nullptr;
    }
  }
  if (!InRange("damping",
               options.damping,
               0.0,
               std::numeric_limits<double>::max(),
               error)) {
    return nullptr;
  }
  if (options.external) {
    const ExternalForce& force = *options.external;
    bool is_finite =
        std::isfinite(force.frequency) && std::isfinite(force.phase);
    for (int k = 0; k < 3; ++k) {
      is_finite = is_finite && std::isfinite(force.constant[k]) &&
                  std::isfinite(force.amplitude[k]);
    }
    if (!is_finite) {
      *error = Format(
          "external force: frequency %g, phase %g and vectors must be finite",
          force.frequency,
          force.phase);
      return nullptr;
    }
  }
  const double largest =
      *std::max_element(grains.radius.begin(), grains.radius.end());
  if (options.domain.kind != Domain::Kind::OPEN &&
      !(options.domain.side >= 4.0 * largest)) {
    *error = Format("cube of side %g is smaller than four radii (%g)",
                    options.domain.side,
                    largest);
    return nullptr;
  }
  std::unique_ptr<FlowScene> scene(new FlowScene);
  scene->options_ = options;
  scene->n_ = n;
  scene->stride_ = grains.stride();
  scene->inverse_mass_.assign(scene->stride_, 0.0);
  for (int i = 0; i < n; ++i) {
    if (!grains.is_pinned.empty() && grains.is_pinned[i] != 0) continue;
    scene->inverse_mass_[i] = 1.0 / grains.mass[i];
    scene->total_mass_ += grains.mass[i];
  }
  scene->least_radius_ =
      *std::min_element(grains.radius.begin(), grains.radius.end());
  if (options.near_field) {
    std::vector<double> weights(scene->stride_, 0.0);
    for (int i = 0; i < n; ++i) {
      switch (options.weight) {
        case FlowSceneOptions::Weight::MASS:
          weights[i] = grains.mass[i];
          break;
        case FlowSceneOptions::Weight::AREA:
          weights[i] = 4.0 * kPi * grains.radius[i] * grains.radius[i];
          break;
        case FlowSceneOptions::Weight::ONE:
          weights[i] = 1.0;
          break;
      }
    }
    scene->near_field_ = NearField::Create(*options.near_field,
                                           n,
                                           std::move(weights),
                                           options.domain.period(),
                                           error);
    if (scene->near_field_ == nullptr) return nullptr;
  }
  return scene;
}

bool FlowScene::Begin(double step, FlowState* state, std::string* error) const {
  const std::size_t size = 3 * static_cast<std::size_t>(stride_);
  if (state->x.size() != size || state->v.size() != size) {
    *error = Format("%zu coordinates and %zu velocities for %d grains",
                    state->x.size(),
                    state->v.size(),
                    n_);
    return false;
  }
  bool is_finite = true;
  ForEntries(n_, stride_, [&](int e, int, int) {
    is_finite =
        is_finite && std::isfinite(state->x[e]) && std::isfinite(state->v[e]);
  });
  if (!is_finite) {
    *error = "a coordinate or velocity of the start is not finite";
    return false;
  }
  FindContacts(state->x.data(), &pairs_);
  const double* const radius = options_.grains.radius.data();
  const ClosePair* worst = nullptr;
  double worst_overlap = 0.0;
  int overlapping = 0;
  for (const ClosePair& pair : pairs_) {
    if (pair.distance == 0.0) {
      *error = Format("coincident grains: %d and %d are both at (%g, %g, %g)",
                      pair.i,
                      pair.j,
                      state->x[pair.i],
                      state->x[stride_ + pair.i],
                      state->x[2 * stride_ + pair.i]);
      return false;
    }
    const double overlap =
        1.0 - pair.distance / (radius[pair.i] + radius[pair.j]);
    // Grains that touch are no fault.
    if (overlap > 1e-12) ++overlapping;
    if (overlap > worst_overlap) {
      worst = &pair;
      worst_overlap = overlap;
    }
  }
  if (options_.impact && overlapping > 0) {
    *error = Format(
        "overlapping start: %d pairs of grains overlap, %d and %d by %.3g of "
        "the sum of their radii (--relax_overlaps moves them apart)",
        overlapping,
        worst->i,
        worst->j,
        worst_overlap);
    return false;
  }
  FlowState fresh;
  fresh.x = std::move(state->x);
  fresh.v = std::move(state->v);
  fresh.step = step;
  for (int i = 0; i < n_; ++i) {
    if (inverse_mass_[i] > 0.0) continue;
    for (int k = 0; k < 3; ++k) fresh.v[k * stride_ + i] = 0.0;
  }
  *state = std::move(fresh);
  state->kinetic_start = Kinetic(state->v.data()).total();
  state->potential_start = Potential(state->x.data());
  Momentum(state->v.data(), state->momentum_start.data());
  return true;
}

void FlowScene::FindContacts(const double* x,
                             std::vector<ClosePair>* pairs) const {
  search_.Find(n_,
               stride_,
               x,
               options_.grains.radius.data(),
               options_.domain.period(),
               0.0,
               pairs);
}

void FlowScene::Forces(const double* x,
                       double time,
                       bool with_energy,
                       SmoothForces* forces) const {
  const std::size_t size = 3 * static_cast<std::size_t>(stride_);
  forces->total.assign(size, 0.0);
  forces->near_field_energy = forces->soft_contact_energy = 0.0;
  if (kHasNearField && near_field_ != nullptr) {
    forces->near_field.resize(size);
    near_field_->Forces(x,
                        forces->near_field.data(),
                        with_energy ? &forces->near_field_energy : nullptr);
    forces->total = forces->near_field;
  }
  if (kHasSoftContacts && options_.soft_contact) {
    forces->soft_contact.resize(size);
    FindContacts(x, &pairs_);
    forces->soft_contact_energy =
        SoftContactForces(pairs_,
                          *options_.soft_contact,
                          options_.grains.radius.data(),
                          stride_,
                          forces->soft_contact.data());
    for (std::size_t e = 0; e < size; ++e) {
      forces->total[e] += forces->soft_contact[e];
    }
  }
  if (kHasExternalForces && options_.external) {
    double a[3];
    options_.external->At(time, a);
    ForEntries(n_, stride_, [&](int e, int i, int k) {
      forces->total[e] += options_.grains.mass[i] * a[k];
    });
  }
}

double FlowScene::Potential(const double* x) const {
  if (near_field_ == nullptr && !options_.soft_contact) return 0.0;
  SmoothForces forces;
  Forces(x, 0.0, true, &forces);
  return forces.near_field_energy + forces.soft_contact_energy;
}

KineticEnergy FlowScene::Kinetic(const double* v) const {
  double p[3];
  Momentum(v, p);
  KineticEnergy kinetic;
  for (int k = 0; k < 3; ++k) {
    const double mean = total_mass_ > 0.0 ? p[k] / total_mass_ : 0.0;
    kinetic.bulk += 0.5 * p[k] * mean;
    double sum = 0.0;
    for (int i = 0; i < n_; ++i) {
      if (inverse_mass_[i] == 0.0) continue;
      const double dv = v[k * stride_ + i] - mean;
      sum += options_.grains.mass[i] * dv * dv;
    }
    kinetic.relative += 0.5 * sum;
  }
  return kinetic;
}

void FlowScene::Momentum(const double* v, double* p) const {
  for (int k = 0; k < 3; ++k) {
    p[k] = 0.0;
    for (int i = 0; i < n_; ++i) {
      if (inverse_mass_[i] == 0.0) continue;
      p[k] += options_.grains.mass[i] * v[k * stride_ + i];
    }
  }
}

double FlowScene::PotentialOf(int i, const double* x, const double* at) const {
  double energy = 0.0;
  if (near_field_ != nullptr) {
    double force[3];
    near_field_->ForceOn(i, x, at, force, &energy);
  }
  if (options_.soft_contact) {
    for (int j = 0; j < n_; ++j) {
      if (j == i) continue;
      double square = 0.0;
      for (int k = 0; k < 3; ++k) {
        const double d = x[k * stride_ + j] - at[k];
        square += d * d;
      }
      energy +=
          EvaluateSoftContact(*options_.soft_contact,
                              options_.grains.radius[i] +
                                  options_.grains.radius[j] - std::sqrt(square))
              .energy;
    }
  }
  return energy;
}

void FlowScene::ApplyBoundary(FlowState* state) const {
  if (options_.domain.kind == Domain::Kind::OPEN) return;
  const double half = 0.5 * options_.domain.side;
  const bool jumps_cost = options_.domain.kind == Domain::Kind::REENTRY &&
                          (near_field_ != nullptr || options_.soft_contact);
  double* const x = state->x.data();
  double* const v = state->v.data();
  for (int i = 0; i < n_; ++i) {
    if (inverse_mass_[i] == 0.0) continue;
    double from[3], to[3];
    bool moved = false;
    for (int k = 0; k < 3; ++k) {
      const int e = k * stride_ + i;
      from[k] = to[k] = x[e];
      if (!(std::fabs(x[e]) > half && x[e] * v[e] > 0.0)) continue;
      switch (options_.domain.kind) {
        case Domain::Kind::OPEN:
          break;
        case Domain::Kind::REENTRY:
          to[k] = -x[e];
          moved = true;
          break;
        case Domain::Kind::NEAREST_IMAGE:
          to[k] = x[e] - 2.0 * half * std::nearbyint(x[e] / (2.0 * half));
          moved = true;
          break;
        case Domain::Kind::WALLS:
          state->momentum.fixed[k] -= 2.0 * options_.grains.mass[i] * v[e];
          v[e] = -v[e];
          ++state->jumps;
          break;
      }
    }
    if (!moved) continue;
    ++state->jumps;
    if (jumps_cost) {
      state->energy.boundary += PotentialOf(i, x, to) - PotentialOf(i, x, from);
    }
    for (int k = 0; k < 3; ++k) x[k * stride_ + i] = to[k];
  }
}

void FlowScene::Book(const SmoothForces& forces,
                     double duration,
                     const double* u,
                     const double* v,
                     FlowState* state) const {
  const auto work = [&](const std::vector<double>& force) {
    double sum = 0.0;
    ForEntries(n_, stride_, [&](int e, int i, int) {
      if (inverse_mass_[i] == 0.0) return;
      sum += force[e] * (u[e] + v[e]);
    });
    return 0.5 * duration * sum;
  };
  if (!forces.near_field.empty()) {
    state->energy.near_field += work(forces.near_field);
  }
  if (!forces.soft_contact.empty()) {
    state->energy.soft_contact += work(forces.soft_contact);
  }
  if (options_.external) {
    // What is left of the total.
    double sum = 0.0;
    ForEntries(n_, stride_, [&](int e, int i, int k) {
      double force = forces.total[e];
      if (!forces.near_field.empty()) force -= forces.near_field[e];
      if (!forces.soft_contact.empty()) force -= forces.soft_contact[e];
      if (inverse_mass_[i] == 0.0) return;
      sum += force * (u[e] + v[e]);
      state->momentum.external[k] += duration * force;
    });
    state->energy.external += 0.5 * duration * sum;
  }
  // What pinned grains take up from internal forces.
  if (!options_.grains.is_pinned.empty()) {
    ForEntries(n_, stride_, [&](int e, int i, int k) {
      if (inverse_mass_[i] > 0.0) return;
      double force = 0.0;
      if (!forces.near_field.empty()) force += forces.near_field[e];
      if (!forces.soft_contact.empty()) force += forces.soft_contact[e];
      state->momentum.fixed[k] -= duration * force;
    });
  }
}

void FlowScene::BookImpacts(const ImpactWork& work, FlowState* state) const {
  state->energy.impact += work.normal;
  state->energy.friction += work.friction;
  state->impulses += work.impulses;
  state->sticking += work.sticking;
  if (options_.grains.is_pinned.empty()) return;
  for (int k = 0; k < 3; ++k) state->momentum.fixed[k] += work.fixed[k];
}

void FlowScene::BookDamping(const double* impulse_velocity,
                            double duration,
                            const double* u,
                            const double* v,
                            FlowState* state) const {
  if (!kHasDamping || options_.damping == 0.0) return;
  ForEntries(n_, stride_, [&](int e, int i, int k) {
    if (inverse_mass_[i] == 0.0) return;
    const double impulse = -options_.damping * options_.grains.mass[i] *
                           duration * impulse_velocity[e];
    state->energy.damping += 0.5 * impulse * (u[e] + v[e]);
    state->momentum.damping[k] += impulse;
  });
}

double FlowScene::Balance(const SmoothForces& forces) const {
  double magnitude = 0.0;
  double sum[3] = {};
  for (const auto* part : {&forces.near_field, &forces.soft_contact}) {
    if (part->empty()) continue;
    for (int i = 0; i < n_; ++i) {
      double square = 0.0;
      for (int k = 0; k < 3; ++k) {
        const double f = (*part)[k * stride_ + i];
        sum[k] += f;
        square += f * f;
      }
      magnitude += std::sqrt(square);
    }
  }
  return magnitude > 0.0
             ? std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]) /
                   magnitude
             : 0.0;
}

double FlowScene::LargestMove(const double* v, double duration) const {
  double largest = 0.0;
  for (int i = 0; i < n_; ++i) {
    double square = 0.0;
    for (int k = 0; k < 3; ++k) {
      square += v[k * stride_ + i] * v[k * stride_ + i];
    }
    largest = std::max(
        largest, std::sqrt(square) * duration / options_.grains.radius[i]);
  }
  return largest;
}

double FlowScene::Numerical(const FlowState& state, double potential) const {
  const EnergyLedger& e = state.energy;
  return e.near_field + e.soft_contact + (potential - state.potential_start) -
         e.boundary;
}

double FlowScene::Closure(const FlowState& state, double kinetic) const {
  const EnergyLedger& e = state.energy;
  return kinetic - state.kinetic_start -
         (e.near_field + e.soft_contact + e.impact + e.friction + e.external +
          e.damping);
}

bool FlowScene::HasCollapsed(const double* x,
                             double time,
                             std::string* error) const {
  if (!kHasNearField || near_field_ == nullptr) return false;
  const double distance = near_field_->LastLeastDistance();
  if (!(distance < kCollapsedDistance * 2.0 * least_radius_) ||
      !(EvaluateLaw(near_field_->law(), distance).force_over_distance > 0.0)) {
    return false;
  }
  double ratio;
  *error = Format("collapse at t = %.9g: %s and attract each other still",
                  time,
                  DescribeClosest(x, &ratio).c_str());
  return true;
}

std::string FlowScene::DescribeClosest(const double* x, double* ratio) const {
  *ratio = std::numeric_limits<double>::infinity();
  const double period = options_.domain.period();
  int first = 0, second = 0;
  for (int i = 0; i < n_; ++i) {
    for (int j = i + 1; j < n_; ++j) {
      double square = 0.0;
      for (int k = 0; k < 3; ++k) {
        double d = x[k * stride_ + j] - x[k * stride_ + i];
        if (period > 0.0) d -= period * std::nearbyint(d / period);
        square += d * d;
      }
      const double r = std::sqrt(square) /
                       (options_.grains.radius[i] + options_.grains.radius[j]);
      if (r < *ratio) {
        *ratio = r;
        first = i;
        second = j;
      }
    }
  }
  if (n_ < 2) return "there is one grain";
  return Format("grains %d and %d are at %.3g of the sum of their radii",
                first,
                second,
                *ratio);
}

// ---------------------------------------------------------------- starts

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
  // Cells of one diameter or more with the grains placed so far, for large n;
  // at most some eight a grain, however small the grains.
  const int most = static_cast<int>(std::ceil(std::cbrt(8.0 * n)));
  const int cells = static_cast<int>(std::clamp(
      start.side / (2.0 * radius), 1.0, std::min(400.0, 1.0 * most)));
  std::vector<int> first(static_cast<std::size_t>(cells) * cells * cells, -1);
  std::vector<int> next(n, -1);
  const auto cell_of = [&](double y) {
    return std::clamp(
        static_cast<int>((y / start.side + 0.5) * cells), 0, cells - 1);
  };
  const bool is_periodic = start.period > 0.0 && cells >= 3;
  for (int i = 0; i < n; ++i) {
    bool is_free = false;
    double at[3] = {};
    int own[3] = {};
    for (int attempt = 0; attempt < std::max(1, start.attempts) && !is_free;
         ++attempt) {
      for (int k = 0; k < 3; ++k) {
        at[k] = start.side * (random() - 0.5);
        own[k] = cell_of(at[k]);
      }
      is_free = true;
      if (start.attempts == 0) break;
      const auto overlaps = [&](int j) {
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
          double d = state->x[k * stride + j] - at[k];
          if (start.period > 0.0) {
            d -= start.period * std::nearbyint(d / start.period);
          }
          square += d * d;
        }
        return square < 4.0 * radius * radius;
      };
      if (start.period > 0.0 && !is_periodic) {
        for (int j = 0; j < i && is_free; ++j) is_free = !overlaps(j);
        continue;
      }
      for (int offset = 0; offset < 27 && is_free; ++offset) {
        const int shift[3] = {
            offset / 9 - 1, offset / 3 % 3 - 1, offset % 3 - 1};
        int index = 0;
        bool is_inside = true;
        for (int k = 0; k < 3; ++k) {
          int c = own[k] + shift[k];
          if (is_periodic) {
            c = (c + cells) % cells;
          } else if (c < 0 || c >= cells) {
            is_inside = false;
          }
          index = index * cells + c;
        }
        if (!is_inside) continue;
        for (int j = first[index]; j >= 0 && is_free; j = next[j]) {
          is_free = !overlaps(j);
        }
      }
    }
    if (!is_free) {
      *error = Format(
          "placement impossible: no place for grain %d of %d after %d attempts "
          "(volume fraction %.3g; random placement ends near 0.38)",
          i + 1,
          n,
          start.attempts,
          n * (4.0 / 3.0) * kPi * radius * radius * radius /
              (start.side * start.side * start.side));
      return false;
    }
    const int index = (own[0] * cells + own[1]) * cells + own[2];
    next[i] = first[index];
    first[index] = i;
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
  // has gaps. An open or non-periodic domain is a cell that no image reaches
  // across.
  constexpr double kMargin = 1e-3;
  double low[3], high[3], length = 0.0;
  double largest = 0.0;
  for (int i = 0; i < n; ++i) largest = std::max(largest, grains.radius[i]);
  for (int k = 0; k < 3; ++k) {
    const auto ends = std::minmax_element(state->x.begin() + k * stride,
                                          state->x.begin() + k * stride + n);
    low[k] = *ends.first;
    high[k] = *ends.second;
    length = std::max(length, high[k] - low[k]);
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
              0.0,
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
  *report = Format(
      "%s, %lld evaluations, no grain moved by more than %.3g "
      "radii",
      solver.name().c_str(),
      static_cast<long long>(summary.counters.evaluations),
      moved);
  return true;
}

}  // namespace granopt
