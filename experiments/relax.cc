// relax: one energy minimization of one packing, the everyday tool.
//
//   relax --input=F.xyz | --particles=N --phi=P --seed=S
//         --alpha=2 --precision=double --solver=NAME[:key=value,...]
//         --tolerance=1e-10
//         --copies=1 --radius_factor=1 --simple_shear=0 --pure_shear=0
//         --perturb=0
//         --out=DIR [--resume]
//
// Writes DIR/summary.json, DIR/packing.xyz, DIR/contacts.csv, DIR/trace.csv and
// two figures; with --modes=K also modes.csv, modes.xyz and mode.svg, see
// certificate.h. Scripts may rely on flags, files and exit status.

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "experiments/certificate.h"
#include "experiments/checkpoint.h"
#include "experiments/moduli.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/quad_residual.h"
#include "granular/relaxation.h"

DEFINE_double(phi, 0.8438, "packing fraction of a random start");
DEFINE_double(
    absolute_tolerance,
    0.0,
    "if > 0: stop at max|g| <= this instead, in units k = 1, box = 1");
DEFINE_int32(copies,
             1,
             "of the packing side by side in each direction, before anything "
             "else is done to it");
DEFINE_double(radius_factor, 1.0, "multiply all radii before relaxing");
DEFINE_double(simple_shear, 0.0, "shear strain gamma: D = (1 gamma; 0 1)");
DEFINE_double(pure_shear,
              0.0,
              "strain gamma: D = diag(1 + gamma, 1/(1 + gamma))");
DEFINE_double(
    perturb,
    0.0,
    "random displacement of each coordinate, uniform in +-this, box = 1");
DEFINE_double(max_seconds, 0.0, "give up after this time (0: never)");
DEFINE_int64(max_evaluations,
             0,
             "give up after this many evaluations (0: never)");
DEFINE_int64(leg,
             0,
             "start the method afresh, and write a checkpoint, after this many "
             "evaluations (0: so many that it takes minutes)");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out from its last checkpoint; "
            "ends in the same bits as a run that was never interrupted");

namespace granopt {
namespace {

// From here on a run is told how much memory it will take.
constexpr int kManyGrains = 100000;

// Measured with `lbfgs` at random starts, the largest of what the library
// keeps.
double EstimatedBytes(const Packing& packing) {
  return (packing.dimension() == 2 ? 1000.0 : 1850.0) * packing.size();
}

// Of this process, so far.
double PeakBytes() {
  rusage usage;
  return getrusage(RUSAGE_SELF, &usage) == 0 ? 1024.0 * usage.ru_maxrss : 0.0;
}

void CheckFlags() {
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  CheckPositive("phi", FLAGS_phi);
  CheckRange("copies", FLAGS_copies, 1.0, 1000.0);
  CheckPositive("radius_factor", FLAGS_radius_factor);
  CheckRange("absolute_tolerance", FLAGS_absolute_tolerance, 0.0, 1e300);
  CheckRange("simple_shear", FLAGS_simple_shear, -1e3, 1e3);
  CheckRange("pure_shear", FLAGS_pure_shear, -0.99, 1e3);
  CheckRange("perturb", FLAGS_perturb, 0.0, 1.0);
  CheckCertificateFlags();
  CheckRange("max_seconds", FLAGS_max_seconds, 0.0, 1e300);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 0.0, 9e18);
  CheckRange("leg", FLAGS_leg, 0.0, 9e18);
  if (FLAGS_smoke && !IsGiven("particles") && FLAGS_input.empty()) {
    FLAGS_particles = 64;
  }
}

Load MakeLoad() {
  Load load;
  load.radius_factor = FLAGS_radius_factor;
  load.simple_shear = FLAGS_simple_shear;
  load.pure_shear = FLAGS_pure_shear;
  load.perturbation = FLAGS_perturb;
  return load;
}

SolveOptions MakeOptions(const Scene& scene) {
  SolveOptions options = MakeSolveOptions();
  if (FLAGS_absolute_tolerance > 0.0) {
    options.absolute_tolerance =
        FLAGS_absolute_tolerance * ForceUnit(scene.packing, scene.energy);
  }
  if (FLAGS_max_seconds > 0.0) options.max_seconds = FLAGS_max_seconds;
  if (FLAGS_max_evaluations > 0) {
    options.max_evaluations = FLAGS_max_evaluations;
  }
  options.record_trace = true;
  return options;
}

// How far the energy's own forces are from the judge's, in mean forces.
double ForceError(const Packing& packing,
                  const ContactEnergyOptions& law,
                  const QuadResidual& judge) {
  std::string error;
  const auto energy = ContactEnergy::Create(packing, law, &error);
  if (energy == nullptr) BadInput(error);
  energy->Refine();
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  std::vector<double> gradient(zero.size());
  double value;
  energy->Evaluate(zero.data(), &value, gradient.data());
  double largest = 0.0;
  for (std::size_t v = 0; v < gradient.size(); ++v) {
    largest = std::max(largest, std::abs(gradient[v] - judge.gradient[v]));
  }
  return judge.mean_force > 0.0 ? largest / judge.mean_force : largest;
}

// `certificate` and `moduli` are lines of the report.
void PrintResult(const Relaxation& result,
                 const QuadResidual& judge,
                 double force_error,
                 const std::string& certificate,
                 const std::string& moduli,
                 double peak_bytes) {
  const Summary& s = result.summary;
  const Observables& o = result.observables;
  std::printf("\n%s  %s\n", StopReasonName(s.reason), s.message.c_str());
  std::printf("  energy        %.10e\n", o.energy);
  std::printf("  pressure      %.10e   shear stress %.3e\n",
              o.pressure,
              o.shear_stress);
  std::printf(
      "  contacts      %d, z = %.4f; rigid part: %d grains with %d "
      "contacts (isostatic: %d)\n",
      o.contacts,
      o.coordination,
      o.rigid_grains,
      o.rigid_contacts,
      o.isostatic_contacts);
  std::printf("  rattlers      %d of %d\n", o.rattlers, o.grains);
  std::printf("  mean force    %.4e   mean overlap / mean radius %.2e\n",
              o.mean_force,
              o.mean_overlap / result.packing.MeanRadius());
  std::printf(
      "  residual      %.1e mean forces, judged in quadruple precision "
      "(forces agree to %.0e)\n",
      judge.Relative(),
      force_error);
  if (!certificate.empty()) std::printf("  %s", certificate.c_str());
  if (!moduli.empty()) std::printf("  %s", moduli.c_str());
  std::printf(
      "  work          %lld iterations, %lld evaluations, %.3g s "
      "(%.0f %% in the energy)\n",
      static_cast<long long>(s.counters.iterations),
      static_cast<long long>(s.counters.evaluations),
      s.seconds,
      s.seconds > 0 ? 100.0 * s.function_seconds / s.seconds : 0.0);
  if (o.grains >= kManyGrains) {
    std::printf("  memory        %.2f GB at most, %.0f bytes a grain\n",
                1e-9 * peak_bytes,
                peak_bytes / o.grains);
  }
}

int Main() {
  CheckFlags();
  Scene scene = MakeSceneWithSolver(FLAGS_phi);
  Packing& packing = scene.packing;
  const int d = packing.dimension();

  if (FLAGS_copies > 1) packing = packing.Copies(FLAGS_copies);
  ApplyLoad(MakeLoad(), FLAGS_seed, &packing);

  SolveOptions options = MakeOptions(scene);
  CheckScene(scene);
  std::printf(
      "relax     %s (%s)\n", Describe(packing).c_str(), scene.origin.c_str());
  std::printf("          phi = %.6f, contact energy k delta^%g / %g, k = %g\n",
              packing.PackingFraction(),
              scene.energy.alpha,
              scene.energy.alpha,
              scene.energy.stiffness);
  std::printf("          method %s, precision %s\n",
              scene.solver->name().c_str(),
              PrecisionName(scene.energy.precision));
  if (packing.size() >= kManyGrains) {
    std::printf("          about %.1f GB of memory, and what factors take\n",
                1e-9 * EstimatedBytes(packing));
  }

  const std::int64_t leg = FLAGS_leg > 0 ? FLAGS_leg : LegEvaluations(packing);
  Json setup = SceneSetup(scene, options);
  setup.update(
      {{"absolute_tolerance", options.absolute_tolerance}, {"leg", leg}});
  const Checkpoint checkpoint(CheckpointPath(), setup);
  RelaxationState state;
  if (FLAGS_resume && Resume(checkpoint, [&state](const Json& json) {
        state = RelaxationStateOf(json);
      })) {
    std::printf("          resumed after evaluation %lld\n",
                static_cast<long long>(state.summary.counters.evaluations));
  } else {
    state.packing = std::move(packing);
  }
  std::fflush(stdout);
  Output output;
  CreateOutput(WithCertificateFiles({"summary.json",
                                     "packing.xyz",
                                     "contacts.csv",
                                     "trace.csv",
                                     "packing.svg",
                                     "packing.png",
                                     "trace.svg",
                                     "trace.png"}),
               FLAGS_resume,
               &output);

  Relaxation result;
  std::string error;
  {
    Progress progress;
    options.callback = [&](const IterationState& state) {
      if (progress.Due()) {
        const double scale = state.scales.gradient;
        progress.Show(
            Format("iteration %lld, %.1f s: energy %.6e, |g| / mean force %.1e "
                   "(to %.1e)",
                   static_cast<long long>(state.counters.iterations),
                   state.seconds,
                   state.cost,
                   state.max_gradient / scale,
                   options.absolute_tolerance > 0.0
                       ? options.absolute_tolerance / scale
                       : options.relative_tolerance));
      }
      return !StopRequested();
    };
    const auto observer = [&](const RelaxationState& state) {
      Save(checkpoint, ToJson(state));
    };
    if (!RelaxInLegs(scene.energy,
                     *scene.solver,
                     options,
                     leg,
                     observer,
                     &state,
                     &result,
                     &error)) {
      BadInput(scene.origin + ": " + error);
    }
  }
  const double peak_bytes = PeakBytes();
  QuadResidual judge;
  if (!EvaluateQuad(result.packing, scene.energy, nullptr, &judge, &error)) {
    BadInput(error);
  }

  const double force_error = ForceError(result.packing, scene.energy, judge);

  Json json = RelaxationJson(result);
  json["relative_residual"] = result.observables.relative_residual;
  json["quad_relative_residual"] = judge.Relative();
  json["quad_energy"] = judge.energy;
  json["force_error"] = force_error;
  json["alpha"] = scene.energy.alpha;
  json["k"] = scene.energy.stiffness;
  json["precision"] = PrecisionName(scene.energy.precision);
  json["dimension"] = d;
  json["particles"] = result.packing.size();
  json["schema"] = "granopt/relax/1";
  json["peak_bytes"] = peak_bytes;
  output.WriteRelaxation(result, scene.energy);
  const std::string certificate = PublishCertificate(
      result.packing, scene.energy, "contacts.csv", &output, &json);
  const std::string moduli = PublishModuli(result.packing, scene.energy, &json);
  json["provenance"] = Provenance();
  output.Write("trace.csv", TraceCsv(result.summary));
  output.WriteJson("summary.json", json);
  output.PlotPacking();
  if (result.summary.trace.size() > 1) {
    output.Plot({"trace", output.Path("trace.csv"), output.Path("trace")},
                {"trace.svg", "trace.png"});
  }

  PrintResult(result, judge, force_error, certificate, moduli, peak_bytes);
  output.PrintFiles();
  const bool converged = result.summary.Succeeded();
  if (StopRequested() && !converged) {
    std::printf("stopped as asked: --input=%s goes on from here%s\n",
                output.Path("packing.xyz").c_str(),
                state.legs > 0
                    ? ", the same command with --resume from the last "
                      "checkpoint to the same bits"
                    : "");
  }
  return converged ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "minimize the contact energy of a packing of discs or "
                      "spheres in a periodic cell");
  return granopt::Main();
}
