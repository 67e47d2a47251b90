// granopt: `shear --dynamics`: what comes to rest by damped motion, against
// what a minimizer finds (Remark 1.1).

#ifndef GRANOPT_EXPERIMENTS_SHEAR_DYNAMICS_H_
#define GRANOPT_EXPERIMENTS_SHEAR_DYNAMICS_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "solvers/solver.h"

namespace granopt {

// For each seed a random start of packing fraction `phi` is relaxed both ways,
// and so is the minimizer's state after a pure shear by each of `strains`.
// Returns the exit status.
int RunDynamics(const std::vector<std::uint64_t>& seeds,
                double phi,
                const std::vector<double>& strains,
                std::unique_ptr<Solver> solver);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_DYNAMICS_H_
