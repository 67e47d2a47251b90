// granopt: which protocols `compare --protocol` is asked for.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_PLAN_H_
#define GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_PLAN_H_

#include <memory>
#include <vector>

#include "experiments/protocol_records.h"
#include "experiments/scene.h"
#include "gflags/gflags.h"
#include "solvers/solver.h"

DECLARE_string(protocol);
DECLARE_double(dphi);

namespace granopt {

struct ProtocolPlan {
  ProtocolSetup setup;
  std::vector<std::unique_ptr<Solver>> solvers;  // as setup.methods
  std::unique_ptr<Solver> prepare;
  Scene scene;  // the input, or the random start of the first seed
  double phi_init = 0.0;
  double phi = 0.0;  // shear

  bool jamming() const { return setup.protocol == kJammingProtocol; }
};

// BadInput on any fault of the flags.
ProtocolPlan MakeProtocolPlan();
void PrintPlan(const ProtocolPlan& plan);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_PLAN_H_
