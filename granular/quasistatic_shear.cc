#include "granular/quasistatic_shear.h"

#include <cmath>
#include <memory>
#include <utility>

#include "granular/constant_stress.h"
#include "solvers/format.h"

namespace granopt {
namespace {

// The strain of step k >= 1.
double StrainOf(const QuasistaticShearOptions& options, int k) {
  return options.path.empty() ? options.strain * k / options.steps
                              : options.path[k - 1];
}

int NumSteps(const QuasistaticShearOptions& options) {
  return options.path.empty() ? options.steps
                              : static_cast<int>(options.path.size());
}

bool CheckOptions(const QuasistaticShearOptions& options, std::string* error) {
  if (options.path.empty() && options.steps < 1) {
    *error = Format("steps = %d must be positive", options.steps);
    return false;
  }
  if (options.pressure != 0.0 &&
      (!(options.pressure > 0.0) || !std::isfinite(options.pressure) ||
       options.mode == DeformationMode::BULK)) {
    *error = options.mode == DeformationMode::BULK
                 ? "a pressure cannot go with strains of the volume"
                 : Format("pressure = %g must be positive", options.pressure);
    return false;
  }
  const bool is_bounded = options.mode != DeformationMode::SIMPLE_SHEAR;
  for (int k = 1; k <= NumSteps(options); ++k) {
    // The end is named rather than a step on the way to it.
    const double strain =
        options.path.empty() ? options.strain : options.path[k - 1];
    if (std::isfinite(strain) && (!is_bounded || strain > -1.0)) continue;
    *error = Format("strain = %g must be %s",
                    strain,
                    is_bounded ? "above -1 and finite" : "finite");
    return false;
  }
  return true;
}

double MinusPower(const SmallMatrix& stress,
                  double volume,
                  const SmallMatrix& strain) {
  return volume * stress.cwiseProduct(strain).sum();
}

}  // namespace

const char* DeformationModeName(DeformationMode mode) {
  switch (mode) {
    case DeformationMode::PURE_SHEAR:
      return "pure";
    case DeformationMode::SIMPLE_SHEAR:
      return "simple";
    case DeformationMode::BULK:
      return "bulk";
  }
  return "unknown";
}

SmallMatrix DeformationIncrement(DeformationMode mode,
                                 int dimension,
                                 double from,
                                 double to) {
  switch (mode) {
    case DeformationMode::SIMPLE_SHEAR:
      return SimpleShear(dimension, to - from);
    case DeformationMode::BULK:
      return std::pow((1.0 + to) / (1.0 + from), 1.0 / dimension) *
             SmallMatrix::Identity(dimension, dimension);
    case DeformationMode::PURE_SHEAR:
      break;
  }
  return PureShear(dimension, (1.0 + to) / (1.0 + from) - 1.0);
}

SmallMatrix StrainIncrement(DeformationMode mode,
                            int dimension,
                            double from,
                            double to) {
  SmallMatrix strain = SmallMatrix::Zero(dimension, dimension);
  if (mode == DeformationMode::SIMPLE_SHEAR) {
    strain(0, 1) = to - from;
    return strain;
  }
  // ln((1 + to) / (1 + from)), without cancellation for small steps.
  const double stretch = std::log1p((to - from) / (1.0 + from));
  if (mode == DeformationMode::BULK) {
    strain.diagonal().setConstant(stretch / dimension);
  } else {
    strain(0, 0) = stretch;
    strain(1, 1) = -stretch;
  }
  return strain;
}

double ConjugateStress(DeformationMode mode, const SmallMatrix& stress) {
  switch (mode) {
    case DeformationMode::SIMPLE_SHEAR:
      return -stress(0, 1);
    case DeformationMode::BULK:
      return -stress.trace() / static_cast<double>(stress.rows());
    case DeformationMode::PURE_SHEAR:
      break;
  }
  return stress(1, 1) - stress(0, 0);
}

void DeformTo(DeformationMode mode, double from, double to, Packing* packing) {
  if (from == to) return;
  packing->Deform(DeformationIncrement(mode, packing->dimension(), from, to));
  if (mode != DeformationMode::SIMPLE_SHEAR) return;
  packing->box = packing->box.Rounded();
  Eigen::Matrix3i transform;
  packing->Fold(&transform);
}

bool ContinueShear(
    const QuasistaticShearOptions& options,
    const Solver& solver,
    const std::function<bool(const QuasistaticShearStep&)>& observer,
    QuasistaticShearState* state,
    QuasistaticShearResult* result,
    std::string* error) {
  if (!CheckOptions(options, error)) return false;
  const int d = state->packing.dimension();
  *result = QuasistaticShearResult();
  const auto sum_up = [&]() {
    result->strain = state->strain;
    result->relaxations = state->relaxations;
    result->gave_up = state->gave_up;
    result->counters = state->counters;
    result->seconds = state->seconds;
  };
  sum_up();
  QuasistaticShearStep step;
  QuasistaticShearState before;
  step.before = &before;
  step.state = state;
  while (state->step < NumSteps(options)) {
    before = *state;
    step.step = before.step + 1;
    step.strain = StrainOf(options, step.step);
    Packing packing = before.packing;
    DeformTo(options.mode, before.strain, step.strain, &packing);
    Relaxation relaxed;
    Counters counters;
    double seconds = 0.0;
    bool succeeded = false;
    if (options.pressure > 0.0) {
      ConstantStressOptions stress;
      stress.energy = options.energy;
      stress.solve = options.solve;
      stress.pressure = options.pressure;
      stress.strains = IsotropicStrain(d);
      ConstantStressResult at_stress;
      if (!RelaxAtStress(packing, stress, solver, &at_stress, error)) {
        return false;
      }
      relaxed = std::move(at_stress.relaxation);
      counters = at_stress.counters;
      seconds = at_stress.seconds;
      succeeded = at_stress.converged;
    } else {
      if (!Relax(packing,
                 options.energy,
                 solver,
                 options.solve,
                 &relaxed,
                 error)) {
        return false;
      }
      counters = relaxed.summary.counters;
      seconds = relaxed.summary.seconds;
      succeeded = relaxed.summary.Succeeded();
    }
    state->step = step.step;
    state->strain = step.strain;
    state->packing = relaxed.packing;
    state->energy = relaxed.observables.energy;
    state->stress = relaxed.observables.stress;
    ++state->relaxations;
    state->gave_up += succeeded ? 0 : 1;
    state->counters += counters;
    state->seconds += seconds;
    SmallMatrix strain =
        StrainIncrement(options.mode, d, before.strain, step.strain);
    if (options.pressure > 0.0) {
      strain.diagonal().array() +=
          std::log(state->packing.box.Volume() / before.packing.box.Volume()) /
          d;
    }
    step.work =
        -0.5 * (MinusPower(before.stress, before.packing.box.Volume(), strain) +
                MinusPower(state->stress, state->packing.box.Volume(), strain));
    step.dissipated = before.energy + step.work - state->energy;
    result->last = std::move(relaxed);
    step.result = &result->last;
    sum_up();
    if (observer && !observer(step)) {
      *error = "stopped by the caller";
      return false;
    }
  }
  return true;
}

bool ShearQuasistatically(
    const Packing& start,
    const QuasistaticShearOptions& options,
    const Solver& solver,
    const std::function<bool(const QuasistaticShearStep&)>& observer,
    QuasistaticShearResult* result,
    std::string* error) {
  if (!CheckOptions(options, error)) return false;
  if (!start.IsValid(error)) return false;
  Relaxation first;
  if (!MeasureAsItIs(start, options.energy, &first, error)) return false;
  QuasistaticShearState state;
  state.packing = first.packing;
  state.energy = first.observables.energy;
  state.stress = first.observables.stress;
  QuasistaticShearStep step;
  step.result = &first;
  step.state = &state;
  if (observer && !observer(step)) {
    *result = QuasistaticShearResult();
    *error = "stopped by the caller";
    return false;
  }
  return ContinueShear(options, solver, observer, &state, result, error);
}

}  // namespace granopt
