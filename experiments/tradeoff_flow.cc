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
#include <string>
#include <vector>

#include "experiments/children.h"
#include "experiments/flow_results.h"
#include "experiments/flow_scene.h"
#include "experiments/flow_ways.h"
#include "experiments/run.h"
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

// Flags of this binary that --flow heeds beside those of the scene.
const std::vector<std::string>& FlagsBesideTheScene() {
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

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// Of `flow`, what is varied here.
bool IsVaried(const std::string& name) {
  return name == "stepper" || name == "solver" || Contains(StepFlags(), name);
}

// Names of the flags that were given and describe a flow.
std::vector<std::string> SceneFlags(bool refuse_others) {
  std::vector<std::string> names;
  for (const auto& flag : FlagsDefinedIn("experiments/")) {
    if (flag.is_default ||
        Contains({"out", "seed", "smoke", "pictures"}, flag.name) ||
        Contains(FlagsBesideTheScene(), flag.name)) {
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
    for (const WayResult& result : scene.results) {
      if (result.way != nullptr && !Contains(names, FamilyOf(result))) {
        names.push_back(FamilyOf(result));
      }
    }
    for (const std::string& name : names) {
      rows.push_back({scene.name, name});
      for (const double accuracy : accuracies) {
        std::string text = "-";
        for (const WayResult* result : Ranking(scene, 0, accuracy, false)) {
          if (FamilyOf(*result) != name) continue;
          text = Format(
              "%.3g, %.0f", 1e3 * result->median_seconds, result->mean_sweeps);
          // Threads save time, not work.
          if (scene.name == "many") {
            text = Format("%.3g (%.3g by the clock)",
                          1e3 * result->median_seconds,
                          1e3 * result->median_wall);
          }
        }
        rows.back().push_back(text);
      }
    }
  }
  return rows;
}

int Recommend(const SceneResult& scene, int wanted, Json* json) {
  const std::vector<const WayResult*> ranking =
      Ranking(scene, wanted, FLAGS_accuracy, false);
  std::printf("\n%s, error %s at most %g\n",
              scene.name.c_str(),
              kFlowObservables[wanted].what,
              FLAGS_accuracy);
  if (ranking.empty()) {
    double least = kInfinity;
    for (const WayResult& result : scene.results) {
      least = std::min(least, result.error[wanted]);
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
  for (const WayResult* result : ranking) {
    evidence.push_back(
        {FlagsOf(*result->way),
         Format("%.3g", 1e3 * result->median_seconds),
         Format("%.2f", result->median_seconds / ranking[0]->median_seconds),
         Format("%.0f", result->mean_sweeps),
         (result->is_bound[wanted] ? "< " : "") +
             Format("%.1e", result->error[wanted])});
  }
  std::fputs(Grid(evidence, 0, false).c_str(), stdout);
  return kConverged;
}

// What the flags ask for.
struct Plan {
  std::vector<std::string> scenes;
  std::vector<std::uint64_t> seeds;
  int wanted = -1;                  // observable of --recommend
  std::vector<std::string> passed;  // flags, to the processes of the starts
};

Plan MakePlan() {
  Plan plan;
  const std::vector<std::string> given = SceneFlags(true);
  CheckPositive("accuracy", FLAGS_accuracy);
  CheckRange("accuracy", FLAGS_accuracy, 0.0, 1.0);
  CheckRange("repetitions", FLAGS_repetitions, 1, 1000);
  CheckRange("jobs", FLAGS_jobs, 1, 1024);
  CheckPositive("max_seconds", FLAGS_max_seconds);
  CheckPositive("duration", FLAGS_duration);
  if (!IsGiven("observable")) FLAGS_observable = kFlowObservables[0].name;
  std::string known;
  for (int o = 0; o < kNumFlowObservables; ++o) {
    if (FLAGS_observable == kFlowObservables[o].name) plan.wanted = o;
    known += (o == 0 ? "" : ", ") + std::string(kFlowObservables[o].name);
  }
  if (plan.wanted < 0) {
    BadInput("--observable=" + FLAGS_observable + " is none of " + known);
  }
  // Before flags are changed.
  plan.passed = PassedFlags({"out",
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
  plan.scenes = {"smooth", "paper", "strong", "many"};
  if (!given.empty() || FLAGS_recommend) plan.scenes = {"user"};
  if (!FLAGS_flow_scenes.empty()) plan.scenes = Split(FLAGS_flow_scenes, ',');
  for (const std::string& name : plan.scenes) {
    if (!Contains(FlowTaskNames(), name)) {
      BadInput("--flow_scenes: '" + name +
               "' is none of smooth, paper, strong, many, user");
    }
  }
  if (!given.empty() && !Contains(plan.scenes, "user")) {
    BadInput("--" + given[0] + " describes the scene 'user', which " +
             "--flow_scenes does not name");
  }
  std::string error;
  if (!ParseSeeds(FLAGS_seeds, &plan.seeds, &error)) {
    BadInput("--seeds: " + error);
  }
  return plan;
}

int MeasureOneStart(const Plan& plan) {
  const FlowTask task = MakeFlowTask(
      plan.scenes[0], plan.seeds[0], FLAGS_max_seconds, FLAGS_smoke);
  Output output;
  output.Create(FLAGS_out, {"summary.json"});
  Json json = MeasureFlowTask(task, FLAGS_repetitions);
  json["schema"] = "granopt/tradeoff_flow_start/1";
  json["provenance"] = Provenance();
  output.WriteJson("summary.json", json);
  return kConverged;
}

// The table of the cheapest way for each accuracy of each observable.
void AddRecommendations(const SceneResult& scene,
                        const std::vector<double>& accuracies,
                        std::vector<std::vector<std::string>>* table,
                        Json* recommendations) {
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
        const std::vector<const WayResult*> ranking =
            Ranking(scene, o, accuracy, by_sweeps);
        if (ranking.empty()) {
          row.push_back("-");
          continue;
        }
        const WayResult& best = *ranking[0];
        differs = differs ||
                  (by_sweeps && &best != Ranking(scene, o, accuracy, false)[0]);
        row.push_back((best.is_bound[o] ? "~ " : "") + LabelOf(*best.way) +
                      (by_sweeps
                           ? Format(": %.0f", best.mean_sweeps)
                           : Format(": %.3g", 1e3 * best.median_seconds)));
        recommendations->push_back(
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
      if (!by_sweeps || differs) table->push_back(row);
    }
  }
}

// What its errors are against, which ways failed.
void PrintScene(const SceneResult& scene) {
  std::printf("  %s: %s\n", scene.name.c_str(), Reference(scene).c_str());
  if (!scene.follows && scene.starts > 0) {
    int lost = 0, all = 0;
    for (const WayResult& result : scene.results) {
      if (!std::isfinite(result.median_seconds)) continue;
      ++all;
      lost += result.is_bound[0] ? 1 : 0;
    }
    std::printf(
        "    of %d ways %d differ from it by less than that noise: "
        "between those more starts decide\n",
        all,
        lost);
  }
  int failed = 0;
  std::string fault;
  for (const WayResult& result : scene.results) {
    if (result.failed == 0) continue;
    ++failed;
    fault = LabelOf(*result.way) + ": " + result.fault;
  }
  if (failed > 0) {
    std::printf("    %d ways fail on some start and are not considered (%s)\n",
                failed,
                fault.c_str());
  }
  for (const std::string& failure : scene.failures) {
    std::printf("    failed: %s\n", failure.c_str());
  }
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
  const Plan plan = MakePlan();
  if (FLAGS_one_start) return MeasureOneStart(plan);
  std::vector<SceneResult> scenes(plan.scenes.size());
  std::vector<Child> children;
  std::vector<std::size_t> scene_of_child;
  std::printf("tradeoff  flows; starts %s, %d repetitions, interleaved\n",
              FLAGS_seeds.c_str(),
              FLAGS_repetitions);
  for (std::size_t s = 0; s < plan.scenes.size(); ++s) {
    scenes[s].name = plan.scenes[s];
    scenes[s].task = MakeFlowTask(
        plan.scenes[s], plan.seeds[0], FLAGS_max_seconds, FLAGS_smoke);
    std::printf("          %-6s  %s; %zu ways\n",
                plan.scenes[s].c_str(),
                DescribeFlowTask(plan.scenes[s]).c_str(),
                scenes[s].task.ways.size());
    for (const std::uint64_t seed : plan.seeds) {
      // One start is enough for the error of forces.
      if (plan.scenes[s] == "many" && seed != plan.seeds[0]) break;
      Child child;
      child.name = Format("%s_seed%llu",
                          plan.scenes[s].c_str(),
                          static_cast<unsigned long long>(seed));
      child.arguments = plan.passed;
      child.arguments.push_back("--one_start");
      child.arguments.push_back(Format("--repetitions=%d", FLAGS_repetitions));
      child.arguments.push_back("--flow_scenes=" + plan.scenes[s]);
      child.arguments.push_back(
          Format("--seeds=%llu", static_cast<unsigned long long>(seed)));
      child.weight = plan.scenes[s] == "many" ? 10.0 : scenes[s].task.end;
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
    AddRecommendations(scene, accuracies, &table, &json["recommendations"]);
  }
  output.Write("tradeoff_flow.csv", ResultsCsv(scenes));
  const std::vector<std::vector<std::string>> families =
      Families(scenes, accuracies);
  output.Write("recommendations.md",
               Grid(table, 0, true, 3) + "\n" + Grid(families, 0, true, 2));
  if (FLAGS_recommend) {
    for (const SceneResult& scene : scenes) {
      if (Recommend(scene, plan.wanted, &json) != kConverged) {
        status = kNotConverged;
      }
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
        "the exact flow; it is below that\n");
    for (int o = 0; o < kNumFlowObservables; ++o) {
      std::printf(
          "  %s: %s\n", kFlowObservables[o].name, kFlowObservables[o].what);
    }
  }
  std::printf("\n");
  for (const SceneResult& scene : scenes) PrintScene(scene);
  json["schema"] = "granopt/tradeoff_flow/1";
  json["provenance"] = Provenance();
  output.WriteJson("summary.json", json);
  output.PrintFiles();
  return status;
}

}  // namespace granopt
