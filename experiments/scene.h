// granopt: the flags that say which packing an experiment starts from, with
// which law and which method.

#ifndef GRANOPT_EXPERIMENTS_SCENE_H_
#define GRANOPT_EXPERIMENTS_SCENE_H_

#include <cstdint>
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
DECLARE_double(tolerance);
DECLARE_double(zero_pressure);
DECLARE_bool(list_solvers);

namespace granopt {

// The default of --solver.
extern const char kDefaultSolver[];

struct Scene {
  Packing packing;
  ContactEnergyOptions energy;
  std::unique_ptr<Solver> solver;
  // "F.xyz" or "seed 3".
  std::string origin;
};

// Prints the methods and exits on --list_solvers.
void ListSolversIfAsked();

// Reads or generates the packing (`phi` and `seed` for a generated one), checks
// --alpha, --tolerance and --zero_pressure; BadInput on any fault. The scene
// has no method yet.
Scene MakeScene(double phi, std::uint64_t seed);

// In method.cc, whose flag --solver only those binaries have that call this:
// the scene of --seed with the method of --solver.
Scene MakeSceneWithSolver(double phi);

// BadInput, with `flag` named, if there is no such method.
std::unique_ptr<Solver> MakeSolver(const char* flag, const std::string& spec);

// BadInput if the energy refuses the packing, or if two grains are at one
// place, where their force has no direction. MakeScene() calls it; call it
// again after a load.
void CheckScene(const Scene& scene);

// What is done to a packing before it is relaxed, in this order.
struct Load {
  double radius_factor = 1.0;
  double simple_shear = 0.0;
  double pure_shear = 0.0;
  double perturbation = 0.0;  // of each coordinate, box = 1
};
void ApplyLoad(const Load& load, std::uint64_t seed, Packing* packing);

// k L^(alpha-1) with L = V^(1/d): the force that is 1 in units k = 1, box = 1.
double ForceUnit(const Packing& packing, const ContactEnergyOptions& energy);

// Relative tolerance and the bound under which a packing counts as unjammed.
SolveOptions MakeSolveOptions();

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SCENE_H_
