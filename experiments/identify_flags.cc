#include "experiments/identify_flags.h"

#include <cstring>
#include <string>

#include "experiments/run.h"
#include "solvers/search/search.h"

// ---- what is searched
DEFINE_string(search,
              "alpha1:0:1,beta1:0:1,alpha2:0:1,beta2:1:2",
              "name:low:high of each parameter, any flag of a flow that is a "
              "number");
DEFINE_string(target,
              "",
              "CSV file with the columns time, T, T_b, T_r (s, J/kg), and, if "
              "they are known, their deviations T_error, T_b_error, T_r_error, "
              "which weigh the misfit");
DEFINE_string(target_energies,
              "1,0.5,0.5",
              "T, T_b, T_r of a target that does not change, J/kg");
DEFINE_string(weights, "1,1,1", "w_E, w_Eb, w_Er of (8.5), for T, T_b, T_r");
DEFINE_string(recover,
              "",
              "values of the parameters: the target is what they do, on "
              "average over 20 starts; are they found again?");
// ---- how
DEFINE_string(method, "genetic_algorithm", "search (see --list_methods)");
DEFINE_bool(list_methods, false, "print the searches and exit");
DEFINE_int32(budget,
             0,
             "strings of the search at most; 0: the method's own end");
DEFINE_string(ensemble,
              "honest",
              "starts of a string: until two means in a row agree; paper: at "
              "least 2, honest: at least 5");
DEFINE_double(ensemble_tolerance, 0.01, "TOL of two means in a row");
DEFINE_int32(most_runs, 100, "starts of a string at most");
DEFINE_int32(most_steps,
             0,
             "time steps of a flow at most, 0: 100 duration / dt; where grains "
             "fall into each other steps shrink without end, and the string "
             "has no value");
DEFINE_int32(winners, 24, "strings that are tried again on fresh starts");
DEFINE_int32(fresh, 60, "those starts, the same for all of them");
DEFINE_bool(gradient,
            false,
            "go on from the best by Ceres (see identification.md)");
DEFINE_int32(gradient_runs, 20, "starts of --gradient, the same for all");
DEFINE_int32(gradient_budget, 120, "strings of --gradient at most");
DEFINE_bool(profile,
            false,
            "the least P at fixed values of each parameter, others free");
DEFINE_int32(profile_points, 7, "values of each parameter in --profile");
DEFINE_int32(profile_budget, 30, "strings of each of them at most");
DEFINE_bool(alternatives, false, "other searches with as many runs");
DEFINE_int32(repeats, 2, "searches of each of --alternatives");
DEFINE_bool(recovery,
            false,
            "find the first string of Table 1 again from what it does");
DEFINE_bool(paper, false, "sec. 8.2: Fig. 7, Table 1, Fig. 8, and all above");
// ---- where
DEFINE_int32(threads,
             1,
             "results are the same bits on any number (--stepper=minimize: one "
             "flow at a time all the same)");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out; ends in the same bits");
DEFINE_bool(external,
            false,
            "evaluate nothing: write OUT/strings.csv for --worker, take "
            "OUT/values_*.csv, exit with 1 until all is there");
DEFINE_bool(worker,
            false,
            "evaluate a share of --strings, write OUT/values_LIST_k_of_n.csv; "
            "LIST is the CRC-32 of --strings: lists have files of their own");
DEFINE_string(strings, "", "strings.csv of --external");
DEFINE_string(share, "1/1", "k/n: of --strings the k-th of every n");

namespace granopt::identify {

void CheckFlags() {
  CheckRange("budget", FLAGS_budget, 0, 1e9);
  CheckRange("most_runs", FLAGS_most_runs, 2, 1e6);
  CheckRange("most_steps", FLAGS_most_steps, 0, 2e9);
  CheckRange("ensemble_tolerance", FLAGS_ensemble_tolerance, 0.0, 1.0);
  CheckRange("winners", FLAGS_winners, 1, 100000);
  CheckRange("fresh", FLAGS_fresh, 2, 1e6);
  CheckRange("gradient_runs", FLAGS_gradient_runs, 1, 1e6);
  CheckRange("gradient_budget", FLAGS_gradient_budget, 1, 1e9);
  CheckRange("profile_points", FLAGS_profile_points, 2, 1000);
  CheckRange("profile_budget", FLAGS_profile_budget, 1, 1e9);
  CheckRange("repeats", FLAGS_repeats, 1, 10);
  CheckRange("threads", FLAGS_threads, 1, 1024);
  if (FLAGS_ensemble != "paper" && FLAGS_ensemble != "honest") {
    BadInput("--ensemble=" + FLAGS_ensemble + " must be paper or honest");
  }
  std::string error;
  if (CreateSearch(FLAGS_method, &error) == nullptr) {
    BadInput("--method: " + error);
  }
  if (FLAGS_external && FLAGS_worker) {
    BadInput("--external and --worker exclude each other");
  }
  for (const char* flag : {"strings", "share"}) {
    if (IsGiven(flag) && !FLAGS_worker) {
      BadInput(std::string("--") + flag + " is of --worker");
    }
  }
  if (FLAGS_external && (FLAGS_paper || !FLAGS_recover.empty())) {
    BadInput(
        "--external cannot go with --paper or --recover, whose targets "
        "come from runs");
  }
  if (FLAGS_recovery && !FLAGS_paper) {
    BadInput(
        "--recovery is of --paper; --recover=VALUES is for any parameters");
  }
  if (FLAGS_paper) {
    for (const char* flag : {"search",
                             "target",
                             "target_energies",
                             "weights",
                             "recover",
                             "ensemble",
                             "method",
                             "budget"}) {
      if (IsGiven(flag)) {
        BadInput(std::string("--") + flag +
                 " cannot go with --paper, which sets what sec. 8.2 says");
      }
    }
    FLAGS_ensemble = "paper";
    if (!IsGiven("gradient")) FLAGS_gradient = true;
    if (!IsGiven("profile")) FLAGS_profile = true;
    if (!IsGiven("alternatives")) FLAGS_alternatives = true;
    if (!IsGiven("recovery")) FLAGS_recovery = true;
  }
  if (FLAGS_smoke) {
    const auto set = [](const char* flag, const char* value) {
      if (!IsGiven(flag)) {
        gflags::SetCommandLineOptionWithMode(
            flag, value, gflags::SET_FLAGS_DEFAULT);
      }
    };
    set("particles", "20");
    set("duration", "0.2");
    set("method",
        "genetic_algorithm:population=8,generations=4,parents=2,restart=3");
    set("most_runs", "6");
    set("winners", "6");
    set("fresh", "6");
    set("gradient_runs", "3");
    set("gradient_budget", "40");
    set("profile_points", "3");
    set("profile_budget", "6");
    set("repeats", "1");
  }
}

}  // namespace granopt::identify
