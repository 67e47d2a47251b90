// granopt: the least misfit at fixed values of each parameter.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_PROFILE_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_PROFILE_H_

#include <string>
#include <vector>

#include "experiments/identify_search.h"
#include "experiments/run.h"

namespace granopt::identify {

struct ProfilePoint {
  int parameter;
  std::vector<double> string;
  Ensemble check;
};

// False if halted.
bool RunProfile(Record* record,
                const Task& task,
                const Identification& id,
                std::vector<ProfilePoint>* points);

// Prints them beside the best and writes profile.csv.
void ReportProfile(const Task& task,
                   const Candidate& best,
                   const std::vector<ProfilePoint>& profile,
                   Output* output);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_PROFILE_H_
