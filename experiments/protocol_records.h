// granopt: the raw files of comparisons over whole protocols, jamming by
// Algorithm 1 and quasistatic shear: setup.json, protocol_steps.csv and
// protocol_runs.csv.
//
// Every relaxation of a protocol is a ProtocolStep, every protocol that a
// method has driven a ProtocolRun; what is reported is computed from those two
// files and a ProtocolSetup, so that it can be computed again.

#ifndef GRANOPT_EXPERIMENTS_PROTOCOL_RECORDS_H_
#define GRANOPT_EXPERIMENTS_PROTOCOL_RECORDS_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "experiments/comparison_records.h"

namespace granopt {

constexpr char kJammingProtocol[] = "jamming";
constexpr char kShearProtocol[] = "shear";

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

struct ProtocolKey {
  double tolerance = 0.0;
  std::uint64_t seed = 0;
  int repetition = 0;  // from 1
  std::string label;
  std::string spec;
};

// Tolerance, seed, label and repetition.
using ProtocolPlace = std::tuple<double, std::uint64_t, std::string, int>;
ProtocolPlace PlaceOf(const ProtocolKey& key);

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

// For FormatCsv() and ParseCsv().
void Columns(ProtocolStep* step, CsvColumns* columns);
void Columns(ProtocolRun* run, CsvColumns* columns);

// Runs and steps by what they are of; both must outlive it.
class ProtocolIndex {
 public:
  explicit ProtocolIndex(const std::vector<ProtocolRun>& runs,
                         const std::vector<ProtocolStep>& steps = {});

  // Null if it was not run.
  const ProtocolRun* Run(double tolerance,
                         std::uint64_t seed,
                         const std::string& label,
                         int repetition = 1) const;

  // In their order; empty if it was not run.
  const std::vector<const ProtocolStep*>& Steps(double tolerance,
                                                std::uint64_t seed,
                                                const std::string& label) const;

 private:
  std::map<ProtocolPlace, const ProtocolRun*> runs_;
  std::map<ProtocolPlace, std::vector<const ProtocolStep*>> steps_;
};
// The first step in which the energies of two curves differ by more than
// Minima::kEnergyBound of the larger, or the number of common steps if none
// does.
std::size_t FirstDifference(const std::vector<const ProtocolStep*>& a,
                            const std::vector<const ProtocolStep*>& b);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PROTOCOL_RECORDS_H_
