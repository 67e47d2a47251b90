// The first-order methods of other libraries, with the options that change how
// they run.

#ifndef GRANOPT_TESTS_SOLVERS_EXTERNAL_SPECS_H_
#define GRANOPT_TESTS_SOLVERS_EXTERNAL_SPECS_H_

#include <string>
#include <vector>

#include "tests/solvers/run_method.h"

namespace granopt {

inline std::vector<std::string> CeresSpecs() {
  std::vector<std::string> specs;
  for (const char* scaled : {"scaled=0", "scaled=1"}) {
    specs.push_back(std::string("ceres_lbfgs:") + scaled);
    specs.push_back(std::string("ceres_lbfgs:differences=1,") + scaled);
    for (const char* beta : {"fr", "pr", "hs"}) {
      for (const char* search : {"wolfe", "armijo"}) {
        specs.push_back(std::string("ceres_ncg:beta=") + beta +
                        ",line_search=" + search + "," + scaled);
      }
    }
  }
  return specs;
}

// Armijo's rule with the direction of Hestenes and Stiefel is the one
// combination that Ceres itself cannot be trusted with: in units of order one
// it creeps for ever on the parabola 500 (x - s)^2, and it fails on
// Rosenbrock's function.
inline bool IsReliable(const std::string& spec) {
  return !Contains(spec, "beta=hs,line_search=armijo");
}

inline const char* const kCompetitors[] = {
    "nlopt_lbfgs", "liblbfgs", "tao_lmvm"};

inline std::vector<std::string> CompetitorSpecs() {
  std::vector<std::string> specs;
  for (const std::string scaled : {"scaled=0", "scaled=1"}) {
    for (const std::string name : kCompetitors) {
      specs.push_back(name + ":" + scaled);
    }
    for (const char* search : {"wolfe", "strong_wolfe"}) {
      specs.push_back(std::string("liblbfgs:line_search=") + search + "," +
                      scaled);
    }
  }
  return specs;
}

}  // namespace granopt

#endif  // GRANOPT_TESTS_SOLVERS_EXTERNAL_SPECS_H_
