#include "experiments/comparison_setup.h"

#include <algorithm>
#include <cstdlib>

#include "experiments/tabular.h"
#include "nlohmann/json.hpp"
#include "solvers/format.h"

namespace granopt {
namespace {

using Json = nlohmann::ordered_json;

}  // namespace

const char* KindOf(const Level& level) {
  return level.absolute ? "absolute" : "relative";
}

std::vector<Level> Ladder(const std::vector<Level>& more) {
  std::vector<Level> ladder;
  // Parsed, not computed: 1e-13 here is 1e-13 on the command line.
  for (int e = 1; e <= 15; ++e) {
    ladder.push_back({false, std::strtod(Format("1e-%d", e).c_str(), nullptr)});
  }
  for (int e = 4; e <= 16; ++e) {
    ladder.push_back({true, std::strtod(Format("1e-%d", e).c_str(), nullptr)});
  }
  for (const Level& level : more) {
    if (std::find(ladder.begin(), ladder.end(), level) == ladder.end()) {
      ladder.push_back(level);
    }
  }
  std::sort(ladder.begin(), ladder.end(), [](const Level& a, const Level& b) {
    if (a.absolute != b.absolute) return b.absolute;
    return a.value > b.value;
  });
  return ladder;
}

std::string FormatSetup(const ComparisonSetup& setup) {
  Json json;
  json["schema"] = "granopt/compare_setup/1";
  json["paper"] = setup.paper;
  json["what"] = setup.what;
  json["cases"] = Json::array();
  for (const Case& c : setup.cases) {
    json["cases"].push_back({{"id", c.id},
                             {"kind", c.kind},
                             {"value", c.value},
                             {"distance", c.distance},
                             {"relative", c.relative}});
  }
  json["solvers"] = MethodsJson(setup.methods);
  json["seeds"] = setup.seeds;
  json["repetitions"] = setup.repetitions;
  json["steps"] = setup.steps;
  json["levels"] = Json::array();
  for (const Level& level : setup.levels) {
    json["levels"].push_back(
        {{"absolute", level.absolute}, {"value", level.value}});
  }
  json["baseline"] = setup.baseline;
  json["reference"] = setup.reference;
  json["conditions"] = setup.conditions;
  json["assumptions"] = Json::array();
  for (const auto& [open, assumed] : setup.assumptions) {
    json["assumptions"].push_back({{"open", open}, {"assumed", assumed}});
  }
  return json.dump(2) + "\n";
}

bool ParseSetup(const std::string& text,
                const std::string& name,
                ComparisonSetup* setup,
                std::string* error) {
  try {
    const Json json = Json::parse(text);
    ComparisonSetup result;
    result.paper = json.at("paper").get<std::string>();
    result.what = json.at("what").get<std::string>();
    for (const Json& c : json.at("cases")) {
      result.cases.push_back({c.at("id").get<std::string>(),
                              c.at("kind").get<std::string>(),
                              c.at("value").get<double>(),
                              c.at("distance").get<double>(),
                              c.value("relative", false)});
    }
    result.methods = MethodsFrom(json.at("solvers"));
    result.seeds = json.at("seeds").get<std::vector<std::uint64_t>>();
    result.repetitions = json.at("repetitions").get<int>();
    result.steps = json.value("steps", 1);
    for (const Json& level : json.at("levels")) {
      result.levels.push_back(
          {level.at("absolute").get<bool>(), level.at("value").get<double>()});
    }
    result.baseline = json.at("baseline").get<std::string>();
    result.reference = json.value("reference", "");
    result.conditions = json.value("conditions", "");
    for (const Json& row : json.at("assumptions")) {
      result.assumptions.emplace_back(row.at("open").get<std::string>(),
                                      row.at("assumed").get<std::string>());
    }
    if (result.cases.empty() || result.methods.empty() ||
        result.levels.empty()) {
      return Fail(name + ": no cases, solvers or levels", error);
    }
    *setup = std::move(result);
    return true;
  } catch (const Json::exception& e) {
    return Fail(name + ": " + e.what(), error);
  }
}

int StepsOf(const ComparisonSetup& setup, const Case& c) {
  return c.kind == "near_jamming" ? setup.steps : 1;
}
bool IsChain(const ComparisonSetup& setup, const Case& c) {
  return StepsOf(setup, c) > 1;
}

std::string Meaning(const Level& level) {
  return "max|g| <= " + Neat(level.value) +
         (level.absolute ? " (k = 1, box = 1)" : " mean forces");
}

Json MethodsJson(const std::vector<Method>& methods) {
  Json json = Json::array();
  for (const Method& method : methods) {
    json.push_back({{"label", method.label}, {"spec", method.spec}});
  }
  return json;
}

std::vector<Method> MethodsFrom(const Json& json) {
  std::vector<Method> methods;
  for (const Json& method : json) {
    methods.push_back({method.at("label").get<std::string>(),
                       method.at("spec").get<std::string>()});
  }
  return methods;
}

}  // namespace granopt
