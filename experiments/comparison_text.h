// granopt: the tables of a comparison as people read them, with what they must
// know about the runs.

#ifndef GRANOPT_EXPERIMENTS_COMPARISON_TEXT_H_
#define GRANOPT_EXPERIMENTS_COMPARISON_TEXT_H_

#include <string>
#include <vector>

#include "experiments/comparison_tables.h"

namespace granopt {

// For the terminal, or as Markdown.
std::string TablesText(const ComparisonSetup& setup,
                       const std::vector<Table>& tables,
                       const std::vector<RunRecord>& runs,
                       bool markdown);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARISON_TEXT_H_
