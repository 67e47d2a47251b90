// granopt: what the modes of the experiment `flow` share.

#ifndef GRANOPT_EXPERIMENTS_FLOW_H_
#define GRANOPT_EXPERIMENTS_FLOW_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "experiments/flow_scene.h"
#include "experiments/run.h"

namespace granopt {

// (alpha1, alpha2) of the four simulations of figures 5 and 6.
struct Strength {
  double alpha1, alpha2;
};
constexpr Strength kPaperStrengths[] = {
    {0.0, 0.0}, {0.1, 0.05}, {0.25, 0.125}, {0.5, 0.25}};

// One of the paper's simulations (sec. 7.1) from that seed; strengths of 0 have
// no near field.
FlowCase MakePaperCase(const Strength& strength,
                       std::uint64_t seed,
                       Domain::Kind domain,
                       bool velocity_dependent,
                       int particles);

// "work_precision", "remark8", "oscillator", "throughput": what --study takes.
bool IsStudy(const std::string& name);
std::vector<std::string> StudyFiles(const std::string& name);
// Runs it, writes its files.
int RunStudy(const std::string& name, Output* output);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_H_
