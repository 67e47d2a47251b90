// What accuracy costs in a flow: steppers, steps, tolerances and evaluations of
// forces against the error of what users want.
//
// The exact flow is Verlet's with a step some thousand times shorter; how far
// that is from one with twice the step is what it can be wrong by, and no error
// below that is claimed. Flows with many impacts part from each other however
// short the step: there the errors are those of means over starts, and what is
// claimed is the difference and two of its standard errors.

#include "experiments/tradeoff_flow.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "experiments/cases.h"
#include "experiments/children.h"
#include "experiments/flow_scene.h"
#include "experiments/flow_ways.h"
#include "experiments/run.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"

DEFINE_bool(flow,
            false,
            "ways to run a near-field flow instead of minimizations: steppers, "
            "steps, tolerances, evaluations of forces; takes the flags of "
            "`flow` for a scene of one's own");
DEFINE_string(flow_scenes,
              "",
              "with --flow: some of smooth, paper, strong, many, or user, "
              "separated by commas; default: the first four, or user where "
              "flags describe one, and with --recommend");
DEFINE_int32(jobs, 1, "with --flow: starts at a time, each in a process");
DEFINE_bool(resume,
            false,
            "with --flow: run only what has no result in --out yet");
DEFINE_bool(one_start, false, "with --flow: one scene and start, as numbers");

DECLARE_string(seeds);
DECLARE_int32(repetitions);
DECLARE_double(max_seconds);
DECLARE_bool(recommend);
DECLARE_double(accuracy);
DECLARE_string(observable);

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Starts follow the exact flow if that is known to so many radii.
constexpr double kFollows = 0.05;

// Flags of this binary that --flow heeds beside those of the scene.
const std::vector<std::string>& OwnFlags() {
  static const std::vector<std::string> names = {"flow",
                                                 "flow_scenes",
                                                 "jobs",
                                                 "resume",
                                                 "one_start",
                                                 "seeds",
                                                 "accuracy",
                                                 "repetitions",
                                                 "max_seconds",
                                                 "recommend",
                                                 "observable"};
  return names;
}

// Of `flow`, what is varied here.
bool IsVaried(const std::string& name) {
  for (const char* flag : {"stepper",
                           "dt",
                           "first_dt",
                           "tolerance",
                           "iterations",
                           "sweep",
                           "groups",
                           "relaxation",
                           "safety",
                           "solver"}) {
    if (name == flag) return true;
  }
  return false;
}

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// Names of the flags that were given and describe a flow.
std::vector<std::string> SceneFlags(bool refuse_others) {
  std::vector<std::string> names;
  std::vector<gflags::CommandLineFlagInfo> all;
  gflags::GetAllFlags(&all);
  for (const auto& flag : all) {
    if (flag.is_default ||
        flag.filename.find("experiments/") == std::string::npos ||
        Contains({"out", "seed", "smoke", "pictures"}, flag.name) ||
        Contains(OwnFlags(), flag.name)) {
      continue;
    }
    const bool is_shared = Contains({"particles", "input"}, flag.name);
    const bool is_flow =
        flag.filename.find("experiments/flow_scene") != std::string::npos;
    if (refuse_others && (IsVaried(flag.name) || !(is_flow || is_shared))) {
      BadInput("--" + flag.name +
               (IsVaried(flag.name) ? " is what --flow varies"
                                    : " cannot go with --flow"));
    }
    if (is_flow || (refuse_others && is_shared)) names.push_back(flag.name);
  }
  return names;
}

// A way on all starts of a scene.
struct Cell {
  const Way* way = nullptr;
  int failed = 0;
  std::string fault;
  std::vector<double> sweeps, seconds, walls;
  // By start, of each observable; and T and its part against the exact ones.
  std::vector<double> errors[kNumFlowObservables];
  std::vector<double> differences[2];
  // What is claimed; whether it is only an upper bound, the difference itself
  // being lost in noise or in what is not known of the exact flow.
  double error[kNumFlowObservables] = {
      kInfinity, kInfinity, kInfinity, kInfinity};
  bool is_bound[kNumFlowObservables] = {};
  double mean_sweeps = kInfinity, median_seconds = kInfinity,
         median_wall = kInfinity;
};

struct SceneResult {
  std::string name;
  FlowTask task;
  int starts = 0;
  bool follows = true;  // the exact flow of a start is known
  std::vector<double> apart[kNumFlowObservables];  // of the two references
  double exact_mean[2] = {};
  std::vector<Cell> cells;
  std::vector<std::string> failures;
};

double Largest(const std::vector<double>& values) {
  return values.empty() ? kInfinity
                        : *std::max_element(values.begin(), values.end());
}

void Digest(const std::vector<Json>& starts, SceneResult* scene) {
  scene->cells.resize(scene->task.ways.size());
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
    for (std::size_t w = 0; w < scene->cells.size(); ++w) {
      Cell& cell = scene->cells[w];
      cell.way = &scene->task.ways[w];
      const Json& row = start.at("rows").at(w);
      if (row.contains("error")) {
        ++cell.failed;
        row.at("error").get_to(cell.fault);
        continue;
      }
      cell.sweeps.push_back(row.at("sweeps").get<double>());
      cell.seconds.push_back(row.at("cpu_seconds").get<double>());
      cell.walls.push_back(row.at("wall_seconds").get<double>());
      for (int o = 0; o < kNumFlowObservables; ++o) {
        cell.errors[o].push_back(row.at("errors")[o].get<double>());
      }
      for (int k = 0; k < 2; ++k) {
        cell.differences[k].push_back(row.at("end").at(names[k]).get<double>() -
                                      exact[k].back());
      }
    }
  }
  if (scene->starts == 0) return;
  for (int k = 0; k < 2; ++k) {
    scene->exact_mean[k] = MeanAndDeviation(exact[k]).mean;
  }
  scene->follows = MedianOf(scene->apart[2]) <= kFollows;
  for (Cell& cell : scene->cells) {
    // A way that fails on one start cannot be recommended.
    if (cell.failed > 0 || cell.sweeps.empty()) continue;
    cell.mean_sweeps = MeanAndDeviation(cell.sweeps).mean;
    cell.median_seconds = MedianOf(cell.seconds);
    cell.median_wall = MedianOf(cell.walls);
    for (int o = 0; o < kNumFlowObservables; ++o) {
      if (o == 3) {
        cell.error[o] = Largest(cell.errors[o]);
      } else if (scene->follows) {
        const double found = Largest(cell.errors[o]);
        const double known = Largest(scene->apart[o]);
        cell.error[o] = std::max(found, known);
        cell.is_bound[o] = found <= known && known > 0.0;
      } else if (o < 2 && scene->starts > 1) {
        const MeanDeviation d = MeanAndDeviation(cell.differences[o]);
        const double unit = o == 0 ? scene->exact_mean[0] : 1.0;
        cell.error[o] =
            (std::fabs(d.mean) + 2.0 * d.standard_error) / std::fabs(unit);
        cell.is_bound[o] = std::fabs(d.mean) < 2.0 * d.standard_error;
      }
    }
  }
  // An error that happens to be small where a shorter step has a larger one is
  // luck: the larger one counts.
  if (!scene->follows) return;
  for (std::size_t w = scene->cells.size() - 1; w-- > 0;) {
    Cell& cell = scene->cells[w];
    const Cell& finer = scene->cells[w + 1];
    if (cell.way->family != finer.way->family ||
        cell.way->setting.tolerance != finer.way->setting.tolerance ||
        !(finer.way->setting.dt < cell.way->setting.dt) ||
        !std::isfinite(finer.median_seconds)) {
      continue;
    }
    for (int o = 0; o < kNumFlowObservables; ++o) {
      cell.error[o] = std::max(cell.error[o], finer.error[o]);
    }
  }
}

// Ways that reach the accuracy, the cheapest first; of each family one.
std::vector<const Cell*> Ranking(const SceneResult& scene,
                                 int observable,
                                 double accuracy,
                                 bool by_sweeps) {
  const auto cost = [by_sweeps](const Cell& cell) {
    return by_sweeps ? cell.mean_sweeps : cell.median_seconds;
  };
  std::map<std::string, const Cell*> best;
  for (const Cell& cell : scene.cells) {
    if (!(cell.error[observable] <= accuracy) || !std::isfinite(cost(cell))) {
      continue;
    }
    // Ways to evaluate forces are all of one family.
    const std::string key =
        cell.way->field_accuracy >= 0.0 ? LabelOf(*cell.way) : cell.way->family;
    const Cell*& b = best[key];
    if (b == nullptr || cost(cell) < cost(*b)) b = &cell;
  }
  std::vector<const Cell*> ranking;
  for (const auto& [key, cell] : best) ranking.push_back(cell);
  std::sort(ranking.begin(), ranking.end(), [&](const Cell* a, const Cell* b) {
    return cost(*a) < cost(*b);
  });
  return ranking;
}

std::string Reference(const SceneResult& scene) {
  if (scene.starts == 0) return "no start has a reference";
  if (scene.name == "many") {
    return "exact: all pairs, the same step (errors are those of forces)";
  }
  std::string text = Format(
      "exact: Verlet at Dt = %.3g; with twice that step T is apart by at most "
      "%.1e, places by %.1e radii",
      scene.task.finest.setting.dt,
      Largest(scene.apart[0]),
      Largest(scene.apart[2]));
  text += scene.follows
              ? ": errors are known to that, and claimed no smaller"
              : Format(
                    ": starts part, so that errors are of means of %d "
                    "starts, two standard errors included",
                    scene.starts);
  return text;
}

std::string Csv(const std::vector<SceneResult>& scenes) {
  std::string csv =
      "scene,family,tolerance,dt,field_accuracy,threads,flags,starts,failed,"
      "sweeps,pairs,cpu_seconds,wall_seconds";
  for (const FlowObservable& o : kFlowObservables) {
    csv += Format(",%s,%s_is_bound", o.name, o.name);
  }
  csv += "\n";
  for (const SceneResult& scene : scenes) {
    const double n = scene.task.flow.scene->size();
    for (const Cell& cell : scene.cells) {
      if (cell.way == nullptr) continue;
      const Way& way = *cell.way;
      csv += Field(scene.name) + "," + way.family +
             Format(",%g,%g,%g,%d,",
                    way.setting.tolerance,
                    way.setting.dt,
                    way.field_accuracy,
                    way.threads) +
             Field(FlagsOf(way)) +
             Format(",%d,%d,%.6g,%.6g,%.6g,%.6g",
                    scene.starts,
                    cell.failed,
                    cell.mean_sweeps,
                    cell.mean_sweeps * 0.5 * n * (n - 1.0),
                    cell.median_seconds,
                    cell.median_wall);
      for (int o = 0; o < kNumFlowObservables; ++o) {
        csv += Format(",%.4g,%d", cell.error[o], cell.is_bound[o] ? 1 : 0);
      }
      csv += "\n";
    }
  }
  return csv;
}

// What each family costs for an error of T.
std::vector<std::vector<std::string>> Families(
    const std::vector<SceneResult>& scenes,
    const std::vector<double>& accuracies) {
  std::vector<std::vector<std::string>> rows = {{"scene", "way"}};
  for (const double accuracy : accuracies) {
    rows[0].push_back(Format("T <= %g", accuracy));
  }
  for (const SceneResult& scene : scenes) {
    std::vector<std::string> names;
    const auto name_of = [](const Cell& cell) {
      return cell.way->field_accuracy >= 0.0 ? LabelOf(*cell.way)
                                             : cell.way->family;
    };
    for (const Cell& cell : scene.cells) {
      if (cell.way != nullptr && !Contains(names, name_of(cell))) {
        names.push_back(name_of(cell));
      }
    }
    for (const std::string& name : names) {
      rows.push_back({scene.name, name});
      for (const double accuracy : accuracies) {
        std::string text = "-";
        for (const Cell* cell : Ranking(scene, 0, accuracy, false)) {
          if (name_of(*cell) != name) continue;
          text = Format(
              "%.3g, %.0f", 1e3 * cell->median_seconds, cell->mean_sweeps);
          // Threads save time, not work.
          if (scene.name == "many") {
            text = Format("%.3g (%.3g by the clock)",
                          1e3 * cell->median_seconds,
                          1e3 * cell->median_wall);
          }
        }
        rows.back().push_back(text);
      }
    }
  }
  return rows;
}

int Recommend(const SceneResult& scene, int wanted, Json* json) {
  const std::vector<const Cell*> ranking =
      Ranking(scene, wanted, FLAGS_accuracy, false);
  std::printf("\n%s, error %s at most %g\n",
              scene.name.c_str(),
              kFlowObservables[wanted].what,
              FLAGS_accuracy);
  if (ranking.empty()) {
    double least = kInfinity;
    for (const Cell& cell : scene.cells) {
      least = std::min(least, cell.error[wanted]);
    }
    std::printf(
        "  no way is known to reach it: the best has %.1e, %s\n",
        least,
        !scene.follows
            ? "two standard errors of the mean included: more --seeds make "
              "them smaller"
            : Format("and the exact flow is known to %.1e only",
                     scene.starts > 0 ? Largest(scene.apart[wanted]) : NAN)
                  .c_str());
    return kNotConverged;
  }
  (*json)["recommended"] = FlagsOf(*ranking[0]->way);
  std::printf("  use  %s\n\n", FlagsOf(*ranking[0]->way).c_str());
  std::vector<std::vector<std::string>> evidence = {
      {"measured", "CPU ms", "ratio", "sweeps", "error"}};
  for (const Cell* cell : ranking) {
    evidence.push_back(
        {FlagsOf(*cell->way),
         Format("%.3g", 1e3 * cell->median_seconds),
         Format("%.2f", cell->median_seconds / ranking[0]->median_seconds),
         Format("%.0f", cell->mean_sweeps),
         (cell->is_bound[wanted] ? "< " : "") +
             Format("%.1e", cell->error[wanted])});
  }
  std::fputs(Grid(evidence, 0, false).c_str(), stdout);
  return kConverged;
}

std::vector<std::string> Split(const std::string& text) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t comma = std::min(text.find(',', at), text.size());
    parts.push_back(text.substr(at, comma - at));
    at = comma + 1;
  }
  return parts;
}

}  // namespace

void RefuseFlowFlags() {
  for (const std::string& name : SceneFlags(false)) {
    BadInput("--" + name + " describes a flow: give --flow, too");
  }
  for (const char* name : {"flow_scenes", "jobs", "resume", "one_start"}) {
    if (IsGiven(name)) BadInput(std::string("--") + name + " needs --flow");
  }
}

int FlowTradeoff() {
  const std::vector<std::string> given = SceneFlags(true);
  CheckPositive("accuracy", FLAGS_accuracy);
  CheckRange("accuracy", FLAGS_accuracy, 0.0, 1.0);
  CheckRange("repetitions", FLAGS_repetitions, 1, 1000);
  CheckRange("jobs", FLAGS_jobs, 1, 1024);
  CheckPositive("max_seconds", FLAGS_max_seconds);
  CheckPositive("duration", FLAGS_duration);
  if (!IsGiven("observable")) FLAGS_observable = kFlowObservables[0].name;
  int wanted = -1;
  std::string known;
  for (int o = 0; o < kNumFlowObservables; ++o) {
    if (FLAGS_observable == kFlowObservables[o].name) wanted = o;
    known += (o == 0 ? "" : ", ") + std::string(kFlowObservables[o].name);
  }
  if (wanted < 0) {
    BadInput("--observable=" + FLAGS_observable + " is none of " + known);
  }
  // Before flags are changed.
  const std::vector<std::string> passed = PassedFlags({"out",
                                                       "pictures",
                                                       "jobs",
                                                       "resume",
                                                       "repetitions",
                                                       "seeds",
                                                       "flow_scenes",
                                                       "recommend",
                                                       "accuracy",
                                                       "observable"});
  if (!IsGiven("particles")) FLAGS_particles = FLAGS_smoke ? 30 : 100;
  if (FLAGS_smoke && !IsGiven("duration")) FLAGS_duration = 0.2;
  if (!IsGiven("seeds")) {
    FLAGS_seeds = FLAGS_smoke ? "1-2" : FLAGS_recommend ? "1-3" : "1-10";
  }
  if (!IsGiven("repetitions") && (FLAGS_smoke || FLAGS_recommend)) {
    FLAGS_repetitions = 1;
  }
  std::vector<std::string> names = {"smooth", "paper", "strong", "many"};
  if (!given.empty() || FLAGS_recommend) names = {"user"};
  if (!FLAGS_flow_scenes.empty()) names = Split(FLAGS_flow_scenes);
  for (const std::string& name : names) {
    if (!Contains(FlowTaskNames(), name)) {
      BadInput("--flow_scenes: '" + name +
               "' is none of smooth, paper, strong, many, user");
    }
  }
  if (!given.empty() && !Contains(names, "user")) {
    BadInput("--" + given[0] + " describes the scene 'user', which " +
             "--flow_scenes does not name");
  }
  std::vector<std::uint64_t> seeds;
  std::string error;
  if (!ParseSeeds(FLAGS_seeds, &seeds, &error)) BadInput("--seeds: " + error);

  if (FLAGS_one_start) {
    const FlowTask task =
        MakeFlowTask(names[0], seeds[0], FLAGS_max_seconds, FLAGS_smoke);
    Output output;
    output.Create(FLAGS_out, {"summary.json"});
    Json json = MeasureFlowTask(task, FLAGS_repetitions);
    json["schema"] = "granopt/tradeoff_flow_start/1";
    json["provenance"] = Provenance();
    output.WriteJson("summary.json", json);
    return kConverged;
  }

  std::vector<SceneResult> scenes(names.size());
  std::vector<Child> children;
  std::vector<std::size_t> scene_of_child;
  std::printf("tradeoff  flows; starts %s, %d repetitions, interleaved\n",
              FLAGS_seeds.c_str(),
              FLAGS_repetitions);
  for (std::size_t s = 0; s < names.size(); ++s) {
    scenes[s].name = names[s];
    scenes[s].task =
        MakeFlowTask(names[s], seeds[0], FLAGS_max_seconds, FLAGS_smoke);
    std::printf("          %-6s  %s; %zu ways\n",
                names[s].c_str(),
                DescribeFlowTask(names[s]).c_str(),
                scenes[s].task.ways.size());
    for (const std::uint64_t seed : seeds) {
      // One start is enough for the error of forces.
      if (names[s] == "many" && seed != seeds[0]) break;
      Child child;
      child.name = Format("%s_seed%llu",
                          names[s].c_str(),
                          static_cast<unsigned long long>(seed));
      child.arguments = passed;
      child.arguments.push_back("--one_start");
      child.arguments.push_back(Format("--repetitions=%d", FLAGS_repetitions));
      child.arguments.push_back("--flow_scenes=" + names[s]);
      child.arguments.push_back(
          Format("--seeds=%llu", static_cast<unsigned long long>(seed)));
      child.weight = names[s] == "many" ? 10.0 : scenes[s].task.end;
      children.push_back(child);
      scene_of_child.push_back(s);
    }
  }
  std::fflush(stdout);
  Output output;
  output.Create(FLAGS_out,
                {"summary.json",
                 "tradeoff_flow.csv",
                 "recommendations.md",
                 "tradeoff_flow.svg",
                 "tradeoff_flow.png"});
  bool interrupted = false;
  const std::vector<ChildResult> results = RunChildren("tradeoff",
                                                       children,
                                                       FLAGS_jobs,
                                                       FLAGS_resume,
                                                       false,
                                                       output,
                                                       &interrupted);
  if (interrupted) {
    std::printf("\nstopped as asked: the same command with --resume goes on\n");
    return kNotConverged;
  }
  std::vector<std::vector<Json>> starts(scenes.size());
  int status = kConverged;
  for (std::size_t c = 0; c < children.size(); ++c) {
    SceneResult& scene = scenes[scene_of_child[c]];
    if (results[c].failure.empty()) {
      starts[scene_of_child[c]].push_back(results[c].summary);
    } else {
      scene.failures.push_back(children[c].name + ": " + results[c].failure);
    }
  }
  Json json;
  json["scenes"] = Json::array();
  json["recommendations"] = Json::array();
  const std::vector<double> accuracies = {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
  std::vector<std::vector<std::string>> table = {
      {"scene", "error of", "cheapest by"}};
  for (const double accuracy : accuracies) {
    table[0].push_back(Format("<= %g", accuracy));
  }
  for (std::size_t s = 0; s < scenes.size(); ++s) {
    SceneResult& scene = scenes[s];
    Digest(starts[s], &scene);
    if (!scene.failures.empty()) status = kNotConverged;
    Json apart = Json::object();
    for (int o = 0; o < kNumFlowObservables; ++o) {
      apart[kFlowObservables[o].name] =
          scene.starts > 0 ? Largest(scene.apart[o]) : 0.0;
    }
    json["scenes"].push_back({{"scene", scene.name},
                              {"what", DescribeFlowTask(scene.name)},
                              {"particles", scene.task.flow.scene->size()},
                              {"end", scene.task.end},
                              {"starts", scene.starts},
                              {"failures", scene.failures},
                              {"reference_dt", scene.task.finest.setting.dt},
                              {"reference_apart", apart},
                              {"follows_the_exact_flow", scene.follows}});
    for (int o = 0; o < kNumFlowObservables; ++o) {
      if (!scene.follows && o == 2) continue;
      // Every way of the scene of many has the same sweeps, and a drift that
      // is that of its two steps.
      const bool is_forces = scene.name == "many";
      if (is_forces && o == 3) continue;
      for (const bool by_sweeps : {false, true}) {
        if (is_forces && by_sweeps) continue;
        std::vector<std::string> row = {scene.name,
                                        kFlowObservables[o].name,
                                        by_sweeps ? "sweeps" : "CPU ms"};
        bool differs = false;
        for (const double accuracy : accuracies) {
          const std::vector<const Cell*> ranking =
              Ranking(scene, o, accuracy, by_sweeps);
          if (ranking.empty()) {
            row.push_back("-");
            continue;
          }
          const Cell& best = *ranking[0];
          differs = differs || (by_sweeps &&
                                &best != Ranking(scene, o, accuracy, false)[0]);
          row.push_back((best.is_bound[o] ? "~ " : "") + LabelOf(*best.way) +
                        (by_sweeps
                             ? Format(": %.0f", best.mean_sweeps)
                             : Format(": %.3g", 1e3 * best.median_seconds)));
          json["recommendations"].push_back(
              {{"scene", scene.name},
               {"observable", kFlowObservables[o].name},
               {"accuracy", accuracy},
               {"cheapest_by", by_sweeps ? "sweeps" : "cpu_seconds"},
               {"flags", FlagsOf(*best.way)},
               {"sweeps", best.mean_sweeps},
               {"cpu_seconds", best.median_seconds},
               {"wall_seconds", best.median_wall},
               {"error", best.error[o]},
               {"is_bound", best.is_bound[o]}});
        }
        // By sweeps only where another way is the cheapest.
        if (!by_sweeps || differs) table.push_back(row);
      }
    }
  }
  output.Write("tradeoff_flow.csv", Csv(scenes));
  const std::vector<std::vector<std::string>> families =
      Families(scenes, accuracies);
  output.Write("recommendations.md",
               Grid(table, 0, true, 3) + "\n" + Grid(families, 0, true, 2));
  if (FLAGS_recommend) {
    for (const SceneResult& scene : scenes) {
      if (Recommend(scene, wanted, &json) != kConverged) status = kNotConverged;
    }
  } else {
    output.Plot({"tradeoff_flow",
                 output.Path("tradeoff_flow.csv"),
                 output.Path("tradeoff_flow")},
                {"tradeoff_flow.svg", "tradeoff_flow.png"});
    std::printf("\nfor this accuracy use this: stepper, TOL, Dt: cost\n%s",
                Grid(table, 0, false, 3).c_str());
    std::printf(
        "\nwhat each stepper takes for T, with its best TOL and Dt: CPU ms, "
        "sweeps\n%s\n",
        Grid(families, 0, false, 2).c_str());
    std::printf(
        "  ~: the error itself is lost in noise, or in what is not known of "
        "the "
        "exact flow; it is below that\n");
    for (int o = 0; o < kNumFlowObservables; ++o) {
      std::printf(
          "  %s: %s\n", kFlowObservables[o].name, kFlowObservables[o].what);
    }
  }
  std::printf("\n");
  for (const SceneResult& scene : scenes) {
    std::printf("  %s: %s\n", scene.name.c_str(), Reference(scene).c_str());
    if (!scene.follows && scene.starts > 0) {
      int lost = 0, all = 0;
      for (const Cell& cell : scene.cells) {
        if (!std::isfinite(cell.median_seconds)) continue;
        ++all;
        lost += cell.is_bound[0] ? 1 : 0;
      }
      std::printf(
          "    of %d ways %d differ from it by less than that noise: "
          "between those more starts decide\n",
          all,
          lost);
    }
    int failed = 0;
    std::string fault;
    for (const Cell& cell : scene.cells) {
      if (cell.failed == 0) continue;
      ++failed;
      fault = LabelOf(*cell.way) + ": " + cell.fault;
    }
    if (failed > 0) {
      std::printf(
          "    %d ways fail on some start and are not considered (%s)\n",
          failed,
          fault.c_str());
    }
    for (const std::string& failure : scene.failures) {
      std::printf("    failed: %s\n", failure.c_str());
    }
  }
  json["schema"] = "granopt/tradeoff_flow/1";
  json["provenance"] = Provenance();
  output.WriteJson("summary.json", json);
  output.PrintFiles();
  return status;
}

}  // namespace granopt
