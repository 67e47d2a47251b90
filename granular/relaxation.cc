#include "granular/relaxation.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "granular/spatial_order.h"
#include "solvers/format.h"
#include "solvers/solver_sequence.h"

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
  std::vector<int> order;
  Packing reordered;
  if (start.IsValid(error) && IsScattered(start)) {
    order = SpatialOrder(start);
    reordered = Reordered(start, order);
  }
  ContactEnergyOptions options = energy_options;
  if (!order.empty() && options.fixed.size() == order.size()) {
    for (std::size_t k = 0; k < order.size(); ++k) {
      options.fixed[k] = energy_options.fixed[order[k]];
    }
  }
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(order.empty() ? start : reordered, options, error);
  if (energy == nullptr) return false;
  reordered = Packing();
  std::vector<double> u(energy->NumParameters(), 0.0);
  Summary summary = solver.Minimize(energy.get(), solve_options, u.data());
  *result = Conclude(std::move(summary), u.data(), energy.get());
  if (!order.empty()) {
    result->packing = Restored(result->packing, order);
    result->contacts = Restored(std::move(result->contacts), order);
    const std::vector<bool> is_rattler = result->observables.is_rattler;
    for (std::size_t k = 0; k < order.size(); ++k) {
      result->observables.is_rattler[order[k]] = is_rattler[k];
    }
  }
  return true;
}

std::int64_t LegEvaluations(const Packing& packing) {
  constexpr std::int64_t kCoordinates = 10'000'000'000;
  return std::max<std::int64_t>(
      1000,
      kCoordinates / (std::int64_t{packing.dimension()} * packing.size()));
}

bool RelaxInLegs(const ContactEnergyOptions& energy_options,
                 const Solver& solver,
                 const SolveOptions& solve_options,
                 std::int64_t leg,
                 const std::function<void(const RelaxationState&)>& observer,
                 RelaxationState* state,
                 Relaxation* result,
                 std::string* error) {
  while (true) {
    const Summary done = state->summary;
    SolveOptions options = Remaining(solve_options, done);
    const bool is_last = options.max_evaluations <= leg;
    options.max_evaluations = std::min(options.max_evaluations, leg);
    if (!Relax(
            state->packing, energy_options, solver, options, result, error)) {
      return false;
    }
    const bool has_moved =
        result->packing.positions != state->packing.positions ||
        result->packing.positions_low.size() !=
            state->packing.positions_low.size() ||
        result->packing.positions_low != state->packing.positions_low;
    if (state->legs > 0) {
      result->summary = Joined(done, std::move(result->summary));
      result->summary.message =
          Format("leg %d: ", state->legs + 1) + result->summary.message;
    }
    result->list_builds += state->list_builds;
    if (result->summary.reason != StopReason::MAX_EVALUATIONS || is_last) {
      return true;
    }
    if (!has_moved) {
      result->summary.reason = StopReason::NO_PROGRESS;
      result->summary.message =
          Format("no better point within %lld evaluations",
                 static_cast<long long>(leg));
      return true;
    }
    state->packing = std::move(result->packing);
    state->summary = std::move(result->summary);
    state->list_builds = result->list_builds;
    *result = Relaxation();  // its memory
    ++state->legs;
    if (observer) observer(*state);
  }
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
  relaxation.observables = Measure(
      relaxation.packing, relaxation.contacts, value, energy->options().fixed);
  relaxation.list_builds = energy->num_list_builds();
  return relaxation;
}

bool MeasureAsItIs(const Packing& packing,
                   const ContactEnergyOptions& energy_options,
                   Relaxation* result,
                   std::string* error) {
  ContactEnergyOptions options = energy_options;
  options.precision = Precision::DOUBLE;
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, options, error);
  if (energy == nullptr) return false;
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  *result = Conclude(Summary(), zero.data(), energy.get());
  return true;
}

}  // namespace granopt
