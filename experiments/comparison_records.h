// granopt: the raw files of a comparison: events.csv, runs.csv, curves.csv and,
// of chains of shear steps, steps.csv.
//
// While a method runs, the first crossing of each level of a ladder of
// residuals is written down as an Event with the work done until then; each run
// ends as a RunRecord. Everything that is reported is computed from those files
// and a ComparisonSetup, so that it can be computed again.

#ifndef GRANOPT_EXPERIMENTS_COMPARISON_RECORDS_H_
#define GRANOPT_EXPERIMENTS_COMPARISON_RECORDS_H_

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "experiments/comparison_setup.h"
#include "experiments/tabular.h"
#include "solvers/solver.h"

namespace granopt {

struct RunKey {
  std::string case_id;
  std::uint64_t seed = 0;
  int repetition = 0;  // from 1
  std::string label;
  std::string spec;
  // Of the chain, from 1; 1 in cases without one.
  int step = 1;
};

// Work until some moment of a run.
struct Work {
  std::int64_t iterations = 0;
  std::int64_t evaluations = 0;
  std::int64_t hessians = 0;
  std::int64_t factorizations = 0;
  std::int64_t solves = 0;
  std::int64_t linear_iterations = 0;
  double cpu_seconds = 0.0;
  double function_share = 0.0;  // of the time, in the function
  double linear_share = 0.0;    // in matrices, factors and solves
};
Work MakeWork(const Counters& counters,
              double cpu_seconds,
              double seconds,
              double function_seconds,
              double linear_seconds);
void Columns(Work* work, CsvColumns* columns);

// The work that tables are made of, as numbers that may be infinite.
enum Cost {
  kIterations,
  kEvaluations,
  kHessians,
  kFactorizations,
  kSolves,
  kLinearIterations,
  kCpuSeconds,
  kCosts  // how many
};
template <typename T>
using Costs = std::array<T, kCosts>;
Costs<double> CostsOf(const Work& work);
// Those of a run that never got there.
Costs<double> InfiniteCosts();
void Append(const Costs<double>& costs, Costs<std::vector<double>>* columns);
// A statistic of each column.
template <typename Function>
auto OfEach(const Costs<std::vector<double>>& columns, const Function& function)
    -> Costs<decltype(function(columns[0]))> {
  Costs<decltype(function(columns[0]))> results;
  for (int k = 0; k < kCosts; ++k) results[k] = function(columns[k]);
  return results;
}

struct Event {
  RunKey key;
  Level level;
  Work work;
  double energy = 0.0;
};

struct RunRecord {
  RunKey key;
  int position = 0;  // in the block, from 1
  bool converged = false;
  std::string stop_reason;
  std::string message;
  double residual = 0.0;           // max|g| / mean force, as the method saw it
  double quad_residual = 0.0;      // judged in quadruple precision
  double quad_max_gradient = 0.0;  // units k = 1, box = 1
  double energy = 0.0;
  double pressure = 0.0;
  double phi = 0.0;
  int rattlers = 0;
  std::string minimum;    // "A", "B", ...; "0": E = 0; "-": at no minimum
  double distance = 0.0;  // near_jamming: phi - phi_J of the state; else 0
  std::int64_t list_builds = 0, restarts = 0, recenters = 0, rebases = 0;
  Work work;
  double seconds = 0.0;  // wall
};

// One point of a curve, of the first step of a chain.
struct CurveRow {
  std::string case_id;
  std::uint64_t seed = 0;
  std::string label;
  std::int64_t iteration = 0;
  std::int64_t evaluations = 0;
  double cpu_seconds = 0.0;
  double residual = 0.0;      // max|g| / mean force
  double max_gradient = 0.0;  // units k = 1, box = 1
  double energy = 0.0;
};

// One shear step of a chain, as its preparation found it. A step is called
// non-rearranging if its strain in one step and in two halves end at one place.
struct StepRecord {
  std::string case_id;
  std::uint64_t seed = 0;
  int step = 0;         // from 1
  double strain = 0.0;  // of this step
  // kNonRearranging, kRearranging, kUnjammed (both ends), kUndecided (an end
  // that was not relaxed tightly).
  std::string kind;
  // RigidDistance() of the two ends, in mean overlaps; infinite if one of them
  // is unjammed.
  double apart = 0.0;
  // Contacts between rigid grains: after the step, and how many of those before
  // or after are not in both.
  int contacts = 0;
  int contacts_changed = 0;
  // At the end of the one step, and of the two halves. Residuals in mean
  // forces, judged in quadruple precision.
  double energy = 0.0, half_energy = 0.0;
  double residual = 0.0, half_residual = 0.0;
  double pressure = 0.0;
  std::string minimum;  // of the end of the one step, as RunRecord::minimum
};
constexpr char kNonRearranging[] = "non-rearranging";
constexpr char kRearranging[] = "rearranging";
constexpr char kUnjammed[] = "unjammed";
constexpr char kUndecided[] = "undecided";
constexpr const char* kStepKinds[] = {
    kNonRearranging, kRearranging, kUnjammed, kUndecided};

// For FormatCsv() and ParseCsv().
void Columns(Event* event, CsvColumns* columns);
void Columns(RunRecord* run, CsvColumns* columns);
void Columns(CurveRow* row, CsvColumns* columns);
void Columns(StepRecord* step, CsvColumns* columns);

// A packing that all methods run on: case, seed, step.
using Place = std::tuple<std::string, std::uint64_t, int>;
Place PlaceOf(const RunKey& key);
Place PlaceOf(const StepRecord& step);

std::map<Place, const StepRecord*> StepIndex(
    const std::vector<StepRecord>& steps);

// The median phi - phi_J of a case near jamming; 0 in other cases.
double MedianDistance(const std::vector<RunRecord>& runs,
                      const std::string& case_id);

// Runs and events by what they are of; both must outlive it.
class RunIndex {
 public:
  RunIndex(const std::vector<Event>& events,
           const std::vector<RunRecord>& runs);

  // Null if it was not run: an unfinished comparison.
  const RunRecord* Find(const Place& place,
                        const std::string& label,
                        int repetition) const;

  // Work until the level, null if it was never reached. A run that ended at
  // E = 0 has reached every level.
  const Work* Reached(const RunRecord& run, const Level& level) const;

 private:
  using RunPlace = std::tuple<Place, std::string, int>;

  std::map<RunPlace, const RunRecord*> runs_;
  std::map<std::tuple<RunPlace, bool, double>, const Event*> events_;
};

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARISON_RECORDS_H_
