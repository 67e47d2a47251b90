// jamming: the jamming point of a packing by Algorithm 1 of Wang & Zhang
// (sec. 2.4): growth of the radii at fixed positions from phi_init by dphi
// until the packing is jammed, bisection to epsilon, and a decompression along
// the jammed branch that brings the error bar below --error_bar. With --seeds
// the same for many packings, as processes of their own (ensemble.h).

#include "granular/jamming.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "experiments/certificate.h"
#include "experiments/distributions.h"
#include "experiments/ensemble.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/quad_residual.h"

DEFINE_double(
    phi_init,
    0.0,
    "packing fraction of the start; default 0.80 (discs), 0.58 (spheres)");
DEFINE_double(dphi, 1e-3, "increment delta phi of the growth");
DEFINE_double(epsilon, 1e-6, "accuracy of the bisection: width of the bracket");
DEFINE_double(
    error_bar,
    1e-8,
    "then follow the jammed branch down until the error bar of phi_J is at "
    "most this; 0: stop where the published algorithm stops");
DEFINE_bool(resume,
            false,
            "with --seeds: runs that are complete are not run again");

namespace granopt {
namespace {

int Main() {
  // Before defaults are changed: what the user gave goes to every child.
  const Ensemble ensemble = ReadEnsembleFlags();
  if (!IsGiven("tolerance")) FLAGS_tolerance = 1e-8;
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("dphi")) FLAGS_dphi = 5e-3;
    if (!IsGiven("epsilon")) FLAGS_epsilon = 1e-4;
    if (!IsGiven("error_bar")) FLAGS_error_bar = 1e-6;
  }
  CheckCertificateFlags();
  CheckRange("phi_init", FLAGS_phi_init, 0.0, 4.0);
  CheckPositive("dphi", FLAGS_dphi);
  CheckPositive("epsilon", FLAGS_epsilon);
  CheckRange("dphi", FLAGS_dphi, 0.0, 1.0);
  CheckRange("epsilon", FLAGS_epsilon, 0.0, 1.0);
  CheckRange("error_bar", FLAGS_error_bar, 0.0, 1.0);
  const double finest = FLAGS_error_bar > 0.0
                            ? std::min(FLAGS_epsilon, FLAGS_error_bar)
                            : FLAGS_epsilon;
  // A state that close to jamming cannot be told from one at it.
  if (!IsGiven("zero_pressure")) FLAGS_zero_pressure = 1e-3 * FLAGS_epsilon;
  Scene scene = MakeSceneWithSolver(FLAGS_phi_init > 0.0   ? FLAGS_phi_init
                                    : FLAGS_dimension == 3 ? 0.58
                                                           : 0.80);
  const int d = scene.packing.dimension();
  JammingOptions options;
  options.energy = scene.energy;
  options.solve = MakeSolveOptions();
  options.phi_init =
      FLAGS_phi_init > 0.0 ? FLAGS_phi_init : (d == 3 ? 0.58 : 0.80);
  options.phi_increment = FLAGS_dphi;
  options.accuracy = FLAGS_epsilon;
  if (FLAGS_error_bar > 0.0)
    options.error_bar = FLAGS_error_bar;
  else
    options.error_bar = std::numeric_limits<double>::infinity();

  if (ensemble.asked) return RunEnsemble(ensemble, scene.energy);

  Output output;
  output.Create(
      FLAGS_out,
      WithDistributionFiles(WithCertificateFiles({"summary.json",
                                                  "packing.xyz",
                                                  "contacts.csv",
                                                  "path.csv",
                                                  "stage_initial.xyz",
                                                  "stage_unjammed.xyz",
                                                  "packing.svg",
                                                  "packing.png",
                                                  "stages.svg",
                                                  "stages.png",
                                                  "path.svg",
                                                  "path.png"})));
  std::printf("jamming   %s (%s), alpha = %g\n",
              Describe(scene.packing).c_str(),
              scene.origin.c_str(),
              scene.energy.alpha);
  std::printf(
      "          Algorithm 1: grow from phi = %.4f by %g, bisect to %g%s\n",
      options.phi_init,
      options.phi_increment,
      options.accuracy,
      FLAGS_error_bar > 0.0
          ? Format(", decompress to an error bar of %g", FLAGS_error_bar)
                .c_str()
          : "");
  std::printf(
      "          each state relaxed to |g| <= %g mean forces; unjammed below "
      "--zero_pressure=%g\n",
      options.solve.relative_tolerance,
      FLAGS_zero_pressure);
  std::printf("          method %s\n", scene.solver->name().c_str());
  std::fflush(stdout);

  std::string csv =
      "stage,phi,energy,pressure,coordination,rigid_grains,rigid_contacts,"
      "verdict,iterations,evaluations,seconds\n";
  JammingResult result;
  std::string error;
  bool found;
  {
    Progress progress;
    int done = 0;
    // Seconds and number of the relaxations of the present stage.
    double spent = 0.0;
    int in_stage = 0;
    JammingStage stage = JammingStage::START;
    std::string stage_line;
    // What is left of the present stage, in relaxations.
    const auto estimate = [&](const JammingStep& step) {
      const double mean = spent / std::max(1, in_stage);
      switch (step.stage) {
        case JammingStage::BISECTION: {
          const double left = std::ceil(
              std::log2((step.phi_jammed - step.phi_unjammed) / FLAGS_epsilon));
          return Format(
              "bracket [%.7f, %.7f], at most %.0f more halvings, "
              "about %.0f s",
              step.phi_unjammed,
              step.phi_jammed,
              std::max(0.0, left),
              std::max(0.0, left) * mean);
        }
        case JammingStage::DECOMPRESSION:
          return Format("error bar %.1e (to %.1e)", step.distance, finest);
        default:
          return Format("phi = %.4f, discs jam near 0.84, spheres near 0.64",
                        step.phi);
      }
    };
    options.solve.callback = [&](const IterationState& state) {
      if (progress.Due()) {
        progress.Show(
            Format("%s | relaxation %d, iteration %lld: |g| / mean force %.1e",
                   stage_line.c_str(),
                   done + 1,
                   static_cast<long long>(state.counters.iterations),
                   state.scales.gradient > 0
                       ? state.max_gradient / state.scales.gradient
                       : 0.0));
      }
      return true;
    };
    const auto observer = [&](const JammingStep& step) {
      const Observables& o = step.result->observables;
      const Summary& s = step.result->summary;
      ++done;
      if (step.stage != stage) {
        stage = step.stage;
        spent = 0.0;
        in_stage = 0;
      }
      spent += s.seconds;
      ++in_stage;
      csv += Format("%s,%.17g,%.17g,%.17g,%.17g,%d,%d,%s,%lld,%lld,%.6g\n",
                    JammingStageName(step.stage),
                    o.packing_fraction,
                    o.energy,
                    o.pressure,
                    o.coordination,
                    o.rigid_grains,
                    o.rigid_contacts,
                    JammingVerdictName(step.verdict),
                    static_cast<long long>(s.counters.iterations),
                    static_cast<long long>(s.counters.evaluations),
                    s.seconds);
      stage_line =
          std::string(JammingStageName(step.stage)) + ": " + estimate(step);
      return true;
    };
    found = FindJamming(
        scene.packing, options, *scene.solver, observer, &result, &error);
  }
  Json json;
  json["found"] = found;
  json["converged"] = found && result.converged;
  json["cycles"] = result.cycles;
  json["relaxations"] = result.relaxations;
  json["iterations"] = result.counters.iterations;
  json["evaluations"] = result.counters.evaluations;
  json["seconds"] = result.seconds;
  json["solver"] = scene.solver->name();
  json["alpha"] = scene.energy.alpha;
  json["dimension"] = d;
  json["particles"] = scene.packing.size();
  json["phi_init"] = options.phi_init;
  json["dphi"] = options.phi_increment;
  json["epsilon"] = options.accuracy;
  json["error_bar"] = FLAGS_error_bar;
  json["zero_pressure"] = FLAGS_zero_pressure;
  json["tolerance"] = options.solve.relative_tolerance;
  json["schema"] = "granopt/jamming/1";
  output.Write("path.csv", csv);
  if (!found) {
    json["error"] = error;
    json["provenance"] = Provenance();
    output.WriteJson("summary.json", json);
    std::fprintf(stderr, "jamming: %s\n", error.c_str());
    output.PrintFiles();
    return kNotConverged;
  }
  QuadResidual judge;
  if (!EvaluateQuad(
          result.jammed.packing, scene.energy, nullptr, &judge, &error)) {
    BadInput(error);
  }
  const Observables& o = result.jammed.observables;
  json["phi_j"] = result.phi_j;
  json["phi_j_error"] = result.distance;
  json["phi_cr"] = result.phi_cr;
  json["slope_from_branch"] = result.secant;
  json["state"] = RelaxationJson(result.jammed);
  json["state"]["quad_relative_residual"] = judge.Relative();

  output.WritePacking("packing.xyz", Annotated(result.jammed, scene.energy));
  output.Write("contacts.csv", ContactsCsv(result.jammed));
  // What the decompression counted as jammed is not unjammed to the
  // certificate.
  if (FLAGS_error_bar > 0.0) {
    FLAGS_zero_pressure = std::min(FLAGS_zero_pressure, 1e-2 * FLAGS_error_bar);
  }
  const std::string certificate = PublishCertificate(
      result.jammed.packing, scene.energy, "contacts.csv", &output, &json);
  const std::string distributions = PublishDistributions(
      result.jammed.packing, result.jammed.contacts, &output, &json);
  json["provenance"] = Provenance();
  output.WritePacking("stage_initial.xyz", result.start);
  output.WritePacking("stage_unjammed.xyz", result.unjammed);
  output.WriteJson("summary.json", json);
  output.Plot({"packing",
               output.Path("packing.xyz"),
               output.Path("contacts.csv"),
               output.Path("packing")},
              {"packing.svg", "packing.png"});
  output.Plot({"stages", output.folder(), output.Path("stages")},
              {"stages.svg", "stages.png"});
  output.Plot({"path",
               output.Path("path.csv"),
               output.Path("path"),
               Format("--phi_j=%.17g", result.phi_j),
               Format("--alpha=%g", scene.energy.alpha),
               Format("--dimension=%d", d)},
              {"path.svg", "path.png"});

  // Digits of phi_J down to those of its error.
  const int digits = std::clamp(
      1 - static_cast<int>(std::floor(std::log10(result.distance))), 4, 15);
  std::printf("\nphi_J = %.*f +- %.1e%s\n",
              digits,
              result.phi_j,
              result.distance,
              result.converged
                  ? ""
                  : "   NOT CONVERGED: error bar above what was asked");
  std::printf(
      "  jammed state  phi = %.*f, pressure %.4e, mean overlap / mean "
      "radius %.1e\n",
      digits,
      result.phi_cr,
      o.pressure,
      o.mean_overlap / result.jammed.packing.MeanRadius());
  std::printf(
      "  error bar     (alpha - 1) p / p', p' = dp/dphi %s\n",
      result.secant ? "measured along the branch" : "for fixed positions");
  std::printf(
      "  contacts      %d among %d rigid grains, z = %.4f (isostatic: %d, "
      "excess %d); %d rattlers\n",
      o.rigid_contacts,
      o.rigid_grains,
      o.coordination,
      o.isostatic_contacts,
      o.rigid_contacts - o.isostatic_contacts,
      o.rattlers);
  std::printf(
      "  residual      %.1e mean forces, judged in quadruple precision\n",
      judge.Relative());
  if (!certificate.empty()) std::printf("  %s", certificate.c_str());
  std::printf("  %s", distributions.c_str());
  if (result.cycles > 1) {
    std::printf(
        "  branches      %d: the earlier ones lost stability at a finite "
        "pressure on the way down\n",
        result.cycles);
  }
  std::printf(
      "  work          %d relaxations, %lld iterations, %lld evaluations, "
      "%.3g s\n",
      result.relaxations,
      static_cast<long long>(result.counters.iterations),
      static_cast<long long>(result.counters.evaluations),
      result.seconds);
  std::printf(
      "  meaning       +- is how far this state is above the jamming point of "
      "its own branch;\n                another seed or protocol ends "
      "elsewhere\n");
  if (d == 2 && FLAGS_input.empty() && o.grains >= 64) {
    // The scatter of 256 to 4096 discs over seeds is about 0.06 / sqrt(N).
    std::printf(
        "  literature    0.8418 for N -> infinity and a rapid quench; single "
        "packings of this size scatter by about %.4f\n",
        0.06 / std::sqrt(static_cast<double>(o.grains)));
  }
  output.PrintFiles();
  return result.converged ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "find the jamming point of a packing: growth, bisection, "
                      "decompression (Algorithm 1)");
  return granopt::Main();
}
