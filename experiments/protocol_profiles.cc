#include "experiments/protocol_profiles.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "experiments/statistics.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

using Matrix = std::vector<std::vector<double>>;  // [problem][method]

// Costs of problems, infinite where a method did not solve one.
struct CostMatrices {
  Matrix evaluations, cpu_seconds;
};

// Of one tolerance and seed, medians over repetitions; appends the first run of
// each method to `ends`. False, with nothing added to `costs`, if a method was
// not run: an unfinished comparison.
bool AddProtocol(const ProtocolSetup& setup,
                 const ProtocolIndex& index,
                 double tolerance,
                 std::uint64_t seed,
                 CostMatrices* costs,
                 std::vector<const ProtocolRun*>* ends) {
  std::vector<double> evaluations, seconds;
  for (const Method& method : setup.methods) {
    std::vector<double> counts, times;
    for (int r = 1; r <= setup.repetitions; ++r) {
      const ProtocolRun* run = index.Run(tolerance, seed, method.label, r);
      if (run == nullptr) continue;
      counts.push_back(run->finished
                           ? static_cast<double>(run->work.evaluations)
                           : kInfinity);
      times.push_back(run->finished ? run->work.cpu_seconds : kInfinity);
    }
    const ProtocolRun* first = index.Run(tolerance, seed, method.label);
    if (first == nullptr) return false;
    ends->push_back(first);
    evaluations.push_back(MedianOf(counts));
    seconds.push_back(MedianOf(times));
  }
  costs->evaluations.push_back(evaluations);
  costs->cpu_seconds.push_back(seconds);
  return true;
}

// phi_cr - phi_J in epsilon, and who agrees with the reference about phi_cr.
void AddExcess(const ProtocolSetup& setup,
               const std::vector<const ProtocolRun*>& ends,
               std::size_t reference,
               Matrix* values,
               Quality* quality) {
  std::vector<double> excess;
  for (std::size_t m = 0; m < ends.size(); ++m) {
    const ProtocolRun &run = *ends[m], &base = *ends[reference];
    const bool known = run.finished && std::isfinite(run.Excess());
    excess.push_back(known ? std::max(0.0, run.Excess()) / setup.epsilon
                           : kInfinity);
    if (!base.finished) continue;
    ++quality->judged[m];
    quality->agree[m] +=
        run.finished && std::abs(run.phi_cr - base.phi_cr) <= setup.epsilon;
  }
  values->push_back(excess);
}

// Energies at each strain, the costs of the steps that all methods start from
// one state, and who agrees with the reference all the way.
void AddCurves(const std::vector<std::vector<const ProtocolStep*>>& curves,
               std::size_t reference,
               CostMatrices* costs,
               Matrix* values,
               Quality* quality) {
  std::size_t common = curves[0].size();
  for (const auto& curve : curves) common = std::min(common, curve.size());
  std::size_t shared = common;
  for (std::size_t m = 0; m < curves.size(); ++m) {
    const std::size_t first = FirstDifference(curves[m], curves[reference]);
    shared = std::min(shared, first + 1);
    ++quality->judged[m];
    quality->agree[m] += first == curves[reference].size() ? 1 : 0;
  }
  for (std::size_t k = 1; k < common; ++k) {
    std::vector<double> evaluations, seconds, energies;
    for (const auto& curve : curves) {
      const ProtocolStep& step = *curve[k];
      evaluations.push_back(step.converged
                                ? static_cast<double>(step.work.evaluations)
                                : kInfinity);
      seconds.push_back(step.converged ? step.work.cpu_seconds : kInfinity);
      energies.push_back(step.energy);
    }
    values->push_back(energies);
    if (k >= shared) continue;
    costs->evaluations.push_back(evaluations);
    costs->cpu_seconds.push_back(seconds);
  }
}

void AddProfiles(const std::string& problems,
                 const std::vector<Method>& methods,
                 const CostMatrices& costs,
                 std::vector<Profile>* profiles) {
  if (static_cast<int>(costs.evaluations.size()) < kLeastProblems) return;
  profiles->push_back(
      MakeProfile(problems, "evaluations", methods, costs.evaluations));
  profiles->push_back(
      MakeProfile(problems, "cpu_seconds", methods, costs.cpu_seconds));
}

}  // namespace

ComparisonProfiles MakeProtocolProfiles(const ProtocolSetup& setup,
                                        const std::vector<ProtocolStep>& steps,
                                        const std::vector<ProtocolRun>& runs) {
  ComparisonProfiles result;
  const ProtocolIndex index(runs, steps);
  const std::size_t methods = setup.methods.size();
  if (static_cast<int>(methods) < kLeastMethods) return result;
  const bool shear = setup.protocol == kShearProtocol;
  std::size_t reference = 0;
  while (reference + 1 < methods &&
         setup.methods[reference].label != setup.reference) {
    ++reference;
  }
  CostMatrices protocols, shared_steps;
  Matrix values;
  Quality quality;
  quality.methods = setup.methods;
  quality.reference = setup.reference;
  quality.agree.assign(methods, 0);
  quality.judged.assign(methods, 0);
  for (const double tolerance : setup.tolerances) {
    for (const std::uint64_t seed : setup.seeds) {
      std::vector<const ProtocolRun*> ends;
      if (!AddProtocol(setup, index, tolerance, seed, &protocols, &ends)) {
        continue;
      }
      if (!shear) {
        AddExcess(setup, ends, reference, &values, &quality);
        continue;
      }
      std::vector<std::vector<const ProtocolStep*>> curves;
      for (const Method& method : setup.methods) {
        curves.push_back(index.Steps(tolerance, seed, method.label));
      }
      AddCurves(curves, reference, &shared_steps, &values, &quality);
    }
  }
  AddProfiles("whole protocols", setup.methods, protocols, &result.profiles);
  AddProfiles("steps that all begin from one state",
              setup.methods,
              shared_steps,
              &result.profiles);
  if (static_cast<int>(values.size()) < kLeastProblems) return result;
  if (shear) values = EnergyDifferences(values, static_cast<int>(reference));
  quality.problems = shear ? "strains" : "whole protocols";
  quality.measure = shear ? "path" : "excess";
  quality.agreement = shear ? "energies all the way" : "phi_cr";
  quality.count = static_cast<int>(values.size());
  for (std::size_t m = 0; m < methods; ++m) {
    quality.steps.push_back(Distribution(Column(values, m), quality.count));
  }
  result.qualities.push_back(quality);
  return result;
}

}  // namespace granopt
