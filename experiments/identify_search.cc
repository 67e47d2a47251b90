#include "experiments/identify_search.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <set>

#include "experiments/identify_flags.h"
#include "experiments/run.h"
#include "experiments/statistics.h"

namespace granopt::identify {
namespace {

constexpr std::int64_t kUnlimited = std::numeric_limits<std::int64_t>::max();

// Found here, not given.
bool IsOwn(const Candidate& c) {
  return c.origin == "search" || c.origin == "gradient";
}

}  // namespace

SearchOutcome RunSearch(Record* record,
                        const std::string& stage,
                        const Task& task,
                        const std::string& spec,
                        const EnsembleRule& rule,
                        std::uint64_t seed,
                        int budget,
                        std::int64_t run_budget,
                        const std::vector<double>& start) {
  std::string error;
  const std::unique_ptr<SearchMethod> method = CreateSearch(spec, &error);
  if (method == nullptr) BadInput("--method: " + error);
  SearchProblem problem;
  for (const SearchedFlag& flag : task.flags) {
    problem.low.push_back(flag.low);
    problem.high.push_back(flag.high);
  }
  problem.start = start;
  problem.seed = seed;
  problem.budget = budget;
  problem.objective = [&](const Strings& strings, std::vector<double>* values) {
    if (record->stage(stage).runs >= run_budget) return false;
    std::vector<Ensemble> ensembles;
    if (!record->Evaluate(stage, task, rule, strings, &ensembles)) return false;
    values->clear();
    for (const Ensemble& e : ensembles) values->push_back(e.mean());
    return true;
  };
  SearchOutcome outcome;
  outcome.result = method->Search(problem);
  outcome.runs = record->stage(stage).runs;
  return outcome;
}

bool Identify(Record* record,
              const std::string& prefix,
              const Task& task,
              const EnsembleRule& rule,
              bool with_gradient,
              std::vector<Candidate> others,
              Identification* id) {
  const double cpu = CpuSeconds();
  const std::string stage = prefix + "search";
  id->search = RunSearch(record,
                         stage,
                         task,
                         FLAGS_method,
                         rule,
                         FLAGS_seed,
                         FLAGS_budget,
                         kUnlimited,
                         {});
  if (record->halted()) return false;
  // The best strings, and those that were the best for a while.
  const std::vector<Ensemble>& done = record->stage(stage).done;
  std::vector<int> order(record->stage(stage).next);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return done[a].mean() < done[b].mean();
  });
  std::set<std::vector<double>> known;
  const auto add = [&](const std::string& origin,
                       const std::vector<double>& string,
                       double reported) {
    if (!std::isfinite(reported) || !known.insert(string).second) return;
    Candidate c;
    c.origin = origin;
    c.string = string;
    c.reported = reported;
    id->candidates.push_back(c);
  };
  for (std::size_t k = 0;
       k < order.size() && static_cast<int>(known.size()) < FLAGS_winners;
       ++k) {
    add("search", done[order[k]].string, done[order[k]].mean());
  }
  for (const SearchRow& row : id->search.result.history) {
    add("search", row.best_string, row.best);
  }
  if (id->candidates.empty()) {
    record->Clear();
    BadInput("no string of the search has a value: every flow failed");
  }
  if (with_gradient) {
    const SearchOutcome gradient =
        RunSearch(record,
                  prefix + "gradient",
                  task,
                  "ceres_differences",
                  Fixed(FLAGS_gradient_runs, kGradient),
                  FLAGS_seed,
                  FLAGS_gradient_budget,
                  kUnlimited,
                  id->search.result.best);
    if (record->halted()) return false;
    add("gradient", gradient.result.best, gradient.result.value);
  }
  for (const Candidate& c : others) id->candidates.push_back(c);
  Strings strings;
  for (const Candidate& c : id->candidates) strings.push_back(c.string);
  std::vector<Ensemble> fresh;
  if (!record->Evaluate(prefix + "fresh",
                        task,
                        Fixed(FLAGS_fresh, kFresh),
                        strings,
                        &fresh)) {
    return false;
  }
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    id->candidates[k].fresh = fresh[k];
  }
  std::stable_sort(id->candidates.begin(),
                   id->candidates.end(),
                   [](const Candidate& a, const Candidate& b) {
                     return a.fresh.mean() < b.fresh.mean();
                   });
  for (std::size_t k = 0; k < id->candidates.size() && id->best < 0; ++k) {
    if (IsOwn(id->candidates[k])) id->best = static_cast<int>(k);
  }
  const Candidate best = id->candidates[id->best];
  Strings equal;
  for (Candidate& c : id->candidates) {
    PairedDifference(
        c.fresh.values, best.fresh.values, &c.difference, &c.difference_error);
    c.is_equal = AreEqual(c.difference,
                          c.difference_error,
                          static_cast<int>(best.fresh.values.size()));
    if (c.is_equal && IsOwn(c)) equal.push_back(c.string);
  }
  id->equal = static_cast<int>(equal.size());
  id->valley = DescribeValley(equal, task.flags);
  std::vector<Ensemble> confirmed;
  if (!record->Evaluate(prefix + "confirm",
                        task,
                        Fixed(FLAGS_fresh, kConfirm),
                        {best.string},
                        &confirmed)) {
    return false;
  }
  id->confirmed = confirmed[0];
  id->cpu = CpuSeconds() - cpu;
  return true;
}

}  // namespace granopt::identify
