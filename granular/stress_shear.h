// granopt: a packing that is sheared by a given stress, until it yields.

#ifndef GRANOPT_GRANULAR_STRESS_SHEAR_H_
#define GRANOPT_GRANULAR_STRESS_SHEAR_H_

#include <cstdint>
#include <functional>
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

struct StressPath {
  double stress = 0.0;  // -sigma_12 at the end, either sign
  int steps = 20;       // equal ones, from none
  // A step without a state is halved so often: the yield stress to 1/64 of a
  // step.
  int halvings = 6;
};

// Where a run stands between two steps: plain data, all that the next one
// depends on. One begins with shear.packing = the start and goes on, to the
// same bits, from a copy that an observer was shown.
struct StressShearState {
  StressShearState() { shear.step = -1; }

  QuasistaticShearState shear;  // the last state; step -1: nothing is relaxed
  Summary summary;              // of its relaxation
  std::int64_t list_builds = 0;
  double reached = 0.0;  // the stress of that state, as asked
  // Halvings so far, 0: nothing yielded; the least stress without a state, and
  // what its minimization said.
  int halvings = 0;
  double refused = 0.0;
  std::string why;
};

// The yield stress, if the packing yields before path.stress: relaxes the start
// and takes it to no shear stress, where strains are counted from (step 0),
// then raises the stress step by step; from the first one without a state on,
// halves what lies between it and the last one with a state.
//
// `observer` (may be empty) sees where the run stands after each step and, if a
// state was found, that state, else null; returning false ends the run. `last`
// is the last state. Returns false with one line in `error` if the observer
// stopped, if the packing cannot be simulated or has no state at all, or for a
// bad path.
bool ShearByStress(const StressPath& path,
                   const StressShearOptions& options,
                   const Solver& solver,
                   const std::function<bool(const StressShearState&,
                                            const Relaxation*)>& observer,
                   StressShearState* state,
                   Relaxation* last,
                   std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_STRESS_SHEAR_H_
