// granopt: what the modes of the experiment `flow` share.

#ifndef GRANOPT_EXPERIMENTS_FLOW_H_
#define GRANOPT_EXPERIMENTS_FLOW_H_

#include <string>
#include <vector>

#include "experiments/flow_scene.h"
#include "experiments/run.h"

namespace granopt {

// "work_precision", "remark8", "oscillator", "throughput": what --study takes.
bool IsStudy(const std::string& name);
std::vector<std::string> StudyFiles(const std::string& name);
// The flags of a flow that it heeds.
std::vector<std::string> StudyFlags(const std::string& name);
// Runs it, writes its files.
int RunStudy(const std::string& name, Output* output);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_H_
