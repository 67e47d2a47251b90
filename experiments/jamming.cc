// jamming: the jamming point of a packing, sharply: growth from phi_init by
// dphi until the packing is over-compressed, and a decompression along the
// jammed branch that brings the error bar below --error_bar and goes on until
// no contact opens. --paper: Algorithm 1 of Wang & Zhang (sec. 2.4) as
// published, growth and bisection to epsilon. --seeds: the same for many
// packings, as processes of their own (ensemble.h).

#include "granular/jamming.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "experiments/certificate.h"
#include "experiments/checkpoint.h"
#include "experiments/distributions.h"
#include "experiments/ensemble.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/quad_residual.h"

DEFINE_double(
    phi_init,
    0.0,
    "packing fraction of the start; default 0.80 (discs), 0.58 (spheres), that "
    "of the --input; a start that is jammed is followed down at once");
DEFINE_double(dphi, 1e-3, "increment delta phi of the growth");
DEFINE_double(
    overcompression,
    1e-3,
    "growth goes on until the packing is at least this far above its jamming "
    "point; 0: bisect as Algorithm 1 does");
DEFINE_double(epsilon, 1e-6, "accuracy of the bisection: width of the bracket");
DEFINE_double(
    error_bar,
    1e-8,
    "then follow the jammed branch down until the error bar of phi_J is at "
    "most this; 0: stop where the published algorithm stops");
DEFINE_bool(until_isostatic,
            true,
            "and on, decade by decade, until no contact opens");
DEFINE_string(route,
              "radii",
              "how packing fractions are reached: growth of the radii in a "
              "fixed cell, or compression of the cell around fixed radii");
DEFINE_bool(paper,
            false,
            "Algorithm 1 as published: --overcompression=0 --error_bar=0");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out from its last checkpoint; "
            "with --seeds: and do not run again what is complete");

namespace granopt {
namespace {

// Checks the flags; the packing is not read yet.
void CheckFlags() {
  if (!IsGiven("tolerance")) FLAGS_tolerance = 1e-8;
  if (FLAGS_paper) {
    for (const char* flag : {"overcompression", "error_bar"}) {
      if (IsGiven(flag)) {
        BadInput(
            Format("--%s cannot go with --paper, which bisects and stops "
                   "there",
                   flag));
      }
    }
    FLAGS_overcompression = FLAGS_error_bar = 0.0;
  }
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("dphi")) FLAGS_dphi = 5e-3;
    if (!IsGiven("epsilon")) FLAGS_epsilon = 1e-4;
    if (!IsGiven("error_bar") && !FLAGS_paper) FLAGS_error_bar = 1e-6;
  }
  CheckCertificateFlags();
  if (IsGiven("phi_init")) CheckPositive("phi_init", FLAGS_phi_init);
  CheckRange("phi_init", FLAGS_phi_init, 0.0, 4.0);
  CheckPositive("dphi", FLAGS_dphi);
  CheckPositive("epsilon", FLAGS_epsilon);
  CheckRange("dphi", FLAGS_dphi, 0.0, 1.0);
  CheckRange("overcompression", FLAGS_overcompression, 0.0, 1.0);
  CheckRange("epsilon", FLAGS_epsilon, 0.0, 1.0);
  CheckRange("error_bar", FLAGS_error_bar, 0.0, 1.0);
  if (FLAGS_route != "radii" && FLAGS_route != "cell") {
    BadInput("--route=" + FLAGS_route + " must be radii or cell");
  }
  // A state that close to jamming cannot be told from one at it.
  if (!IsGiven("zero_pressure")) FLAGS_zero_pressure = 1e-3 * FLAGS_epsilon;
}

JammingOptions MakeJammingOptions(const Scene& scene, double phi_init) {
  JammingOptions options;
  options.energy = scene.energy;
  options.solve = MakeSolveOptions();
  options.route =
      FLAGS_route == "cell" ? JammingRoute::CELL : JammingRoute::RADII;
  options.phi_init = phi_init;
  options.phi_increment = FLAGS_dphi;
  options.overcompression = FLAGS_overcompression;
  options.accuracy = FLAGS_epsilon;
  options.error_bar = FLAGS_error_bar > 0.0
                          ? FLAGS_error_bar
                          : std::numeric_limits<double>::infinity();
  options.until_isostatic = FLAGS_until_isostatic && FLAGS_error_bar > 0.0;
  return options;
}

// What must be the same for a run to go on from a checkpoint.
Json Setup(const Scene& scene, const JammingOptions& options) {
  Json setup = SceneSetup(scene, options.solve);
  setup.update({{"route", JammingRouteName(options.route)},
                {"phi_init", options.phi_init},
                {"dphi", options.phi_increment},
                {"overcompression", options.overcompression},
                {"epsilon", options.accuracy},
                {"error_bar", FLAGS_error_bar},
                {"until_isostatic", options.until_isostatic}});
  return setup;
}

void PrintTask(const Scene& scene, const JammingOptions& options) {
  const std::string start =
      options.phi_init > 0.0
          ? Format("phi = %.4f", options.phi_init)
          : Format("phi = %.6f as it is", scene.packing.PackingFraction());
  std::printf("jamming   %s (%s), alpha = %g\n",
              Describe(scene.packing).c_str(),
              scene.origin.c_str(),
              scene.energy.alpha);
  std::printf("          %s: from %s grow %s by %g",
              FLAGS_overcompression > 0.0 ? "sharp" : "Algorithm 1",
              start.c_str(),
              options.route == JammingRoute::CELL ? "(by shrinking the cell)"
                                                  : "the radii",
              options.phi_increment);
  if (FLAGS_overcompression > 0.0) {
    std::printf(" to %g above jamming", FLAGS_overcompression);
  } else {
    std::printf(", bisect to %g", options.accuracy);
  }
  if (FLAGS_error_bar > 0.0) {
    std::printf(",\n          decompress to an error bar of %g%s",
                FLAGS_error_bar,
                options.until_isostatic ? " and until no contact opens" : "");
  }
  std::printf("\n");
  if (FLAGS_paper) {
    std::printf(
        "          the paper states neither phi_init nor dphi, epsilon or the "
        "tolerance: assumed here\n");
  }
  std::printf(
      "          each state relaxed to |g| <= %g mean forces; unjammed below "
      "--zero_pressure=%g\n",
      options.solve.relative_tolerance,
      FLAGS_zero_pressure);
  std::printf("          method %s\n", scene.solver->name().c_str());
}

// ------------------------------------------------------------ progress

// Where the search stands and what is left of its stage, in relaxations.
class StageLine {
 public:
  void Note(const JammingStep& step) {
    if (step.stage != stage_) {
      stage_ = step.stage;
      spent_ = 0.0;
      in_stage_ = 0;
    }
    spent_ += step.result->summary.seconds;
    ++in_stage_;
    text_ = std::string(JammingStageName(step.stage)) + ": " + Estimate(step);
  }
  const std::string& text() const { return text_; }

 private:
  std::string Estimate(const JammingStep& step) const {
    const double mean = spent_ / std::max(1, in_stage_);
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
        return Format("error bar %.1e (to %.1e)",
                      step.distance,
                      FLAGS_error_bar > 0.0
                          ? std::min(FLAGS_epsilon, FLAGS_error_bar)
                          : FLAGS_epsilon);
      default:
        return Format("phi = %.4f, discs jam near 0.84, spheres near 0.64",
                      step.phi);
    }
  }

  JammingStage stage_ = JammingStage::START;
  double spent_ = 0.0;  // seconds of its relaxations
  int in_stage_ = 0;    // how many
  std::string text_;
};

constexpr char kPathHead[] =
    "stage,phi,energy,pressure,coordination,rigid_grains,rigid_contacts,"
    "verdict,iterations,evaluations,seconds\n";

std::string PathRow(const JammingStep& step) {
  const Observables& o = step.result->observables;
  const Summary& s = step.result->summary;
  return Format("%s,%.17g,%.17g,%.17g,%.17g,%d,%d,%s,%lld,%lld,%.6g\n",
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
}

// ------------------------------------------------------------ results

Json SummaryJson(const Scene& scene,
                 const JammingOptions& options,
                 const JammingResult& result,
                 bool found) {
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
  json["precision"] = PrecisionName(scene.energy.precision);
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["route"] = JammingRouteName(options.route);
  json["phi_init"] = options.phi_init;
  json["overcompression"] = options.overcompression;
  json["dphi"] = options.phi_increment;
  json["epsilon"] = options.accuracy;
  json["error_bar"] = FLAGS_error_bar;
  json["zero_pressure"] = FLAGS_zero_pressure;
  json["tolerance"] = options.solve.relative_tolerance;
  json["schema"] = "granopt/jamming/1";
  return json;
}

// `certificate` and `distributions` are lines of the report.
void PrintResult(const JammingOptions& options,
                 const JammingResult& result,
                 double residual,
                 const std::string& certificate,
                 const std::string& distributions) {
  const Observables& o = result.jammed.observables;
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
  if (options.until_isostatic && o.rigid_contacts > o.isostatic_contacts) {
    std::printf(
        "  excess        stays down to %.0e: loops of equal grains may close "
        "by "
        "themselves and keep\n                contacts that nothing opens; "
        "with radii that all differ (--polydispersity=1e-3)\n"
        "                none was left in some hundred packings\n",
        result.distance);
  }
  std::printf(
      "  residual      %.1e mean forces, judged in quadruple precision\n",
      residual);
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
  if (result.jammed.packing.dimension() == 2 && FLAGS_input.empty() &&
      o.grains >= 64) {
    // The scatter of 256 to 4096 discs over seeds is about 0.06 / sqrt(N).
    std::printf(
        "  literature    0.8418 for N -> infinity and a rapid quench; single "
        "packings of this size scatter by about %.4f\n",
        0.06 / std::sqrt(static_cast<double>(o.grains)));
  }
}

// A state was found: writes and prints it.
void Publish(const Scene& scene,
             const JammingOptions& options,
             const JammingResult& result,
             Output* output,
             Json* json) {
  QuadResidual judge;
  std::string error;
  if (!EvaluateQuad(
          result.jammed.packing, scene.energy, nullptr, &judge, &error)) {
    BadInput(error);
  }
  const Observables& o = result.jammed.observables;
  (*json)["phi_j"] = result.phi_j;
  (*json)["phi_j_error"] = result.distance;
  (*json)["phi_cr"] = result.phi_cr;
  (*json)["slope_from_branch"] = result.secant;
  (*json)["phi_unjammed"] = result.phi_unjammed;
  (*json)["excess_contacts"] = o.rigid_contacts - o.isostatic_contacts;
  (*json)["state"] = RelaxationJson(result.jammed);
  (*json)["state"]["quad_relative_residual"] = judge.Relative();

  output->WriteRelaxation(result.jammed, scene.energy);
  // What the decompression counted as jammed is not unjammed to the
  // certificate.
  FLAGS_zero_pressure = std::min(FLAGS_zero_pressure, 1e-2 * result.distance);
  const std::string certificate = PublishCertificate(
      result.jammed.packing, scene.energy, "contacts.csv", output, json);
  const std::string distributions = PublishDistributions(
      result.jammed.packing, result.jammed.contacts, output, json);
  (*json)["provenance"] = Provenance();
  output->WritePacking("stage_initial.xyz", result.start);
  output->WritePacking("stage_unjammed.xyz", result.unjammed);
  output->WriteJson("summary.json", *json);
  output->PlotPacking();
  output->Plot({"stages", output->folder(), output->Path("stages")},
               {"stages.svg", "stages.png"});
  output->Plot({"path",
                output->Path("path.csv"),
                output->Path("path"),
                Format("--phi_j=%.17g", result.phi_j),
                Format("--alpha=%g", scene.energy.alpha),
                Format("--dimension=%d", scene.packing.dimension())},
               {"path.svg", "path.png"});
  PrintResult(options, result, judge.Relative(), certificate, distributions);
}

int Main() {
  // Before defaults are changed: what the user gave goes to every child.
  const Ensemble ensemble = ReadEnsembleFlags();
  CheckFlags();
  const double phi_random = FLAGS_dimension == 3 ? 0.58 : 0.80;
  const Scene scene =
      MakeSceneWithSolver(FLAGS_phi_init > 0.0 ? FLAGS_phi_init : phi_random);
  const double phi_init = FLAGS_phi_init > 0.0  ? FLAGS_phi_init
                          : FLAGS_input.empty() ? phi_random
                                                : 0.0;
  JammingOptions options = MakeJammingOptions(scene, phi_init);
  if (ensemble.asked) return RunEnsemble(ensemble, scene.energy);
  PrintTask(scene, options);

  JammingState state;
  std::string error;
  if (!BeginJamming(scene.packing, options, &state, &error)) BadInput(error);
  const Checkpoint checkpoint(CheckpointPath(), Setup(scene, options));
  std::string csv = kPathHead;
  if (FLAGS_resume && Resume(checkpoint, [&](const Json& json) {
        state = JammingStateOf(json.at("search"));
        json.at("path").get_to(csv);
      })) {
    std::printf("          resumed after relaxation %d\n", state.relaxations);
  }
  std::fflush(stdout);
  Output output;
  CreateOutput(WithDistributionFiles(WithCertificateFiles({"summary.json",
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
                                                           "path.png"})),
               FLAGS_resume,
               &output);

  JammingResult result;
  bool found;
  {
    Progress progress;
    StageLine stage;
    int done = state.relaxations;
    options.solve.callback = [&](const IterationState& iteration) {
      if (progress.Due()) {
        progress.Show(
            Format("%s | relaxation %d, ", stage.text().c_str(), done + 1) +
            IterationLine(iteration));
      }
      return true;
    };
    const auto observer = [&](const JammingStep& step) {
      ++done;
      csv += PathRow(step);
      stage.Note(step);
      Save(checkpoint, {{"search", ToJson(*step.state)}, {"path", csv}});
      return !StopRequested();
    };
    found = ContinueJamming(
        options, *scene.solver, observer, &state, &result, &error);
  }
  if (!found && StopRequested()) {
    return StoppedAsAsked(Format("after relaxation %d", state.relaxations));
  }
  Json json = SummaryJson(scene, options, result, found);
  output.Write("path.csv", csv);
  if (found) {
    Publish(scene, options, result, &output, &json);
  } else {
    json["error"] = error;
    json["provenance"] = Provenance();
    output.WriteJson("summary.json", json);
    std::fprintf(stderr, "jamming: %s\n", error.c_str());
  }
  output.PrintFiles();
  return found && result.converged ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "find the jamming point of a packing: growth, "
                      "over-compression, decompression until no contact opens "
                      "(--paper: Algorithm 1)");
  return granopt::Main();
}
