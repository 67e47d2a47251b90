#include "granular/quasistatic_shear.h"

#include <cmath>
#include <memory>
#include <utility>

#include "solvers/format.h"

namespace granopt {
namespace {

// -V sigma : ln diag(stretch, 1 / stretch).
double Power(const Relaxation& state, double stretch) {
  const SmallMatrix& stress = state.observables.stress;
  return -state.packing.box.Volume() * (stress(0, 0) - stress(1, 1)) *
         std::log(stretch);
}

}  // namespace

bool ShearQuasistatically(
    const Packing& start,
    const QuasistaticShearOptions& options,
    const Solver& solver,
    const std::function<bool(const QuasistaticShearStep&)>& observer,
    QuasistaticShearResult* result,
    std::string* error) {
  if (!(options.strain > -1.0) || !std::isfinite(options.strain)) {
    *error = Format("strain = %g must be above -1", options.strain);
    return false;
  }
  if (options.steps < 1) {
    *error = Format("steps = %d must be positive", options.steps);
    return false;
  }
  if (!start.IsValid(error)) return false;
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(start, options.energy, error);
  if (energy == nullptr) return false;
  *result = QuasistaticShearResult();
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  result->last = Conclude(Summary(), zero.data(), energy.get());
  QuasistaticShearStep step;
  for (step.step = 0; step.step <= options.steps; ++step.step) {
    if (step.step > 0) {
      const double strain = options.strain * step.step / options.steps;
      const double stretch = (1.0 + strain) / (1.0 + step.strain);
      Packing packing = result->last.packing;
      packing.Deform(PureShear(packing.dimension(), stretch - 1.0));
      Relaxation relaxed;
      if (!Relax(packing,
                 options.energy,
                 solver,
                 options.solve,
                 &relaxed,
                 error)) {
        return false;
      }
      ++result->relaxations;
      result->gave_up += relaxed.summary.Succeeded() ? 0 : 1;
      result->counters += relaxed.summary.counters;
      result->seconds += relaxed.summary.seconds;
      step.strain = strain;
      step.work =
          0.5 * (Power(result->last, stretch) + Power(relaxed, stretch));
      step.dissipated = result->last.observables.energy + step.work -
                        relaxed.observables.energy;
      result->last = std::move(relaxed);
      result->strain = strain;
    }
    step.result = &result->last;
    if (observer && !observer(step)) {
      *error = "stopped by the caller";
      return false;
    }
  }
  return true;
}

}  // namespace granopt
