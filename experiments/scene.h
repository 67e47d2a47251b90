// granopt: the flags that say which packing an experiment starts from, with
// which law and which method.

#ifndef GRANOPT_EXPERIMENTS_SCENE_H_
#define GRANOPT_EXPERIMENTS_SCENE_H_

#include <memory>
#include <string>

#include "gflags/gflags.h"
#include "granular/contact_energy.h"
#include "granular/packing.h"
#include "solvers/solver.h"

DECLARE_string(input);
DECLARE_int32(particles);
DECLARE_int32(dimension);
DECLARE_double(alpha);
DECLARE_string(solver);
DECLARE_double(tolerance);
DECLARE_double(zero_pressure);
DECLARE_bool(list_solvers);

namespace granopt {

struct Scene {
  Packing packing;
  ContactEnergyOptions energy;
  std::unique_ptr<Solver> solver;
  // "the file F.xyz" or "seed 3".
  std::string origin;
};

// Reads or generates the packing (`phi` and FLAGS_seed for a generated one),
// makes the method, checks --alpha, --tolerance and --zero_pressure; BadInput
// on any fault. Prints the methods and exits on --list_solvers.
Scene MakeScene(double phi);

// BadInput if the energy refuses the packing, or if two grains are at one
// place, where their force has no direction. MakeScene() calls it; call it
// again after a load.
void CheckScene(const Scene& scene);

// Relative tolerance and the bound under which a packing counts as unjammed.
SolveOptions MakeSolveOptions();

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SCENE_H_
