// The flag --solver, apart from scene.cc for binaries that take several
// methods.

#include "experiments/run.h"
#include "experiments/scene.h"

DEFINE_string(solver,
              granopt::kDefaultSolver,
              "method as name:key=value,... (see --list_solvers)");

namespace granopt {

Scene MakeSceneWithSolver(double phi) {
  ListSolversIfAsked();
  std::unique_ptr<Solver> solver = MakeSolver("solver", FLAGS_solver);
  Scene scene = MakeScene(phi, FLAGS_seed);
  scene.solver = std::move(solver);
  return scene;
}

}  // namespace granopt
