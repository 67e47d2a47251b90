// granopt: where the energy and the momentum of a flow come from and go to.

#ifndef GRANOPT_GRANULAR_FLOW_ENERGY_LEDGER_H_
#define GRANOPT_GRANULAR_FLOW_ENERGY_LEDGER_H_

#include <array>

namespace granopt {

// Kinetic energy, (4.3) and (4.7) times the total mass: bulk = M |v_cm|^2 / 2,
// relative = sum m_i |v_i - v_cm|^2 / 2.
struct KineticEnergy {
  double bulk = 0.0;
  double relative = 0.0;
  double total() const { return bulk + relative; }
};

// Every entry is a change of energy since the start of the run, in J. The
// velocity of a grain changes by impulses P only, and an impulse does the work
// P . (v_before + v_after) / 2 exactly; impulses of impacts come first in a
// step, then those of smooth forces. So
//   T - T_start = near_field + soft_contact + impact + friction + external
//                 + damping                                              (L1)
// to roundoff, whatever the step, and what the integrator itself did is
//   numerical = near_field + soft_contact + (V - V_start) - boundary,    (L2)
// 0 for the exact motion, V the potential energy of near field and soft
// contacts.
struct EnergyLedger {
  double near_field = 0.0;    // work of near-field forces
  double soft_contact = 0.0;  // of soft contacts
  double impact = 0.0;        // of normal impulses, <= 0 but for E in (3.14)
  double friction = 0.0;      // of tangential impulses
  double external = 0.0;
  double damping = 0.0;
  double boundary = 0.0;  // change of V where grains jumped: "wrap input"
};

// Momentum in N s: p - p_start = external + damping + fixed + numerical.
struct MomentumLedger {
  std::array<double, 3> external = {};
  std::array<double, 3> damping = {};
  std::array<double, 3> fixed = {};  // from pinned grains and walls
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_ENERGY_LEDGER_H_
