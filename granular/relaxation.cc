#include "granular/relaxation.h"

#include <memory>
#include <utility>
#include <vector>

#include "granular/spatial_order.h"

namespace granopt {

bool Relax(const Packing& start,
           const ContactEnergyOptions& energy_options,
           const Solver& solver,
           const SolveOptions& solve_options,
           Relaxation* result,
           std::string* error) {
  std::vector<int> order;
  Packing reordered;
  if (start.IsValid(error) && IsScattered(start)) {
    order = SpatialOrder(start);
    reordered = Reordered(start, order);
  }
  const std::unique_ptr<ContactEnergy> energy = ContactEnergy::Create(
      order.empty() ? start : reordered, energy_options, error);
  if (energy == nullptr) return false;
  reordered = Packing();
  std::vector<double> u(energy->NumParameters(), 0.0);
  Summary summary = solver.Minimize(energy.get(), solve_options, u.data());
  *result = Conclude(std::move(summary), u.data(), energy.get());
  if (!order.empty()) {
    result->packing = Restored(result->packing, order);
    result->contacts = Restored(std::move(result->contacts), order);
  }
  return true;
}

Relaxation Conclude(Summary summary, const double* u, ContactEnergy* energy) {
  Relaxation relaxation;
  relaxation.summary = std::move(summary);
  energy->Recenter(u);
  relaxation.packing = energy->Configuration(u);
  relaxation.contacts = energy->Contacts(u);
  // Images are those of the wrapped grains.
  const std::vector<Image> moved_by = relaxation.packing.Wrap();
  for (Contact& c : relaxation.contacts) {
    for (int k = 0; k < 3; ++k) {
      c.id.image[k] += moved_by[c.id.i][k] - moved_by[c.id.j][k];
    }
  }
  double value = 0.0;
  energy->EvaluateWithScales(u, &value, nullptr, nullptr);
  relaxation.observables =
      Measure(relaxation.packing, relaxation.contacts, value);
  relaxation.list_builds = energy->num_list_builds();
  return relaxation;
}

}  // namespace granopt
