// Runs one kernel a number of times on a packing, for instructions_test.py:
//
//   run_kernel PACKING.xyz KERNEL TIMES
//
// Prints the instruction set in use.

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/neighbor_list.h"
#include "granular/packing_io.h"
#include "solvers/multifrontal_cholesky.h"
#include "solvers/registry.h"

int main(int argc, char** argv) {
  using namespace granopt;
  if (argc != 4) return 2;
  Packing packing;
  std::string error;
  if (!ReadPacking(argv[1], &packing, &error)) {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 2;
  }
  const auto energy = ContactEnergy::Create(packing, {}, &error);
  const int n = energy->NumParameters();
  std::vector<double> u(n, 0.0), g(n);
  double value;
  Scales scales;
  NeighborList list;
  SparseMatrix hessian;
  energy->EvaluateHessian(u.data(), &hessian);
  MultifrontalCholesky factor;
  factor.Analyze(hessian);
  constexpr double kShift = 1e-3;
  if (!factor.Factorize(hessian.valuePtr(), kShift)) return 2;
  // Iterations of a method: of a displaced packing, which they do not relax.
  packing.Perturb(1e-4, 1);
  const auto displaced = ContactEnergy::Create(packing, {}, &error);
  const auto minimize = [&](const char* method, int iterations) {
    std::vector<double> x(n, 0.0);
    SolveOptions options;
    options.relative_tolerance = 1e-14;
    options.max_iterations = iterations;
    CreateSolver(method, &error)->Minimize(displaced.get(), options, x.data());
  };

  const int times = std::atoi(argv[3]);
  const std::map<std::string, std::function<void()>> kernels = {
      {"energy",
       [&]() {
         energy->EvaluateWithScales(u.data(), &value, g.data(), &scales);
       }},
      {"hessian", [&]() { energy->EvaluateHessian(u.data(), &hessian); }},
      {"list",
       [&]() {
         BuildNeighborList(packing.box,
                           packing.positions,
                           packing.radii,
                           0.05 * packing.radii.minCoeff(),
                           &list,
                           &error);
       }},
      {"rebase", [&]() { energy->Rebase(u.data()); }},
      {"analyze", [&]() { factor.Analyze(hessian); }},
      {"factorize", [&]() { factor.Factorize(hessian.valuePtr(), kShift); }},
      {"solve", [&]() { factor.Solve(u.data(), g.data()); }},
      {"fire", [&]() { minimize("fire", 100); }},
      {"lbfgs", [&]() { minimize("lbfgs", 100); }},
  };
  const auto kernel = kernels.find(argv[2]);
  if (kernel == kernels.end()) return 2;
  for (int k = 0; k < times; ++k) kernel->second();
  std::puts(FastestPanel().name);
  return 0;
}
