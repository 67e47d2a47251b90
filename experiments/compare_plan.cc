#include "experiments/compare_plan.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <string>

#include "experiments/compare_flags.h"
#include "experiments/preparation.h"
#include "experiments/report_text.h"
#include "experiments/run.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

constexpr double kFig2Phi = 0.8389;
// Of a run with --paper: more than ten times what the slowest method there
// took.
constexpr int kPaperEvaluations = 100000;

constexpr char kTable1Solvers[] =
    "L-BFGS@lbfgs:memory=5;"
    "P-L-BFGS (A = 0)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=0;"
    "P-L-BFGS (A = 3)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=3;"
    "FR-CG@ncg:beta=fr;"
    "P-FR-CG@ncg:beta=fr,preconditioner=laplacian";
constexpr char kFig2Solvers[] =
    "L-BFGS@lbfgs:memory=5;"
    "P-L-BFGS (A = 0)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=0;"
    "FR-CG@ncg:beta=fr;"
    "P-FR-CG@ncg:beta=fr,preconditioner=laplacian";

// The paper has the first two; beside them FR-CG, second-order methods, `auto`.
constexpr char kFig7Solvers[] =
    "L-BFGS@lbfgs:memory=5;"
    "P-L-BFGS (A = 0)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=0;"
    "FR-CG@ncg:beta=fr;newton;interior_point;auto";

void AddAssumptions(Plan* plan) {
  ComparisonSetup& setup = plan->setup;
  auto& rows = setup.assumptions;
  const double alpha = plan->scene.energy.alpha;
  rows.emplace_back("exponent alpha",
                    Neat(alpha) + (IsGiven("alpha") ? ", given by --alpha"
                                   : alpha == 2.0   ? ", the harmonic law"
                                                    : ", the input's own"));
  std::string levels;
  for (const Level& level : setup.levels) {
    levels += (levels.empty() ? "" : ", ") + Neat(level.value) +
              (level.absolute ? " absolute" : " mean forces");
  }
  rows.emplace_back(
      "tolerance",
      "max|g| <= " + levels +
          (setup.levels.size() > 1 ? "; all from the runs to the first" : ""));
  rows.emplace_back("units of an absolute tolerance",
                    "k = 1, L = V^(1/d) = 1: max|g| / (k L^(alpha-1))");
  rows.emplace_back("memory m, line search, r_nn, mu",
                    "the methods' options; what is not given has its default "
                    "(--list_solvers)");
  rows.emplace_back("meaning of n_iter",
                    "accepted steps; evaluations of E and its gradient beside "
                    "them");
  const std::string random =
      "uniform random centres, radii 1 : 1.4 half and half";
  if (setup.paper == "fig2") {
    rows.emplace_back(
        "the unjammed state",
        !FLAGS_input.empty()
            ? "the input " + FLAGS_input
            : random +
                  Format("; relaxed at phi = %g, radii grown to phi in "
                         "steps of %g, relaxed after each, by ",
                         Preparation::kCompressedFrom,
                         Preparation::kStep) +
                  plan->prepare->name());
    rows.emplace_back("phi of the caption", "that before the radii grow");
  } else if (setup.paper == "fig7") {
    rows.emplace_back("the packings",
                      !FLAGS_input.empty()
                          ? "the input " + FLAGS_input
                          : random +
                                "; relaxed above jamming, followed down to "
                                "phi_J, compressed from distance to distance");
    rows.emplace_back("strains of 1e-6 to 1e-5 in 10 steps",
                      "ten steps of 1e-6, each from the state before");
    rows.emplace_back("the methods",
                      "the paper has the first two; its error bars are "
                      "standard deviations here");
  } else {
    rows.emplace_back("the over-jammed state",
                      !FLAGS_input.empty()
                          ? "the input " + FLAGS_input
                          : random +
                                Format("; relaxed at phi to %g mean forces by ",
                                       Preparation::kTolerance) +
                                plan->prepare->name());
    rows.emplace_back("random perturbation O(1e-4)",
                      "each coordinate by a uniform number in +-1e-4 L");
    rows.emplace_back("shear strain",
                      "cell and centres deformed affinely, then relaxed in the "
                      "deformed periodic cell");
  }
  if (FLAGS_max_evaluations > 0) {
    rows.emplace_back(
        "end of a method that stalls",
        "after " + std::to_string(FLAGS_max_evaluations) + " evaluations");
  }
  rows.emplace_back(
      "time",
      "CPU seconds of this machine; compare ratios to " + setup.baseline);
}

// What --paper and --smoke say where the user does not.
void ApplyPresets(ComparisonSetup* setup) {
  setup->paper = FLAGS_paper;
  if (!FLAGS_paper.empty()) {
    const bool table1 = FLAGS_paper == "table1";
    const bool fig7 = FLAGS_paper == "fig7";
    if (!table1 && !fig7 && FLAGS_paper != "fig2") {
      BadInput("--paper=" + FLAGS_paper + " must be table1, fig2 or fig7");
    }
    if (!IsGiven("solvers")) {
      FLAGS_solvers = table1 ? kTable1Solvers
                      : fig7 ? kFig7Solvers
                             : kFig2Solvers;
    }
    if (!IsGiven("cases")) {
      FLAGS_cases = table1 ? "growth,simple_shear,random"
                    : fig7 ? "near_jamming=1e-6"
                           : "fig2";
    }
    if (fig7) {
      if (!IsGiven("distances")) {
        FLAGS_distances =
            FLAGS_smoke ? "1e-2,1e-3,1e-4" : "1e-2,1e-3,1e-4,1e-5,1e-6";
      }
      if (!IsGiven("steps")) FLAGS_steps = FLAGS_smoke ? 2 : 10;
      // Set as by the user: IsGiven() decides whether there is a list.
      if (!IsGiven("seeds") && !IsGiven("seed") && FLAGS_input.empty()) {
        gflags::SetCommandLineOption("seeds", FLAGS_smoke ? "1-2" : "1-10");
      }
      if (!IsGiven("repetitions")) FLAGS_repetitions = 1;
    }
    if (!IsGiven("particles") && FLAGS_input.empty() && !FLAGS_smoke) {
      FLAGS_particles = 4096;
    }
    if (!IsGiven("max_evaluations")) FLAGS_max_evaluations = kPaperEvaluations;
    setup->levels = {{true, 1e-13}};
    // An absolute one would be four digits at 1e-2 and none at 1e-6.
    if (fig7) setup->levels = {{false, 1e-7}};
    if (table1) {
      setup->levels.push_back({true, 1e-10});
      setup->levels.push_back({false, 1e-6});
    }
  }
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("repetitions")) FLAGS_repetitions = 2;
    if (!IsGiven("distances")) FLAGS_distances = "1e-2,1e-3,1e-4";
  }
  Level level;
  if (GivenLevel(&level) || setup->levels.empty()) setup->levels = {level};
}

// Flags that need nothing else to be judged by.
void CheckFlags() {
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  CheckPositive("phi", FLAGS_phi);
  CheckPositive("tolerance", FLAGS_tolerance);
  CheckRange("absolute_tolerance", FLAGS_absolute_tolerance, 0.0, 1e300);
  CheckLimits();
  CheckRange("prepare_evaluations", FLAGS_prepare_evaluations, 0.0, 9e18);
  CheckPositive("shear", FLAGS_shear);
  CheckRange("shear", FLAGS_shear, 0.0, 1.0);
  CheckRange("steps", FLAGS_steps, 1.0, 1e5);
}

// The cases and what they need of the packings.
void MakeCases(Plan* plan) {
  ComparisonSetup& setup = plan->setup;
  std::string error;
  Require(ParseDistances(FLAGS_distances, &plan->distances, &error),
          "distances",
          error);
  Require(ParseCases(
              FLAGS_cases, plan->distances, FLAGS_shear, &setup.cases, &error),
          "cases",
          error);
  std::sort(plan->distances.begin(), plan->distances.end());
  plan->phi = plan->phi_fig2 = FLAGS_phi;
  bool all_fig2 = true, any_near = false;
  for (const Case& c : setup.cases) {
    if (c.kind == "user" && FLAGS_input.empty()) {
      BadInput("--cases: user is the packing of --input, which is not given");
    }
    if (c.kind == "start" && !FLAGS_input.empty()) {
      BadInput("--cases: start is a random start and cannot go with --input");
    }
    all_fig2 = all_fig2 && c.kind == "fig2";
    any_near = any_near || c.kind == "near_jamming";
    if (c.kind == "fig2" && FLAGS_input.empty() && !IsGiven("phi")) {
      if (FLAGS_dimension != 2) BadInput("--cases: fig2 in 3D needs --phi");
      plan->phi_fig2 = kFig2Phi;
    }
  }
  if (IsGiven("steps") && !any_near) {
    BadInput("--steps is of the case near_jamming, which --cases lacks");
  }
  setup.steps = any_near ? FLAGS_steps : 1;
  if (all_fig2) plan->phi = plan->phi_fig2;
}

// A load that makes a packing impossible is found before any work.
void CheckLoads(const Plan& plan) {
  for (const Case& c : plan.setup.cases) {
    Scene loaded;
    loaded.packing = plan.scene.packing;
    loaded.energy = plan.scene.energy;
    loaded.origin = plan.scene.origin + ", " + c.id;
    ApplyLoad(LoadOf(c), plan.setup.seeds[0], &loaded.packing);
    CheckScene(loaded);
  }
}

// What all runs have in common, for reports.
void Describe(Plan* plan) {
  ComparisonSetup& setup = plan->setup;
  const Packing& packing = plan->scene.packing;
  const double alpha = plan->scene.energy.alpha;
  setup.what = FLAGS_input.empty()
                   ? Format("%d %s, phi = %s, alpha = %g",
                            packing.size(),
                            packing.dimension() == 2 ? "discs" : "spheres",
                            Neat(plan->phi).c_str(),
                            alpha)
                   : Format("%s (%s), phi = %.6g, alpha = %g",
                            granopt::Describe(packing).c_str(),
                            FLAGS_input.c_str(),
                            packing.PackingFraction(),
                            alpha);
  setup.conditions = "prepared by " + plan->prepare->name() +
                     "; zero pressure " + Neat(FLAGS_zero_pressure) +
                     LimitsText("");
  const bool any_near =
      std::any_of(setup.cases.begin(), setup.cases.end(), [](const Case& c) {
        return c.kind == "near_jamming";
      });
  if (any_near && FLAGS_prepare_evaluations > 0) {
    setup.conditions += "; steps prepared in at most " +
                        std::to_string(FLAGS_prepare_evaluations) +
                        " evaluations";
  }
}

// How many there will be, unless a chain ends early.
int Runs(const Plan& plan) {
  const ComparisonSetup& setup = plan.setup;
  std::size_t runs = 0;
  for (const Case& c : setup.cases) {
    runs += SeedsOf(setup, c).size() * setup.methods.size() *
            setup.repetitions * StepsOf(setup, c);
  }
  return static_cast<int>(runs);
}

}  // namespace

std::vector<std::uint64_t> SeedsOf(const ComparisonSetup& setup,
                                   const Case& c) {
  if (FLAGS_input.empty() || c.kind == "random") return setup.seeds;
  return {setup.seeds[0]};
}

bool GivenLevel(Level* level) {
  if (IsGiven("absolute_tolerance") && FLAGS_absolute_tolerance > 0.0) {
    *level = {true, FLAGS_absolute_tolerance};
    return true;
  }
  *level = {false, FLAGS_tolerance};
  return IsGiven("tolerance");
}

void SetBaselineAndReference(ComparisonSetup* setup) {
  if (setup->baseline.empty()) setup->baseline = setup->methods[0].label;
  SetBaseline(setup->methods, &setup->baseline);
  SetReference(setup->methods, &setup->reference);
}

Plan MakePlan() {
  Plan plan;
  ComparisonSetup& setup = plan.setup;
  CheckFlags();
  ApplyPresets(&setup);
  CheckRange("repetitions", FLAGS_repetitions, 1.0, 1e6);
  setup.repetitions = FLAGS_repetitions;
  setup.methods = MethodsOfFlags(&plan.solvers);
  plan.prepare = PrepareSolverOfFlags();
  MakeCases(&plan);
  setup.seeds = SeedsOfFlags();
  SetBaselineAndReference(&setup);
  plan.scene = MakeScene(plan.phi, setup.seeds[0]);
  CheckLoads(plan);
  Describe(&plan);
  if (!setup.paper.empty()) AddAssumptions(&plan);
  return plan;
}

void PrintPlan(const Plan& plan) {
  const ComparisonSetup& setup = plan.setup;
  std::printf("compare   %s\n", setup.what.c_str());
  std::size_t width = 0;
  for (const Method& method : setup.methods) {
    width = std::max(width, method.label.size());
  }
  const char* head = "methods";
  for (const Method& method : setup.methods) {
    std::string line = method.label;
    if (method.label != method.spec) {
      line +=
          std::string(width - method.label.size(), ' ') + "  " + method.spec;
    }
    std::printf("%-9s %s%s\n",
                head,
                line.c_str(),
                method.label == setup.baseline ? "  (baseline)" : "");
    head = "";
  }
  std::printf(
      "runs      %d: %s x %s x %s%s x %s; a repetition\n"
      "          runs all methods on a packing before the next one and "
      "begins with another method\n",
      Runs(plan),
      Plural(setup.methods.size(), "method").c_str(),
      Plural(setup.cases.size(), "case").c_str(),
      Plural(setup.seeds.size(), "seed").c_str(),
      setup.steps > 1 ? (" x " + Plural(setup.steps, "step")).c_str() : "",
      Plural(setup.repetitions, "repetition").c_str());
  std::fflush(stdout);
}

}  // namespace granopt
