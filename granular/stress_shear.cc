#include "granular/stress_shear.h"

#include <cmath>
#include <utility>

#include "granular/constant_stress.h"
#include "solvers/format.h"

namespace granopt {

bool StepToShearStress(double stress,
                       const StressShearOptions& options,
                       const Solver& solver,
                       QuasistaticShearState* state,
                       Relaxation* last,
                       bool* found,
                       std::string* error) {
  *found = false;
  if (!std::isfinite(stress)) {
    *error = Format("shear stress = %g must be finite", stress);
    return false;
  }
  const int d = state->packing.dimension();
  ConstantStressOptions at;
  at.energy = options.energy;
  at.solve = options.solve;
  at.pressure = options.pressure;
  at.load = SmallMatrix::Zero(d, d);
  at.load(0, 1) = at.load(1, 0) = -stress;
  at.strains = SimpleShearStrain(d);
  if (options.pressure > 0.0) {
    at.strains.push_back(IsotropicStrain(d).front());
  }
  Packing start = state->packing;
  // Before the relaxation, which then knows of what is rounded.
  start.box = start.box.Rounded();
  Eigen::Matrix3i transform;
  start.Fold(&transform);
  ConstantStressResult result;
  if (!RelaxAtStress(start, at, solver, &result, error)) return false;
  ++state->relaxations;
  state->counters += result.counters;
  state->seconds += result.seconds;
  *last = std::move(result.relaxation);
  *found = result.converged;
  if (!*found) return true;
  ++state->step;
  state->strain += result.deformation(0, 1) / result.deformation(1, 1);
  state->packing = last->packing;
  state->energy = last->observables.energy;
  state->stress = last->observables.stress;
  return true;
}

}  // namespace granopt
