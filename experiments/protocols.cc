#include "experiments/protocols.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>
#include <utility>

#include "experiments/tabular.h"
#include "nlohmann/json.hpp"
#include "solvers/format.h"

namespace granopt {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr char kSchema[] = "granopt/compare-protocol-setup/1";

constexpr char kKeyColumns[] = "tolerance,seed,repetition,solver,spec,";

std::string KeyFields(const ProtocolKey& key) {
  return Neat(key.tolerance) +
         Format(",%llu,%d,",
                static_cast<unsigned long long>(key.seed),
                key.repetition) +
         Field(key.label) + "," + Field(key.spec) + ",";
}

void ReadKey(CsvReader* reader, ProtocolKey* key) {
  reader->Read("tolerance", &key->tolerance);
  reader->Read("seed", &key->seed);
  reader->Read("repetition", &key->repetition);
  reader->Read("solver", &key->label);
  reader->Read("spec", &key->spec);
}

// Runs and steps by what they are of.
class ProtocolIndex {
 public:
  explicit ProtocolIndex(const std::vector<ProtocolRun>& runs,
                         const std::vector<ProtocolStep>& steps = {}) {
    for (const ProtocolRun& run : runs) runs_[PlaceOf(run.key)] = &run;
    for (const ProtocolStep& step : steps) {
      steps_[PlaceOf(step.key)].push_back(&step);
    }
  }

  // Null if it was not run.
  const ProtocolRun* Run(double tolerance,
                         std::uint64_t seed,
                         const std::string& label,
                         int repetition = 1) const {
    const auto found = runs_.find({tolerance, seed, label, repetition});
    return found == runs_.end() ? nullptr : found->second;
  }

  // In their order; empty if it was not run.
  const std::vector<const ProtocolStep*>& Steps(
      double tolerance, std::uint64_t seed, const std::string& label) const {
    static const std::vector<const ProtocolStep*> kNone;
    const auto found = steps_.find({tolerance, seed, label, 1});
    return found == steps_.end() ? kNone : found->second;
  }

 private:
  using Place = std::tuple<double, std::uint64_t, std::string, int>;
  static Place PlaceOf(const ProtocolKey& key) {
    return {key.tolerance, key.seed, key.label, key.repetition};
  }

  std::map<Place, const ProtocolRun*> runs_;
  std::map<Place, std::vector<const ProtocolStep*>> steps_;
};

// |a - b| / max(|a|, |b|).
double RelativeDifference(double a, double b) {
  const double size = std::max(std::abs(a), std::abs(b));
  return size > 0.0 ? std::abs(a - b) / size : 0.0;
}

// The first step in which the energies differ, or the number of common steps if
// none does.
std::size_t FirstDifference(const std::vector<const ProtocolStep*>& a,
                            const std::vector<const ProtocolStep*>& b) {
  const std::size_t common = std::min(a.size(), b.size());
  for (std::size_t k = 0; k < common; ++k) {
    if (RelativeDifference(a[k]->energy, b[k]->energy) > Minima::kEnergyBound) {
      return k;
    }
  }
  return common;
}

double Range(const std::vector<double>& values) {
  if (values.empty()) return 0.0;
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return *most - *least;
}

std::string CountOrDash(int count) {
  return count == 0 ? "-" : std::to_string(count);
}

std::string Brief(double value) {
  return std::isnan(value) ? "-" : Format("%.1e", value);
}

}  // namespace

// ---------------------------------------------------------------- the plan

std::string FormatProtocolSetup(const ProtocolSetup& setup) {
  Json json;
  json["schema"] = kSchema;
  json["protocol"] = setup.protocol;
  json["what"] = setup.what;
  json["solvers"] = Json::array();
  for (const Method& method : setup.methods) {
    json["solvers"].push_back({{"label", method.label}, {"spec", method.spec}});
  }
  json["tolerances"] = setup.tolerances;
  json["seeds"] = setup.seeds;
  json["repetitions"] = setup.repetitions;
  json["baseline"] = setup.baseline;
  json["reference"] = setup.reference;
  json["conditions"] = setup.conditions;
  json["epsilon"] = setup.epsilon;
  json["strain"] = setup.strain;
  json["strain_steps"] = setup.strain_steps;
  return json.dump(2) + "\n";
}

bool IsProtocolSetup(const std::string& text) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  return json.is_object() && json.contains("schema") &&
         json["schema"] == kSchema;
}

bool ParseProtocolSetup(const std::string& text,
                        const std::string& name,
                        ProtocolSetup* setup,
                        std::string* error) {
  try {
    const Json json = Json::parse(text);
    ProtocolSetup result;
    result.protocol = json.at("protocol").get<std::string>();
    result.what = json.at("what").get<std::string>();
    for (const Json& method : json.at("solvers")) {
      result.methods.push_back({method.at("label").get<std::string>(),
                                method.at("spec").get<std::string>()});
    }
    result.tolerances = json.at("tolerances").get<std::vector<double>>();
    result.seeds = json.at("seeds").get<std::vector<std::uint64_t>>();
    result.repetitions = json.at("repetitions").get<int>();
    result.baseline = json.at("baseline").get<std::string>();
    result.reference = json.at("reference").get<std::string>();
    result.conditions = json.at("conditions").get<std::string>();
    result.epsilon = json.at("epsilon").get<double>();
    result.strain = json.at("strain").get<double>();
    result.strain_steps = json.at("strain_steps").get<int>();
    if (result.protocol != kJammingProtocol &&
        result.protocol != kShearProtocol) {
      return Fail(name + ": protocol '" + result.protocol + "' is not known",
                  error);
    }
    if (result.methods.empty() || result.tolerances.empty() ||
        result.seeds.empty()) {
      return Fail(name + ": no solvers, tolerances or seeds", error);
    }
    *setup = std::move(result);
    return true;
  } catch (const Json::exception& e) {
    return Fail(name + ": " + e.what(), error);
  }
}

// ---------------------------------------------------------------- records

std::string ProtocolStepsCsv(const std::vector<ProtocolStep>& steps) {
  std::string csv =
      std::string(kKeyColumns) +
      "step,stage,verdict,stop_reason,converged,phi,strain,residual,energy,"
      "pressure,deviatoric_stress,shear_stress,work_done,dissipated," +
      kWorkColumns + "\n";
  for (const ProtocolStep& step : steps) {
    csv += KeyFields(step.key) + Format("%d,", step.step) + step.stage + "," +
           step.verdict + "," + step.stop_reason +
           Format(",%d,", step.converged ? 1 : 0) + Number(step.phi) + "," +
           Number(step.strain) + "," + Number(step.residual) + "," +
           Number(step.energy) + "," + Number(step.pressure) + "," +
           Number(step.deviatoric) + "," + Number(step.shear_stress) + "," +
           Number(step.work_done) + "," + Number(step.dissipated) + "," +
           WorkFields(step.work) + "\n";
  }
  return csv;
}

bool ParseProtocolSteps(const std::string& text,
                        const std::string& name,
                        std::vector<ProtocolStep>* steps,
                        std::string* error) {
  steps->clear();
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    ProtocolStep step;
    ReadKey(&reader, &step.key);
    reader.Read("step", &step.step);
    reader.Read("stage", &step.stage);
    reader.Read("verdict", &step.verdict);
    reader.Read("stop_reason", &step.stop_reason);
    reader.Read("converged", &step.converged);
    reader.Read("phi", &step.phi);
    reader.Read("strain", &step.strain);
    reader.Read("residual", &step.residual);
    reader.Read("energy", &step.energy);
    reader.Read("pressure", &step.pressure);
    reader.Read("deviatoric_stress", &step.deviatoric);
    reader.Read("shear_stress", &step.shear_stress);
    reader.Read("work_done", &step.work_done);
    reader.Read("dissipated", &step.dissipated);
    ReadWork(&reader, &step.work);
    if (!reader.error().empty()) return Fail(reader.error(), error);
    steps->push_back(step);
  }
  return true;
}

std::string ProtocolRunsCsv(const std::vector<ProtocolRun>& runs) {
  std::string csv =
      std::string(kKeyColumns) +
      "position,finished,message,relaxations,undecided,gave_up,energy,"
      "pressure,phi_cr,phi_unjammed,contacts_excess,rattlers,branch,phi_j,"
      "distance,strain,deviatoric_stress,shear_stress," +
      kWorkColumns + ",seconds\n";
  for (const ProtocolRun& run : runs) {
    csv += KeyFields(run.key) +
           Format("%d,%d,", run.position, run.finished ? 1 : 0) +
           Field(run.message) +
           Format(",%d,%d,%d,", run.relaxations, run.undecided, run.gave_up) +
           Number(run.energy) + "," + Number(run.pressure) + "," +
           Number(run.phi_cr) + "," + Number(run.phi_unjammed) +
           Format(",%d,%d,", run.contacts_excess, run.rattlers) + run.branch +
           "," + Number(run.phi_j) + "," + Number(run.distance) + "," +
           Number(run.strain) + "," + Number(run.deviatoric) + "," +
           Number(run.shear_stress) + "," + WorkFields(run.work) +
           Format(",%.9g\n", run.seconds);
  }
  return csv;
}

bool ParseProtocolRuns(const std::string& text,
                       const std::string& name,
                       std::vector<ProtocolRun>* runs,
                       std::string* error) {
  runs->clear();
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    ProtocolRun run;
    ReadKey(&reader, &run.key);
    reader.Read("position", &run.position);
    reader.Read("finished", &run.finished);
    reader.Read("message", &run.message);
    reader.Read("relaxations", &run.relaxations);
    reader.Read("undecided", &run.undecided);
    reader.Read("gave_up", &run.gave_up);
    reader.Read("energy", &run.energy);
    reader.Read("pressure", &run.pressure);
    reader.Read("phi_cr", &run.phi_cr);
    reader.Read("phi_unjammed", &run.phi_unjammed);
    reader.Read("contacts_excess", &run.contacts_excess);
    reader.Read("rattlers", &run.rattlers);
    reader.Read("branch", &run.branch);
    reader.Read("phi_j", &run.phi_j);
    reader.Read("distance", &run.distance);
    reader.Read("strain", &run.strain);
    reader.Read("deviatoric_stress", &run.deviatoric);
    reader.Read("shear_stress", &run.shear_stress);
    ReadWork(&reader, &run.work);
    reader.Read("seconds", &run.seconds);
    if (!reader.error().empty()) return Fail(reader.error(), error);
    runs->push_back(run);
  }
  return true;
}

// ---------------------------------------------------------------- tables

std::vector<ProtocolRow> TabulateProtocols(
    const ProtocolSetup& setup, const std::vector<ProtocolRun>& runs) {
  const ProtocolIndex index(runs);
  std::vector<ProtocolRow> rows;
  for (const double tolerance : setup.tolerances) {
    for (const Method& method : setup.methods) {
      ProtocolRow row;
      row.method = method;
      row.tolerance = tolerance;
      std::vector<double> relaxations, iterations, evaluations, hessians,
          factorizations, linear_iterations, seconds, ratios, function_shares,
          linear_shares, spent_evaluations, spent_seconds;
      for (const std::uint64_t seed : setup.seeds) {
        for (int r = 1; r <= setup.repetitions; ++r) {
          const ProtocolRun* run = index.Run(tolerance, seed, method.label, r);
          if (run == nullptr) continue;
          ++row.runs;
          row.finished += run->finished ? 1 : 0;
          row.undecided += run->undecided;
          row.gave_up += run->gave_up;
          const auto cost = [run](double value) {
            return run->finished ? value : kInfinity;
          };
          const Work& work = run->work;
          relaxations.push_back(cost(run->relaxations));
          iterations.push_back(cost(static_cast<double>(work.iterations)));
          evaluations.push_back(cost(static_cast<double>(work.evaluations)));
          hessians.push_back(cost(static_cast<double>(work.hessians)));
          factorizations.push_back(
              cost(static_cast<double>(work.factorizations)));
          linear_iterations.push_back(
              cost(static_cast<double>(work.linear_iterations)));
          seconds.push_back(cost(work.cpu_seconds));
          function_shares.push_back(work.function_share);
          linear_shares.push_back(work.linear_share);
          spent_evaluations.push_back(static_cast<double>(work.evaluations));
          spent_seconds.push_back(work.cpu_seconds);
          const ProtocolRun* base =
              index.Run(tolerance, seed, setup.baseline, r);
          if (base != nullptr && base->finished &&
              base->work.cpu_seconds > 0.0) {
            ratios.push_back(seconds.back() / base->work.cpu_seconds);
          }
        }
      }
      row.relaxations = QuantilesOf(relaxations);
      row.iterations = QuantilesOf(iterations);
      row.evaluations = QuantilesOf(evaluations);
      row.hessians = QuantilesOf(hessians);
      row.factorizations = QuantilesOf(factorizations);
      row.linear_iterations = QuantilesOf(linear_iterations);
      row.cpu_seconds = QuantilesOf(seconds);
      row.ratio = QuantilesOf(ratios);
      row.function_share = MedianOf(function_shares);
      row.linear_share = MedianOf(linear_shares);
      row.spent_evaluations = MedianOf(spent_evaluations);
      row.spent_seconds = MedianOf(spent_seconds);
      rows.push_back(row);
    }
  }
  return rows;
}

std::vector<JammingRow> TabulateJamming(const ProtocolSetup& setup,
                                        const std::vector<ProtocolRun>& runs) {
  const ProtocolIndex index(runs);
  std::vector<JammingRow> rows;
  for (const double tolerance : setup.tolerances) {
    for (const Method& method : setup.methods) {
      JammingRow row;
      row.method = method;
      row.tolerance = tolerance;
      row.least_phi = kInfinity;
      row.most_phi = -kInfinity;
      row.worst_excess = kNan;
      std::vector<double> excess, pressures, contacts;
      for (const std::uint64_t seed : setup.seeds) {
        const ProtocolRun* run = index.Run(tolerance, seed, method.label);
        if (run == nullptr || !run->finished) continue;
        ++row.runs;
        row.least_phi = std::min(row.least_phi, run->phi_cr);
        row.most_phi = std::max(row.most_phi, run->phi_cr);
        pressures.push_back(run->pressure);
        contacts.push_back(run->contacts_excess);
        row.most_contacts =
            contacts.size() == 1
                ? run->contacts_excess
                : std::max(row.most_contacts, run->contacts_excess);
        row.lost += run->branch == kLost ? 1 : 0;
        row.spurious += run->branch == kSpurious ? 1 : 0;
        row.unknown += run->branch == kUnknown ? 1 : 0;
        row.non_monotone += run->NonMonotone(setup.epsilon) ? 1 : 0;
        if (std::isfinite(run->Excess())) excess.push_back(run->Excess());
        const ProtocolRun* reference =
            index.Run(tolerance, seed, setup.reference);
        if (reference != nullptr && reference->finished) {
          row.apart =
              std::max(row.apart, std::abs(run->phi_cr - reference->phi_cr));
        }
      }
      row.excess = QuantilesOf(excess);
      if (!excess.empty()) {
        row.worst_excess = *std::max_element(excess.begin(), excess.end());
      }
      row.pressure = MedianOf(pressures);
      row.contacts = MedianOf(contacts);
      rows.push_back(row);
    }
  }
  return rows;
}

std::vector<SeedSpread> SpreadOfSeeds(const ProtocolSetup& setup,
                                      const std::vector<ProtocolRun>& runs) {
  const ProtocolIndex index(runs);
  std::vector<SeedSpread> spreads;
  for (const std::uint64_t seed : setup.seeds) {
    SeedSpread spread;
    spread.seed = seed;
    spread.least_phi = spread.least_phi_j = kInfinity;
    spread.most_phi = spread.most_phi_j = -kInfinity;
    std::map<std::string, std::vector<double>> of_method;
    std::map<double, std::vector<double>> of_tolerance;
    for (const double tolerance : setup.tolerances) {
      for (const Method& method : setup.methods) {
        const ProtocolRun* run = index.Run(tolerance, seed, method.label);
        if (run == nullptr || !run->finished) continue;
        ++spread.runs;
        spread.least_phi = std::min(spread.least_phi, run->phi_cr);
        spread.most_phi = std::max(spread.most_phi, run->phi_cr);
        if (run->branch == kFollowed) {
          spread.least_phi_j = std::min(spread.least_phi_j, run->phi_j);
          spread.most_phi_j = std::max(spread.most_phi_j, run->phi_j);
        }
        of_method[method.label].push_back(run->phi_cr);
        of_tolerance[tolerance].push_back(run->phi_cr);
      }
    }
    for (const auto& [label, values] : of_method) {
      spread.by_tolerance = std::max(spread.by_tolerance, Range(values));
    }
    for (const auto& [tolerance, values] : of_tolerance) {
      spread.by_method = std::max(spread.by_method, Range(values));
    }
    spreads.push_back(spread);
  }
  return spreads;
}

std::vector<ShearRow> TabulateShear(const ProtocolSetup& setup,
                                    const std::vector<ProtocolStep>& steps) {
  const ProtocolIndex index({}, steps);
  std::vector<ShearRow> rows;
  for (const double tolerance : setup.tolerances) {
    for (const Method& method : setup.methods) {
      for (const std::uint64_t seed : setup.seeds) {
        const auto& mine = index.Steps(tolerance, seed, method.label);
        const auto& other = index.Steps(tolerance, seed, setup.reference);
        if (mine.empty() || other.empty()) continue;
        ShearRow row;
        row.method = method;
        row.tolerance = tolerance;
        row.seed = seed;
        const std::size_t common = std::min(mine.size(), other.size());
        row.steps = static_cast<int>(common) - 1;
        const std::size_t first = FirstDifference(mine, other);
        if (first < common) {
          row.first_difference = mine[first]->step;
          row.strain = mine[first]->strain;
        }
        double scale = 0.0, sum = 0.0;
        for (std::size_t k = 0; k < common; ++k) {
          scale = std::max(scale, other[k]->deviatoric);
        }
        for (std::size_t k = 0; k < common; ++k) {
          const double difference =
              scale > 0.0
                  ? std::abs(mine[k]->deviatoric - other[k]->deviatoric) / scale
                  : 0.0;
          row.largest = std::max(row.largest, difference);
          sum += difference * difference;
          row.dissipated += mine[k]->dissipated;
        }
        row.rms = std::sqrt(sum / static_cast<double>(common));
        const double start = mine[0]->energy;
        row.dissipated = start > 0.0 ? row.dissipated / start : 0.0;
        rows.push_back(row);
      }
    }
  }
  return rows;
}

ComparisonProfiles MakeProtocolProfiles(const ProtocolSetup& setup,
                                        const std::vector<ProtocolStep>& steps,
                                        const std::vector<ProtocolRun>& runs) {
  ComparisonProfiles result;
  const ProtocolIndex index(runs, steps);
  const std::size_t methods = setup.methods.size();
  if (static_cast<int>(methods) < kLeastMethods) return result;
  const bool shear = setup.protocol == kShearProtocol;
  std::size_t base = 0;
  while (base + 1 < methods && setup.methods[base].label != setup.reference) {
    ++base;
  }

  // Whole protocols, and the steps of a shear that begin from one state.
  std::vector<std::vector<double>> evaluations, seconds, step_evaluations,
      step_seconds, values;
  Quality quality;
  quality.methods = setup.methods;
  quality.reference = setup.reference;
  quality.agree.assign(methods, 0);
  quality.judged.assign(methods, 0);
  for (const double tolerance : setup.tolerances) {
    for (const std::uint64_t seed : setup.seeds) {
      std::vector<double> counts, times;
      std::vector<const ProtocolRun*> ends;
      for (const Method& method : setup.methods) {
        std::vector<double> of_runs, times_of_runs;
        for (int r = 1; r <= setup.repetitions; ++r) {
          const ProtocolRun* run = index.Run(tolerance, seed, method.label, r);
          if (run == nullptr) continue;
          of_runs.push_back(run->finished
                                ? static_cast<double>(run->work.evaluations)
                                : kInfinity);
          times_of_runs.push_back(run->finished ? run->work.cpu_seconds
                                                : kInfinity);
        }
        const ProtocolRun* first = index.Run(tolerance, seed, method.label);
        if (first == nullptr) break;
        ends.push_back(first);
        counts.push_back(MedianOf(of_runs));
        times.push_back(MedianOf(times_of_runs));
      }
      if (ends.size() < methods) continue;  // an unfinished comparison
      evaluations.push_back(counts);
      seconds.push_back(times);
      if (!shear) {
        std::vector<double> excess;
        for (std::size_t m = 0; m < methods; ++m) {
          const bool known =
              ends[m]->finished && std::isfinite(ends[m]->Excess());
          excess.push_back(known ? std::max(0.0, ends[m]->Excess()) /
                                       setup.epsilon
                                 : kInfinity);
          if (!ends[base]->finished) continue;
          ++quality.judged[m];
          quality.agree[m] +=
              ends[m]->finished &&
              std::abs(ends[m]->phi_cr - ends[base]->phi_cr) <= setup.epsilon;
        }
        values.push_back(excess);
        continue;
      }
      std::vector<std::vector<const ProtocolStep*>> curves;
      std::size_t common = std::numeric_limits<std::size_t>::max();
      for (const Method& method : setup.methods) {
        curves.push_back(index.Steps(tolerance, seed, method.label));
        common = std::min(common, curves.back().size());
      }
      std::size_t shared = common;
      for (std::size_t m = 0; m < methods; ++m) {
        const std::size_t first = FirstDifference(curves[m], curves[base]);
        shared = std::min(shared, first + 1);
        ++quality.judged[m];
        quality.agree[m] += first == curves[base].size() ? 1 : 0;
      }
      for (std::size_t k = 1; k < common; ++k) {
        std::vector<double> step_counts, step_times, energies;
        for (const auto& curve : curves) {
          const ProtocolStep& step = *curve[k];
          step_counts.push_back(step.converged
                                    ? static_cast<double>(step.work.evaluations)
                                    : kInfinity);
          step_times.push_back(step.converged ? step.work.cpu_seconds
                                              : kInfinity);
          energies.push_back(step.energy);
        }
        values.push_back(energies);
        if (k >= shared) continue;
        step_evaluations.push_back(step_counts);
        step_seconds.push_back(step_times);
      }
    }
  }
  const auto add = [&](const std::string& what,
                       const std::vector<std::vector<double>>& counts,
                       const std::vector<std::vector<double>>& times) {
    if (static_cast<int>(counts.size()) < kLeastProblems) return;
    result.profiles.push_back(
        MakeProfile(what, "evaluations", setup.methods, counts));
    result.profiles.push_back(
        MakeProfile(what, "cpu_seconds", setup.methods, times));
  };
  add("whole protocols", evaluations, seconds);
  add("steps that all begin from one state", step_evaluations, step_seconds);
  if (static_cast<int>(values.size()) < kLeastProblems) return result;
  if (shear) values = EnergyDifferences(values, static_cast<int>(base));
  quality.problems = shear ? "strains" : "whole protocols";
  quality.measure = shear ? "path" : "excess";
  quality.agreement = shear ? "energies all the way" : "phi_cr";
  quality.count = static_cast<int>(values.size());
  for (std::size_t m = 0; m < methods; ++m) {
    std::vector<double> column;
    for (const std::vector<double>& row : values) column.push_back(row[m]);
    quality.steps.push_back(Distribution(column, quality.count));
  }
  result.qualities.push_back(quality);
  return result;
}

// ---------------------------------------------------------------- text

std::string ProtocolTablesCsv(const std::vector<ProtocolRow>& rows) {
  std::string csv =
      "tolerance,solver,spec,runs,finished,undecided,gave_up,relaxations,"
      "iterations,evaluations,evaluations_q20,evaluations_q80,hessians,"
      "factorizations,linear_iterations,cpu_seconds,cpu_seconds_q20,"
      "cpu_seconds_q80,ratio,ratio_q20,ratio_q80,function_share,linear_share,"
      "spent_evaluations,spent_seconds\n";
  const auto three = [](const Quantiles& q) {
    return Format("%.9g,%.9g,%.9g,", q.median, q.low, q.high);
  };
  for (const ProtocolRow& row : rows) {
    csv += Neat(row.tolerance) + "," + Field(row.method.label) + "," +
           Field(row.method.spec) +
           Format(",%d,%d,%d,%d,%.9g,%.9g,",
                  row.runs,
                  row.finished,
                  row.undecided,
                  row.gave_up,
                  row.relaxations.median,
                  row.iterations.median) +
           three(row.evaluations) +
           Format("%.9g,%.9g,%.9g,",
                  row.hessians.median,
                  row.factorizations.median,
                  row.linear_iterations.median) +
           three(row.cpu_seconds) + three(row.ratio) +
           Format("%.4g,%.4g,%.9g,%.9g\n",
                  row.function_share,
                  row.linear_share,
                  row.spent_evaluations,
                  row.spent_seconds);
  }
  return csv;
}

std::string JammingTableCsv(const std::vector<JammingRow>& rows) {
  std::string csv =
      "tolerance,solver,spec,runs,phi_cr_least,phi_cr_most,apart,excess,"
      "excess_q20,excess_q80,excess_most,pressure,contacts_excess,"
      "contacts_excess_most,non_monotone,lost,spurious,unknown\n";
  for (const JammingRow& row : rows) {
    csv += Neat(row.tolerance) + "," + Field(row.method.label) + "," +
           Field(row.method.spec) +
           Format(
               ",%d,%.12g,%.12g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d,%d,%d,"
               "%d,%d\n",
               row.runs,
               row.least_phi,
               row.most_phi,
               row.apart,
               row.excess.median,
               row.excess.low,
               row.excess.high,
               row.worst_excess,
               row.pressure,
               row.contacts,
               row.most_contacts,
               row.non_monotone,
               row.lost,
               row.spurious,
               row.unknown);
  }
  return csv;
}

std::string ShearTableCsv(const std::vector<ShearRow>& rows) {
  std::string csv =
      "tolerance,seed,solver,spec,steps,first_difference,strain,largest,rms,"
      "dissipated\n";
  for (const ShearRow& row : rows) {
    csv += Neat(row.tolerance) +
           Format(",%llu,", static_cast<unsigned long long>(row.seed)) +
           Field(row.method.label) + "," + Field(row.method.spec) +
           Format(",%d,%d,%.9g,%.6g,%.6g,%.6g\n",
                  row.steps,
                  row.first_difference,
                  row.strain,
                  row.largest,
                  row.rms,
                  row.dissipated);
  }
  return csv;
}

namespace {

std::string Heading(const std::string& title, bool markdown) {
  return (markdown ? "## " : "\n") + title + "\n" + (markdown ? "\n" : "");
}

std::string Lines(const std::vector<std::string>& lines, bool markdown) {
  std::string text;
  for (const std::string& line : lines) {
    text += (markdown ? "" : "  ") + line + "\n";
  }
  return text + (markdown ? "\n" : "");
}

std::string WorkText(const ProtocolSetup& setup,
                     const std::vector<ProtocolRun>& runs,
                     bool markdown) {
  const std::vector<ProtocolRow> table = TabulateProtocols(setup, runs);
  const Quantiles ProtocolRow::*const optional[3] = {
      &ProtocolRow::hessians,
      &ProtocolRow::factorizations,
      &ProtocolRow::linear_iterations};
  constexpr const char* kOptional[3] = {"Hessians", "factors", "linear its"};
  bool any[3] = {false, false, false};
  for (const ProtocolRow& row : table) {
    for (int k = 0; k < 3; ++k) {
      const double median = (row.*optional[k]).median;
      any[k] = any[k] || (std::isfinite(median) && median > 0.0);
    }
  }
  std::vector<std::vector<std::string>> grid(1);
  grid[0] = {"tolerance",
             "method",
             "finished",
             "relaxations",
             "gave up",
             "iterations",
             "evaluations"};
  for (int k = 0; k < 3; ++k) {
    if (any[k]) grid[0].push_back(kOptional[k]);
  }
  for (const char* name : {"CPU s", "ratio", "f/lin/rest %"}) {
    grid[0].push_back(name);
  }
  double last = kNan;
  for (const ProtocolRow& row : table) {
    std::vector<std::string> cells = {
        row.tolerance == last ? "" : Neat(row.tolerance),
        row.method.label,
        Format("%d of %d", row.finished, row.runs),
        Spread(row.relaxations, kNan, Count),
        CountOrDash(row.gave_up),
        Spread(row.iterations, kNan, Count),
        Spread(row.evaluations, row.spent_evaluations, Count)};
    last = row.tolerance;
    for (int k = 0; k < 3; ++k) {
      if (any[k]) cells.push_back(Spread(row.*optional[k], kNan, Count));
    }
    cells.push_back(Spread(row.cpu_seconds, row.spent_seconds, Seconds));
    cells.push_back(Spread(row.ratio, kNan, Ratio));
    const double f = 100.0 * row.function_share;
    const double l = 100.0 * row.linear_share;
    cells.push_back(
        row.runs == 0
            ? "-"
            : Format("%.0f/%.0f/%.0f", f, l, std::max(0.0, 100.0 - f - l)));
    grid.push_back(cells);
  }
  std::string text =
      Heading(setup.protocol == kJammingProtocol
                  ? "the work of growth and bisection"
                  : Format("the work of a pure shear to %s in %d steps",
                           Neat(setup.strain).c_str(),
                           setup.strain_steps),
              markdown) +
      Grid(grid, 0, markdown, 2) + (markdown ? "\n" : "");
  std::map<std::string, int> failures;
  std::vector<std::string> notes;
  for (const ProtocolRun& run : runs) {
    if (run.finished || ++failures[run.key.label] > 2) continue;
    notes.push_back(
        "! " + run.key.label + ", tolerance " + Neat(run.key.tolerance) +
        Format(", seed %llu: ", static_cast<unsigned long long>(run.key.seed)) +
        run.message);
  }
  if (!notes.empty()) text += Lines(notes, markdown);
  return text + Lines({Format("totals, medians over %zu seed%s and %d "
                              "repetition%s, 20-80 %% in brackets; a protocol "
                              "that did not end counts as infinitely",
                              setup.seeds.size(),
                              setup.seeds.size() == 1 ? "" : "s",
                              setup.repetitions,
                              setup.repetitions == 1 ? "" : "s"),
                       "expensive (> what it had spent); gave up: relaxations, "
                       "over all runs; CPU s: of the relaxations and what is",
                       "measured on them; ratio: to " + setup.baseline +
                           " from the same start"},
                      markdown);
}

std::string JammingText(const ProtocolSetup& setup,
                        const std::vector<ProtocolRun>& runs,
                        bool markdown) {
  std::vector<std::vector<std::string>> grid = {{"tolerance",
                                                 "method",
                                                 "runs",
                                                 "phi_cr",
                                                 "from " + setup.reference,
                                                 "phi_cr - phi_J",
                                                 "worst",
                                                 "pressure",
                                                 "contacts",
                                                 "non-monotone",
                                                 "lost",
                                                 "spurious",
                                                 "unknown"}};
  double last = kNan;
  for (const JammingRow& row : TabulateJamming(setup, runs)) {
    const std::string tolerance =
        row.tolerance == last ? "" : Neat(row.tolerance);
    last = row.tolerance;
    if (row.runs == 0) {
      grid.push_back({tolerance, row.method.label, "0"});
      grid.back().resize(grid[0].size(), "-");
      continue;
    }
    grid.push_back(
        {tolerance,
         row.method.label,
         std::to_string(row.runs),
         Format("%.6f-%.6f", row.least_phi, row.most_phi),
         row.method.label == setup.reference ? "-" : Brief(row.apart),
         Brief(row.excess.median),
         Brief(row.worst_excess),
         Brief(row.pressure),
         Format("%+.0f (%+d)", row.contacts, row.most_contacts),
         CountOrDash(row.non_monotone),
         CountOrDash(row.lost),
         CountOrDash(row.spurious),
         CountOrDash(row.unknown)});
  }
  std::string text =
      Heading("how far the published Algorithm 1 can be believed, epsilon = " +
                  Neat(setup.epsilon),
              markdown) +
      Grid(grid, 0, markdown, 2) + (markdown ? "\n" : "");
  text += Lines(
      {"phi_cr: least and most over seeds; from: largest distance to the "
       "reference's phi_cr from the same start; phi_J: where the",
       "branch of the returned state unjams, followed down by one method for "
       "all; contacts: above isostatic, median (most);",
       "non-monotone: jammed on its branch more than epsilon below the state "
       "that the bisection calls unjammed; lost: the branch",
       "ends at a finite pressure, phi_J is lower still; spurious: relaxed "
       "further, the state is not jammed"},
      markdown);
  grid = {{"seed",
           "runs",
           "phi_cr, all methods and tolerances",
           "spread / epsilon",
           "by tolerance",
           "by method",
           "phi_J of the branches"}};
  for (const SeedSpread& spread : SpreadOfSeeds(setup, runs)) {
    if (spread.runs == 0) continue;
    grid.push_back(
        {Format("%llu", static_cast<unsigned long long>(spread.seed)),
         std::to_string(spread.runs),
         Format("%.7f-%.7f", spread.least_phi, spread.most_phi),
         Format("%.0f", (spread.most_phi - spread.least_phi) / setup.epsilon),
         Format("%.0f", spread.by_tolerance / setup.epsilon),
         Format("%.0f", spread.by_method / setup.epsilon),
         spread.least_phi_j > spread.most_phi_j
             ? "-"
             : Format("%.7f-%.7f", spread.least_phi_j, spread.most_phi_j)});
  }
  if (grid.size() == 1) return text;
  return text + Heading("one start, many jamming points", markdown) +
         Grid(grid, 0, markdown) + (markdown ? "\n" : "") +
         Lines({"spreads in epsilon: largest difference of phi_cr from one "
                "start, between tolerances with one method, and",
                "between methods at one tolerance"},
               markdown);
}

std::string ShearText(const ProtocolSetup& setup,
                      const std::vector<ProtocolStep>& steps,
                      bool markdown) {
  std::vector<std::vector<std::string>> grid = {{"tolerance",
                                                 "method",
                                                 "seed",
                                                 "first difference",
                                                 "stress apart",
                                                 "rms",
                                                 "dissipated"}};
  std::pair<double, std::string> last = {kNan, ""};
  for (const ShearRow& row : TabulateShear(setup, steps)) {
    const bool same = row.tolerance == last.first;
    const bool reference = row.method.label == setup.reference;
    grid.push_back(
        {same ? "" : Neat(row.tolerance),
         same && row.method.label == last.second ? "" : row.method.label,
         Format("%llu", static_cast<unsigned long long>(row.seed)),
         reference ? "-"
         : row.first_difference == 0
             ? "none"
             : Format("step %d, %.4g", row.first_difference, row.strain),
         reference ? "-" : Brief(row.largest),
         reference ? "-" : Brief(row.rms),
         Format("%.3g", row.dissipated)});
    last = {row.tolerance, row.method.label};
  }
  return Heading("the curves beside that of " + setup.reference, markdown) +
         Grid(grid, 0, markdown, 2) + (markdown ? "\n" : "") +
         Lines(
             {Format("first difference: step and strain where the energies "
                     "first differ by more than %s of the larger: another "
                     "rearrangement;",
                     Neat(Minima::kEnergyBound).c_str()),
              "stress apart, rms: of the deviatoric stress, in the largest of "
              "the reference; dissipated: in rearrangements, in the energy of "
              "the start"},
             markdown);
}

}  // namespace

std::string ProtocolText(const ProtocolSetup& setup,
                         const std::vector<ProtocolStep>& steps,
                         const std::vector<ProtocolRun>& runs,
                         bool markdown) {
  std::string text;
  if (markdown) {
    text += "# Comparison of methods over a whole protocol: " + setup.protocol +
            "\n\n" + setup.what + "; " + std::to_string(setup.repetitions) +
            " repetition" + (setup.repetitions == 1 ? "" : "s") + ", " +
            std::to_string(setup.seeds.size()) + " seed" +
            (setup.seeds.size() == 1 ? "" : "s") + "; " + setup.conditions +
            ".\n\n";
    for (const Method& method : setup.methods) {
      if (method.label == method.spec) continue;
      text += "- " + method.label + ": `" + method.spec + "`\n";
    }
    text += "\n";
  }
  text += WorkText(setup, runs, markdown);
  text += setup.protocol == kJammingProtocol
              ? JammingText(setup, runs, markdown)
              : ShearText(setup, steps, markdown);
  const ComparisonProfiles profiles = MakeProtocolProfiles(setup, steps, runs);
  return text + ProfilesText(profiles.profiles, markdown) +
         QualitiesText(profiles.qualities, markdown);
}

}  // namespace granopt
