#include "granular/flow/flow.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "solvers/format.h"

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

// f(entry, grain, axis) for all coordinates of all grains.
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

bool CheckOptions(const FlowSceneOptions& options, std::string* error) {
  const Grains& grains = options.grains;
  const int n = grains.size();
  if (n < 1) {
    *error = "a flow needs at least one grain";
    return false;
  }
  if (static_cast<int>(grains.radius.size()) != n ||
      (!grains.is_pinned.empty() &&
       static_cast<int>(grains.is_pinned.size()) != n)) {
    *error = Format("%d masses, %zu radii, %zu marks of pinned grains",
                    n,
                    grains.radius.size(),
                    grains.is_pinned.size());
    return false;
  }
  for (int i = 0; i < n; ++i) {
    for (const double value : {grains.mass[i], grains.radius[i]}) {
      if (!(value > 0.0 && std::isfinite(value))) {
        *error = Format("grain %d: mass %g and radius %g must be positive",
                        i,
                        grains.mass[i],
                        grains.radius[i]);
        return false;
      }
    }
  }
  if (options.impact && options.soft_contact) {
    *error = "impacts and soft contacts exclude each other";
    return false;
  }
  if (options.impact && !CheckImpact(*options.impact, error)) return false;
  constexpr double kFinite = std::numeric_limits<double>::max();
  const auto& soft = options.soft_contact;
  if (soft &&
      (!InRange("contact stiffness", soft->stiffness, 0.0, kFinite, error) ||
       !InRange("contact exponent alpha", soft->alpha, 2.0, 10.0, error))) {
    return false;
  }
  if (!InRange("damping", options.damping, 0.0, kFinite, error)) return false;
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
      return false;
    }
  }
  const double largest =
      *std::max_element(grains.radius.begin(), grains.radius.end());
  if (options.domain.kind != Domain::Kind::OPEN &&
      !(options.domain.side >= 4.0 * largest)) {
    *error = Format("cube of side %g is smaller than four radii (%g)",
                    options.domain.side,
                    largest);
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

bool ParseWeight(const std::string& word, FlowSceneOptions::Weight* weight) {
  using Weight = FlowSceneOptions::Weight;
  for (const Weight known : {Weight::MASS, Weight::AREA, Weight::ONE}) {
    if (word != WeightName(known)) continue;
    *weight = known;
    return true;
  }
  return false;
}

std::unique_ptr<FlowScene> FlowScene::Create(const FlowSceneOptions& options,
                                             std::string* error) {
  if (!CheckOptions(options, error)) return nullptr;
  const Grains& grains = options.grains;
  const int n = grains.size();
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

void FlowScene::BookDamping(const double* drag_velocity,
                            double duration,
                            const double* u,
                            const double* v,
                            FlowState* state) const {
  if (!kHasDamping || options_.damping == 0.0) return;
  ForEntries(n_, stride_, [&](int e, int i, int k) {
    if (inverse_mass_[i] == 0.0) return;
    const double impulse = -options_.damping * options_.grains.mass[i] *
                           duration * drag_velocity[e];
    state->energy.damping += 0.5 * impulse * (u[e] + v[e]);
    state->momentum.damping[k] += impulse;
  });
}

void FlowScene::EndStep(double dt,
                        const ImpactWork& impacts,
                        const SmoothForces* forces,
                        std::vector<double>* x,
                        std::vector<double>* v,
                        FlowState* state) const {
  state->energy.impact += impacts.normal;
  state->energy.friction += impacts.friction;
  state->impulses += impacts.impulses;
  state->sticking += impacts.sticking;
  if (!options_.grains.is_pinned.empty()) {
    for (int k = 0; k < 3; ++k) state->momentum.fixed[k] += impacts.fixed[k];
  }
  if (forces != nullptr) {
    state->worst_balance = std::max(state->worst_balance, Balance(*forces));
  }
  state->fast += LargestMove(v->data(), dt) > 1.0 ? 1 : 0;
  state->x.swap(*x);
  state->v.swap(*v);
  state->time += dt;
  ++state->steps;
  ApplyBoundary(state);
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

}  // namespace granopt
