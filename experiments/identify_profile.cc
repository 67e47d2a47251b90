#include "experiments/identify_profile.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "experiments/identify_flags.h"
#include "experiments/identify_report.h"
#include "experiments/statistics.h"

namespace granopt::identify {

bool RunProfile(Record* record,
                const Task& task,
                const Identification& id,
                std::vector<ProfilePoint>* points) {
  const std::string method = HasSearch("nelder_mead")
                                 ? "nelder_mead"
                                 : "genetic_algorithm:population=10,parents=2";
  const int n = static_cast<int>(task.flags.size());
  Strings strings;
  for (int k = 0; k < n; ++k) {
    for (int p = 0; p < FLAGS_profile_points; ++p) {
      const SearchedFlag& flag = task.flags[k];
      const double value =
          flag.low + (flag.high - flag.low) * p / (FLAGS_profile_points - 1);
      // From the nearest of the good strings.
      const Candidate* nearest = &id.candidates[id.best];
      for (const Candidate& c : id.candidates) {
        if (c.is_equal && std::fabs(c.string[k] - value) <
                              std::fabs(nearest->string[k] - value)) {
          nearest = &c;
        }
      }
      std::vector<double> string = nearest->string;
      string[k] = value;
      if (n > 1) {
        const std::string stage = Format("profile_%s_%d", flag.name.c_str(), p);
        std::string error;
        const std::unique_ptr<SearchMethod> search =
            CreateSearch(method, &error);
        SearchProblem problem;
        for (int c = 0; c < n; ++c) {
          if (c == k) continue;
          problem.low.push_back(task.flags[c].low);
          problem.high.push_back(task.flags[c].high);
          problem.start.push_back(string[c]);
        }
        problem.seed = FLAGS_seed;
        problem.budget = FLAGS_profile_budget;
        problem.objective = [&](const Strings& some,
                                std::vector<double>* values) {
          Strings whole = some;
          for (auto& s : whole) s.insert(s.begin() + k, value);
          std::vector<Ensemble> ensembles;
          if (!record->Evaluate(
                  stage, task, Fixed(6, kProfile), whole, &ensembles)) {
            return false;
          }
          values->clear();
          for (const Ensemble& e : ensembles) values->push_back(e.mean());
          return true;
        };
        const SearchResult result = search->Search(problem);
        if (record->halted()) return false;
        string = result.best;
        string.insert(string.begin() + k, value);
      }
      points->push_back({k, string, {}});
      strings.push_back(string);
    }
  }
  std::vector<Ensemble> checks;
  if (!record->Evaluate("profile_check",
                        task,
                        Fixed(std::min(FLAGS_fresh, 20), kFresh),
                        strings,
                        &checks)) {
    return false;
  }
  for (std::size_t k = 0; k < checks.size(); ++k) {
    (*points)[k].check = checks[k];
  }
  return true;
}

void ReportProfile(const Task& task,
                   const Candidate& best,
                   const std::vector<ProfilePoint>& profile,
                   Output* output) {
  std::string csv = "parameter,value";
  for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
  csv += ",P,error,best,best_error\n";
  // The best one on as many of the same starts.
  Ensemble base = best.fresh;
  base.values.resize(
      std::min<std::size_t>(base.values.size(), std::min(FLAGS_fresh, 20)));
  std::printf(
      "\n  profile: the least P with one parameter fixed, %zu "
      "starts; in brackets 95 %% in the last digit; the best: %.3f\n",
      base.values.size(),
      base.mean());
  const double factor = ConfidenceFactor(static_cast<int>(base.values.size()));
  for (std::size_t k = 0; k < profile.size(); ++k) {
    const ProfilePoint& p = profile[k];
    const SearchedFlag& flag = task.flags[p.parameter];
    csv += flag.name + Format(",%.17g", p.string[p.parameter]) +
           Values(p.string) +
           Format(",%.17g,%.17g,%.17g,%.17g\n",
                  p.check.mean(),
                  p.check.error(),
                  base.mean(),
                  base.error());
    if (k == 0 || profile[k - 1].parameter != p.parameter) {
      std::printf("%s    %-8s", k == 0 ? "" : "\n", flag.name.c_str());
    }
    std::printf(" %.3g: %.3f(%.0f)",
                p.string[p.parameter],
                p.check.mean(),
                std::ceil(1e3 * factor * p.check.error()));
  }
  std::printf("\n");
  output->Write("profile.csv", csv);
}

}  // namespace granopt::identify
