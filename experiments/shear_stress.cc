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

DECLARE_bool(resume);

namespace granopt {
namespace {

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

// At most ten rows, and the last one.
void PrintRows(const std::vector<std::vector<double>>& rows) {
  std::vector<std::vector<std::string>> table = {
      {"shear stress", "strain", "pressure", "phi", "z"}};
  const std::size_t every = std::max<std::size_t>(1, rows.size() / 10);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (k % every != 0 && k + 1 != rows.size()) continue;
    const std::vector<double>& row = rows[k];
    table.push_back({Format("%.5e",
                            std::abs(row[kShearStress]) < 1e-12 * row[kPressure]
                                ? 0.0
                                : row[kShearStress]),
                     Format("%.5e", row[kStrain]),
                     Format("%.5e", row[kPressure]),
                     Format("%.8f", row[kPhi]),
                     Format("%.4f", row[kZ])});
  }
  std::printf("\n%s", Grid(table, 0, false).c_str());
}

}  // namespace

int RunStressShear(const Scene& scene,
                   const StressPath& path,
                   double pressure) {
  StressShearOptions options;
  options.energy = scene.energy;
  options.solve = MakeSolveOptions();
  options.solve.max_evaluations = kEvaluations;
  options.pressure = pressure;
  std::printf(
      "shear     %s (%s), alpha = %g, phi = %.6f\n"
      "          simple shear by stress, to %g in %d steps, at constant %s\n"
      "          each state relaxed to |g| <= %g mean forces; method %s\n",
      Describe(scene.packing).c_str(),
      scene.origin.c_str(),
      scene.energy.alpha,
      scene.packing.PackingFraction(),
      path.stress,
      path.steps,
      pressure > 0.0 ? Format("pressure %g", pressure).c_str() : "volume",
      options.solve.relative_tolerance,
      scene.solver->name().c_str());
  Json setup = SceneSetup(scene, options.solve);
  setup.update({{"mode", "stress"},
                {"shear_stress", path.stress},
                {"stress_steps", path.steps},
                {"pressure", pressure}});
  const Checkpoint checkpoint(CheckpointPath(), setup);
  StressShearState state;
  state.shear.packing = scene.packing;
  std::vector<std::vector<double>> rows;
  if (FLAGS_resume && Resume(checkpoint, [&](const Json& json) {
        state = StressShearStateOf(json.at("state"));
        json.at("rows").get_to(rows);
      })) {
    std::printf("          resumed at shear stress %g\n", state.reached);
  }
  std::fflush(stdout);
  Output output;
  CreateOutput({"summary.json",
                "stress.csv",
                "packing.xyz",
                "contacts.csv",
                "stress.svg",
                "stress.png",
                "packing.svg",
                "packing.png"},
               FLAGS_resume,
               &output);

  std::string error;
  Relaxation last;
  bool finished;
  {
    Progress progress;
    options.solve.callback = [&](const IterationState& now) {
      if (progress.Due()) {
        progress.Show(Format("after shear stress %g | ", state.reached) +
                      IterationLine(now));
      }
      return true;
    };
    finished = ShearByStress(
        path,
        options,
        *scene.solver,
        [&](const StressShearState& now, const Relaxation* found) {
          if (found != nullptr) rows.push_back(RowOf(now.shear, *found));
          const bool stop = StopRequested();
          if (stop || IsCheckpointStep(rows.size())) {
            Save(checkpoint, {{"state", ToJson(now)}, {"rows", rows}});
          }
          return !stop;
        },
        &state,
        &last,
        &error);
  }
  if (!finished && !StopRequested()) BadInput(error);
  if (!finished) {
    return StoppedAsAsked(Format("at shear stress %g", state.reached));
  }
  const bool yields = state.halvings > 0;

  Json json;
  json["converged"] = true;
  json["mode"] = "stress";
  json["asked"] = path.stress;
  json["steps"] = path.steps;
  json["pressure"] = pressure;
  json["reached"] = state.reached;
  json["yields"] = yields;
  if (yields) {
    json["refused"] = state.refused;
    json["why"] = state.why;
  }
  json["strain"] = state.shear.strain;
  json["relaxations"] = state.shear.relaxations;
  json["evaluations"] = state.shear.counters.evaluations;
  json["seconds"] = state.shear.seconds;
  json["solver"] = scene.solver->name();
  json["alpha"] = scene.energy.alpha;
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["state"] = RelaxationJson(last);
  json["schema"] = "granopt/shear_stress/1";
  json["provenance"] = Provenance();
  output.Write("stress.csv",
               NumbersCsv({std::begin(kColumns), std::end(kColumns)}, rows));
  output.WriteRelaxation(last, scene.energy);
  output.WriteJson("summary.json", json);
  output.Plot(
      {"stress",
       output.Path("stress.csv"),
       output.Path("stress"),
       yields ? Format("--yields=%.17g", 0.5 * (state.reached + state.refused))
              : std::string("--yields=0")},
      {"stress.svg", "stress.png"});
  output.PlotPacking();

  PrintRows(rows);
  if (yields) {
    std::printf(
        "\n  yields        between shear stresses %.6g and %.6g, at %.4f of "
        "its pressure: no state was found above\n                (%s)\n",
        state.reached,
        state.refused,
        state.reached / rows.back()[kPressure],
        state.why.c_str());
  } else {
    std::printf("\n  holds         the shear stress %g, at strain %g\n",
                path.stress,
                state.shear.strain);
  }
  std::printf("  work          %d relaxations, %lld evaluations, %.3g s\n",
              state.shear.relaxations,
              static_cast<long long>(state.shear.counters.evaluations),
              state.shear.seconds);
  output.PrintFiles();
  return kConverged;
}

}  // namespace granopt
