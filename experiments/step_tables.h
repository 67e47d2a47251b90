// granopt: tables of chains of shear steps near jamming: over all steps, and
// over those that do not rearrange.

#ifndef GRANOPT_EXPERIMENTS_STEP_TABLES_H_
#define GRANOPT_EXPERIMENTS_STEP_TABLES_H_

#include <string>
#include <vector>

#include "experiments/comparison_records.h"
#include "experiments/statistics.h"

namespace granopt {

// Shear steps of one method in one case at one level. A step's number is the
// median of its repetitions; one that never got there is infinitely expensive.
struct StepRow {
  Method method;
  int steps = 0;
  int failed = 0;    // steps of which a repetition did not get there
  int unjammed = 0;  // steps of which one ended at E = 0 or on the way there
  Costs<MedianWorst> costs;
  Costs<MedianWorst> spent;  // reached or not
  // Of what was spent, as in the paper's Fig. 7.
  MeanDeviation mean_iterations, mean_seconds;
  // Steps whose minimum is the reference's, of those in which both are known.
  int same = 0, judged = 0;
  // (E - E_ref) / max(E, E_ref) at the end of runs, of those with one of the
  // two above 0: the largest, and how many are beyond kEnergyDifference.
  double difference = 0.0;  // with its sign; NaN without values
  int lower = 0, higher = 0;
};
constexpr double kEnergyDifference = 1e-9;

struct StepTable {
  Case table_case;
  Level level;
  double distance = 0.0;  // median phi - phi_J
  // kNonRearranging or "all".
  std::string kind;
  int steps = 0;
  std::vector<StepRow> rows;
};

// The cases near_jamming at every level of the setup: over all steps, and
// before that over the non-rearranging ones where `steps` knows any.
std::vector<StepTable> TabulateSteps(const ComparisonSetup& setup,
                                     const std::vector<Event>& events,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps);
std::string StepTablesCsv(const std::vector<StepTable>& tables);
std::string StepTablesText(const ComparisonSetup& setup,
                           const std::vector<StepTable>& tables,
                           const std::vector<StepRecord>& steps,
                           bool markdown);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_STEP_TABLES_H_
