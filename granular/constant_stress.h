// granopt: a packing relaxed at a given stress.

#ifndef GRANOPT_GRANULAR_CONSTANT_STRESS_H_
#define GRANOPT_GRANULAR_CONSTANT_STRESS_H_

#include <string>
#include <vector>

#include "granular/cell_energy.h"
#include "granular/relaxation.h"
#include "solvers/solver.h"

namespace granopt {

struct ConstantStressOptions {
  ContactEnergyOptions energy;
  // For each minimization.
  SolveOptions solve;
  double pressure = 0.0;
  SmallMatrix load;                  // s; empty: none
  std::vector<SmallMatrix> strains;  // empty: all symmetric ones
  // With a load s, minimizations are repeated from the cell that the last one
  // ended in until no strain exceeds this.
  double strain_tolerance = 1e-12;
};

struct ConstantStressResult {
  // At the end, relaxed once more in the cell as it is rounded. Its summary is
  // that of the minimization over the cell if that one gave up.
  Relaxation relaxation;
  SmallMatrix deformation;  // F from the start to the end
  int rounds = 0;
  bool converged = false;  // every minimization, and the strain
  Counters counters;
  double seconds = 0.0;
};

// The state at a given stress: minimizes the enthalpy over positions and cell.
// Returns false with one line in `error` if the packing cannot be simulated.
bool RelaxAtStress(const Packing& start,
                   const ConstantStressOptions& options,
                   const Solver& solver,
                   ConstantStressResult* result,
                   std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_CONSTANT_STRESS_H_
