// granopt: every ensemble of a run of `identify`, and its checkpoints.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_RECORD_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_RECORD_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/identify_runs.h"
#include "experiments/run.h"

namespace granopt::identify {

// Fills the ensembles of strings that have the numbers `indices` in their
// stage; false if some are not there yet: the run was asked to stop, or waits
// for workers. `show` as of RunEnsembles().
using EvaluateStrings =
    std::function<bool(const std::string& stage,
                       const Task& task,
                       const EnsembleRule& rule,
                       const std::vector<std::int64_t>& indices,
                       std::vector<Ensemble>* ensembles,
                       const std::function<void(int, int, int)>& show)>;

// Ensembles by stages, in order. Searches are functions of the values they are
// given: a run that goes on asks for the same strings again and is answered
// from here.
class Record {
 public:
  // Strings are evaluated, and kept, `piece` at a time: a stop loses no more.
  Record(const Checkpoint* checkpoint,
         EvaluateStrings evaluate,
         std::size_t piece);

  struct Stage {
    std::vector<Ensemble> done;
    std::size_t next = 0;   // the first that has not been asked for
    std::int64_t runs = 0;  // of those before
  };

  // The state of a checkpoint; throws Json::exception if it is not of that
  // form.
  void Load(const Json& state);
  std::int64_t loaded() const { return loaded_; }

  // False once the run stops or waits for workers.
  bool Evaluate(const std::string& name,
                const Task& task,
                const EnsembleRule& rule,
                const Strings& strings,
                std::vector<Ensemble>* ensembles);

  // Writes the checkpoint; BadInput if that is impossible.
  void Save();

  bool halted() const { return halted_; }
  const Stage& stage(const std::string& name) { return stages_[name]; }
  const std::map<std::string, Stage>& stages() const { return stages_; }
  std::int64_t runs() const;
  // The line of progress.
  void Clear() { progress_.Clear(); }

 private:
  void Show(const std::string& name,
            const Stage& stage,
            int strings,
            int run,
            int runs);

  const Checkpoint* const checkpoint_;
  const EvaluateStrings evaluate_;
  const std::size_t piece_;
  std::map<std::string, Stage> stages_;
  std::map<std::string, double> best_;
  std::int64_t loaded_ = 0;
  std::size_t unsaved_ = 0;  // runs
  std::chrono::steady_clock::time_point saved_;
  bool halted_ = false;
  Progress progress_;
};

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_RECORD_H_
