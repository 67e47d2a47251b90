// granopt: the packings that the methods of `compare` start from.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_STARTS_H_
#define GRANOPT_EXPERIMENTS_COMPARE_STARTS_H_

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "experiments/compare_plan.h"
#include "experiments/comparison_records.h"
#include "experiments/preparation.h"
#include "granular/packing.h"

namespace granopt {

struct Start {
  Packing packing;
  double distance = 0.0;
  // Of a shear step near jamming: where it was prepared to end.
  std::unique_ptr<ShearStep> step;
};

using Starts = std::map<Place, Start>;

// False, with one line in `error`, if a state near jamming cannot be made.
bool MakeStarts(const Plan& plan,
                Preparation* preparation,
                Starts* starts,
                std::vector<StepRecord>* steps,
                std::string* error);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_STARTS_H_
