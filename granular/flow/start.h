// granopt: where the grains of a flow begin.

#ifndef GRANOPT_GRANULAR_FLOW_START_H_
#define GRANOPT_GRANULAR_FLOW_START_H_

#include <cstdint>
#include <string>

#include "granular/flow/flow.h"
#include "solvers/solver.h"

namespace granopt {

// The paper's start (sec. 7): n equal grains of radius L V^(1/3), V = D^3 / n,
// and mass rho 4 pi b^3 / 3 (7.1)-(7.2), centres uniform in the cube of side D
// around 0 without overlap; velocities mean + perturbation * uniform in [-1, 1]
// for each component, shifted so that their mean is `mean`.
struct FlowStart {
  int particles = 100;
  double side = 1.0;
  double length_ratio = 0.25;  // L
  double density = 2000.0;
  double mean[3] = {1.0, 0.1, 0.1};
  double perturbation[3] = {1.0, 0.1, 0.1};
  std::uint64_t seed = 1;
  // `side` where grains overlap by their nearest images, too; else 0.
  double period = 0.0;
  // Random places tried for a grain; 0: overlaps are allowed.
  int attempts = 10000;
};
// False with one line in `error` if a grain finds no place.
bool MakeStart(const FlowStart& start,
               Grains* grains,
               FlowState* state,
               std::string* error);

// Moves grains apart until none overlap, by minimizing the contact energy
// (Harmonic) of the radii enlarged a little; velocities are kept. False with
// one line in `error` if overlaps remain. Returns what it did in `report`.
bool RelaxOverlaps(const Grains& grains,
                   const Domain& domain,
                   const Solver& solver,
                   FlowState* state,
                   std::string* report,
                   std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_START_H_
