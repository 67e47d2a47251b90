// granopt: strings of `identify` that other processes evaluate.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_EXTERNAL_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_EXTERNAL_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/identify_runs.h"

namespace granopt::identify {

// What --external does instead of running flows.
class Workers {
 public:
  // `setup`: the CRC-32 of Setup(), by which values of other flags are told.
  explicit Workers(std::uint32_t setup) : setup_(setup) {}

  // Takes values that workers have left in OUT/values_*.csv, of this list or of
  // those before. False if some are missing: OUT/strings.csv is then the list
  // of those strings.
  bool Collect(const std::string& stage,
               const Task& task,
               const EnsembleRule& rule,
               const std::vector<std::int64_t>& indices,
               std::vector<Ensemble>* ensembles);
  // Strings in that file.
  int waiting() const { return waiting_; }

 private:
  const std::uint32_t setup_;
  int waiting_ = 0;
};

// --worker: its exit status.
int RunWorker();

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_EXTERNAL_H_
