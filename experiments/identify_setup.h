// granopt: what `identify` searches and what its values depend on.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_SETUP_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_SETUP_H_

#include <string>
#include <vector>

#include "experiments/identify_runs.h"
#include "experiments/run.h"

namespace granopt::identify {

// The numbers of "1,2,3"; BadInput for what is none.
std::vector<double> ReadNumbers(const char* flag, const std::string& text);

// Parameters, weights and target of the flags; BadInput where they are wrong.
Task MakeTask();

// Every flag that a value depends on.
Json Setup(const Task& task);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_SETUP_H_
