#include "experiments/compare_flags.h"

#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/tabular.h"

DEFINE_string(solvers,
              "lbfgs;lbfgs:preconditioner=laplacian;"
              "lbfgs:preconditioner=contact;ncg;fire;"
              "ceres_lbfgs:scaled=1,differences=1,restarts=10",
              "methods, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,... (see --list_solvers)");
DEFINE_string(
    cases,
    "growth,simple_shear,random",
    "what is relaxed, separated by commas: growth, simple_shear, "
    "pure_shear, random, fig2, near_jamming, start, user; with a size as in "
    "growth=5e-5; near_jamming=0.3x is a strain of 0.3 (phi - phi_J)");
DEFINE_double(phi, 0.8438, "packing fraction of generated packings");
DEFINE_string(seeds, "", "seeds as in 1-3 or 1,4,7; default: --seed");
DEFINE_int32(repetitions, 3, "how often each run is repeated, for its time");
DEFINE_double(
    absolute_tolerance,
    0.0,
    "if > 0: stop at max|g| <= this instead, in units k = 1, box = 1");
DEFINE_double(max_seconds, 0.0, "a run gives up after this time (0: never)");
DEFINE_int64(max_evaluations,
             0,
             "a run gives up after this many evaluations (0: never)");
DEFINE_string(distances,
              "1e-2,1e-3,1e-4,1e-5,1e-6,1e-7,1e-8",
              "distances phi - phi_J of the case near_jamming");
DEFINE_double(shear, 1e-6, "shear step of the case near_jamming");
DEFINE_int32(steps,
             1,
             "shear steps of the case near_jamming, one after another: each "
             "starts from the state before, relaxed by --prepare_solver");
DEFINE_string(prepare_solver,
              granopt::kDefaultSolver,
              "the method that relaxes the packings before the loads");
DEFINE_int64(
    prepare_evaluations,
    1000000,
    "a relaxation of these steps gives up after this many evaluations, "
    "which ends their chain (0: never)");
DEFINE_string(reference,
              "",
              "label of the method whose minima the others' are compared with: "
              "who leaves its basin, how often");
DEFINE_bool(resume,
            false,
            "go on with an interrupted comparison in --out: what it has run is "
            "not run again");
DEFINE_string(baseline,
              "",
              "label of the method that times are divided by; default: the "
              "first");
DEFINE_string(
    paper,
    "",
    "the paper's parameters: table1, fig2 or fig7 (each can be changed by "
    "its flag)");
DEFINE_string(replot,
              "",
              "folder of an earlier comparison: make its tables and figures "
              "again, run nothing");

namespace granopt {
namespace {

// The label that a flag names, by itself or by its spec; BadInput if none.
std::string LabelOf(const std::vector<Method>& methods,
                    const char* flag,
                    const std::string& value) {
  std::string known;
  for (const Method& method : methods) {
    if (method.label == value || method.spec == value) return method.label;
    known += (known.empty() ? "" : "; ") + method.label;
  }
  BadInput(std::string("--") + flag + ": no method is labelled '" + value +
           "'; there are " + known);
}

}  // namespace

std::vector<Method> MethodsOfFlags(
    std::vector<std::unique_ptr<Solver>>* solvers) {
  std::vector<Method> methods;
  std::string error;
  Require(ParseMethods(FLAGS_solvers, &methods, &error), "solvers", error);
  for (const Method& method : methods) {
    solvers->push_back(MakeSolver("solvers", method.spec));
  }
  return methods;
}

std::unique_ptr<Solver> PrepareSolverOfFlags() {
  return MakeSolver("prepare_solver", FLAGS_prepare_solver);
}

std::vector<std::uint64_t> SeedsOfFlags() {
  std::vector<std::uint64_t> seeds = {FLAGS_seed};
  std::string error;
  if (IsGiven("seeds")) {
    Require(ParseSeeds(FLAGS_seeds, &seeds, &error), "seeds", error);
  }
  return seeds;
}

void SetBaseline(const std::vector<Method>& methods, std::string* baseline) {
  if (IsGiven("baseline")) {
    *baseline = LabelOf(methods, "baseline", FLAGS_baseline);
  }
}

void SetReference(const std::vector<Method>& methods, std::string* reference) {
  if (IsGiven("reference")) {
    *reference = LabelOf(methods, "reference", FLAGS_reference);
  }
}

void CheckLimits() {
  CheckRange("max_seconds", FLAGS_max_seconds, 0.0, 1e300);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 0.0, 9e18);
}

void SetLimits(SolveOptions* options) {
  if (FLAGS_max_seconds > 0.0) options->max_seconds = FLAGS_max_seconds;
  if (FLAGS_max_evaluations > 0) {
    options->max_evaluations = FLAGS_max_evaluations;
  }
}

std::string LimitsText(const std::string& per) {
  std::string text;
  if (FLAGS_max_seconds > 0.0) {
    text += "; at most " + Neat(FLAGS_max_seconds) + " s" + per;
  }
  if (FLAGS_max_evaluations > 0) {
    text += "; at most " + std::to_string(FLAGS_max_evaluations) +
            " evaluations" + per;
  }
  return text;
}

void RefuseFlags(const std::vector<const char*>& flags,
                 const std::string& words) {
  for (const char* flag : flags) {
    if (IsGiven(flag)) BadInput(std::string("--") + flag + " " + words);
  }
}

}  // namespace granopt
