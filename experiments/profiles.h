// granopt: which of several methods is good at many problems: performance
// profiles of their work and quality profiles of where they end. No packing and
// no clock in here.

#ifndef GRANOPT_EXPERIMENTS_PROFILES_H_
#define GRANOPT_EXPERIMENTS_PROFILES_H_

#include <cstddef>
#include <string>
#include <vector>

#include "experiments/comparison_records.h"

namespace granopt {

// Fewer say nothing.
constexpr int kLeastMethods = 2;
constexpr int kLeastProblems = 3;

// A distribution: `fraction` of the problems have a value of at most `at`. By
// `at`, increasing.
struct StepPoint {
  double at = 0.0;
  double fraction = 0.0;
};
using StepFunction = std::vector<StepPoint>;
// Of the values of `total` problems; infinite and NaN ones count in the total
// only.
StepFunction Distribution(const std::vector<double>& values, int total);
double ValueAt(const StepFunction& steps, double at);

// Column `method` of [problem][method].
std::vector<double> Column(const std::vector<std::vector<double>>& table,
                           std::size_t method);

// Performance ratios of Dolan and More (Math. Program. 91 (2002) 201, eq. 1)
//   r_ps = t_ps / min_s' t_ps'
// of costs t [problem p][method s], infinite where s did not solve p: infinite
// then too, and for a cost above 0 where another method had none.
std::vector<std::vector<double>> PerformanceRatios(
    const std::vector<std::vector<double>>& costs);

// (E_ps - E_p*) / max(|E_ps|, |E_p*|) with E_p* = min_s' E_ps' or, if
// `reference` >= 0, that method's, then without its sign; 0 if both are 0,
// infinite where an energy is not known.
std::vector<std::vector<double>> EnergyDifferences(
    const std::vector<std::vector<double>>& energies, int reference);

// rho_s(tau) = |{p: r_ps <= tau}| / |{p}| for one measure of work. Problems
// that no method solved count.
struct Profile {
  std::string problems;  // what they are: "case, seed, step"
  std::string measure;   // "evaluations", "cpu_seconds"
  int count = 0;         // of problems
  std::vector<Method> methods;
  std::vector<int> solved;
  std::vector<StepFunction> steps;
};
Profile MakeProfile(const std::string& problems,
                    const std::string& measure,
                    const std::vector<Method>& methods,
                    const std::vector<std::vector<double>>& costs);

// How far the ends of a method are from the best, as a distribution over
// problems, and how often it ended where the reference did.
struct Quality {
  std::string problems;
  // What is at most the abscissa: "energy" (above the least of the methods, of
  // the larger), "path" (energy beside the reference's), "excess" (phi_cr -
  // phi_J, in epsilon).
  std::string measure;
  int count = 0;
  std::vector<Method> methods;
  std::vector<StepFunction> steps;
  // What agreement is: "minimum", "energies all the way", "phi_cr".
  std::string agreement;
  std::string reference;  // a label
  // Problems in which a method agrees, of those in which it can be said.
  std::vector<int> agree, judged;
};
// What profiles are made of: each case, seed and step in which every method was
// run is a problem; [problem][method], methods in the order of the setup. Costs
// are those of the first level, medians over repetitions, infinite if it was
// not reached; energies and minima those at the end of the first repetition.
struct Problems {
  std::vector<Method> methods;
  std::vector<std::vector<double>> evaluations, cpu_seconds, energies;
  std::vector<std::vector<std::string>> minima;
};
Problems CollectProblems(const ComparisonSetup& setup,
                         const std::vector<Event>& events,
                         const std::vector<RunRecord>& runs);

// Of an ordinary comparison; `reference` is a label. A method at no minimum
// agrees with none; a problem in which the reference is at none is not judged.
Quality MakeQuality(const Problems& problems, const std::string& reference);

// problems,measure,solver,spec,count,solved,ratio,fraction: a row a step.
std::string ProfilesCsv(const std::vector<Profile>& profiles);
// problems,measure,solver,spec,count,value,fraction,agreement,reference,agree,
// judged,low,high: a row a step, with agreement and its Wilson interval in
// each. A method without a step has one row with an infinite value.
std::string QualitiesCsv(const std::vector<Quality>& qualities);
std::string ProfilesText(const std::vector<Profile>& profiles, bool markdown);
std::string QualitiesText(const std::vector<Quality>& qualities, bool markdown);

// Of an ordinary comparison; both empty with too few methods or problems.
struct ComparisonProfiles {
  std::vector<Profile> profiles;
  std::vector<Quality> qualities;
};
ComparisonProfiles MakeComparisonProfiles(const ComparisonSetup& setup,
                                          const std::vector<Event>& events,
                                          const std::vector<RunRecord>& runs);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PROFILES_H_
