// granopt: performance and quality profiles of comparisons over whole
// protocols.

#ifndef GRANOPT_EXPERIMENTS_PROTOCOL_PROFILES_H_
#define GRANOPT_EXPERIMENTS_PROTOCOL_PROFILES_H_

#include <vector>

#include "experiments/profiles.h"
#include "experiments/protocol_records.h"

namespace granopt {

// Problems: whole protocols (seed, tolerance); in a shear also the steps that
// all methods start from the same state, which ends with the first in which one
// method leaves the others.
ComparisonProfiles MakeProtocolProfiles(const ProtocolSetup& setup,
                                        const std::vector<ProtocolStep>& steps,
                                        const std::vector<ProtocolRun>& runs);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PROTOCOL_PROFILES_H_
