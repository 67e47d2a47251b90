#include "experiments/shear_stress.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <string>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "experiments/tabular.h"
#include "granular/packing_io.h"
#include "granular/stress_shear.h"

DECLARE_bool(resume);

namespace granopt {
namespace {

// A step without a state is halved so often: the yield stress to 1/64 of a
// step.
constexpr int kHalvings = 6;
// The most of a minimization, which may have no minimum to find.
constexpr std::int64_t kEvaluations = 100000;

constexpr const char* kColumns[] = {"step",
                                    "strain",
                                    "shear_stress",
                                    "pressure",
                                    "phi",
                                    "energy",
                                    "fabric_iso",
                                    "fabric_dev",
                                    "contacts",
                                    "coordination"};
constexpr int kStrain = 1, kShearStress = 2, kPressure = 3, kPhi = 4, kZ = 9;

std::vector<double> RowOf(const QuasistaticShearState& state,
                          const Relaxation& relaxation) {
  const Observables& o = relaxation.observables;
  return {static_cast<double>(state.step),
          state.strain,
          0.0 - o.stress(0, 1),
          o.pressure,
          relaxation.packing.PackingFraction(),
          o.energy,
          o.fabric_parts.isotropic,
          o.fabric_parts.deviatoric,
          static_cast<double>(o.contacts),
          o.coordination};
}

}  // namespace

int RunStressShear(Scene scene, double stress, int steps, double pressure) {
  StressShearOptions options;
  options.energy = scene.energy;
  options.solve = MakeSolveOptions();
  options.pressure = pressure;
  if (options.solve.max_evaluations <= 0 ||
      options.solve.max_evaluations > kEvaluations) {
    options.solve.max_evaluations = kEvaluations;
  }
  std::printf(
      "shear     %s (%s), alpha = %g, phi = %.6f\n"
      "          simple shear by stress, to %g in %d steps, at constant %s\n"
      "          each state relaxed to |g| <= %g mean forces; method %s\n",
      Describe(scene.packing).c_str(),
      scene.origin.c_str(),
      scene.energy.alpha,
      scene.packing.PackingFraction(),
      stress,
      steps,
      pressure > 0.0 ? Format("pressure %g", pressure).c_str() : "volume",
      options.solve.relative_tolerance,
      scene.solver->name().c_str());
  const Checkpoint checkpoint(
      CheckpointPath(),
      {{"packing", Crc32(FormatPacking(scene.packing))},
       {"alpha", scene.energy.alpha},
       {"solver", scene.solver->name()},
       {"tolerance", options.solve.relative_tolerance},
       {"mode", "stress"},
       {"shear_stress", stress},
       {"stress_steps", steps},
       {"pressure", pressure},
       {"precision", PrecisionName(scene.energy.precision)}});

  // Where the run stands. The next stress is reached + width; no state was
  // found at `refused`, if above `reached`.
  QuasistaticShearState state;
  std::vector<std::vector<double>> rows;
  double reached = 0.0, refused = 0.0;
  std::string why;
  int halvings = 0;
  bool begun = false;
  Json written;
  if (FLAGS_resume && Resume(checkpoint, &written)) {
    try {
      state = ShearStateOf(written.at("state"));
      written.at("rows").get_to(rows);
      written.at("reached").get_to(reached);
      written.at("refused").get_to(refused);
      written.at("halvings").get_to(halvings);
      written.at("why").get_to(why);
      begun = true;
    } catch (const Json::exception& exception) {
      RefuseState(checkpoint, exception);
    }
    std::printf("          resumed at shear stress %g\n", reached);
  }
  std::fflush(stdout);
  const std::vector<std::string> kept = CheckpointFiles();
  std::vector<std::string> names = {"summary.json",
                                    "stress.csv",
                                    "packing.xyz",
                                    "contacts.csv",
                                    "stress.svg",
                                    "stress.png",
                                    "packing.svg",
                                    "packing.png"};
  if (!FLAGS_resume) names.insert(names.end(), kept.begin(), kept.end());
  Output output;
  output.Create(FLAGS_out, names, kept);
  CatchStopSignals();

  std::string error, fault;
  Relaxation last;
  bool stopped = false;
  {
    Progress progress;
    options.solve.callback = [&](const IterationState& now) {
      if (progress.Due()) {
        progress.Show(Format("after shear stress %g | iteration %lld",
                             reached,
                             static_cast<long long>(now.counters.iterations)));
      }
      return true;
    };
    const auto step_to = [&](double target) {
      bool found = false;
      Relaxation next;
      if (!StepToShearStress(
              target, options, *scene.solver, &state, &next, &found, &error)) {
        BadInput(error);
      }
      if (found) {
        rows.push_back(RowOf(state, next));
        last = std::move(next);
      } else {
        why = next.summary.message;
      }
      return found;
    };
    if (!begun) {
      // First at no shear stress: there strains are counted from.
      Relaxation start;
      if (!Relax(scene.packing,
                 scene.energy,
                 *scene.solver,
                 options.solve,
                 &start,
                 &error)) {
        BadInput(error);
      }
      state.packing = start.packing;
      state.step = -1;
      if (!step_to(0.0)) {
        BadInput("no state without shear stress was found: " + why +
                 (pressure > 0.0 ? "" : "; is the packing jammed?"));
      }
      state.strain = 0.0;
      rows.back()[kStrain] = 0.0;
    }
    while (halvings <= kHalvings && !stopped) {
      // Exactly those of the steps where nothing yields.
      const double target = halvings == 0 ? stress * (state.step + 1) / steps
                                          : 0.5 * (reached + refused);
      if (halvings == 0 && state.step == steps) break;
      if (step_to(target)) {
        reached = target;
        halvings += halvings > 0 ? 1 : 0;
      } else {
        refused = target;
        ++halvings;
      }
      if (!checkpoint.Write({{"state", ToJson(state)},
                             {"rows", rows},
                             {"reached", reached},
                             {"refused", refused},
                             {"halvings", halvings},
                             {"why", why}},
                            &fault)) {
        BadInput(fault);
      }
      stopped = StopRequested();
    }
  }
  if (stopped) {
    std::printf(
        "\nstopped as asked, at shear stress %g: the same command with "
        "--resume goes on\n",
        reached);
    return kNotConverged;
  }
  const bool yields = halvings > 0;
  if (last.packing.size() == 0 &&
      !MeasureAsItIs(state.packing, scene.energy, &last, &error)) {
    BadInput(error);
  }

  Json json;
  json["converged"] = true;
  json["mode"] = "stress";
  json["asked"] = stress;
  json["steps"] = steps;
  json["pressure"] = pressure;
  json["reached"] = reached;
  json["yields"] = yields;
  if (yields) {
    json["refused"] = refused;
    json["why"] = why;
  }
  json["strain"] = state.strain;
  json["relaxations"] = state.relaxations;
  json["evaluations"] = state.counters.evaluations;
  json["seconds"] = state.seconds;
  json["solver"] = scene.solver->name();
  json["alpha"] = scene.energy.alpha;
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["state"] = RelaxationJson(last);
  json["schema"] = "granopt/shear_stress/1";
  json["provenance"] = Provenance();
  output.Write("stress.csv",
               NumbersCsv({std::begin(kColumns), std::end(kColumns)}, rows));
  output.WritePacking("packing.xyz", Annotated(last, scene.energy));
  output.Write("contacts.csv", ContactsCsv(last));
  output.WriteJson("summary.json", json);
  output.Plot({"stress",
               output.Path("stress.csv"),
               output.Path("stress"),
               yields ? Format("--yields=%.17g", 0.5 * (reached + refused))
                      : std::string("--yields=0")},
              {"stress.svg", "stress.png"});
  output.Plot({"packing",
               output.Path("packing.xyz"),
               output.Path("contacts.csv"),
               output.Path("packing")},
              {"packing.svg", "packing.png"});

  std::printf(
      "\n   shear stress       strain     pressure          phi       z\n");
  const std::size_t every = std::max<std::size_t>(1, rows.size() / 10);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (k % every != 0 && k + 1 != rows.size()) continue;
    const std::vector<double>& row = rows[k];
    std::printf("   %12.5e %12.5e %12.5e %12.8f %7.4f\n",
                std::abs(row[kShearStress]) < 1e-12 * row[kPressure]
                    ? 0.0
                    : row[kShearStress],
                row[kStrain],
                row[kPressure],
                row[kPhi],
                row[kZ]);
  }
  if (yields) {
    std::printf(
        "\n  yields        between shear stresses %.6g and %.6g, at %.4f of "
        "its "
        "pressure: no state was found above\n                (%s)\n",
        reached,
        refused,
        reached / rows.back()[kPressure],
        why.c_str());
  } else {
    std::printf("\n  holds         the shear stress %g, at strain %g\n",
                stress,
                state.strain);
  }
  std::printf("  work          %d relaxations, %lld evaluations, %.3g s\n",
              state.relaxations,
              static_cast<long long>(state.counters.evaluations),
              state.seconds);
  output.PrintFiles();
  return kConverged;
}

}  // namespace granopt
