// granopt: the runs of `compare`: each method on each start, interleaved.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_RUNS_H_
#define GRANOPT_EXPERIMENTS_COMPARE_RUNS_H_

#include <vector>

#include "experiments/compare_plan.h"
#include "experiments/compare_report.h"
#include "experiments/compare_starts.h"
#include "experiments/comparison_records.h"
#include "experiments/run.h"

namespace granopt {

// Runs all, but for blocks (repetition and packing) of `before` in which every
// method has run. Writes events.csv, curves.csv and runs.csv into `output`,
// now and then and at the end. Returns the runs.
std::vector<RunRecord> RunAll(const Plan& plan,
                              const Starts& starts,
                              RawRecords before,
                              Output* output);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_RUNS_H_
