// granopt: near-field granular flow.
//
//   m_i r''_i = Psi_i^nf + Psi_i^con + Psi_i^fric + Psi_i^ext - d_i r'_i (2.1)
//
// Spheres that do not turn, in three dimensions (a plane one has z = 0).
// Source: Zohdi, Modeling and direct simulation of near-field granular flows,
// Int. J. Solids Struct. 42 (2005) 539; equation numbers are theirs.

#ifndef GRANOPT_GRANULAR_FLOW_FLOW_H_
#define GRANOPT_GRANULAR_FLOW_FLOW_H_

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "granular/flow/collision.h"
#include "granular/flow/contact_search.h"
#include "granular/flow/domain.h"
#include "granular/flow/energy_ledger.h"
#include "granular/flow/ingredients.h"
#include "granular/flow/near_field.h"
#include "granular/flow/soft_contact.h"

namespace granopt {

// What does not change in a run.
struct Grains {
  std::vector<double> mass;    // n, > 0
  std::vector<double> radius;  // n, > 0
  // n, or empty for none: grains that are held in place.
  std::vector<char> is_pinned;

  int size() const { return static_cast<int>(mass.size()); }
  int stride() const { return FlowStride(size()); }
};

// A force per mass on every grain: constant + amplitude sin(frequency t +
// phase) (7.5), both along given vectors.
struct ExternalForce {
  double constant[3] = {};
  double amplitude[3] = {};
  double frequency = 0.0;  // angular, Omega
  double phase = 0.0;

  void At(double time, double* acceleration) const;
};

// Positions and velocities, in the layout of near_field_loops.h, and all else
// that the rest of a run depends on.
struct FlowState {
  double time = 0.0;
  double step = 0.0;  // that the next step is tried with
  std::vector<double> x, v;
  std::int64_t steps = 0;
  std::int64_t rejected = 0;
  std::int64_t sweeps = 0;  // evaluations of all smooth forces
  // The last of them was at x: Verlet's next step begins with those forces.
  bool is_evaluated = false;
  std::int64_t impulses = 0;  // of impacts
  std::int64_t sticking = 0;  // of which stuck
  std::int64_t jumps = 0;     // of grains at the boundary
  std::int64_t fast = 0;  // steps in which a grain moved by more than a radius
  double worst_balance = 0.0;  // largest |sum Psi^INT| / sum |Psi^INT|  (6.10)
  EnergyLedger energy;
  MomentumLedger momentum;
  // At the start of the run.
  double kinetic_start = 0.0;
  double potential_start = 0.0;
  std::array<double, 3> momentum_start = {};
};

// What a scene contains. An ingredient that is absent is not called and holds
// no memory.
struct FlowSceneOptions {
  Grains grains;
  Domain domain;
  enum class Weight { MASS, AREA, ONE };
  std::optional<NearFieldOptions> near_field;
  Weight weight = Weight::MASS;
  // At most one of the two.
  std::optional<ImpactOptions> impact;
  std::optional<SoftContactOptions> soft_contact;
  std::optional<ExternalForce> external;
  double damping = 0.0;  // d_i / m_i, 1 / s
};

// "mass", "area", "one".
const char* WeightName(FlowSceneOptions::Weight weight);
// False for another word.
bool ParseWeight(const std::string& word, FlowSceneOptions::Weight* weight);

// Smooth forces by origin; empty where the scene has none.
struct SmoothForces {
  std::vector<double> near_field, soft_contact;
  std::vector<double> total;  // and the external one
  double near_field_energy = 0.0;
  double soft_contact_energy = 0.0;
};

// Closer than this part of the sum of their radii, grains have collapsed: the
// model of their contact has long lost its meaning.
constexpr double kCollapsedDistance = 0.01;

// Calls of one scene share workspaces: not for two threads at a time.
class FlowScene {
 public:
  // Null and one line in `error` for anything out of range: e outside [0, 1],
  // mu_d > mu_s, both models of contact, a cube smaller than a grain, ...
  static std::unique_ptr<FlowScene> Create(const FlowSceneOptions& options,
                                           std::string* error);

  int size() const { return n_; }
  int stride() const { return stride_; }
  const FlowSceneOptions& options() const { return options_; }
  const Grains& grains() const { return options_.grains; }
  const NearField* near_field() const { return near_field_.get(); }
  const std::vector<double>& inverse_mass() const { return inverse_mass_; }
  double total_mass() const { return total_mass_; }  // of those that move

  // State at the start of a run: zeros the ledgers, checks that no two grains
  // are at one place or (for impacts) overlap.
  bool Begin(double step, FlowState* state, std::string* error) const;

  // False where Forces() would be zero: then they need not be asked for.
  bool HasForces() const {
    return (kHasNearField && near_field_ != nullptr) ||
           (kHasSoftContacts && options_.soft_contact.has_value()) ||
           (kHasExternalForces && options_.external.has_value());
  }
  // Pairs that overlap.
  void FindContacts(const double* x, std::vector<ClosePair>* pairs) const;
  // Psi^nf + Psi^soft + Psi^ext at positions x and a time.
  void Forces(const double* x,
              double time,
              bool with_energy,
              SmoothForces* forces) const;
  double Potential(const double* x) const;
  KineticEnergy Kinetic(const double* v) const;
  void Momentum(const double* v, double* p) const;

  // After a step: moves grains that left the domain, books what that did.
  void ApplyBoundary(FlowState* state) const;

  // Book what acts in a step in which velocities change from u to v: forces for
  // `duration`, and damping by -d `drag_velocity` for `duration`.
  void Book(const SmoothForces& forces,
            double duration,
            const double* u,
            const double* v,
            FlowState* state) const;
  void BookDamping(const double* drag_velocity,
                   double duration,
                   const double* u,
                   const double* v,
                   FlowState* state) const;
  // Ends a step of length dt at positions x and velocities v, which are left
  // with those of its start: books impacts, the balance (6.10) of `forces`
  // (null: there were none), grains that moved by more than a radius, the
  // boundary.
  void EndStep(double dt,
               const ImpactWork& impacts,
               const SmoothForces* forces,
               std::vector<double>* x,
               std::vector<double>* v,
               FlowState* state) const;

  // numerical of (L2), and the roundoff of (L1).
  double Numerical(const FlowState& state, double potential) const;
  double Closure(const FlowState& state, double kinetic) const;

  // True, with one line in `error`, if two grains have collapsed in the last
  // Forces() and attract each other all the same: nothing holds them apart.
  bool HasCollapsed(const double* x, double time, std::string* error) const;

  // The closest pair, for messages: "grains 3 and 17 are at 0.31 of the sum of
  // their radii".
  std::string DescribeClosest(const double* x, double* ratio) const;

 private:
  FlowScene() = default;
  // |sum Psi^INT| / sum |Psi^INT| of a force field (6.10).
  double Balance(const SmoothForces& forces) const;
  // Largest distance that a grain moves in `duration`, over its radius.
  double LargestMove(const double* v, double duration) const;
  // V of one grain with all others if it were at `at`.
  double PotentialOf(int i, const double* x, const double* at) const;

  FlowSceneOptions options_;
  int n_ = 0;
  int stride_ = 0;
  std::unique_ptr<NearField> near_field_;
  std::vector<double> inverse_mass_;
  double total_mass_ = 0.0;
  double least_radius_ = 0.0;
  mutable ContactSearch search_;
  mutable std::vector<ClosePair> pairs_;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_FLOW_H_
