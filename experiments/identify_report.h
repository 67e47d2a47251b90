// granopt: what an identification prints and writes.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_REPORT_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_REPORT_H_

#include <string>

#include "experiments/identify_search.h"
#include "experiments/run.h"

namespace granopt::identify {

// With the best `rows` strings of the search.
void PrintIdentification(const Task& task, const Identification& id, int rows);
Json IdentificationJson(const Task& task, const Identification& id);

// ",1.5,0.3": the values of a string, all digits.
std::string Values(const std::vector<double>& string);
std::string FreshCsv(const Task& task, const Identification& id);
std::string HistoryCsv(const Identification& id);
std::string StringsCsv(const Task& task, const Record& record);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_REPORT_H_
