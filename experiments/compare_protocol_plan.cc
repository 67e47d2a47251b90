#include "experiments/compare_protocol_plan.h"

#include <cstdio>
#include <string>

#include "experiments/compare_flags.h"
#include "experiments/run.h"
#include "experiments/tabular.h"

DEFINE_string(protocol,
              "",
              "compare over a whole protocol instead: jamming (Algorithm 1) or "
              "shear (quasistatic pure shear)");
DEFINE_string(tolerances,
              "",
              "of a protocol: tolerances separated by commas, each with every "
              "method; default: --tolerance (jamming: 1e-8)");
DEFINE_double(phi_init,
              0.0,
              "jamming: packing fraction of the start; default 0.80 (discs), "
              "0.58 (spheres)");
DEFINE_double(dphi, 1e-3, "jamming: increment delta phi of the growth");
DEFINE_double(epsilon, 1e-6, "jamming: accuracy of the bisection");
DEFINE_double(strain, 0.02, "shear: pure shear strain at the end");
DEFINE_int32(strain_steps, 200, "shear: equal increments of the strain");

namespace granopt {
namespace {

// A relaxation of a protocol gives up after that many evaluations unless
// --max_evaluations says other: one that stalls would never end.
constexpr int kProtocolEvaluations = 200000;
constexpr double kShearPhi = 0.86;
constexpr double kShearPhi3d = 0.70;

// Flags of the other protocol and of ordinary comparisons.
void RefuseFlagsOfOthers(bool jamming) {
  RefuseFlags({"cases",
               "absolute_tolerance",
               "distances",
               "shear",
               "steps",
               "prepare_evaluations",
               "paper"},
              "cannot go with --protocol");
  if (jamming) {
    RefuseFlags({"strain", "strain_steps"}, "is of --protocol=shear");
    RefuseFlags({"phi"},
                "is of --protocol=shear; --phi_init is the start of "
                "Algorithm 1");
  } else {
    RefuseFlags({"phi_init", "dphi", "epsilon"}, "is of --protocol=jamming");
  }
}

// What --smoke and a protocol say where the user does not; checked.
void SetAndCheckFlags(bool jamming) {
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("dphi")) FLAGS_dphi = 5e-3;
    if (!IsGiven("epsilon")) FLAGS_epsilon = 1e-4;
    if (!IsGiven("strain_steps")) FLAGS_strain_steps = 10;
  }
  if (!IsGiven("repetitions")) FLAGS_repetitions = 1;
  if (!IsGiven("max_evaluations")) FLAGS_max_evaluations = kProtocolEvaluations;
  CheckLimits();
  CheckRange("repetitions", FLAGS_repetitions, 1.0, 1e6);
  CheckRange("phi_init", FLAGS_phi_init, 0.0, 4.0);
  CheckPositive("dphi", FLAGS_dphi);
  CheckRange("dphi", FLAGS_dphi, 0.0, 1.0);
  CheckPositive("epsilon", FLAGS_epsilon);
  CheckRange("epsilon", FLAGS_epsilon, 0.0, 1.0);
  CheckPositive("strain", FLAGS_strain);
  CheckRange("strain", FLAGS_strain, 0.0, 10.0);
  CheckRange("strain_steps", FLAGS_strain_steps, 1.0, 1e6);
  CheckPositive("phi", FLAGS_phi);
  // A state that close to jamming cannot be told from one at it.
  if (jamming && !IsGiven("zero_pressure")) {
    FLAGS_zero_pressure = 1e-3 * FLAGS_epsilon;
  }
}

std::vector<double> Tolerances(bool jamming) {
  std::vector<double> tolerances;
  if (IsGiven("tolerances")) {
    if (IsGiven("tolerance")) {
      BadInput("--tolerance cannot go with --tolerances");
    }
    std::string error;
    Require(ParsePositives(FLAGS_tolerances, &tolerances, &error),
            "tolerances",
            error);
    return tolerances;
  }
  CheckPositive("tolerance", FLAGS_tolerance);
  if (jamming && !IsGiven("tolerance")) FLAGS_tolerance = 1e-8;
  return {FLAGS_tolerance};
}

// What all runs have in common, for reports.
void Describe(ProtocolPlan* plan) {
  ProtocolSetup& setup = plan->setup;
  const Packing& packing = plan->scene.packing;
  setup.what = FLAGS_input.empty()
                   ? Format("%d %s",
                            packing.size(),
                            packing.dimension() == 2 ? "discs" : "spheres")
                   : granopt::Describe(packing) + " (" + FLAGS_input + ")";
  setup.what += Format(", alpha = %g", plan->scene.energy.alpha);
  if (plan->jamming()) {
    setup.epsilon = FLAGS_epsilon;
    setup.what += Format(", from phi = %s by %s, epsilon = %s",
                         Neat(plan->phi_init).c_str(),
                         Neat(FLAGS_dphi).c_str(),
                         Neat(FLAGS_epsilon).c_str());
  } else {
    setup.strain = FLAGS_strain;
    setup.strain_steps = FLAGS_strain_steps;
    setup.what +=
        Format(", phi = %s, pure shear to %s in %d steps",
               Neat(FLAGS_input.empty() ? plan->phi : packing.PackingFraction())
                   .c_str(),
               Neat(FLAGS_strain).c_str(),
               FLAGS_strain_steps);
  }
  setup.conditions =
      (plan->jamming() ? "branches followed by " : "prepared by ") +
      plan->prepare->name() + "; zero pressure " + Neat(FLAGS_zero_pressure) +
      LimitsText(" a relaxation");
}

}  // namespace

ProtocolPlan MakeProtocolPlan() {
  ProtocolPlan plan;
  ProtocolSetup& setup = plan.setup;
  setup.protocol = FLAGS_protocol;
  if (setup.protocol != kJammingProtocol && setup.protocol != kShearProtocol) {
    BadInput("--protocol=" + setup.protocol + " must be jamming or shear");
  }
  const bool jamming = plan.jamming();
  RefuseFlagsOfOthers(jamming);
  SetAndCheckFlags(jamming);
  setup.repetitions = FLAGS_repetitions;
  setup.methods = MethodsOfFlags(&plan.solvers);
  plan.prepare = PrepareSolverOfFlags();
  setup.tolerances = Tolerances(jamming);
  setup.seeds = SeedsOfFlags();
  if (!FLAGS_input.empty() && setup.seeds.size() > 1) {
    BadInput("--seeds are of random starts and cannot go with --input");
  }
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  setup.baseline = setup.methods[0].label;
  SetBaseline(setup.methods, &setup.baseline);
  setup.reference = setup.baseline;
  SetReference(setup.methods, &setup.reference);
  const bool flat = FLAGS_dimension != 3;
  plan.phi_init = FLAGS_phi_init > 0.0 ? FLAGS_phi_init : flat ? 0.80 : 0.58;
  plan.phi = IsGiven("phi") ? FLAGS_phi : flat ? kShearPhi : kShearPhi3d;
  plan.scene = MakeScene(jamming ? plan.phi_init : plan.phi, setup.seeds[0]);
  if (jamming && !FLAGS_input.empty() && !IsGiven("phi_init")) {
    plan.phi_init = plan.scene.packing.dimension() == 3 ? 0.58 : 0.80;
  }
  Describe(&plan);
  return plan;
}

void PrintPlan(const ProtocolPlan& plan) {
  const ProtocolSetup& setup = plan.setup;
  std::printf("compare   %s: %s\n", setup.protocol.c_str(), setup.what.c_str());
  const char* head = "methods";
  for (const Method& method : setup.methods) {
    std::printf("%-9s %s%s%s\n",
                head,
                method.label.c_str(),
                method.label == method.spec ? "" : ("  " + method.spec).c_str(),
                method.label == setup.baseline ? "  (baseline)" : "");
    head = "";
  }
  std::string tolerances;
  for (const double tolerance : setup.tolerances) {
    tolerances += (tolerances.empty() ? "" : ", ") + Neat(tolerance);
  }
  std::printf(
      "runs      %zu: %zu methods x tolerances %s x %zu seeds x %d "
      "repetitions; each a whole protocol\n",
      setup.methods.size() * setup.tolerances.size() * setup.seeds.size() *
          setup.repetitions,
      setup.methods.size(),
      tolerances.c_str(),
      setup.seeds.size(),
      setup.repetitions);
  std::fflush(stdout);
}

}  // namespace granopt
