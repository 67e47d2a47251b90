#include "experiments/shear_walls.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "experiments/tabular.h"
#include "granular/packing_io.h"
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

}  // namespace

std::vector<std::string> WallFiles() {
  return {"summary.json",
          "walls.csv",
          "profile.csv",
          "packing.xyz",
          "contacts.csv",
          "walls.svg",
          "walls.png",
          "packing.svg",
          "packing.png"};
}

int RunWallShear(Scene scene,
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
  const Checkpoint checkpoint(
      CheckpointPath(),
      {{"packing", Crc32(FormatPacking(scene.packing))},
       {"alpha", scene.energy.alpha},
       {"solver", scene.solver->name()},
       {"tolerance", solve.relative_tolerance},
       {"mode", "wall"},
       {"wall", kind},
       {"path", path},
       {"precision", PrecisionName(scene.energy.precision)}});
  QuasistaticShearState state;
  state.step = -1;
  state.packing = packing;
  // Of kColumns; along the wall from state to state, added up, and the height
  // in the first one.
  std::vector<std::vector<double>> rows;
  std::vector<double> moved(packing.size(), 0.0), height(packing.size(), 0.0);
  Json written;
  if (FLAGS_resume && Resume(checkpoint, &written)) {
    try {
      state = ShearStateOf(written.at("state"));
      written.at("rows").get_to(rows);
      written.at("moved").get_to(moved);
      written.at("height").get_to(height);
    } catch (const Json::exception& exception) {
      RefuseState(checkpoint, exception);
    }
    std::printf("          resumed at strain %g\n", state.strain);
  }
  Output output;
  const std::vector<std::string> kept = CheckpointFiles();
  std::vector<std::string> names = WallFiles();
  if (!FLAGS_resume) names.insert(names.end(), kept.begin(), kept.end());
  output.Create(FLAGS_out, names, kept);
  CatchStopSignals();
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
          const Observables& o = step.result->observables;
          const Counters& c = step.result->summary.counters;
          rows.push_back({static_cast<double>(step.step),
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
                          static_cast<double>(c.evaluations)});
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
          std::string fault;
          if (!checkpoint.Write({{"state", ToJson(*step.state)},
                                 {"rows", rows},
                                 {"moved", moved},
                                 {"height", height}},
                                &fault)) {
            BadInput(fault);
          }
          return !StopRequested();
        },
        &state,
        &last,
        &error);
  }
  if (!finished && !StopRequested()) BadInput(error);
  if (!finished) {
    std::printf(
        "\nstopped as asked, at strain %g: the same command with --resume "
        "goes on\n",
        state.strain);
    return kNotConverged;
  }
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

  // Displacement over that of the wall, in slices of the height.
  std::string profile = "height,displacement,grains\n";
  const double wall_move = state.strain * walls.Height();
  for (int bin = 0; bin < kBins && wall_move != 0.0; ++bin) {
    double sum = 0.0;
    int count = 0;
    for (int i = 0; i < packing.size(); ++i) {
      const double y = (height[i] - walls.lower) / walls.Height();
      if (walls.side[i] != 0 || y < static_cast<double>(bin) / kBins ||
          y >= (bin + 1.0) / kBins) {
        continue;
      }
      sum += moved[i] / wall_move;
      ++count;
    }
    if (count == 0) continue;
    profile +=
        Format("%.6g,%.9g,%d\n", (bin + 0.5) / kBins, sum / count, count);
  }
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
  output.Write("profile.csv", profile);
  output.WritePacking("packing.xyz", Annotated(last, scene.energy));
  output.Write("contacts.csv", ContactsCsv(last));
  output.WriteJson("summary.json", json);
  output.Plot({"walls", output.folder(), output.Path("walls")},
              {"walls.svg", "walls.png"});
  output.Plot({"packing",
               output.Path("packing.xyz"),
               output.Path("contacts.csv"),
               output.Path("packing")},
              {"packing.svg", "packing.png"});
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
