// granopt: what `--help` of an experiment prints.

#ifndef GRANOPT_EXPERIMENTS_HELP_H_
#define GRANOPT_EXPERIMENTS_HELP_H_

#include <string>
#include <vector>

#include "gflags/gflags.h"

namespace granopt {

// The flags of experiments, without those of the libraries.
std::vector<gflags::CommandLineFlagInfo> OwnFlags();

// Purpose, flags in groups (those of the experiment first) with their defaults,
// examples, exit statuses.
std::string HelpText(const std::string& binary, const std::string& purpose);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_HELP_H_
