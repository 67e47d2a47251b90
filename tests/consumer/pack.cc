// Relaxes a random packing of discs; links granopt::granular.

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing_generator.h"
#include "solvers/registry.h"

int main() {
  std::string error;
  const auto fail = [&error]() {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 2;
  };
  granopt::GeneratorOptions generator;
  generator.particles = 64;
  generator.packing_fraction = 0.9;
  granopt::Packing packing;
  if (!granopt::GeneratePacking(generator, &packing, &error)) return fail();
  const auto energy = granopt::ContactEnergy::Create(
      packing, granopt::ContactEnergyOptions(), &error);
  if (energy == nullptr) return fail();
  const auto solver = granopt::CreateSolver("ceres_lbfgs:scaled=1", &error);
  if (solver == nullptr) return fail();

  granopt::SolveOptions options;
  options.relative_tolerance = 1e-6;
  std::vector<double> u(energy->NumParameters(), 0.0);
  const granopt::Summary summary =
      solver->Minimize(energy.get(), options, u.data());
  std::printf("%s\n", granopt::StopReasonName(summary.reason));
  std::printf("energy = %.9e from %.9e\n", summary.cost, summary.initial_cost);
  std::printf("contacts = %zu\n", energy->Contacts(u.data()).size());
  return summary.Succeeded() ? 0 : 1;
}
