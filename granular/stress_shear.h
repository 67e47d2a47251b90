// granopt: a packing that is sheared by a given stress.

#ifndef GRANOPT_GRANULAR_STRESS_SHEAR_H_
#define GRANOPT_GRANULAR_STRESS_SHEAR_H_

#include <string>

#include "granular/quasistatic_shear.h"

namespace granopt {

struct StressShearOptions {
  ContactEnergyOptions energy;
  // For each minimization.
  SolveOptions solve;
  // Positive: the volume relaxes, too, until the pressure is this one; 0: at
  // constant volume.
  double pressure = 0.0;
};

// One step of stress-controlled simple shear: from `state`, which is relaxed,
// to the next minimum over positions and the strain gamma of simple shear (and
// the volume) at the shear stress -sigma_12 = `stress` of (10), whose unit is
// that of k length^(alpha - d): RelaxAtStress() with the load
//   s = -stress (e_1 (x) e_2 + e_2 (x) e_1),   F = 1 + gamma e_1 (x) e_2.
//
// True with `found`: `state` and `last` are there, state->strain has grown by
// F_12 / F_22 of the step. True without: the packing yields, no state at this
// stress was found (the cell sheared without end, or a minimization gave up:
// see last->summary), and `state` stays but for its counters. False with one
// line in `error` if the packing cannot be simulated.
bool StepToShearStress(double stress,
                       const StressShearOptions& options,
                       const Solver& solver,
                       QuasistaticShearState* state,
                       Relaxation* last,
                       bool* found,
                       std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_STRESS_SHEAR_H_
