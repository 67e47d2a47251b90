// granopt: identification of the parameters of a flow from its energies.
//
// Source: Zohdi, Int. J. Solids Struct. 42 (2005) 539, sec. 8; equation numbers
// are theirs.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFICATION_H_
#define GRANOPT_EXPERIMENTS_IDENTIFICATION_H_

#include <cstdint>
#include <string>
#include <vector>

namespace granopt {

// Kinetic energies per mass over time, J / kg: of all motion T, of the centre
// of mass T_b, relative to it T_r (4.7). Linear between times.
struct EnergyCurve {
  std::vector<double> time, total, bulk, relative;
};

// A target that does not change (sec. 8.2: 1.0, 0.5, 0.5).
EnergyCurve ConstantTarget(double total,
                           double bulk,
                           double relative,
                           double duration);

// w_E, w_Eb, w_Er of (8.5), >= 0, not all 0.
struct MisfitWeights {
  double total = 1.0, bulk = 1.0, relative = 1.0;
};

// A target from a file with the columns time, T, T_b, T_r (s, J / kg); those of
// weight 0 may be missing. Times begin at 0, rise and reach `duration`. False
// with one line in `error`, "FILE:line: ...".
bool ReadTarget(const std::string& path,
                double duration,
                const MisfitWeights& weights,
                EnergyCurve* target,
                std::string* error);
std::string FormatCurve(const EnergyCurve& curve);

//   P_E = int_0^T |T - T*| dt / int_0^T |T*| dt                     (8.2)
// and the same for T_r (8.3) and T_b (8.4);
//   P = (w_E P_E + w_Er P_Er + w_Eb P_Eb) / (w_E + w_Er + w_Eb)     (8.5)
struct Misfit {
  double total = 0.0, bulk = 0.0, relative = 0.0;
  double value = 0.0;  // P
};
// Integrals of curves that are linear between their times are exact. A curve
// that ends before `duration` has no misfit: +infinity.
Misfit ComputeMisfit(const EnergyCurve& curve,
                     const EnergyCurve& target,
                     const MisfitWeights& weights,
                     double duration);

// int_0^end |a - b| dt of two curves.
double IntegrateDifference(const std::vector<double>& time_a,
                           const std::vector<double>& a,
                           const std::vector<double>& time_b,
                           const std::vector<double>& b,
                           double end);
double Interpolate(const std::vector<double>& time,
                   const std::vector<double>& y,
                   double at);

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

// Half the width of the 95 % interval of a mean of n values, in standard errors
// (Student's t, to 1 % for n >= 5).
double ConfidenceFactor(int n);

// True if n values do not tell the mean of a difference from 0, on either side.
bool AreEqual(double difference, double error, int n);

// A parameter that is searched: a flag of a flow and its bounds.
struct SearchedFlag {
  std::string name;
  double low, high;
};
// "alpha1:0:1,beta1:0:1".
bool ParseSearched(const std::string& text,
                   std::vector<SearchedFlag>* flags,
                   std::string* error);

// The strings that no test tells from the best: standard deviations along the
// principal axes in the unit box, smallest first; axes in columns.
struct Valley {
  std::vector<double> low, high;  // ranges, in the parameters' units
  std::vector<double> deviation;
  std::vector<std::vector<double>> axis;
};
Valley DescribeValley(const std::vector<std::vector<double>>& strings,
                      const std::vector<SearchedFlag>& flags);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_IDENTIFICATION_H_
