#include "experiments/replot.h"

#include "experiments/children.h"
#include "experiments/run.h"

namespace granopt {

void RefuseOthersWithReplot(std::vector<std::string> allowed) {
  allowed.insert(allowed.end(), {"replot", "out", "pictures"});
  for (const std::string& flag : PassedFlags(allowed)) {
    BadInput(flag.substr(0, flag.find('=')) + " cannot go with --replot");
  }
}

std::string FolderToReplot(std::string flag) {
  if (flag.empty()) BadInput("--replot= is empty");
  while (flag.size() > 1 && flag.back() == '/') flag.pop_back();
  return flag;
}

}  // namespace granopt
