// scaling: how pressure, moduli and coordination grow with the distance from
// jamming (Wang & Zhang, sec. 4.2, Figs 4-6).
//
//   scaling --particles=N --seed=S --alpha=2 --distances=1e-6,...,1e-2
//           --spectra=1e-6,1e-4,1e-2 --modes=1 --out=DIR      one packing
//   scaling --seeds=1-10 --sizes=256,1024 --alphas=2,2.5 --jobs=2 --resume
//           --out=DIR                              many, as processes of their
//           own, with exponents and a finite-size collapse; --paper: N = 4096
//
// A random start is relaxed, followed down to its jamming point, which gives
// phi_J, and compressed from distance to distance. Moduli are those of linear
// response, exact for each state. prepared_*.xyz in --out that were made in the
// same way are used again.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "experiments/certificate.h"
#include "experiments/children.h"
#include "experiments/ensemble.h"
#include "experiments/moduli.h"
#include "experiments/preparation.h"
#include "experiments/run.h"
#include "experiments/scaling_laws.h"
#include "experiments/scene.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"
#include "granular/linear_response.h"
#include "granular/quad_residual.h"
#include "granular/vibrations.h"

DECLARE_string(seeds);
DECLARE_string(solver);

DEFINE_string(distances,
              "1e-6,3e-6,1e-5,3e-5,1e-4,3e-4,1e-3,3e-3,1e-2",
              "distances phi - phi_J");
DEFINE_string(alphas,
              "2,2.5",
              "with --seeds: exponents of the contact energy (instead of "
              "--alpha)");
DEFINE_string(spectra,
              "",
              "distances, some of --distances, at which the modes of vibration "
              "are computed: all of them up to 1024 grains, else the lowest "
              "100");
DEFINE_double(phi,
              0.0,
              "packing fraction at which random starts are relaxed, above "
              "jamming; default 0.86 (discs), 0.68 (spheres)");
DEFINE_double(least_size,
              10.0,
              "with --seeds: exponents are fitted from the distance on where P "
              "N^2 reaches this, P = (p / (k r^(alpha-d)))^(1/(alpha-1))");
DEFINE_double(most_distance, 1e-2, "with --seeds: and up to this distance");
DEFINE_bool(paper,
            false,
            "the paper's system, N = 4096, with 256 and 1024 beside it, seeds "
            "1 to 10");
DEFINE_bool(resume,
            false,
            "with --seeds: do not run again what is complete in --out (states "
            "that were made are used again in any case)");

namespace granopt {
namespace {

constexpr char kSpectrumHead[] =
    "particles,seed,alpha,asked,grains,complete,frequency,participation\n";

struct Plan {
  std::vector<double> distances, spectra;
};

Plan CheckFlags() {
  Plan plan;
  std::string error;
  if (!ParsePositives(FLAGS_distances, &plan.distances, &error)) {
    BadInput("--distances: " + error);
  }
  for (const double distance : plan.distances) {
    if (!(distance >= 1e-12 && distance <= 0.5)) {
      BadInput(Format("--distances: %g must be in [1e-12, 0.5]", distance));
    }
  }
  std::sort(plan.distances.begin(), plan.distances.end());
  if (!FLAGS_spectra.empty() &&
      !ParsePositives(FLAGS_spectra, &plan.spectra, &error)) {
    BadInput("--spectra: " + error);
  }
  for (const double distance : plan.spectra) {
    if (std::find(plan.distances.begin(), plan.distances.end(), distance) ==
        plan.distances.end()) {
      BadInput(Format("--spectra: %g is none of --distances", distance));
    }
  }
  CheckCertificateFlags();
  CheckRange("phi", FLAGS_phi, 0.0, 4.0);
  CheckPositive("least_size", FLAGS_least_size);
  CheckPositive("most_distance", FLAGS_most_distance);
  if (FLAGS_phi == 0.0) FLAGS_phi = FLAGS_dimension == 3 ? 0.68 : 0.86;
  return plan;
}

// ------------------------------------------------------------ one packing

// False with one line in `error` if moduli are not defined.
bool MeasureState(const Packing& packing,
                  const ContactEnergyOptions& law,
                  double asked,
                  ScalingState* state,
                  Json* json,
                  std::string* error) {
  Relaxation as_it_is;
  if (!MeasureAsItIs(packing, law, &as_it_is, error)) BadInput(*error);
  const Observables& o = as_it_is.observables;
  const int d = packing.dimension();
  state->particles = packing.size();
  state->seed = static_cast<double>(FLAGS_seed);
  state->alpha = law.alpha;
  state->dimension = d;
  state->asked = asked;
  state->phi_j = std::strtod(packing.attributes.at("phi_j").c_str(), nullptr);
  state->distance = o.packing_fraction - state->phi_j;
  state->pressure = o.pressure;
  state->reduced = std::pow(
      o.pressure /
          (law.stiffness * std::pow(packing.MeanRadius(), law.alpha - d)),
      1.0 / (law.alpha - 1.0));
  state->coordination = o.coordination;
  state->excess_contacts = o.rigid_contacts - o.isostatic_contacts;
  state->excess =
      o.rigid_grains > 0 ? 2.0 * state->excess_contacts / o.rigid_grains : 0.0;
  state->rigid_grains = o.rigid_grains;
  state->rattlers = o.rattlers;
  state->fabric_isotropic = o.fabric_parts.isotropic;
  state->fabric_deviatoric = o.fabric_parts.deviatoric;
  state->stress_deviatoric = o.stress_parts.deviatoric;
  state->mean_force = o.mean_force;
  state->mean_overlap = o.mean_overlap;
  if (o.mean_overlap > 0.0) {
    state->stiffness = (law.alpha - 1.0) * o.mean_force / o.mean_overlap;
  }
  QuadResidual judge;
  if (!EvaluateQuad(packing, law, nullptr, &judge, error)) BadInput(*error);
  state->residual = judge.Relative();
  const ElasticResponse r = ComputeElasticResponse(packing, law);
  if (!r.found) {
    *error = r.message;
    return false;
  }
  state->bulk = r.bulk_growth;
  state->bulk_box = r.bulk_box;
  state->bulk_affine = r.bulk_affine;
  state->shear = r.shear;
  state->shear_mean = r.shear_mean;
  state->shear_least = r.shear_principal[0];
  state->shear_affine = r.shear_affine;
  *json = {{"asked", asked},
           {"distance", state->distance},
           {"pressure", o.pressure},
           {"coordination", o.coordination},
           {"excess_contacts", o.rigid_contacts - o.isostatic_contacts},
           {"moduli", ModuliJson(r)}};
  return true;
}

// The rows of spectrum.csv, or false with a line in `error`.
bool SpectrumRows(const Packing& packing,
                  const ContactEnergyOptions& law,
                  double asked,
                  std::string* rows,
                  std::string* error) {
  const Vibrations all = ComputeVibrations(packing, law, VibrationOptions());
  if (!all.found) {
    *error = all.message;
    return false;
  }
  for (const Vibration& mode : all.modes) {
    *rows += Format("%d,%llu,%g,%g,%d,%d,%.9g,%.9g\n",
                    packing.size(),
                    static_cast<unsigned long long>(FLAGS_seed),
                    law.alpha,
                    asked,
                    all.grains,
                    all.complete ? 1 : 0,
                    mode.frequency,
                    mode.participation);
  }
  return true;
}

void PrintTask(const Scene& scene, const Plan& plan) {
  std::printf("scaling   %s (%s), alpha = %g\n",
              Describe(scene.packing).c_str(),
              scene.origin.c_str(),
              scene.energy.alpha);
  std::printf(
      "          %s, down to its jamming point, then up to phi_J + %s ... %s\n",
      FLAGS_input.empty()
          ? Format("relaxed at phi = %g", FLAGS_phi).c_str()
          : Format("phi = %.6f", scene.packing.PackingFraction()).c_str(),
      Neat(plan.distances.front()).c_str(),
      Neat(plan.distances.back()).c_str());
  std::printf("          method %s; moduli by linear response\n",
              scene.solver->name().c_str());
  std::fflush(stdout);
}

// What was measured on the packings of RunOne().
struct Measured {
  std::vector<ScalingState> states;
  Json json = Json::array();
  std::string spectrum = kSpectrumHead;
  std::vector<std::string> failures;
};

Measured MeasureStates(const std::vector<Packing>& packings,
                       const ContactEnergyOptions& law,
                       const Plan& plan) {
  Measured all;
  Progress progress;
  for (std::size_t k = 0; k < packings.size(); ++k) {
    const double asked = plan.distances[k];
    ScalingState state;
    Json json;
    std::string why;
    if (!MeasureState(packings[k], law, asked, &state, &json, &why)) {
      all.failures.push_back("phi_J + " + Neat(asked) + ": " + why);
      continue;
    }
    all.states.push_back(state);
    all.json.push_back(json);
    if (std::find(plan.spectra.begin(), plan.spectra.end(), asked) ==
        plan.spectra.end()) {
      continue;
    }
    if (progress.Due()) {
      progress.Show("modes of vibration at phi_J + " + Neat(asked));
    }
    if (!SpectrumRows(packings[k], law, asked, &all.spectrum, &why)) {
      all.failures.push_back("modes at phi_J + " + Neat(asked) + ": " + why);
    }
  }
  return all;
}

void PrintStates(const std::vector<ScalingState>& states, int d) {
  std::vector<std::vector<std::string>> rows = {{"phi - phi_J",
                                                 "pressure",
                                                 "B (12)",
                                                 "B affine",
                                                 "G (13)",
                                                 "G mean",
                                                 "G least",
                                                 "G affine",
                                                 "z - z_iso",
                                                 "rattlers",
                                                 "residual"}};
  for (const ScalingState& s : states) {
    rows.push_back({Format("%.6g", s.distance),
                    Format("%.4e", s.pressure),
                    Format("%.4e", s.bulk),
                    Format("%.4e", s.bulk_affine),
                    Format("%.4e", s.shear),
                    Format("%.4e", s.shear_mean),
                    Format("%.4e", s.shear_least),
                    Format("%.4e", s.shear_affine),
                    Format("%.4f", s.excess),
                    Format("%.0f", s.rattlers),
                    Format("%.0e", s.residual)});
  }
  std::printf("\n  phi_J = %.12f\n\n%s\n",
              states.empty() ? 0.0 : states[0].phi_j,
              Grid(rows, 0, false).c_str());
  std::printf(
      "  energies a %s; G least: of all shears at fixed volume; z_iso = %d - "
      "%d/N'; residuals in mean forces, in quadruple precision\n",
      d == 2 ? "area" : "volume",
      2 * d,
      2 * (d - 1));
}

int RunOne(const Plan& plan) {
  const Scene scene = MakeSceneWithSolver(FLAGS_phi);
  const int d = scene.packing.dimension();
  PrintTask(scene, plan);
  Output output;
  output.Create(FLAGS_out,
                WithCertificateFiles({"summary.json",
                                      "states.csv",
                                      "spectrum.csv",
                                      "packing.xyz",
                                      "contacts.csv",
                                      "laws.svg",
                                      "laws.png",
                                      "vibrations.svg",
                                      "vibrations.png"}));
  Preparation preparation(scene, *scene.solver, FLAGS_phi, &output);
  std::vector<Packing> packings;
  std::string error;
  Json json;
  json["dimension"] = d;
  json["particles"] = scene.packing.size();
  json["alpha"] = scene.energy.alpha;
  json["solver"] = scene.solver->name();
  json["schema"] = "granopt/scaling/1";
  const bool found =
      preparation.NearJamming(FLAGS_seed, plan.distances, &packings, &error);
  preparation.ClearProgress();
  if (!found) {
    json["found"] = false;
    json["error"] = error;
    json["provenance"] = Provenance();
    output.WriteJson("summary.json", json);
    std::fprintf(stderr, "scaling: %s\n", error.c_str());
    return kNotConverged;
  }

  json["found"] = true;
  const Measured measured = MeasureStates(packings, scene.energy, plan);
  const std::vector<ScalingState>& states = measured.states;
  json["states"] = measured.json;
  json["failures"] = measured.failures;
  if (!states.empty()) json["phi_j"] = states[0].phi_j;

  output.Write("states.csv", StatesCsv(states));
  if (!plan.spectra.empty()) output.Write("spectrum.csv", measured.spectrum);
  // The state nearest to jamming.
  std::string certificate;
  {
    Relaxation nearest;
    if (!MeasureAsItIs(packings[0], scene.energy, &nearest, &error)) {
      BadInput(error);
    }
    output.WriteRelaxation(nearest, scene.energy);
    FLAGS_zero_pressure =
        std::min(FLAGS_zero_pressure, 1e-3 * plan.distances[0]);
    certificate = PublishCertificate(
        nearest.packing, scene.energy, "contacts.csv", &output, &json);
  }
  json["provenance"] = Provenance();
  output.WriteJson("summary.json", json);
  if (!states.empty()) {
    output.Plot({"laws", output.Path("states.csv"), output.Path("laws")},
                {"laws.svg", "laws.png"});
  }
  if (!plan.spectra.empty()) {
    output.Plot(
        {"vibrations", output.Path("spectrum.csv"), output.Path("vibrations")},
        {"vibrations.svg", "vibrations.png"});
  }

  PrintStates(states, d);
  for (const std::string& line : measured.failures) {
    std::printf("  without moduli: %s\n", line.c_str());
  }
  if (!certificate.empty()) {
    std::printf("\n  at phi_J + %s: %s",
                Neat(plan.distances[0]).c_str(),
                certificate.c_str());
  }
  output.PrintFiles();
  return measured.failures.empty() ? kConverged : kNotConverged;
}

// ----------------------------------------------------------- many packings

std::string Interval(const Exponent& e) {
  if (e.low == 0.0 && e.high == 0.0) return "-";
  return Format("%.3f ... %.3f", e.low, e.high);
}

std::string Verdict(const Exponent& e) {
  if (e.distances < 2) return "no fit";
  const double apart = e.value - e.paper;
  if (e.low <= e.paper && e.paper <= e.high && e.low < e.high) {
    return "agrees: in the interval";
  }
  if (std::abs(apart) <= 0.05)
    return Format("%+.3f: to the digit given", apart);
  return Format("%+.3f: differs", apart);
}

// What the runs left behind.
struct Collected {
  std::vector<ScalingState> states;
  std::string spectrum = kSpectrumHead;
  std::vector<std::string> failures;
};

Collected Collect(const std::vector<Child>& children,
                  const std::vector<ChildResult>& results,
                  const Output& output) {
  Collected all;
  for (std::size_t k = 0; k < children.size(); ++k) {
    const std::string& name = children[k].name;
    std::string failure = results[k].failure;
    const Json& json = results[k].summary;
    if (failure.empty() && !json.value("found", false)) {
      failure = json.value("error", "no result");
    }
    std::string text, error;
    if (failure.empty()) {
      const std::string path = output.Path(name + "/states.csv");
      if (!ReadFile(path, &text, &error) ||
          !ReadStates(text, path, &all.states, &error)) {
        failure = error;
      }
      for (const Json& line : json.value("failures", Json::array())) {
        all.failures.push_back(name + ": " + line.get<std::string>());
      }
    }
    if (!failure.empty()) {
      all.failures.push_back(name + ": " + failure);
      continue;
    }
    if (ReadFile(output.Path(name + "/spectrum.csv"), &text, &error)) {
      all.spectrum +=
          text.substr(std::min(text.size(), sizeof(kSpectrumHead) - 1));
    }
  }
  return all;
}

Json ExponentsJson(const std::vector<Exponent>& exponents) {
  Json json = Json::array();
  for (const Exponent& e : exponents) {
    if (e.distances < 2) continue;
    json.push_back({{"quantity", e.quantity},
                    {"alpha", e.alpha},
                    {"particles", e.particles},
                    {"exponent", e.value},
                    {"low", e.low},
                    {"high", e.high},
                    {"from", e.from},
                    {"to", e.to},
                    {"packings", e.packings},
                    {"not_positive", e.negative},
                    {"claim", e.paper},
                    {"claimed_by", e.from_paper ? "paper" : "theory"}});
  }
  return json;
}

void PrintExponents(const std::vector<Exponent>& exponents) {
  std::vector<std::vector<std::string>> rows = {{"~ distance^exponent",
                                                 "alpha",
                                                 "grains",
                                                 "exponent",
                                                 "95 % interval",
                                                 "claim",
                                                 "window",
                                                 "packings",
                                                 "not positive",
                                                 "verdict"}};
  const auto name_of = [](const std::string& quantity) -> std::string {
    if (quantity == "pressure") return "p";
    if (quantity == "bulk") return "B (12)";
    if (quantity == "shear") return "G (13)";
    if (quantity == "shear_mean") return "G, all directions";
    return "z - z_iso";
  };
  for (const Exponent& e : exponents) {
    rows.push_back(
        {name_of(e.quantity),
         Format("%g", e.alpha),
         Format("%d", e.particles),
         e.distances < 2 ? "-" : Format("%.3f", e.value),
         Interval(e),
         Format("%g (%s)", e.paper, e.from_paper ? "paper" : "theory"),
         Neat(e.from) + " ... " + Neat(e.to),
         Format("%d", e.packings),
         Format("%d", e.negative),
         Verdict(e)});
  }
  std::printf("\n%s\n", Grid(rows, 1, false).c_str());
}

int RunMany(const Ensemble& ensemble, const Plan& plan) {
  std::vector<double> alphas;
  std::string error;
  if (!ParsePositives(FLAGS_alphas, &alphas, &error)) {
    BadInput("--alphas: " + error);
  }
  for (const double alpha : alphas) {
    if (!(alpha >= 2.0 && alpha <= 100.0)) {
      BadInput(Format("--alphas: %g must be in [2, 100]", alpha));
    }
  }
  if (IsGiven("alpha")) BadInput("with --seeds --alpha is --alphas");
  MakeSceneWithSolver(FLAGS_phi);  // checks the flags
  const std::vector<int> sizes = ensemble.Sizes();
  Output output;
  output.Create(FLAGS_out,
                {"summary.json",
                 "states.csv",
                 "spectrum.csv",
                 "exponents.csv",
                 "laws.svg",
                 "laws.png",
                 "collapse.svg",
                 "collapse.png",
                 "vibrations.svg",
                 "vibrations.png"});
  std::vector<Child> children;
  for (const double alpha : alphas) {
    for (const Ensemble::Run& run : ensemble.Runs()) {
      Child child;
      child.name = Format("a%g_n%d_seed%llu",
                          alpha,
                          run.particles,
                          static_cast<unsigned long long>(run.seed));
      child.arguments = run.arguments;
      child.arguments.push_back(Format("--alpha=%.17g", alpha));
      // Dense spectra would take longer than all the rest.
      if (run.particles > VibrationOptions().most_dense) {
        child.arguments.push_back("--spectra=");
      }
      child.weight = run.weight;
      children.push_back(child);
    }
  }
  std::printf("scaling   %zu packings: alpha = %s, seeds %s, grains",
              children.size(),
              FLAGS_alphas.c_str(),
              FLAGS_seeds.c_str());
  for (const int size : sizes) std::printf(" %d", size);
  std::printf("; %d at a time\n          each at phi_J + %s ... %s\n",
              ensemble.jobs,
              Neat(plan.distances.front()).c_str(),
              Neat(plan.distances.back()).c_str());
  bool interrupted = false;
  const std::vector<ChildResult> results = RunChildren("scaling",
                                                       children,
                                                       ensemble.jobs,
                                                       ensemble.resume,
                                                       false,
                                                       output,
                                                       &interrupted);

  const Collected all = Collect(children, results, output);

  ExponentOptions options;
  options.least_size = FLAGS_least_size;
  options.most_distance = FLAGS_most_distance;
  std::vector<Exponent> exponents;
  for (const double alpha : alphas) {
    for (const int size : sizes) {
      for (const std::string& quantity : ScalingQuantities()) {
        exponents.push_back(
            FitExponent(all.states, quantity, alpha, size, options));
      }
    }
  }
  Json json;
  json["runs"] = children.size();
  json["interrupted"] = interrupted;
  json["failures"] = all.failures;
  json["exponents"] = ExponentsJson(exponents);
  json["schema"] = "granopt/scaling_ensemble/1";
  json["provenance"] = Provenance();
  output.Write("states.csv", StatesCsv(all.states));
  output.Write("exponents.csv", ExponentsCsv(exponents));
  const bool has_spectrum = all.spectrum.size() > sizeof(kSpectrumHead);
  if (has_spectrum) output.Write("spectrum.csv", all.spectrum);
  output.WriteJson("summary.json", json);
  if (!all.states.empty()) {
    output.Plot({"laws",
                 output.Path("states.csv"),
                 output.Path("laws"),
                 "--exponents=" + output.Path("exponents.csv")},
                {"laws.svg", "laws.png"});
    if (sizes.size() > 1) {
      output.Plot(
          {"collapse", output.Path("states.csv"), output.Path("collapse")},
          {"collapse.svg", "collapse.png"});
    }
  }
  if (has_spectrum) {
    output.Plot(
        {"vibrations", output.Path("spectrum.csv"), output.Path("vibrations")},
        {"vibrations.svg", "vibrations.png"});
  }

  PrintExponents(exponents);
  std::printf(
      "  lines through the medians over packings, distances with P N^2 >= %g; "
      "intervals by resampling packings\n",
      options.least_size);
  for (const std::string& line : all.failures) {
    std::printf("  %s\n", line.c_str());
  }
  if (interrupted) std::printf("\ninterrupted: --resume goes on\n");
  output.PrintFiles();
  return all.failures.empty() && !interrupted ? kConverged : kNotConverged;
}

int Main() {
  if (FLAGS_paper || FLAGS_smoke) {
    const auto preset = [](const char* flag, const char* value) {
      if (!IsGiven(flag)) {
        gflags::SetCommandLineOption(flag, value);
      }
    };
    if (!IsGiven("seed") && FLAGS_input.empty()) {
      preset("seeds", FLAGS_smoke ? "1-4" : "1-10");
      if (!IsGiven("particles")) {
        preset("sizes", FLAGS_smoke ? "64,256" : "256,1024,4096");
      }
    }
    preset("spectra", FLAGS_smoke ? "1e-4,1e-2" : "1e-6,1e-4,1e-2");
    if (FLAGS_smoke) preset("distances", "1e-4,1e-3,3e-3,1e-2");
  }
  const Ensemble ensemble = ReadEnsembleFlags(
      {"alpha", "alphas", "paper", "smoke", "least_size", "most_distance"});
  const Plan plan = CheckFlags();
  return ensemble.asked ? RunMany(ensemble, plan) : RunOne(plan);
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(
      &argc,
      &argv,
      "pressure, moduli and coordination against the distance from "
      "jamming (Wang & Zhang, sec. 4.2, Figs 4-6)");
  granopt::ListSolversIfAsked();
  return granopt::Main();
}
