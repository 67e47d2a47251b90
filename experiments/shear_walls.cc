#include "experiments/shear_walls.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "granular/walls.h"

namespace granopt {
namespace {

// Rough walls are this many largest diameters thick, grains of flat ones so
// many radii apart.
constexpr double kThickness = 1.05;
constexpr double kSpacing = 0.5;
constexpr int kBins = 16;

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
  Output output;
  output.Create(FLAGS_out, WallFiles());
  CatchStopSignals();
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
  std::string csv =
      "step,strain,shear_stress,normal_stress,energy,work,dissipated,imbalance,"
      "stress_iso,stress_dev,fabric_iso,fabric_dev,contacts,iterations,"
      "evaluations\n";
  Packing before;
  // Along the wall, added up; from the first state.
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(packing.size());
  Eigen::VectorXd height = Eigen::VectorXd::Zero(packing.size());
  double most = 0.0, first_shear = 0.0, last_shear = 0.0, normal = 0.0;
  int steps = 0;
  double strain = 0.0;
  double worst_imbalance = 0.0, work = 0.0, dissipated = 0.0;
  WallShearResult result;
  bool finished;
  {
    Progress progress;
    finished = ShearBetweenWalls(
        packing,
        walls,
        options,
        *scene.solver,
        [&](const WallShearStep& step) {
          const Observables& o = step.result->observables;
          const Counters& c = step.result->summary.counters;
          csv += Format("%d", step.step);
          for (const double value : {step.strain,
                                     step.shear_stress,
                                     step.normal_stress,
                                     o.energy,
                                     step.work,
                                     step.dissipated,
                                     step.imbalance,
                                     o.stress_parts.isotropic,
                                     o.stress_parts.deviatoric,
                                     o.fabric_parts.isotropic,
                                     o.fabric_parts.deviatoric}) {
            csv += Format(",%.17g", value);
          }
          csv += Format(",%d,%lld,%lld\n",
                        o.contacts,
                        static_cast<long long>(c.iterations),
                        static_cast<long long>(c.evaluations));
          const Packing& now = step.result->packing;
          if (step.step == 0) {
            height = now.positions.row(1).transpose();
            first_shear = step.shear_stress;
          } else {
            for (int i = 0; i < now.size(); ++i) {
              double u = now.positions(0, i) - before.positions(0, i);
              u -= length * std::round(u / length);
              moved[i] += u;
            }
          }
          before = now;
          steps = step.step;
          strain = step.strain;
          most = std::max(most, std::abs(step.shear_stress));
          last_shear = step.shear_stress;
          normal = step.normal_stress;
          worst_imbalance = std::max(worst_imbalance, step.imbalance);
          work += step.work;
          dissipated += step.dissipated;
          if (progress.Due()) {
            progress.Show(Format("step %d of %zu", step.step, path.size()));
          }
          return !StopRequested();
        },
        &result,
        &error);
  }
  if (!finished && !StopRequested()) BadInput(error);

  // Displacement over that of the wall, in slices of the height.
  std::string profile = "height,displacement,grains\n";
  const double wall_move = strain * walls.Height();
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
  json["converged"] = finished && result.gave_up == 0;
  json["mode"] = "wall";
  json["wall"] = kind;
  json["height"] = walls.Height();
  json["steps"] = steps;
  json["strain"] = strain;
  json["relaxations"] = result.relaxations;
  json["gave_up"] = result.gave_up;
  json["evaluations"] = result.counters.evaluations;
  json["seconds"] = result.seconds;
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
  output.Write("walls.csv", csv);
  output.Write("profile.csv", profile);
  output.WritePacking("packing.xyz", Annotated(result.last, scene.energy));
  output.Write("contacts.csv", ContactsCsv(result.last));
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
      result.relaxations,
      static_cast<long long>(result.counters.evaluations),
      result.seconds,
      result.gave_up > 0
          ? Format("; %d DID NOT CONVERGE", result.gave_up).c_str()
          : "");
  if (!finished) std::printf("\nstopped as asked\n");
  output.PrintFiles();
  return finished && result.gave_up == 0 ? kConverged : kNotConverged;
}

}  // namespace granopt
