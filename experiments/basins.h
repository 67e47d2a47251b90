// granopt: who leaves the basin of the reference, how often.

#ifndef GRANOPT_EXPERIMENTS_BASINS_H_
#define GRANOPT_EXPERIMENTS_BASINS_H_

#include <string>
#include <vector>

#include "experiments/comparison_records.h"

namespace granopt {

// How often one method ends in another minimum than the reference.
struct BasinRow {
  std::string case_id;  // or "all cases"
  Method method;
  std::string kind;  // "all", or that of the steps
  int differ = 0;
  int judged = 0;   // instances (case, seed, step) in which both are known
  int nowhere = 0;  // the method ended at no minimum, the reference did
  int unknown = 0;  // the reference ended at none
};

// Who leaves the basin of setup.reference; empty without one. Repetitions count
// once.
std::vector<BasinRow> TabulateBasins(const ComparisonSetup& setup,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps);
std::string BasinsCsv(const std::vector<BasinRow>& rows);
std::string BasinsText(const ComparisonSetup& setup,
                       const std::vector<BasinRow>& rows,
                       bool markdown);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_BASINS_H_
