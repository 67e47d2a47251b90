// granopt: comparisons of methods over whole protocols: jamming by Algorithm 1
// and quasistatic shear. Records, files and tables; no packing and no clock in
// here.
//
// Every relaxation of a protocol is a ProtocolStep, every protocol that a
// method has driven a ProtocolRun; what is reported is computed from those two
// files and a ProtocolSetup, so that it can be computed again.

#ifndef GRANOPT_EXPERIMENTS_PROTOCOLS_H_
#define GRANOPT_EXPERIMENTS_PROTOCOLS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/comparison.h"
#include "experiments/profiles.h"

namespace granopt {

constexpr char kJammingProtocol[] = "jamming";
constexpr char kShearProtocol[] = "shear";

// ---------------------------------------------------------------- the plan

struct ProtocolSetup {
  std::string protocol;  // kJammingProtocol or kShearProtocol
  std::string what;      // "256 discs, alpha = 2"
  std::vector<Method> methods;
  std::vector<double> tolerances;
  std::vector<std::uint64_t> seeds;
  int repetitions = 0;
  std::string baseline;    // a label
  std::string reference;   // a label
  std::string conditions;  // what else decides about counts
  double epsilon = 0.0;    // jamming
  double strain = 0.0;     // shear
  int strain_steps = 0;
};
std::string FormatProtocolSetup(const ProtocolSetup& setup);
// True if the text is one of these, not of an ordinary comparison.
bool IsProtocolSetup(const std::string& text);
bool ParseProtocolSetup(const std::string& text,
                        const std::string& name,
                        ProtocolSetup* setup,
                        std::string* error);

// ---------------------------------------------------------------- records

struct ProtocolKey {
  double tolerance = 0.0;
  std::uint64_t seed = 0;
  int repetition = 0;  // from 1
  std::string label;
  std::string spec;
};

// One relaxation, of the first repetition.
struct ProtocolStep {
  ProtocolKey key;
  int step = 0;         // from 1; 0: the start of a shear, as prepared
  std::string stage;    // start, growth, bisection, decompression; shear
  std::string verdict;  // jammed, unjammed, undecided; "" in shear
  std::string stop_reason;
  bool converged = false;
  double phi = 0.0;
  double strain = 0.0;    // so far
  double residual = 0.0;  // max|g| / mean force
  double energy = 0.0;
  double pressure = 0.0;
  double deviatoric = 0.0;    // stress
  double shear_stress = 0.0;  // -sigma_12
  double work_done = 0.0;     // shear: by the stress
  double dissipated = 0.0;
  Work work;
};

// What became of the branch of a jammed state on its way down.
constexpr char kFollowed[] = "followed";  // to phi_J
constexpr char kLost[] = "lost";          // it ends at a finite pressure
constexpr char kSpurious[] = "spurious";  // relaxed further it is not jammed
constexpr char kUnknown[] = "unknown";    // not found out

// One method and one protocol.
struct ProtocolRun {
  ProtocolKey key;
  int position = 0;  // in the block, from 1
  // The protocol came to its end; in a shear every relaxation did.
  bool finished = false;
  std::string message;  // why not
  int relaxations = 0;
  int undecided = 0;  // jamming: relaxations repeated from where they ended
  int gave_up = 0;    // relaxations whose method did, undecided ones among them
  Work work;          // of growth and bisection; of all steps of a shear
  double seconds = 0.0;  // wall, of the minimizations alone
  double pressure = 0.0;
  double energy = 0.0;

  // jamming: the state that the published algorithm returns.
  double phi_cr = 0.0;
  double phi_unjammed = 0.0;  // the lower end of the bracket
  int contacts_excess = 0;    // of the rigid part, above isostatic
  int rattlers = 0;
  std::string branch;  // kFollowed, ...
  // Of its branch; kLost: the least packing fraction at which that was jammed,
  // which phi_J is below; NaN if neither is known.
  double phi_j = 0.0;
  // (alpha - 1) p / p' at the state.
  double distance = 0.0;

  // shear: at the end.
  double strain = 0.0;
  double deviatoric = 0.0;
  double shear_stress = 0.0;

  // phi_cr - phi_J; NaN where phi_J is.
  double Excess() const { return phi_cr - phi_j; }
  // The branch is jammed more than epsilon below a state that the bisection
  // found unjammed: what it halves is not an interval with one transition.
  bool NonMonotone(double epsilon) const {
    return phi_j < phi_unjammed - epsilon;
  }
};

std::string ProtocolStepsCsv(const std::vector<ProtocolStep>& steps);
bool ParseProtocolSteps(const std::string& text,
                        const std::string& name,
                        std::vector<ProtocolStep>* steps,
                        std::string* error);
std::string ProtocolRunsCsv(const std::vector<ProtocolRun>& runs);
bool ParseProtocolRuns(const std::string& text,
                       const std::string& name,
                       std::vector<ProtocolRun>* runs,
                       std::string* error);

// ---------------------------------------------------------------- tables

// One method at one tolerance. Runs that did not finish count as infinitely
// expensive.
struct ProtocolRow {
  Method method;
  double tolerance = 0.0;
  int runs = 0;
  int finished = 0;
  int undecided = 0;  // sums
  int gave_up = 0;
  Quantiles relaxations, iterations, evaluations, hessians, factorizations,
      linear_iterations, cpu_seconds;
  // To the baseline at the same tolerance, seed and repetition.
  Quantiles ratio;
  double function_share = 0.0, linear_share = 0.0;  // medians
  double spent_evaluations = 0.0, spent_seconds = 0.0;
};
std::vector<ProtocolRow> TabulateProtocols(
    const ProtocolSetup& setup, const std::vector<ProtocolRun>& runs);

// How far the published Algorithm 1 can be believed: one method at one
// tolerance, over seeds.
struct JammingRow {
  Method method;
  double tolerance = 0.0;
  int runs = 0;  // that finished
  double least_phi = 0.0, most_phi = 0.0;
  Quantiles excess;  // phi_cr - phi_J where phi_J or a bound above it is known
  double worst_excess = 0.0;
  double pressure = 0.0;  // median
  double contacts = 0.0;  // median excess
  int most_contacts = 0;
  int non_monotone = 0;
  int lost = 0;
  int spurious = 0;
  int unknown = 0;
  // |phi_cr - phi_cr of the reference| from the same start at the same
  // tolerance, largest.
  double apart = 0.0;
};
std::vector<JammingRow> TabulateJamming(const ProtocolSetup& setup,
                                        const std::vector<ProtocolRun>& runs);

// One seed over all methods and tolerances.
struct SeedSpread {
  std::uint64_t seed = 0;
  int runs = 0;
  double least_phi = 0.0, most_phi = 0.0;
  double least_phi_j = 0.0, most_phi_j = 0.0;  // of followed branches
  // The largest difference of phi_cr between tolerances with one method, and
  // between methods at one tolerance.
  double by_tolerance = 0.0, by_method = 0.0;
};
std::vector<SeedSpread> SpreadOfSeeds(const ProtocolSetup& setup,
                                      const std::vector<ProtocolRun>& runs);

// The curve of one method beside that of the reference from the same start.
struct ShearRow {
  Method method;
  double tolerance = 0.0;
  std::uint64_t seed = 0;
  int steps = 0;  // both have
  // The first step at which the energies differ by more than
  // Minima::kEnergyBound of the larger; 0: never.
  int first_difference = 0;
  double strain = 0.0;  // there
  // Of the deviatoric stress, in the largest of the reference: largest and root
  // of the mean square.
  double largest = 0.0, rms = 0.0;
  // Energy dissipated in rearrangements, in that of the start.
  double dissipated = 0.0;
};
std::vector<ShearRow> TabulateShear(const ProtocolSetup& setup,
                                    const std::vector<ProtocolStep>& steps);

// Problems: whole protocols (seed, tolerance); in a shear also the steps that
// all methods start from the same state, which ends with the first in which one
// method leaves the others.
ComparisonProfiles MakeProtocolProfiles(const ProtocolSetup& setup,
                                        const std::vector<ProtocolStep>& steps,
                                        const std::vector<ProtocolRun>& runs);

std::string ProtocolTablesCsv(const std::vector<ProtocolRow>& rows);
std::string JammingTableCsv(const std::vector<JammingRow>& rows);
std::string ShearTableCsv(const std::vector<ShearRow>& rows);
// All of them, for the terminal or as Markdown.
std::string ProtocolText(const ProtocolSetup& setup,
                         const std::vector<ProtocolStep>& steps,
                         const std::vector<ProtocolRun>& runs,
                         bool markdown);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PROTOCOLS_H_
