#include "granular/relaxation.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "solvers/format.h"

namespace granopt {
namespace {

// Puts numbers in double precision in place of those of a run that ended in
// single precision, which may turn out not to have converged.
void JudgeInDouble(const ContactEnergy& energy,
                   const double* u,
                   Summary* summary) {
  std::vector<double> gradient(energy.NumParameters());
  Scales scales;
  if (!energy.EvaluateWithScales(u, &summary->cost, gradient.data(), &scales)) {
    return;
  }
  const double before = summary->max_gradient;
  summary->scales = scales;
  summary->max_gradient = 0.0;
  for (const double g : gradient) {
    summary->max_gradient = std::max(summary->max_gradient, std::abs(g));
  }
  const bool is_worse = summary->reason == StopReason::CONVERGED &&
                        !(summary->max_gradient <= summary->tolerance);
  if (is_worse) summary->reason = StopReason::NO_PROGRESS;
  if (summary->reason != StopReason::NO_PROGRESS) return;
  summary->message =
      Format(
          "|g| = %.2e > %.2e in double precision, %.2e in single precision, "
          "where the run ended (--precision=mixed goes on): ",
          summary->max_gradient,
          summary->tolerance,
          before) +
      summary->message;
}

}  // namespace

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
  Summary summary = solver.Minimize(energy.get(), solve_options, u.data());
  *result = Conclude(std::move(summary), u.data(), energy.get());
  return true;
}

Relaxation Conclude(Summary summary, const double* u, ContactEnergy* energy) {
  Relaxation relaxation;
  energy->Recenter(u);
  if (energy->UseDouble()) JudgeInDouble(*energy, u, &summary);
  relaxation.summary = std::move(summary);
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
