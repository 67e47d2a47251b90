// granopt: the runs of `compare --protocol`: each method drives Algorithm 1, or
// a quasistatic shear, from each start.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_RUNS_H_
#define GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_RUNS_H_

#include <vector>

#include "experiments/compare_protocol_plan.h"
#include "experiments/protocol_records.h"
#include "experiments/run.h"

namespace granopt {

struct ProtocolRecords {
  std::vector<ProtocolStep> steps;
  std::vector<ProtocolRun> runs;
};

// Runs all but those that are in `records` already, from `starts` (one a seed),
// and writes protocol_steps.csv and protocol_runs.csv after each.
void RunProtocols(const ProtocolPlan& plan,
                  const std::vector<Packing>& starts,
                  Output* output,
                  ProtocolRecords* records);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_RUNS_H_
