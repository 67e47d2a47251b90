#include "experiments/shear_walls.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "experiments/tabular.h"
#include "granular/walls.h"

DECLARE_bool(resume);

namespace granopt {
namespace {

// Rough walls are this many largest diameters thick, grains of flat ones so
// many radii apart.
constexpr double kThickness = 1.05;
constexpr double kSpacing = 0.5;
constexpr int kBins = 16;

// Of walls.csv.
constexpr const char* kColumns[] = {"step",
                                    "strain",
                                    "shear_stress",
                                    "normal_stress",
                                    "energy",
                                    "work",
                                    "dissipated",
                                    "imbalance",
                                    "stress_iso",
                                    "stress_dev",
                                    "fabric_iso",
                                    "fabric_dev",
                                    "contacts",
                                    "iterations",
                                    "evaluations"};
constexpr int kShearStress = 2, kNormalStress = 3, kWork = 5, kDissipated = 6,
              kImbalance = 7;

std::vector<double> RowOf(const WallShearStep& step) {
  const Observables& o = step.result->observables;
  const Counters& c = step.result->summary.counters;
  return {static_cast<double>(step.step),
          step.strain,
          step.shear_stress,
          step.normal_stress,
          o.energy,
          step.work,
          step.dissipated,
          step.imbalance,
          o.stress_parts.isotropic,
          o.stress_parts.deviatoric,
          o.fabric_parts.isotropic,
          o.fabric_parts.deviatoric,
          static_cast<double>(o.contacts),
          static_cast<double>(c.iterations),
          static_cast<double>(c.evaluations)};
}

// Displacement of free grains over that of the wall, in slices of the height.
std::string ProfileCsv(const Walls& walls,
                       const std::vector<double>& height,
                       const std::vector<double>& moved,
                       double wall_move) {
  std::string csv = "height,displacement,grains\n";
  for (int bin = 0; bin < kBins && wall_move != 0.0; ++bin) {
    double sum = 0.0;
    int count = 0;
    for (std::size_t i = 0; i < height.size(); ++i) {
      const double y = (height[i] - walls.lower) / walls.Height();
      if (walls.side[i] != 0 || y < static_cast<double>(bin) / kBins ||
          y >= (bin + 1.0) / kBins) {
        continue;
      }
      sum += moved[i] / wall_move;
      ++count;
    }
    if (count == 0) continue;
    csv += Format("%.6g,%.9g,%d\n", (bin + 0.5) / kBins, sum / count, count);
  }
  return csv;
}

}  // namespace

int RunWallShear(const Scene& scene,
                 const std::string& kind,
                 const std::vector<double>& path) {
  const SolveOptions solve = MakeSolveOptions();
  std::string error;
  Relaxation start;
  if (!Relax(
          scene.packing, scene.energy, *scene.solver, solve, &start, &error)) {
    BadInput(error);
  }
  Packing packing = start.packing;
  Walls walls;
  const bool made =
      kind == "rough"
          ? MakeRoughWalls(kThickness * 2.0 * packing.radii.maxCoeff(),
                           &packing,
                           &walls,
                           &error)
          : MakeFlatWalls(kSpacing, &packing, &walls, &error);
  if (!made) BadInput(error);
  std::printf(
      "shear     %s (%s), alpha = %g, between %s walls %.4g apart: %d wall "
      "grains, strain to %g in %zu steps\n          method %s\n",
      Describe(packing).c_str(),
      scene.origin.c_str(),
      scene.energy.alpha,
      kind.c_str(),
      walls.Height(),
      static_cast<int>(std::count_if(walls.side.begin(),
                                     walls.side.end(),
                                     [](int side) { return side != 0; })),
      path.back(),
      path.size(),
      scene.solver->name().c_str());
  std::fflush(stdout);

  const int d = packing.dimension();
  const double length = packing.box.edges()(0, 0);
  WallShearOptions options;
  options.energy = scene.energy;
  options.solve = solve;
  options.path = path;
  Json setup = SceneSetup(scene, solve);
  setup.update({{"mode", "wall"}, {"wall", kind}, {"path", path}});
  const Checkpoint checkpoint(CheckpointPath(), setup);
  QuasistaticShearState state;
  state.step = -1;
  state.packing = packing;
  // Of kColumns; along the wall from state to state, added up, and the height
  // in the first one.
  std::vector<std::vector<double>> rows;
  std::vector<double> moved(packing.size(), 0.0), height(packing.size(), 0.0);
  if (FLAGS_resume && Resume(checkpoint, [&](const Json& json) {
        state = ShearStateOf(json.at("state"));
        json.at("rows").get_to(rows);
        json.at("moved").get_to(moved);
        json.at("height").get_to(height);
      })) {
    std::printf("          resumed at strain %g\n", state.strain);
  }
  Output output;
  CreateOutput({"summary.json",
                "walls.csv",
                "profile.csv",
                "packing.xyz",
                "contacts.csv",
                "walls.svg",
                "walls.png",
                "packing.svg",
                "packing.png"},
               FLAGS_resume,
               &output);
  std::fflush(stdout);

  Relaxation last;
  bool finished;
  {
    Progress progress;
    Packing before = state.packing;
    finished = ShearBetweenWalls(
        walls,
        options,
        *scene.solver,
        [&](const WallShearStep& step) {
          rows.push_back(RowOf(step));
          const Packing& now = step.result->packing;
          for (int i = 0; i < now.size(); ++i) {
            if (step.step == 0) {
              height[i] = now.positions(1, i);
            } else {
              const double u = now.positions(0, i) - before.positions(0, i);
              moved[i] += u - length * std::round(u / length);
            }
          }
          before = now;
          if (progress.Due()) {
            progress.Show(Format("step %d of %zu", step.step, path.size()));
          }
          // A resumed run does the last one again: there its results come from.
          if (step.step == static_cast<int>(path.size())) return true;
          const bool stop = StopRequested();
          if (stop || IsCheckpointStep(rows.size())) {
            Save(checkpoint,
                 {{"state", ToJson(*step.state)},
                  {"rows", rows},
                  {"moved", moved},
                  {"height", height}});
          }
          return !stop;
        },
        &state,
        &last,
        &error);
  }
  if (!finished && !StopRequested()) BadInput(error);
  if (!finished) return StoppedAsAsked(Format("at strain %g", state.strain));
  double most = 0.0, worst_imbalance = 0.0, work = 0.0, dissipated = 0.0;
  for (const std::vector<double>& row : rows) {
    most = std::max(most, std::abs(row[kShearStress]));
    worst_imbalance = std::max(worst_imbalance, row[kImbalance]);
    work += row[kWork];
    dissipated += row[kDissipated];
  }
  const double first_shear = rows.front()[kShearStress];
  const double last_shear = rows.back()[kShearStress];
  const double normal = rows.back()[kNormalStress];

  Json json;
  json["converged"] = state.gave_up == 0;
  json["mode"] = "wall";
  json["wall"] = kind;
  json["height"] = walls.Height();
  json["steps"] = state.step;
  json["strain"] = state.strain;
  json["relaxations"] = state.relaxations;
  json["gave_up"] = state.gave_up;
  json["evaluations"] = state.counters.evaluations;
  json["seconds"] = state.seconds;
  json["solver"] = scene.solver->name();
  json["alpha"] = scene.energy.alpha;
  json["dimension"] = d;
  json["particles"] = packing.size();
  json["first_shear_stress"] = first_shear;
  json["last_shear_stress"] = last_shear;
  json["most_shear_stress"] = most;
  json["last_normal_stress"] = normal;
  json["worst_imbalance"] = worst_imbalance;
  json["work"] = work;
  json["dissipated"] = dissipated;
  json["schema"] = "granopt/shear_walls/1";
  json["provenance"] = Provenance();
  output.Write("walls.csv",
               NumbersCsv({std::begin(kColumns), std::end(kColumns)}, rows));
  output.Write("profile.csv",
               ProfileCsv(walls, height, moved, state.strain * walls.Height()));
  output.WriteRelaxation(last, scene.energy);
  output.WriteJson("summary.json", json);
  output.Plot({"walls", output.folder(), output.Path("walls")},
              {"walls.svg", "walls.png"});
  output.PlotPacking();
  std::printf(
      "\n  wall stress   shear %.4e at first, %.4e at the end, %.4e at most; "
      "normal %.4e at the end\n"
      "  balance       forces on both walls cancel to %.1e of the normal one\n"
      "  work          %.4e by the wall, %.4e of it dissipated\n"
      "                %d relaxations, %lld evaluations, %.3g s%s\n",
      first_shear,
      last_shear,
      most,
      normal,
      worst_imbalance,
      work,
      dissipated,
      state.relaxations,
      static_cast<long long>(state.counters.evaluations),
      state.seconds,
      state.gave_up > 0 ? Format("; %d DID NOT CONVERGE", state.gave_up).c_str()
                        : "");
  output.PrintFiles();
  return state.gave_up == 0 ? kConverged : kNotConverged;
}

}  // namespace granopt
