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

bool ShearByStress(const StressPath& path,
                   const StressShearOptions& options,
                   const Solver& solver,
                   const std::function<bool(const StressShearState&,
                                            const Relaxation*)>& observer,
                   StressShearState* state,
                   Relaxation* last,
                   std::string* error) {
  *last = Relaxation();
  if (!std::isfinite(path.stress) || path.steps < 1 || path.halvings < 0) {
    *error =
        Format("shear stress = %g in %d steps: must be finite, in at least 1",
               path.stress,
               path.steps);
    return false;
  }
  const auto step_to = [&](double target, bool* found) {
    Relaxation next;
    if (!StepToShearStress(
            target, options, solver, &state->shear, &next, found, error)) {
      return false;
    }
    if (*found) {
      state->reached = target;
      state->summary = next.summary;
      state->list_builds = next.list_builds;
      *last = std::move(next);
    } else {
      state->why = next.summary.message;
    }
    return true;
  };
  const auto show = [&](bool found) {
    if (!observer || observer(*state, found ? last : nullptr)) return true;
    *error = "stopped by the caller";
    return false;
  };
  bool found = false;
  if (state->shear.step < 0) {
    Relaxation start;
    if (!Relax(state->shear.packing,
               options.energy,
               solver,
               options.solve,
               &start,
               error)) {
      return false;
    }
    state->shear.packing = std::move(start.packing);
    if (!step_to(0.0, &found)) return false;
    if (!found) {
      *error = "no state without shear stress was found: " + state->why +
               (options.pressure > 0.0 ? "" : "; is the packing jammed?");
      return false;
    }
    state->shear.strain = 0.0;
    if (!show(true)) return false;
  }
  while (state->halvings == 0 ? state->shear.step < path.steps
                              : state->halvings <= path.halvings) {
    // Exactly those of the steps where nothing yields.
    const double target =
        state->halvings == 0
            ? path.stress * (state->shear.step + 1) / path.steps
            : 0.5 * (state->reached + state->refused);
    if (!step_to(target, &found)) return false;
    if (!found) state->refused = target;
    if (!found || state->halvings > 0) ++state->halvings;
    if (!show(found)) return false;
  }
  if (last->packing.size() > 0) return true;
  // No state since the run went on.
  if (!MeasureAsItIs(state->shear.packing, options.energy, last, error)) {
    return false;
  }
  last->summary = state->summary;
  last->list_builds = state->list_builds;
  return true;
}

}  // namespace granopt
