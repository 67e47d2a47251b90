// granopt: what ways to run a flow come to over all starts of a scene, and
// which are the cheapest (`tradeoff --flow`).

#ifndef GRANOPT_EXPERIMENTS_FLOW_RESULTS_H_
#define GRANOPT_EXPERIMENTS_FLOW_RESULTS_H_

#include <limits>
#include <string>
#include <vector>

#include "experiments/flow_ways.h"

namespace granopt {

// A way on all starts of a scene.
struct WayResult {
  static constexpr double kUnknown = std::numeric_limits<double>::infinity();

  const Way* way = nullptr;
  int failed = 0;
  std::string fault;
  std::vector<double> sweeps, seconds, walls;
  // By start, of each observable; and T and its part against the exact ones.
  std::vector<double> errors[kNumFlowObservables];
  std::vector<double> differences[2];
  // What is claimed; whether it is only an upper bound, the difference itself
  // being lost in noise or in what is not known of the exact flow.
  double error[kNumFlowObservables] = {kUnknown, kUnknown, kUnknown, kUnknown};
  bool is_bound[kNumFlowObservables] = {};
  double mean_sweeps = kUnknown, median_seconds = kUnknown,
         median_wall = kUnknown;
};

struct SceneResult {
  std::string name;
  FlowTask task;
  int starts = 0;
  bool follows = true;  // the exact flow of a start is known
  std::vector<double> apart[kNumFlowObservables];  // of the two references
  double exact_mean[2] = {};
  std::vector<WayResult> results;
  std::vector<std::string> failures;
};

// Fills all but name and task from what MeasureFlowTask() made of each start.
void Digest(const std::vector<Json>& starts, SceneResult* scene);

// +infinity of none.
double Largest(const std::vector<double>& values);
// "jacobi", "multipoles 0.001": ways of which one is recommended.
std::string FamilyOf(const WayResult& result);
// Ways that reach the accuracy, the cheapest first; of each family one.
std::vector<const WayResult*> Ranking(const SceneResult& scene,
                                      int observable,
                                      double accuracy,
                                      bool by_sweeps);
// A row for each way.
std::string ResultsCsv(const std::vector<SceneResult>& scenes);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_RESULTS_H_
