// granopt: flows at the ends of what a user may ask for.

#ifndef GRANOPT_EXPERIMENTS_EXTREME_FLOWS_H_
#define GRANOPT_EXPERIMENTS_EXTREME_FLOWS_H_

#include <string>
#include <vector>

#include "experiments/extreme_scenes.h"

namespace granopt {

const std::vector<ExtremeScene>& ExtremeFlows();
// "implicit", "verlet", "minimize": what a flow is run by instead of a method.
const std::vector<std::string>& FlowSteppers();

struct FlowRun {
  bool refused = false;   // with a named error, before or during the run
  bool finished = false;  // reached its end in time
  bool finite = false;    // every number of the state is
  std::string message;    // one line
  // |T - T_start - work| over the energy that was turned over: roundoff.
  double closure = 0.0;
  // What the integrator itself did to the energy, over the same.
  double numerical = 0.0;
  double momentum = 0.0;  // drift that no ledger explains, relative
  std::int64_t sweeps = 0;
  double seconds = 0.0;
};

// Runs one; at most `max_seconds`. False with one line in `error` for an
// unknown name.
bool RunExtremeFlow(const std::string& name,
                    const std::string& stepper,
                    double max_seconds,
                    FlowRun* run,
                    std::string* error);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_EXTREME_FLOWS_H_
