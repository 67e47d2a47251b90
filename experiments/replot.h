// granopt: --replot of `compare` and `conditioning`: tables and figures of an
// earlier run made again from its files.

#ifndef GRANOPT_EXPERIMENTS_REPLOT_H_
#define GRANOPT_EXPERIMENTS_REPLOT_H_

#include <string>
#include <vector>

namespace granopt {

// BadInput if a flag is given that is none of `allowed`, --replot, --out,
// --pictures: the others are of a run.
void RefuseOthersWithReplot(std::vector<std::string> allowed);

// The folder without a slash at its end; BadInput if the flag is empty.
std::string FolderToReplot(std::string flag);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_REPLOT_H_
