// granopt: flows of strings, and their misfits.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_RUNS_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_RUNS_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "experiments/flow_scene.h"
#include "experiments/identification.h"
#include "granular/flow/energy_misfit.h"

namespace granopt::identify {

using Strings = std::vector<std::vector<double>>;

// Streams of starts.
enum Stream { kSearch = 1, kFresh, kConfirm, kGradient, kProfile, kRecover };

// `runs` starts, the same for every string.
EnsembleRule Fixed(int runs, Stream stream);
// The rule of a search (sec. 8.1).
EnsembleRule SearchRule(bool is_paper);

// What is searched, and for what.
struct Task {
  std::vector<SearchedFlag> flags;
  MisfitWeights weights;
  EnergyCurve target;
};

// --seed, which is another one while a flow is composed. To be set first.
extern std::uint64_t run_seed;

// The flow of a string from a start; false with one line in `error` where there
// is none.
bool Compose(const Task& task,
             const std::vector<double>& string,
             std::uint64_t seed,
             FlowCase* flow,
             std::unique_ptr<Stepper>* stepper,
             std::string* error);

// The energies of a run; false, and what there is of them, if it failed, had
// more than --most_steps or was asked to stop.
bool RunCurve(FlowCase* flow,
              Stepper* stepper,
              double duration,
              EnergyCurve* curve,
              std::string* error);

// f(0) ... f(count - 1) on --threads threads, which take the next as they come.
// `show` is called from the first.
void Spread(int count,
            const std::function<void(int)>& f,
            const std::function<void(int)>& show);

// Ensembles of the strings, which have the numbers `indices` in their stage.
// What they hold already is kept. False if the run was asked to stop. `show` is
// told how many strings, which run, of how many.
bool RunEnsembles(const Task& task,
                  const std::vector<std::int64_t>& indices,
                  const EnsembleRule& rule,
                  std::vector<Ensemble>* ensembles,
                  const std::function<void(int, int, int)>& show);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_RUNS_H_
