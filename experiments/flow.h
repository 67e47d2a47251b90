// granopt: what the modes of the experiment `flow` share.

#ifndef GRANOPT_EXPERIMENTS_FLOW_H_
#define GRANOPT_EXPERIMENTS_FLOW_H_

#include <string>
#include <vector>

#include "experiments/flow_scene.h"
#include "experiments/run.h"

DECLARE_int32(threads);
DECLARE_int32(seeds);
DECLARE_bool(resume);
DECLARE_int32(frames);
DECLARE_int64(checkpoint_every);

namespace granopt {

// Each returns the exit status.
int RunScene();  // that of the flags
int RunPaper();  // --paper

// A study, and what it leaves and heeds.
struct Study {
  const char* name;
  std::vector<std::string> files;  // beside summary.json
  std::vector<std::string> flags;  // of a flow
  int (*run)(Output* output);
};
const std::vector<Study>& Studies();
int WorkPrecision(Output* output);
int Remark8(Output* output);
int Oscillator(Output* output);
int Throughput(Output* output);
// What a summary.json of a study begins with; writes it with the rest.
Json StudyJson(const std::string& name);
void FinishStudy(Json json, Output* output);

// The ledgers of a run, per mass (J / kg), and what they do not explain.
Json LedgerJson(const FlowScene& scene, const FlowState& state);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_H_
