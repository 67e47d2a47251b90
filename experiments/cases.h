// granopt: which methods are compared in which cases with which seeds, as users
// write it in flags, and the order of runs. What a new case does to a packing
// is said here alone.

#ifndef GRANOPT_EXPERIMENTS_CASES_H_
#define GRANOPT_EXPERIMENTS_CASES_H_

#include <string>
#include <vector>

#include "experiments/scene.h"

namespace granopt {

struct Method {
  std::string label;
  std::string spec;  // for CreateSolver()
};

// "spec;label@spec;...". False, with one line in `error`, for an empty entry or
// a label given twice.
bool ParseMethods(const std::string& text,
                  std::vector<Method>* methods,
                  std::string* error);

struct Case {
  // "growth=5e-5", "near_jamming=1e-6 at 1e-3": unique, and what files say.
  std::string id;
  // growth, simple_shear, pure_shear, random, fig2, near_jamming, start, user.
  std::string kind;
  double value = 0.0;
  double distance = 0.0;  // near_jamming: asked for
  // near_jamming=0.3x: the strain is `value` times the distance.
  bool relative = false;
};
// Shear strain of the case near_jamming.
double StrainOf(const Case& c);
// What is done to a packing in a case, before it is relaxed.
Load LoadOf(const Case& c);
// "radii x (1 + 5e-5), positions fixed".
std::string Meaning(const Case& c);

// "growth,random=1e-4,near_jamming=1e-6,near_jamming=0.3x"; near_jamming
// becomes one case for each of `distances`, in their order, its strain a number
// or, with an x, a multiple of the distance. A kind without its value gets the
// default one, `shear` for near_jamming.
bool ParseCases(const std::string& text,
                const std::vector<double>& distances,
                double shear,
                std::vector<Case>* cases,
                std::string* error);
// "1e-2,1e-3", each once, each a distance phi - phi_J in [1e-12, 0.5].
bool ParseDistances(const std::string& text,
                    std::vector<double>* distances,
                    std::string* error);
// The order of the methods in each block of the given repetition (from 0):
// starts at method `repetition` mod n, forwards in even and backwards in odd
// repetitions, so that neither the first place nor the predecessor is always
// the same.
std::vector<int> MethodOrder(int methods, int repetition);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CASES_H_
