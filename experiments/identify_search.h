// granopt: a search, its winners on fresh starts, what is equal to the best.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_SEARCH_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_SEARCH_H_

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "experiments/identify_record.h"
#include "experiments/identify_runs.h"
#include "solvers/search/search.h"

namespace granopt::identify {

struct SearchOutcome {
  SearchResult result;
  std::int64_t runs = 0;
};

// Lists are begun as long as there were fewer than `run_budget` runs.
SearchOutcome RunSearch(Record* record,
                        const std::string& stage,
                        const Task& task,
                        const std::string& spec,
                        const EnsembleRule& rule,
                        std::uint64_t seed,
                        int budget,
                        std::int64_t run_budget,
                        const std::vector<double>& start);

// A string that is tried on fresh starts.
struct Candidate {
  std::string origin;
  std::vector<double> string;
  double reported = NAN;  // P of the search, or of the paper
  Ensemble fresh;
  double difference = 0.0, difference_error = 0.0;  // to the best one
  bool is_equal = false;                            // not told from the best
};

struct Identification {
  SearchOutcome search;
  std::vector<Candidate> candidates;  // by fresh mean
  int best = -1;                      // of them, of the search's own
  Ensemble confirmed;                 // the best, on other starts again
  Valley valley;
  int equal = 0;
  double cpu = 0.0;
};

// Search, gradients, fresh starts, confirmation. False if halted.
bool Identify(Record* record,
              const std::string& prefix,
              const Task& task,
              const EnsembleRule& rule,
              bool with_gradient,
              std::vector<Candidate> others,
              Identification* id);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_SEARCH_H_
