// granopt: tables of comparisons over whole protocols: their work, how far
// Algorithm 1 can be believed, and how curves of a shear part.

#ifndef GRANOPT_EXPERIMENTS_PROTOCOL_TABLES_H_
#define GRANOPT_EXPERIMENTS_PROTOCOL_TABLES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/protocol_records.h"
#include "experiments/statistics.h"

namespace granopt {

// One method at one tolerance. Runs that did not finish count as infinitely
// expensive.
struct ProtocolRow {
  Method method;
  double tolerance = 0.0;
  int runs = 0;
  int finished = 0;
  int undecided = 0;  // sums
  int gave_up = 0;
  Quantiles relaxations;
  Costs<Quantiles> costs;
  // To the baseline at the same tolerance, seed and repetition.
  Quantiles ratio;
  double function_share = 0.0, linear_share = 0.0;  // medians
  Costs<double> spent{};                            // medians
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

std::string ProtocolTablesCsv(const std::vector<ProtocolRow>& rows);
std::string JammingTableCsv(const std::vector<JammingRow>& rows);
std::string ShearTableCsv(const std::vector<ShearRow>& rows);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PROTOCOL_TABLES_H_
