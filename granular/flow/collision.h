// granopt: impact with restitution.

#ifndef GRANOPT_GRANULAR_FLOW_COLLISION_H_
#define GRANOPT_GRANULAR_FLOW_COLLISION_H_

#include <vector>

#include "granular/flow/contact_search.h"
#include "granular/flow/friction.h"

namespace granopt {

struct ImpactOptions {
  // e0 in [0, 1].
  double restitution = 0.5;
  // e = max(e0 (1 - dv_n / v*), e-)  (5.13) instead of e0, e- at most e0. The
  // paper states neither v* nor e-, and neither matters much.
  bool is_velocity_dependent = false;
  double velocity_scale = 1.0;     // v*
  double least_restitution = 0.1;  // e-
  // gamma of dt = gamma Dt (3.18): the duration of an impact in time steps.
  double duration = 0.01;
  FrictionOptions friction;
};

// (5.13), or e0.
double Restitution(const ImpactOptions& options, double normal_speed);

// P = I_n dt of two grains, along -n_ij on i and n_ij on j: what (3.1) and
// (3.9) with (3.18) reduce to,
//   P = (1 + e) m_eff (v_in - v_jn + D1),
//   D1 = (E_in / m_i - E_jn / m_j) gamma Dt / (1 + e),
// if that is positive, else 0: grains that separate are not drawn back.
// `approach` is v_in - v_jn, `pull` is (E_in / m_i - E_jn / m_j) gamma Dt.
double NormalImpulse(double restitution,
                     double effective_mass,
                     double approach,
                     double pull);

// A contact frozen for the length of a step.
struct Impact {
  int i = 0;
  int j = 0;
  double normal[3] = {};     // n_ij
  double restitution = 0.0;  // by the velocities at the start of the step
};

// Changes of energy, and how many impacts had an impulse.
struct ImpactWork {
  double normal = 0.0;
  double friction = 0.0;
  int impulses = 0;
  int sticking = 0;
  double fixed[3] = {};  // momentum that grains held in place gave the others
};

// e of every overlapping pair at velocities v.
void FreezeImpacts(const std::vector<ClosePair>& pairs,
                   const ImpactOptions& options,
                   int stride,
                   const double* v,
                   std::vector<Impact>* impacts);

// Gives each pair in turn its normal and tangential impulse; each sees the
// velocities that those before it left in u, so that no cluster gains energy
// (impulses of one moment, added up, can: a ball that hits two others gains 75
// %). `force`: E of all grains, or null for none. u is v at the start of the
// step on entry.
//
// Equations (3.14), (3.16), (5.4), (5.5). Their impulses act within gamma Dt of
// a step: divided by Dt they are the forces (3.17) of the text.
ImpactWork ApplyImpacts(const std::vector<Impact>& impacts,
                        const ImpactOptions& options,
                        double step,
                        int stride,
                        const double* inverse_mass,
                        const double* force,
                        double* u);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_COLLISION_H_
