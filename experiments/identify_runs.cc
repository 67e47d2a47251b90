#include "experiments/identify_runs.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <thread>

#include "experiments/checkpoint.h"
#include "experiments/identify_flags.h"
#include "experiments/run.h"
#include "experiments/tabular.h"

namespace granopt::identify {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Flags are global: one flow is composed at a time, and then runs beside
// others.
std::mutex compose_mutex;

}  // namespace

std::uint64_t run_seed = 0;

bool Compose(const Task& task,
             const std::vector<double>& string,
             std::uint64_t seed,
             FlowCase* flow,
             std::unique_ptr<Stepper>* stepper,
             std::string* error) {
  const std::lock_guard<std::mutex> lock(compose_mutex);
  for (std::size_t k = 0; k < string.size(); ++k) {
    gflags::SetCommandLineOption(task.flags[k].name.c_str(),
                                 Number(string[k]).c_str());
  }
  FLAGS_seed = seed;
  std::string relaxed;
  *stepper = MakeStepper();
  const bool made =
      MakeCase(flow, &relaxed, error) &&
      flow->scene->Begin((*stepper)->FirstStep(), &flow->state, error);
  FLAGS_seed = run_seed;
  return made;
}

bool RunCurve(FlowCase* flow,
              Stepper* stepper,
              double duration,
              EnergyCurve* curve,
              std::string* error) {
  const FlowScene& scene = *flow->scene;
  const double m = scene.total_mass();
  const auto add = [&](const FlowState& state) {
    const KineticEnergy k = scene.Kinetic(state.v.data());
    curve->time.push_back(state.time);
    curve->total.push_back(k.total() / m);
    curve->bulk.push_back(k.bulk / m);
    curve->relative.push_back(k.relative / m);
  };
  add(flow->state);
  // Methods of other packages (PETSc, and Ceres' log) keep things of the whole
  // process.
  std::unique_lock<std::mutex> lock(compose_mutex, std::defer_lock);
  if (FLAGS_stepper == "minimize") lock.lock();
  int steps = 0;
  bool cut = false;
  const bool ran = RunFlow(
      scene,
      duration,
      stepper,
      [&](const FlowState& state, const StepReport&) {
        add(state);
        cut = ++steps > FLAGS_most_steps || StopRequested();
        return !cut;
      },
      &flow->state,
      error);
  return ran && !cut;
}

void Spread(int count,
            const std::function<void(int)>& f,
            const std::function<void(int)>& show) {
  std::atomic<int> next{0};
  const auto work = [&](bool is_first) {
    for (int k = next++; k < count && !StopRequested(); k = next++) {
      f(k);
      if (is_first) show(k);
    }
  };
  std::vector<std::thread> threads;
  for (int t = 1; t < std::min(FLAGS_threads, count); ++t) {
    threads.emplace_back(work, false);
  }
  work(true);
  for (std::thread& thread : threads) thread.join();
}

namespace {

// P of one start; +infinity where the flow fails.
double RunMisfit(const Task& task,
                 const std::vector<double>& string,
                 std::uint64_t seed) {
  FlowCase flow;
  std::unique_ptr<Stepper> stepper;
  EnergyCurve curve;
  std::string error;
  if (!Compose(task, string, seed, &flow, &stepper, &error) ||
      !RunCurve(&flow, stepper.get(), FLAGS_duration, &curve, &error)) {
    return kInfinity;
  }
  return ComputeMisfit(curve, task.target, task.weights, FLAGS_duration).value;
}

}  // namespace

bool RunEnsembles(const Task& task,
                  const std::vector<std::int64_t>& indices,
                  const EnsembleRule& rule,
                  std::vector<Ensemble>* ensembles,
                  const std::function<void(int, int, int)>& show) {
  // First what each string needs at least, then one run more of each that is
  // not settled: the same whatever the number of threads.
  const int at_once = std::min(std::max(2, rule.least), rule.most);
  for (;;) {
    struct Run {
      int string, number;
    };
    std::vector<Run> runs;
    for (std::size_t s = 0; s < ensembles->size(); ++s) {
      const std::vector<double>& values = (*ensembles)[s].values;
      if (IsSettled(rule, values)) continue;
      const int first = static_cast<int>(values.size());
      const int last = std::max(first + 1, at_once);
      for (int r = first; r < last; ++r) {
        runs.push_back({static_cast<int>(s), r});
      }
    }
    if (runs.empty()) return true;
    std::vector<double> values(runs.size());
    Spread(
        static_cast<int>(runs.size()),
        [&](int k) {
          values[k] = RunMisfit(
              task,
              (*ensembles)[runs[k].string].string,
              StartSeed(
                  run_seed, rule, indices[runs[k].string], runs[k].number));
        },
        [&](int k) {
          show(static_cast<int>(ensembles->size()),
               k + 1,
               static_cast<int>(runs.size()));
        });
    if (StopRequested()) return false;
    for (std::size_t k = 0; k < runs.size(); ++k) {
      std::vector<double>& of = (*ensembles)[runs[k].string].values;
      // What comes after a failure would depend on how much is run at once.
      if (of.empty() || std::isfinite(of.back())) of.push_back(values[k]);
    }
  }
}

EnsembleRule Fixed(int runs, Stream stream) {
  EnsembleRule rule;
  rule.least = rule.most = runs;
  rule.is_common = true;
  rule.stream = stream;
  return rule;
}

EnsembleRule SearchRule(bool is_paper) {
  EnsembleRule rule;
  rule.least = is_paper ? 2 : 5;
  rule.most = FLAGS_most_runs;
  rule.tolerance = FLAGS_ensemble_tolerance;
  rule.stream = kSearch;
  return rule;
}

}  // namespace granopt::identify
