// granopt: runs of this binary with other flags, as processes of their own.

#ifndef GRANOPT_EXPERIMENTS_CHILDREN_H_
#define GRANOPT_EXPERIMENTS_CHILDREN_H_

#include <string>
#include <vector>

#include "experiments/run.h"

namespace granopt {

// A run in OUT/<name>, with `arguments` beside --out and --pictures=false.
struct Child {
  std::string name;
  std::vector<std::string> arguments;
  double weight = 1.0;  // of its duration, for estimates
};

struct ChildResult {
  std::string failure;  // one line if there is no summary to be read
  Json summary;
};

// --name=value of every flag of an experiment that the user gave, but for
// `own`, for the children. Call it before a flag is changed.
std::vector<std::string> PassedFlags(const std::vector<std::string>& own);

// Runs each child, at most `at_once` at a time; with `resume` only those
// without a complete result for the same arguments, with --resume if they were
// cut short and `children_resume`. Prints progress and, unless `quiet`, what
// went wrong. The folder of `output` exists already.
std::vector<ChildResult> RunChildren(const std::string& binary,
                                     const std::vector<Child>& children,
                                     int at_once,
                                     bool resume,
                                     bool children_resume,
                                     const Output& output,
                                     bool* interrupted,
                                     bool quiet = false);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CHILDREN_H_
