// granopt: identification of the parameters of a flow from its energies.
//
// Source: Zohdi, Int. J. Solids Struct. 42 (2005) 539, sec. 8; equation numbers
// are theirs.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFICATION_H_
#define GRANOPT_EXPERIMENTS_IDENTIFICATION_H_

#include <cstdint>
#include <string>
#include <vector>

#include "granular/flow/energy_misfit.h"

namespace granopt {

// A target from a file with the columns time, T, T_b, T_r (s, J / kg); those of
// weight 0 may be missing. T_error, T_b_error, T_r_error are standard
// deviations of what was measured: of all with a weight, or of none. Times
// begin at 0, rise and reach `duration`. False with one line in `error`,
// "FILE:line: ...".
bool ReadTarget(const std::string& path,
                double duration,
                const MisfitWeights& weights,
                EnergyCurve* target,
                std::string* error);
std::string FormatCurve(const EnergyCurve& curve);

// How many starts a string is tried on: E + 1, once
//   |mean_(E+1) - mean_E| <= TOL |mean_(E+1)|,  E + 1 >= least      (sec. 8.1)
// or E + 1 = most.
struct EnsembleRule {
  int least = 2;
  int most = 100;
  double tolerance = 0.02;
  // The same starts for every string (common random numbers).
  bool is_common = false;
  std::uint64_t stream = 0;  // starts of two streams have nothing in common
};
// True if values are enough. A value that is not finite ends an ensemble.
bool IsSettled(const EnsembleRule& rule, const std::vector<double>& values);

// The seed of a start: of run `run` of string `index`.
std::uint64_t StartSeed(std::uint64_t seed,
                        const EnsembleRule& rule,
                        std::int64_t index,
                        int run);

// What is known of a string.
struct Ensemble {
  std::vector<double> string;
  std::vector<double> values;  // P, a run each
  double mean() const;         // +infinity if a run has none
  double error() const;        // standard error of the mean; 0 for one run
};

// Mean of a - b and its standard error, run by run: same starts.
void PairedDifference(const std::vector<double>& a,
                      const std::vector<double>& b,
                      double* mean,
                      double* error);

// A parameter that is searched: a flag of a flow and its bounds.
struct SearchedFlag {
  std::string name;
  double low, high;
};
// Those of "alpha1:0:1,beta1:0:1"; false with one line in `error` for anything
// else.
bool ParseSearched(const std::string& text,
                   std::vector<SearchedFlag>* flags,
                   std::string* error);

// Where the strings are that no test tells from the best: their range, and
// their standard deviations along their principal axes in the unit box,
// smallest first, which are empty for fewer strings than parameters + 2.
struct Valley {
  std::vector<double> low, high;  // ranges, in the parameters' units
  std::vector<double> deviation;
  std::vector<std::vector<double>> axis;
};
Valley DescribeValley(const std::vector<std::vector<double>>& strings,
                      const std::vector<SearchedFlag>& flags);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_IDENTIFICATION_H_
