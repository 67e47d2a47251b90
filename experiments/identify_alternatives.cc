#include "experiments/identify_alternatives.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "experiments/identify_flags.h"
#include "experiments/identify_report.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt::identify {
namespace {

constexpr Alternative kAlternatives[] = {
    {"genetic, >= 5 runs", "genetic_algorithm", false},
    {"genetic, then gradients", "genetic_algorithm", true},
    {"random", "random_search:strings=1000000", false},
    {"Nelder-Mead", "nelder_mead:strings=1000000", false},
    {"differential evolution",
     "differential_evolution:generations=100000",
     false},
    {"CMA-ES", "cma_es:generations=100000", false}};

}  // namespace

bool RunAlternatives(Record* record,
                     const Task& task,
                     std::int64_t budget,
                     std::vector<AlternativeRun>* all) {
  Strings strings;
  for (const Alternative& method : kAlternatives) {
    const std::string spec = method.spec;
    if (!HasSearch(spec.substr(0, spec.find(':')))) continue;
    for (int r = 0; r < FLAGS_repeats; ++r) {
      const std::string stage = Format(
          "alternative_%d_%d", static_cast<int>(&method - kAlternatives), r);
      const std::uint64_t seed = FLAGS_seed + 1000u + r;
      EnsembleRule rule = SearchRule(false);
      // Repeats are searches of their own.
      rule.stream = 100u + 10u * (&method - kAlternatives) + r;
      const SearchOutcome outcome = RunSearch(
          record,
          stage,
          task,
          spec,
          rule,
          seed,
          0,
          method.ends_with_gradient ? std::max<std::int64_t>(1, budget * 6 / 10)
                                    : budget,
          {});
      if (record->halted()) return false;
      AlternativeRun run = {&method,
                            r,
                            outcome.result.strings,
                            outcome.runs,
                            outcome.result.value,
                            outcome.result.best,
                            {}};
      // Its last list may have used up what was left for gradients.
      if (method.ends_with_gradient && outcome.runs < budget) {
        EnsembleRule common = Fixed(FLAGS_gradient_runs, kGradient);
        common.stream = 200u + r;
        const SearchOutcome gradient = RunSearch(record,
                                                 stage + "_gradient",
                                                 task,
                                                 "ceres_differences",
                                                 common,
                                                 seed,
                                                 0,
                                                 budget - outcome.runs,
                                                 outcome.result.best);
        if (record->halted()) return false;
        run.strings += gradient.result.strings;
        run.runs += gradient.runs;
        if (std::isfinite(gradient.result.value)) {
          run.reported = gradient.result.value;
          run.best = gradient.result.best;
        }
      }
      strings.push_back(run.best);
      all->push_back(run);
    }
  }
  std::vector<Ensemble> fresh;
  if (!record->Evaluate("alternatives_fresh",
                        task,
                        Fixed(FLAGS_fresh, kFresh),
                        strings,
                        &fresh)) {
    return false;
  }
  for (std::size_t k = 0; k < fresh.size(); ++k) (*all)[k].fresh = fresh[k];
  return true;
}

Json ReportAlternatives(const Task& task,
                        const std::vector<AlternativeRun>& alternatives,
                        Output* output) {
  std::string csv = "method,repeat,strings,runs,reported,fresh,fresh_error";
  for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
  csv += "\n";
  std::vector<std::vector<std::string>> table = {{"method",
                                                  "strings",
                                                  "runs",
                                                  "P reported",
                                                  "P, fresh",
                                                  "+- 95 %",
                                                  "too good by"}};
  Json json = Json::array();
  for (std::size_t k = 0; k < alternatives.size(); k += FLAGS_repeats) {
    std::vector<double> strings, runs, reported, fresh;
    double error = 0.0;
    for (int r = 0; r < FLAGS_repeats; ++r) {
      const AlternativeRun& a = alternatives[k + r];
      csv += Field(a.method->name) +
             Format(",%d,%d,%lld,%.17g,%.17g,%.17g",
                    r,
                    a.strings,
                    static_cast<long long>(a.runs),
                    a.reported,
                    a.fresh.mean(),
                    a.fresh.error()) +
             Values(a.best) + "\n";
      strings.push_back(a.strings);
      runs.push_back(static_cast<double>(a.runs));
      reported.push_back(a.reported);
      fresh.push_back(a.fresh.mean());
      error += a.fresh.error() / FLAGS_repeats;
    }
    const double f = MeanAndDeviation(fresh).mean,
                 p = MeanAndDeviation(reported).mean;
    table.push_back({alternatives[k].method->name,
                     Format("%.0f", MeanAndDeviation(strings).mean),
                     Format("%.0f", MeanAndDeviation(runs).mean),
                     Format("%.4f", p),
                     Format("%.4f", f),
                     Format("%.4f", ConfidenceFactor(FLAGS_fresh) * error),
                     Format("%.0f %%", 100.0 * (1.0 - p / f))});
    json.push_back({{"method", alternatives[k].method->name},
                    {"strings", MeanAndDeviation(strings).mean},
                    {"runs", MeanAndDeviation(runs).mean},
                    {"reported", p},
                    {"fresh", f}});
  }
  std::printf(
      "\n  other searches with as many runs, means of %d; their best "
      "on the same %d fresh starts\n\n",
      FLAGS_repeats,
      FLAGS_fresh);
  std::fputs(Grid(table, 0, false).c_str(), stdout);
  output->Write("alternatives.csv", csv);
  return json;
}

}  // namespace granopt::identify
