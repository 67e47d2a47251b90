// granopt: ways to run a flow, and what they come to on one start
// (`tradeoff --flow`).

#ifndef GRANOPT_EXPERIMENTS_FLOW_WAYS_H_
#define GRANOPT_EXPERIMENTS_FLOW_WAYS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/flow_work.h"
#include "experiments/run.h"

namespace granopt {

// What users want of a flow.
struct FlowObservable {
  const char* name;
  const char* what;  // of the error
};
constexpr FlowObservable kFlowObservables[] = {
    {"kinetic", "of T(t), largest over ten times, relative"},
    {"relative_part", "of the part of relative motion in T(t), the same"},
    {"places", "of the places at the end, root mean square, in radii"},
    {"drift", "energy that the integrator made or took, over the largest T"}};
constexpr int kNumFlowObservables = 4;

// A stepper with its step and tolerance, and how it evaluates forces.
struct Way {
  // "verlet", "jacobi", ..., "relaxed": what is one line of the figure, with
  // the tolerance.
  std::string family;
  StepperSetting setting;
  // Bound of a multipole method; 0: all pairs; -1: as the scene has it.
  double field_accuracy = -1.0;
  int threads = 1;
};
std::string LabelOf(const Way& way);
// For `flow`.
std::string FlagsOf(const Way& way);

// "smooth", "paper", "strong", "many"; "user": that of the flags.
struct FlowTask {
  std::string name;
  double end = 0.0;
  std::vector<double> times;
  std::vector<Way> ways;
  Way fine, finest;  // the reference, and what it is checked by
  FlowCase flow;     // begun
};
const std::vector<std::string>& FlowTaskNames();
std::string DescribeFlowTask(const std::string& name);
// BadInput for flags that describe no scene. `max_seconds`: of the reference,
// about.
FlowTask MakeFlowTask(const std::string& name,
                      std::uint64_t seed,
                      double max_seconds,
                      bool smoke);

// Runs all ways on the start, repetitions interleaved. For each way counts,
// median times, T and its relative part at the end, and errors against the
// reference, in the order of `ways`; for the reference how far its two runs are
// apart.
Json MeasureFlowTask(const FlowTask& task, int repetitions);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_WAYS_H_
