#include "granular/constant_stress.h"

#include <memory>

#include "solvers/format.h"

namespace granopt {
namespace {

// Of minimizations with a dead load.
constexpr int kMaxRounds = 50;

}  // namespace

bool RelaxAtStress(const Packing& start,
                   const ConstantStressOptions& options,
                   const Solver& solver,
                   ConstantStressResult* result,
                   std::string* error) {
  const int d = start.dimension();
  CellEnergyOptions cell;
  cell.energy = options.energy;
  cell.pressure = options.pressure;
  cell.load = options.load;
  cell.strains = options.strains.empty() ? AllStrains(d) : options.strains;
  *result = ConstantStressResult();
  result->deformation = SmallMatrix::Identity(d, d);
  const bool is_dead = options.load.size() > 0 && !options.load.isZero(0.0);
  Packing packing = start;
  bool settled = false, succeeded = true;
  Summary over_cell;
  while (!settled && result->rounds < kMaxRounds) {
    const std::unique_ptr<CellEnergy> function =
        CellEnergy::Create(packing, cell, error);
    if (function == nullptr) return false;
    std::vector<double> x(function->NumParameters(), 0.0);
    const Summary summary =
        solver.Minimize(function.get(), options.solve, x.data());
    ++result->rounds;
    result->counters += summary.counters;
    result->seconds += summary.seconds;
    succeeded = summary.Succeeded();
    const SmallMatrix eps = function->Strain(x.data());
    packing = function->Configuration(x.data());
    packing.Wrap();
    result->deformation =
        (SmallMatrix::Identity(d, d) + eps) * result->deformation;
    over_cell = summary;
    settled = !is_dead || eps.cwiseAbs().maxCoeff() <= options.strain_tolerance;
    if (!succeeded) break;
  }
  result->converged = settled && succeeded;
  // The cell is rounded, which a packing next to jamming feels.
  if (!Relax(packing,
             options.energy,
             solver,
             options.solve,
             &result->relaxation,
             error)) {
    return false;
  }
  result->counters += result->relaxation.summary.counters;
  result->seconds += result->relaxation.summary.seconds;
  // What went wrong, not that the grains relaxed in the cell where it did.
  if (!succeeded) {
    result->relaxation.summary = over_cell;
  } else if (!settled) {
    result->relaxation.summary.message = Format(
        "the cell has not settled after %d minimizations", result->rounds);
  }
  result->converged =
      result->converged && result->relaxation.summary.Succeeded();
  return true;
}

}  // namespace granopt
