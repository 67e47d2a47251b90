// granopt: the tables of comparisons over whole protocols as people read them.

#ifndef GRANOPT_EXPERIMENTS_PROTOCOL_TEXT_H_
#define GRANOPT_EXPERIMENTS_PROTOCOL_TEXT_H_

#include <string>
#include <vector>

#include "experiments/protocol_records.h"

namespace granopt {

// All of them, for the terminal or as Markdown.
std::string ProtocolText(const ProtocolSetup& setup,
                         const std::vector<ProtocolStep>& steps,
                         const std::vector<ProtocolRun>& runs,
                         bool markdown);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PROTOCOL_TEXT_H_
