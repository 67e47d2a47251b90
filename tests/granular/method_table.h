// Every registered method, and what each need not do. Tests over the registry
// hold a method to everything that this table does not excuse it from, so that
// a new one is held to all of it.

#ifndef GRANOPT_TESTS_GRANULAR_METHOD_TABLE_H_
#define GRANOPT_TESTS_GRANULAR_METHOD_TABLE_H_

#include <memory>
#include <ostream>
#include <sstream>
#include <string>
#include <vector>

#include "solvers/registry.h"
#include "solvers/solver.h"

namespace granopt {

struct MethodTraits {
  const char* name;
  // Options that all tests use.
  const char* options = "";
  // Somebody else's loop: with its own absolute constants, its own idea of the
  // point to return and of what to do where a function is not finite. Tests
  // that look inside leave it alone.
  bool foreign = false;
  // A convex quadratic of this condition is minimized in 20000 iterations.
  double condition = 1e6;
  // The relative residual that it reaches on packings.
  double tolerance = 1e-9;
  // Is at the minimum of a quadratic after a step or two, so that nothing can
  // happen to it on the way.
  bool solves_quadratics = false;
  // From a random start it may end without a minimum, and say so.
  bool small_loads_only = false;
  // A step on packings may be one of Newton's.
  bool newton_on_packings = solves_quadratics;
};

inline const MethodTraits kMethodTraits[] = {
    {"ceres_lbfgs", "scaled=1,differences=1,restarts=10", true, 1e3},
    {"ceres_ncg", "scaled=1,differences=1,restarts=10", true, 1e3},
    // Line searches on the cost alone end at the root of its roundoff.
    {"nlopt_lbfgs", "scaled=1,restarts=10", true, 1e3, 1e-6},
    {"liblbfgs", "scaled=1,restarts=10", true, 1e3, 1e-6},
    {"tao_lmvm", "scaled=1,restarts=10", true, 1e3, 1e-6},
    // Newton's methods: their tests of a step know of the cost only.
    {"tao_nls", "scaled=1,restarts=10", true, 1e3, 1e-6, true},
    {"tao_bntr", "scaled=1,restarts=10", true, 1e3, 1e-6, true},
    // Takes nothing but sums of gaps.
    {"ceres_nlls", "scaled=1,differences=1,restarts=10", true, 1e3, 1e-8},
    // Follows a differential equation, with tolerances of its own.
    {"gradient_flow", "", true, 1e3},
    // Its momentum is for conditions of about 1 / (1 - beta)^2.
    {"heavy_ball", "", false, 1e3},
    {"newton", "", false, 1e6, 1e-9, true},
    {"auto", "", false, 1e6, 1e-9, false, false, true},
    // Where contacts buckle by the hundred, its path leads nowhere.
    {"interior_point", "", false, 1e6, 1e-9, true, true},
};

inline MethodTraits TraitsOf(const std::string& spec) {
  const std::string name = spec.substr(0, spec.find(':'));
  for (const MethodTraits& traits : kMethodTraits) {
    if (name == traits.name) return traits;
  }
  return {"", ""};
}

inline bool IsInHouse(const std::string& spec) {
  return !TraitsOf(spec).foreign;
}

// "none" and every registered preconditioner.
inline std::vector<std::string> PreconditionerChoices() {
  std::vector<std::string> names = {"none"};
  for (const SolverInfo& info : ListPreconditioners()) {
    names.push_back(info.name);
  }
  return names;
}

// "name:key=value" for every method, with every beta and preconditioner it has.
inline std::vector<std::string> MethodSpecs(bool preconditioned) {
  std::vector<std::string> specs;
  for (const SolverInfo& info : ListSolvers()) {
    std::vector<std::string> variants = {TraitsOf(info.name).options};
    const auto multiply = [&](const std::string& key,
                              const std::vector<std::string>& values) {
      std::vector<std::string> all;
      for (const std::string& variant : variants) {
        for (const std::string& value : values) {
          all.push_back(variant + (variant.empty() ? "" : ",") + key + "=" +
                        value);
        }
      }
      variants = all;
    };
    for (const Parameters::Spec& option : info.options) {
      if (option.key == "beta") {
        std::vector<std::string> betas;
        std::stringstream list(option.choices);
        for (std::string beta; std::getline(list, beta, '|');) {
          betas.push_back(beta);
        }
        multiply("beta", betas);
      }
      if (option.key == "subproblem") {
        multiply("subproblem", {"direct", "truncated"});
      }
      if (option.key == "preconditioner" && preconditioned) {
        multiply("preconditioner", PreconditionerChoices());
      }
    }
    for (const std::string& variant : variants) {
      // A direct solution has no use for a preconditioner, and says so.
      if (variant.find("subproblem=direct") != std::string::npos &&
          variant.find("preconditioner=") != std::string::npos &&
          variant.find("preconditioner=none") == std::string::npos) {
        continue;
      }
      specs.push_back(info.name + (variant.empty() ? "" : ":") + variant);
    }
  }
  return specs;
}

inline std::vector<std::string> InHouseSpecs(bool preconditioned) {
  std::vector<std::string> specs;
  for (const std::string& spec : MethodSpecs(preconditioned)) {
    if (IsInHouse(spec)) specs.push_back(spec);
  }
  return specs;
}

}  // namespace granopt

#endif  // GRANOPT_TESTS_GRANULAR_METHOD_TABLE_H_
