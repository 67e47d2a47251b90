// granopt: what a comparison of methods consists of; setup.json, which is kept
// beside the raw files so that reports can be made again.

#ifndef GRANOPT_EXPERIMENTS_COMPARISON_SETUP_H_
#define GRANOPT_EXPERIMENTS_COMPARISON_SETUP_H_

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "experiments/cases.h"
#include "nlohmann/json_fwd.hpp"

namespace granopt {

// A residual: max|g| / mean contact force, or max|g| in units k = 1, box = 1.
struct Level {
  bool absolute = false;
  double value = 0.0;

  friend bool operator==(const Level& a, const Level& b) {
    return a.absolute == b.absolute && a.value == b.value;
  }
};

// "absolute" or "relative", as files say it.
const char* KindOf(const Level& level);
// "max|g| <= 1e-6 mean forces".
std::string Meaning(const Level& level);

// Decades 1e-1 ... 1e-15 relative, 1e-4 ... 1e-16 absolute, and `more`, each
// kind from large to small.
std::vector<Level> Ladder(const std::vector<Level>& more);

struct ComparisonSetup {
  std::string paper;  // "", "table1", "fig2" or "fig7"
  std::string what;   // "4096 discs, phi = 0.8438, alpha = 2"
  std::vector<Case> cases;
  std::vector<Method> methods;
  std::vector<std::uint64_t> seeds;
  int repetitions = 0;
  int steps = 1;  // of each chain of the case near_jamming
  // The first is where runs stop; the others are reported from the same runs.
  std::vector<Level> levels;
  std::string baseline;  // a label
  // The label of the method whose minima the others' are compared with; "": in
  // the case near_jamming with the states as prepared.
  std::string reference;
  // What else decides about counts: "prepared by lbfgs; ..."
  std::string conditions;
  // What the paper leaves open, and what was assumed.
  std::vector<std::pair<std::string, std::string>> assumptions;
};
// Shear steps of a case, one after another.
int StepsOf(const ComparisonSetup& setup, const Case& c);
bool IsChain(const ComparisonSetup& setup, const Case& c);

std::string FormatSetup(const ComparisonSetup& setup);
bool ParseSetup(const std::string& text,
                const std::string& name,
                ComparisonSetup* setup,
                std::string* error);

// [{"label": ..., "spec": ...}, ...]
nlohmann::ordered_json MethodsJson(const std::vector<Method>& methods);
// Throws nlohmann's exceptions.
std::vector<Method> MethodsFrom(const nlohmann::ordered_json& json);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARISON_SETUP_H_
