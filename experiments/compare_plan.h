// granopt: which runs `compare` is asked for.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_PLAN_H_
#define GRANOPT_EXPERIMENTS_COMPARE_PLAN_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "experiments/comparison_setup.h"
#include "experiments/scene.h"
#include "solvers/solver.h"

namespace granopt {

// All that the flags ask for, checked.
struct Plan {
  ComparisonSetup setup;
  std::vector<std::unique_ptr<Solver>> solvers;  // as setup.methods
  std::unique_ptr<Solver> prepare;
  std::vector<double> distances;
  double phi = 0.0;
  double phi_fig2 = 0.0;
  // The input, or the random start of the first seed.
  Scene scene;
};

// BadInput on any fault of the flags.
Plan MakePlan();
void PrintPlan(const Plan& plan);

// The seeds of a case: with an input only random displacements depend on one.
std::vector<std::uint64_t> SeedsOf(const ComparisonSetup& setup, const Case& c);

// The level that the flags ask for, if any.
bool GivenLevel(Level* level);
void SetBaselineAndReference(ComparisonSetup* setup);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_PLAN_H_
