// granopt: stick and slip of two grains in impact.

#ifndef GRANOPT_GRANULAR_FLOW_FRICTION_H_
#define GRANOPT_GRANULAR_FLOW_FRICTION_H_

namespace granopt {

struct FrictionOptions {
  double mu_static = 0.0;   // mu_s
  double mu_dynamic = 0.0;  // mu_d <= mu_s
  bool IsPresent() const { return mu_static > 0.0; }
};

struct FrictionImpulse {
  bool sticks = false;
  // Taken from grain i, given to grain j; in the tangential plane.
  double impulse[3] = {};
};

// The tangential impulse of two grains whose normal impulse is P >= 0. With
//   I_f dt = m_eff ((E_it / m_i - E_jt / m_j) dt + v_it - v_jt)        (5.4)
// they stick, and I_f dt is the impulse, if |I_f dt| <= mu_s P; else they slip
// with mu_d P along it (5.5), which reverses nothing since mu_d <= mu_s (5.12).
// `slide` is (v_it - v_jt), `pull` is (E_it / m_i - E_jt / m_j) dt.
//
// Deviations: (5.5) slips along v_it - v_jt; here along the trial impulse,
// which is the same without tangential forces and has a direction where both
// grains start from rest.
FrictionImpulse EvaluateFriction(const FrictionOptions& options,
                                 double effective_mass,
                                 double normal_impulse,
                                 const double* slide,
                                 const double* pull);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_FRICTION_H_
