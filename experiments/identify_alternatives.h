// granopt: other searches with as many runs.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_ALTERNATIVES_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_ALTERNATIVES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/identify_search.h"
#include "experiments/run.h"

namespace granopt::identify {

struct Alternative {
  const char* name;
  const char* spec;
  bool ends_with_gradient;
};
struct AlternativeRun {
  const Alternative* method;
  int repeat;
  int strings;
  std::int64_t runs;
  double reported;
  std::vector<double> best;
  Ensemble fresh;
};

// Each of them --repeats times, with `budget` runs; false if halted.
bool RunAlternatives(Record* record,
                     const Task& task,
                     std::int64_t budget,
                     std::vector<AlternativeRun>* all);

// Prints them, writes alternatives.csv; their means.
Json ReportAlternatives(const Task& task,
                        const std::vector<AlternativeRun>& alternatives,
                        Output* output);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_ALTERNATIVES_H_
