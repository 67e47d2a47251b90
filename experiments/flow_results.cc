#include "experiments/flow_results.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Starts follow the exact flow if that is known to so many radii.
constexpr double kFollows = 0.05;

}  // namespace

double Largest(const std::vector<double>& values) {
  return values.empty() ? kInfinity
                        : *std::max_element(values.begin(), values.end());
}

void Digest(const std::vector<Json>& starts, SceneResult* scene) {
  scene->results.resize(scene->task.ways.size());
  std::vector<double> exact[2];
  for (const Json& start : starts) {
    if (start.contains("error")) {
      scene->failures.push_back("reference: " +
                                start.at("error").get<std::string>());
      continue;
    }
    ++scene->starts;
    for (int o = 0; o < kNumFlowObservables; ++o) {
      scene->apart[o].push_back(start.at("reference_apart")[o].get<double>());
    }
    const char* const names[] = {"kinetic", "relative_part"};
    for (int k = 0; k < 2; ++k) {
      exact[k].push_back(start.at("reference").at(names[k]).get<double>());
    }
    for (std::size_t w = 0; w < scene->results.size(); ++w) {
      WayResult& result = scene->results[w];
      result.way = &scene->task.ways[w];
      const Json& row = start.at("rows").at(w);
      if (row.contains("error")) {
        ++result.failed;
        row.at("error").get_to(result.fault);
        continue;
      }
      result.sweeps.push_back(row.at("sweeps").get<double>());
      result.seconds.push_back(row.at("cpu_seconds").get<double>());
      result.walls.push_back(row.at("wall_seconds").get<double>());
      for (int o = 0; o < kNumFlowObservables; ++o) {
        result.errors[o].push_back(row.at("errors")[o].get<double>());
      }
      for (int k = 0; k < 2; ++k) {
        result.differences[k].push_back(
            row.at("end").at(names[k]).get<double>() - exact[k].back());
      }
    }
  }
  if (scene->starts == 0) return;
  for (int k = 0; k < 2; ++k) {
    scene->exact_mean[k] = MeanAndDeviation(exact[k]).mean;
  }
  scene->follows = MedianOf(scene->apart[2]) <= kFollows;
  for (WayResult& result : scene->results) {
    // A way that fails on one start cannot be recommended.
    if (result.failed > 0 || result.sweeps.empty()) continue;
    result.mean_sweeps = MeanAndDeviation(result.sweeps).mean;
    result.median_seconds = MedianOf(result.seconds);
    result.median_wall = MedianOf(result.walls);
    for (int o = 0; o < kNumFlowObservables; ++o) {
      if (o == 3) {
        result.error[o] = Largest(result.errors[o]);
      } else if (scene->follows) {
        const double found = Largest(result.errors[o]);
        const double known = Largest(scene->apart[o]);
        result.error[o] = std::max(found, known);
        result.is_bound[o] = found <= known && known > 0.0;
      } else if (o < 2 && scene->starts > 1) {
        const MeanDeviation d = MeanAndDeviation(result.differences[o]);
        const double unit = o == 0 ? scene->exact_mean[0] : 1.0;
        result.error[o] =
            (std::fabs(d.mean) + 2.0 * d.standard_error) / std::fabs(unit);
        result.is_bound[o] = std::fabs(d.mean) < 2.0 * d.standard_error;
      }
    }
  }
  // An error that happens to be small where a shorter step has a larger one is
  // luck: the larger one counts.
  if (!scene->follows) return;
  for (std::size_t w = scene->results.size() - 1; w-- > 0;) {
    WayResult& result = scene->results[w];
    const WayResult& finer = scene->results[w + 1];
    if (result.way->family != finer.way->family ||
        result.way->setting.tolerance != finer.way->setting.tolerance ||
        !(finer.way->setting.dt < result.way->setting.dt) ||
        !std::isfinite(finer.median_seconds)) {
      continue;
    }
    for (int o = 0; o < kNumFlowObservables; ++o) {
      result.error[o] = std::max(result.error[o], finer.error[o]);
    }
  }
}

std::string FamilyOf(const WayResult& result) {
  // Ways to evaluate forces are families of their own.
  return result.way->field_accuracy >= 0.0 ? LabelOf(*result.way)
                                           : result.way->family;
}

std::vector<const WayResult*> Ranking(const SceneResult& scene,
                                      int observable,
                                      double accuracy,
                                      bool by_sweeps) {
  const auto cost = [by_sweeps](const WayResult& result) {
    return by_sweeps ? result.mean_sweeps : result.median_seconds;
  };
  std::map<std::string, const WayResult*> best;
  for (const WayResult& result : scene.results) {
    if (!(result.error[observable] <= accuracy) ||
        !std::isfinite(cost(result))) {
      continue;
    }
    const WayResult*& b = best[FamilyOf(result)];
    if (b == nullptr || cost(result) < cost(*b)) b = &result;
  }
  std::vector<const WayResult*> ranking;
  for (const auto& [key, result] : best) ranking.push_back(result);
  std::sort(ranking.begin(),
            ranking.end(),
            [&](const WayResult* a, const WayResult* b) {
              return cost(*a) < cost(*b);
            });
  return ranking;
}

std::string ResultsCsv(const std::vector<SceneResult>& scenes) {
  std::string csv =
      "scene,family,tolerance,dt,field_accuracy,threads,flags,starts,failed,"
      "sweeps,pairs,cpu_seconds,wall_seconds";
  for (const FlowObservable& o : kFlowObservables) {
    csv += Format(",%s,%s_is_bound", o.name, o.name);
  }
  csv += "\n";
  for (const SceneResult& scene : scenes) {
    const double n = scene.task.flow.scene->size();
    for (const WayResult& result : scene.results) {
      if (result.way == nullptr) continue;
      const Way& way = *result.way;
      csv += Field(scene.name) + "," + way.family +
             Format(",%g,%g,%g,%d,",
                    way.setting.tolerance,
                    way.setting.dt,
                    way.field_accuracy,
                    way.threads) +
             Field(FlagsOf(way)) +
             Format(",%d,%d,%.6g,%.6g,%.6g,%.6g",
                    scene.starts,
                    result.failed,
                    result.mean_sweeps,
                    result.mean_sweeps * 0.5 * n * (n - 1.0),
                    result.median_seconds,
                    result.median_wall);
      for (int o = 0; o < kNumFlowObservables; ++o) {
        csv += Format(",%.4g,%d", result.error[o], result.is_bound[o] ? 1 : 0);
      }
      csv += "\n";
    }
  }
  return csv;
}

}  // namespace granopt
