#include "granular/relaxation.h"

#include <memory>
#include <utility>

namespace granopt {

bool Relax(const Packing& start,
           const ContactEnergyOptions& energy_options,
           const Solver& solver,
           const SolveOptions& solve_options,
           Relaxation* result,
           std::string* error) {
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(start, energy_options, error);
  if (energy == nullptr) return false;
  std::vector<double> u(energy->NumParameters(), 0.0);
  Relaxation relaxation;
  relaxation.summary = solver.Minimize(energy.get(), solve_options, u.data());
  energy->Recenter(u.data());
  relaxation.packing = energy->Configuration(u.data());
  relaxation.contacts = energy->Contacts(u.data());
  // Images are those of the wrapped grains.
  const std::vector<Image> moved_by = relaxation.packing.Wrap();
  for (Contact& c : relaxation.contacts) {
    for (int k = 0; k < 3; ++k) {
      c.id.image[k] += moved_by[c.id.i][k] - moved_by[c.id.j][k];
    }
  }
  double value = 0.0;
  energy->EvaluateWithScales(u.data(), &value, nullptr, nullptr);
  relaxation.observables =
      Measure(relaxation.packing, relaxation.contacts, value);
  relaxation.list_builds = energy->num_list_builds();
  *result = std::move(relaxation);
  return true;
}

}  // namespace granopt
