#include "experiments/protocol_records.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "experiments/minima.h"
#include "nlohmann/json.hpp"

namespace granopt {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kSchema[] = "granopt/compare_protocol_setup/1";

void Columns(ProtocolKey* key, CsvColumns* columns) {
  columns->Add("tolerance", &key->tolerance, Neat);
  columns->Add("seed", &key->seed);
  columns->Add("repetition", &key->repetition);
  columns->Add("solver", &key->label);
  columns->Add("spec", &key->spec);
}

}  // namespace

std::string FormatProtocolSetup(const ProtocolSetup& setup) {
  Json json;
  json["schema"] = kSchema;
  json["protocol"] = setup.protocol;
  json["what"] = setup.what;
  json["solvers"] = MethodsJson(setup.methods);
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
    result.methods = MethodsFrom(json.at("solvers"));
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

ProtocolPlace PlaceOf(const ProtocolKey& key) {
  return {key.tolerance, key.seed, key.label, key.repetition};
}

void Columns(ProtocolStep* step, CsvColumns* columns) {
  Columns(&step->key, columns);
  columns->Add("step", &step->step);
  columns->Add("stage", &step->stage);
  columns->Add("verdict", &step->verdict);
  columns->Add("stop_reason", &step->stop_reason);
  columns->Add("converged", &step->converged);
  columns->Add("phi", &step->phi);
  columns->Add("strain", &step->strain);
  columns->Add("residual", &step->residual);
  columns->Add("energy", &step->energy);
  columns->Add("pressure", &step->pressure);
  columns->Add("deviatoric_stress", &step->deviatoric);
  columns->Add("shear_stress", &step->shear_stress);
  columns->Add("work_done", &step->work_done);
  columns->Add("dissipated", &step->dissipated);
  Columns(&step->work, columns);
}

void Columns(ProtocolRun* run, CsvColumns* columns) {
  Columns(&run->key, columns);
  columns->Add("position", &run->position);
  columns->Add("finished", &run->finished);
  columns->Add("message", &run->message);
  columns->Add("relaxations", &run->relaxations);
  columns->Add("undecided", &run->undecided);
  columns->Add("gave_up", &run->gave_up);
  columns->Add("energy", &run->energy);
  columns->Add("pressure", &run->pressure);
  columns->Add("phi_cr", &run->phi_cr);
  columns->Add("phi_unjammed", &run->phi_unjammed);
  columns->Add("contacts_excess", &run->contacts_excess);
  columns->Add("rattlers", &run->rattlers);
  columns->Add("branch", &run->branch);
  columns->Add("phi_j", &run->phi_j);
  columns->Add("distance", &run->distance);
  columns->Add("strain", &run->strain);
  columns->Add("deviatoric_stress", &run->deviatoric);
  columns->Add("shear_stress", &run->shear_stress);
  Columns(&run->work, columns);
  columns->Add("seconds", &run->seconds, 9);
}

ProtocolIndex::ProtocolIndex(const std::vector<ProtocolRun>& runs,
                             const std::vector<ProtocolStep>& steps) {
  for (const ProtocolRun& run : runs) runs_[PlaceOf(run.key)] = &run;
  for (const ProtocolStep& step : steps) {
    steps_[PlaceOf(step.key)].push_back(&step);
  }
}

const ProtocolRun* ProtocolIndex::Run(double tolerance,
                                      std::uint64_t seed,
                                      const std::string& label,
                                      int repetition) const {
  const auto found = runs_.find({tolerance, seed, label, repetition});
  return found == runs_.end() ? nullptr : found->second;
}

const std::vector<const ProtocolStep*>& ProtocolIndex::Steps(
    double tolerance, std::uint64_t seed, const std::string& label) const {
  static const std::vector<const ProtocolStep*> kNone;
  const auto found = steps_.find({tolerance, seed, label, 1});
  return found == steps_.end() ? kNone : found->second;
}

std::size_t FirstDifference(const std::vector<const ProtocolStep*>& a,
                            const std::vector<const ProtocolStep*>& b) {
  const std::size_t common = std::min(a.size(), b.size());
  for (std::size_t k = 0; k < common; ++k) {
    const double first = a[k]->energy, second = b[k]->energy;
    if (std::abs(first - second) >
        Minima::kEnergyBound * std::max(std::abs(first), std::abs(second))) {
      return k;
    }
  }
  return common;
}

}  // namespace granopt
