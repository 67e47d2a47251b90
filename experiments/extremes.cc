// extremes: one extreme at a time, with every method. Does a method pass, is it
// worse there, does it refuse, and does anything ever claim what is not so?
//
//   extremes --out=DIR --jobs=2 --resume [--only=distance_1e-8,overflow]
//            [--solvers="auto;lbfgs;..."] [--large] [--smoke]
//   extremes --extreme=distance_1e-8 --solver=fire --out=DIR     one cell
//   extremes --flow            flows, by each stepper (near-field flow)
//   extremes [--flow] --list
//
// Each cell is a process of its own, bounded in evaluations and seconds: one
// that crashes or hangs is a cell, too. What a run claims is judged by a
// quadruple evaluation and by the certificate.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "experiments/cases.h"
#include "experiments/children.h"
#include "experiments/extreme_flows.h"
#include "experiments/extreme_scenes.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/tabular.h"
#include "granular/quad_residual.h"
#include "granular/stability.h"

DECLARE_string(solver);

DEFINE_bool(flow,
            false,
            "flows with each stepper instead of packings with each method");
DEFINE_bool(list, false, "print the extremes and exit");
DEFINE_string(extreme, "", "run this one only, with --solver, in this process");
DEFINE_string(only, "", "run these, separated by commas");
DEFINE_string(solvers,
              "auto;lbfgs;fire;ncg;heavy_ball;newton;interior_point;"
              "barrier@lbfgs:preconditioner=barrier,shift=1e-6;"
              "laplacian@lbfgs:preconditioner=laplacian;"
              "ceres_lbfgs@ceres_lbfgs:scaled=1;ceres_ncg@ceres_ncg:scaled=1",
              "methods, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,...");
DEFINE_bool(large, false, "also 10^4 to 10^6 grains");
DEFINE_int64(max_evaluations, 100000, "a run ends after this many evaluations");
DEFINE_double(max_seconds, 20.0, "and after this time");
DEFINE_int32(jobs, 1, "runs at a time");
DEFINE_bool(resume, false, "do not run again what is complete in --out");

namespace granopt {
namespace {

// What became of a cell, in order of severity.
enum class Cell {
  PASSED,      // converged to a certified strict minimum, or to E = 0
  STATIONARY,  // converged, but not certified to be a minimum
  DEGRADED,    // ended above the tolerance, and says so
  REFUSED,     // bad input or a method that cannot serve, with its reason
  LOST,        // not finite, hung, crashed
  WRONG,       // says that it converged, and has not
};
struct CellName {
  Cell cell;
  const char* name;
};
constexpr CellName kCells[] = {{Cell::PASSED, "passed"},
                               {Cell::STATIONARY, "stationary"},
                               {Cell::DEGRADED, "degraded"},
                               {Cell::REFUSED, "refused"},
                               {Cell::LOST, "lost"},
                               {Cell::WRONG, "wrong"}};

const char* NameOf(Cell cell) {
  for (const CellName& entry : kCells) {
    if (entry.cell == cell) return entry.name;
  }
  return "unknown";
}

bool CellOf(const std::string& name, Cell* cell) {
  for (const CellName& entry : kCells) {
    if (name != entry.name) continue;
    *cell = entry.cell;
    return true;
  }
  return false;
}

struct Result {
  std::string extreme, solver;
  Cell cell = Cell::LOST;
  double residual = 0.0;  // in quadruple precision, in mean forces
  std::string why;        // one line
  std::int64_t evaluations = 0;
  double seconds = 0.0;
};

// A claim may be off by what rounding does to forces.
constexpr double kHonest = 10.0;

Result Judge(const ExtremeStart& start,
             const Relaxation& run,
             double tolerance) {
  Result result;
  const Summary& s = run.summary;
  result.why = std::string(StopReasonName(s.reason)) + ": " + s.message;
  result.evaluations = s.counters.evaluations;
  result.seconds = s.seconds;
  const bool finite = run.packing.positions.allFinite() &&
                      std::isfinite(run.observables.energy) &&
                      std::isfinite(s.cost);
  if (!finite) {
    result.cell = s.Succeeded() ? Cell::WRONG : Cell::LOST;
    if (s.reason == StopReason::EVALUATION_FAILED) result.cell = Cell::REFUSED;
    return result;
  }
  QuadResidual judge;
  std::string error;
  if (!EvaluateQuad(run.packing, start.energy, nullptr, &judge, &error)) {
    result.cell = Cell::LOST;
    result.why += "; the judge: " + error;
    return result;
  }
  result.residual = judge.Relative();
  switch (s.reason) {
    case StopReason::UNSUPPORTED:
    case StopReason::EVALUATION_FAILED:
      result.cell = Cell::REFUSED;
      return result;
    case StopReason::VANISHED: {
      // Overlaps, in mean radii, are at most a few bounds.
      const double overlap =
          run.observables.mean_overlap / run.packing.MeanRadius();
      result.cell = overlap <= kHonest * start.vanishing_tolerance
                        ? Cell::PASSED
                        : Cell::WRONG;
      return result;
    }
    case StopReason::CONVERGED:
      break;
    default:
      result.cell = Cell::DEGRADED;
      return result;
  }
  if (!(result.residual <= kHonest * tolerance)) {
    result.cell = Cell::WRONG;
    result.why += Format("; judged %.1e", result.residual);
    return result;
  }
  result.cell = Cell::STATIONARY;
  if (run.packing.size() > 20000) {
    result.why += "; too large to certify";
    return result;
  }
  const auto energy = ContactEnergy::Create(run.packing, start.energy, &error);
  if (energy == nullptr) {
    result.why += "; " + error;
    return result;
  }
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  StabilityOptions stability;
  stability.vanishing_tolerance = start.vanishing_tolerance;
  const Certificate certificate = Certify(*energy, zero.data(), stability);
  if (certificate.IsStrictMinimum()) result.cell = Cell::PASSED;
  result.why += std::string("; ") + StabilityVerdictName(certificate.verdict) +
                ", " + certificate.message;
  return result;
}

Json ResultJson(const Result& r) {
  return {{"extreme", r.extreme},
          {"solver", r.solver},
          {"cell", NameOf(r.cell)},
          {"residual", r.residual},
          {"evaluations", r.evaluations},
          {"seconds", r.seconds},
          {"why", r.why}};
}

// ------------------------------------------------------------ one cell

// What a flow may lose or gain by its integrator, of the energy that is turned
// over, and still count as passed.
constexpr double kNumerical = 0.05;

void Publish(const Result& result, Output* output) {
  Json json = ResultJson(result);
  json["schema"] = "granopt/extreme/1";
  json["provenance"] = Provenance();
  output->WriteJson("summary.json", json);
  std::printf("%s, %s: %s (residual %.1e)\n  %s\n",
              result.extreme.c_str(),
              result.solver.c_str(),
              NameOf(result.cell),
              result.residual,
              result.why.c_str());
  output->PrintFiles();
}

int RunFlowCell() {
  alarm(static_cast<unsigned>(3.0 * FLAGS_max_seconds) + 30u);
  FlowRun run;
  std::string error;
  if (!RunExtremeFlow(
          FLAGS_extreme, FLAGS_solver, FLAGS_max_seconds, &run, &error)) {
    BadInput("--extreme: " + error);
  }
  Result result;
  result.extreme = FLAGS_extreme;
  result.solver = FLAGS_solver;
  result.why = run.message;
  result.evaluations = run.sweeps;
  result.seconds = run.seconds;
  result.residual = run.numerical;
  if (run.refused) {
    result.cell = run.finite || run.sweeps == 0 ? Cell::REFUSED : Cell::LOST;
  } else if (!run.finite) {
    result.cell = Cell::LOST;
  } else if (!(run.closure <= 1e-9)) {
    // The ledger says what it does not keep.
    result.cell = Cell::WRONG;
  } else {
    result.cell = run.finished && run.numerical <= kNumerical ? Cell::PASSED
                                                              : Cell::DEGRADED;
  }
  Output output;
  output.Create(FLAGS_out, {"summary.json"});
  Publish(result, &output);
  return result.cell <= Cell::STATIONARY ? kConverged : kNotConverged;
}

int RunCell() {
  const std::unique_ptr<Solver> solver = MakeSolver("solver", FLAGS_solver);
  // Whatever hangs, this ends it: the parent calls that hung.
  alarm(static_cast<unsigned>(3.0 * FLAGS_max_seconds) + 30u);
  ExtremeStart start;
  std::string error;
  if (!MakeExtremeStart(FLAGS_extreme, &start, &error)) {
    BadInput("--extreme: " + error);
  }
  Scene scene;
  scene.packing = start.packing;
  scene.energy = start.energy;
  scene.origin = FLAGS_extreme;
  CheckScene(scene);
  SolveOptions options;
  options.relative_tolerance = FLAGS_tolerance;
  options.vanishing_tolerance = start.vanishing_tolerance;
  options.max_evaluations = FLAGS_max_evaluations;
  options.max_seconds = FLAGS_max_seconds;
  Relaxation run;
  if (!Relax(start.packing, start.energy, *solver, options, &run, &error)) {
    BadInput(FLAGS_extreme + ": " + error);
  }
  Result result = Judge(start, run, FLAGS_tolerance);
  result.extreme = FLAGS_extreme;
  result.solver = FLAGS_solver;
  Output output;
  output.Create(FLAGS_out, {"summary.json", "start.xyz", "packing.xyz"});
  if (start.packing.size() <= 20000) {
    output.WritePacking("start.xyz", start.packing);
    output.WritePacking("packing.xyz", Annotated(run, start.energy));
  }
  Publish(result, &output);
  return result.cell <= Cell::STATIONARY ? kConverged : kNotConverged;
}

// ------------------------------------------------------------ the matrix

const std::vector<ExtremeScene>& AllScenes() {
  return FLAGS_flow ? ExtremeFlows() : ExtremeScenes();
}

std::vector<ExtremeScene> Chosen() {
  std::vector<ExtremeScene> chosen;
  if (FLAGS_only.empty()) {
    for (const ExtremeScene& scene : AllScenes()) {
      if (scene.large && !FLAGS_large) continue;
      if (FLAGS_smoke && !scene.smoke) continue;
      chosen.push_back(scene);
    }
    return chosen;
  }
  for (const std::string& name : Split(FLAGS_only, ',')) {
    const auto found = std::find_if(
        AllScenes().begin(),
        AllScenes().end(),
        [&name](const ExtremeScene& scene) { return scene.name == name; });
    if (found == AllScenes().end()) {
      BadInput("--only: unknown extreme '" + name + "' (--list names them)");
    }
    chosen.push_back(*found);
  }
  return chosen;
}

// From a child that has no summary.
Result Lost(const std::string& failure) {
  Result result;
  const std::string refusal = "exit status 2: ";
  if (failure.rfind(refusal, 0) == 0) {
    result.cell = Cell::REFUSED;
    result.why = failure.substr(refusal.size());
    // "extremes: grains_1: ..." as it is printed.
    const std::string name = "extremes: ";
    if (result.why.rfind(name, 0) == 0) result.why.erase(0, name.size());
    return result;
  }
  result.cell = Cell::LOST;
  result.why = failure == "killed by signal 14" ? "hung: " + failure : failure;
  return result;
}

std::string Text(const Result& r) {
  switch (r.cell) {
    case Cell::DEGRADED:
      return Format("%.0e", r.residual);
    case Cell::PASSED:
      return "ok";
    default:
      return NameOf(r.cell);
  }
}

std::vector<Method> ChosenMethods() {
  std::vector<Method> methods;
  std::string error;
  if (FLAGS_flow) {
    for (const std::string& name : FlowSteppers()) {
      methods.push_back({name, name});
    }
  } else if (!ParseMethods(FLAGS_solvers, &methods, &error)) {
    BadInput("--solvers: " + error);
  }
  for (const Method& method : methods) {
    if (!FLAGS_flow) MakeSolver("solvers", method.spec);
  }
  return methods;
}

// A process for each cell, row by row.
std::vector<Child> MakeChildren(const std::vector<ExtremeScene>& scenes,
                                const std::vector<Method>& methods) {
  const std::vector<std::string> passed = PassedFlags({"solvers",
                                                       "only",
                                                       "large",
                                                       "jobs",
                                                       "resume",
                                                       "smoke",
                                                       "out",
                                                       "pictures",
                                                       "extreme",
                                                       "solver",
                                                       "list"});
  std::vector<Child> children;
  for (const ExtremeScene& scene : scenes) {
    for (const Method& method : methods) {
      Child child;
      child.name = scene.name + "_" + method.label;
      std::replace_if(
          child.name.begin(),
          child.name.end(),
          [](char c) { return c == '/' || c == ':' || c == ' '; },
          '_');
      child.arguments = passed;
      child.arguments.push_back("--extreme=" + scene.name);
      child.arguments.push_back("--solver=" + method.spec);
      children.push_back(child);
    }
  }
  return children;
}

Result ResultOf(const ChildResult& outcome) {
  if (!outcome.failure.empty()) return Lost(outcome.failure);
  Result r;
  const Json& json = outcome.summary;
  if (!CellOf(json.value("cell", ""), &r.cell)) {
    r.why = "no cell in its summary.json";
    return r;
  }
  r.residual = json.value("residual", 0.0);
  r.evaluations = json.value("evaluations", std::int64_t{0});
  r.seconds = json.value("seconds", 0.0);
  r.why = json.value("why", "");
  return r;
}

void PrintMatrix(const std::vector<std::vector<std::string>>& rows,
                 std::map<Cell, int> count,
                 const std::vector<std::string>& notes) {
  std::printf("\n%s\n", Grid(rows, 0, false).c_str());
  std::fputs(
      FLAGS_flow
          ? "  ok: reached its end, every number finite, energy and work agree "
            "to 1e-9;\n  a number: the part of the energy turned over that the "
            "integrator made or lost, or out of time\n\n"
          : "  ok: a certified strict minimum, or E = 0; stationary: "
            "converged, "
            "not certified;\n  a number: ended with that residual, in mean "
            "forces, and says so\n\n",
      stdout);
  for (const CellName& entry : kCells) {
    std::printf("  %-10s %d\n", entry.name, count[entry.cell]);
  }
  for (const std::string& note : notes) std::printf("  ! %s\n", note.c_str());
}

int RunMatrix() {
  const std::vector<ExtremeScene> scenes = Chosen();
  const std::vector<Method> methods = ChosenMethods();
  CheckRange("jobs", FLAGS_jobs, 1, 1024);
  const std::vector<Child> children = MakeChildren(scenes, methods);
  Output output;
  output.Create(FLAGS_out,
                {"summary.json",
                 "extremes.csv",
                 "extremes.md",
                 "extremes.svg",
                 "extremes.png"});
  if (FLAGS_flow) {
    std::printf("extremes  %zu flows, %zu steppers, at most %g s each\n",
                scenes.size(),
                methods.size(),
                FLAGS_max_seconds);
  } else {
    std::printf(
        "extremes  %zu extremes, %zu methods, to %g mean forces, at most %lld "
        "evaluations and %g s each\n",
        scenes.size(),
        methods.size(),
        FLAGS_tolerance,
        static_cast<long long>(FLAGS_max_evaluations),
        FLAGS_max_seconds);
  }
  bool interrupted = false;
  const std::vector<ChildResult> outcomes = RunChildren("extremes",
                                                        children,
                                                        FLAGS_jobs,
                                                        FLAGS_resume,
                                                        false,
                                                        output,
                                                        &interrupted,
                                                        /*quiet=*/true);
  std::vector<Result> results;
  std::map<Cell, int> count;
  std::string csv =
      "extreme,group,solver,cell,residual,evaluations,seconds,why\n";
  std::vector<std::vector<std::string>> rows = {{"extreme"}};
  for (const Method& method : methods) rows[0].push_back(method.label);
  std::vector<std::string> notes;
  for (std::size_t k = 0; k < children.size(); ++k) {
    const ExtremeScene& scene = scenes[k / methods.size()];
    const Method& method = methods[k % methods.size()];
    Result r = ResultOf(outcomes[k]);
    r.extreme = scene.name;
    r.solver = method.label;
    ++count[r.cell];
    csv += Field(scene.name) + "," + Field(scene.group) + "," +
           Field(method.label) + "," + NameOf(r.cell) +
           Format(",%.3g,%lld,%.3g,",
                  r.residual,
                  static_cast<long long>(r.evaluations),
                  r.seconds) +
           Field(r.why) + "\n";
    if (k % methods.size() == 0) rows.push_back({scene.name});
    rows.back().push_back(Text(r));
    if (r.cell == Cell::WRONG || r.cell == Cell::LOST) {
      notes.push_back(scene.name + ", " + method.label + ": " + r.why);
    }
    results.push_back(r);
  }
  Json json;
  json["interrupted"] = interrupted;
  json["cells"] = Json::object();
  for (const CellName& entry : kCells) {
    json["cells"][entry.name] = count[entry.cell];
  }
  json["results"] = Json::array();
  for (const Result& r : results) json["results"].push_back(ResultJson(r));
  json["schema"] = "granopt/extremes/1";
  json["provenance"] = Provenance();
  output.Write("extremes.csv", csv);
  output.Write("extremes.md", Grid(rows, 0, true));
  output.WriteJson("summary.json", json);
  output.Plot(
      {"extremes", output.Path("extremes.csv"), output.Path("extremes")},
      {"extremes.svg", "extremes.png"});
  PrintMatrix(rows, count, notes);
  output.PrintFiles();
  return count[Cell::WRONG] + count[Cell::LOST] == 0 && !interrupted
             ? kConverged
             : kNotConverged;
}

int Main() {
  if (FLAGS_list) {
    std::string group;
    for (const ExtremeScene& scene : AllScenes()) {
      if (scene.group != group) std::printf("%s\n", scene.group.c_str());
      group = scene.group;
      std::printf("  %-26s %s%s\n",
                  scene.name.c_str(),
                  scene.what.c_str(),
                  scene.large ? " (--large)" : "");
    }
    return kConverged;
  }
  if (FLAGS_smoke) {
    if (!IsGiven("solvers")) FLAGS_solvers = "auto;lbfgs;fire;newton";
    // Children get it as the user's own.
    if (!IsGiven("max_seconds")) {
      gflags::SetCommandLineOption("max_seconds", "5");
    }
  }
  CheckPositive("tolerance", FLAGS_tolerance);
  CheckPositive("max_seconds", FLAGS_max_seconds);
  CheckRange("max_seconds", FLAGS_max_seconds, 0.0, 1e6);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 1.0, 9e18);
  if (FLAGS_extreme.empty()) return RunMatrix();
  return FLAGS_flow ? RunFlowCell() : RunCell();
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "one extreme at a time with every method: does "
                      "it pass, is it worse, does it refuse, is anything "
                      "claimed that is not so");
  granopt::ListSolversIfAsked();
  return granopt::Main();
}
