// granopt: `tradeoff --flow`.

#ifndef GRANOPT_EXPERIMENTS_TRADEOFF_FLOW_H_
#define GRANOPT_EXPERIMENTS_TRADEOFF_FLOW_H_

#include "gflags/gflags.h"

DECLARE_bool(flow);

namespace granopt {

// BadInput for flags of flows without --flow.
void RefuseFlowFlags();
int FlowTradeoff();

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_TRADEOFF_FLOW_H_
