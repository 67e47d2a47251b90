// shear: quasistatic deformation of a jammed packing: pure shear (sec. 4.3,
// Fig. 8), simple shear in a Lees-Edwards cell, or cycles of compression, with
// stress and fabric against strain; the plastic events on the way, located.
// Also by walls, and by a given stress. With --seeds: the same for many
// packings, and the mean curves (shear_ensemble.h).

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "experiments/ensemble.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/shear_dynamics.h"
#include "experiments/shear_ensemble.h"
#include "experiments/shear_strain.h"
#include "experiments/shear_stress.h"
#include "experiments/shear_walls.h"
#include "experiments/tabular.h"

DEFINE_string(mode,
              "pure",
              "pure: D = diag(1 + strain, 1 / (1 + strain)); simple: D = 1 + "
              "strain e1 e2, any strain; bulk: the volume times 1 + strain; "
              "wall: by a wall that moves; stress: simple shear by "
              "--shear_stress");
DEFINE_string(wall,
              "rough",
              "with --mode=wall: rough (grains of the packing, held) or flat "
              "(rows of small discs)");
DEFINE_double(shear_stress,
              0.0,
              "with --mode=stress: -sigma_12 of (10) at the end, as "
              "--pressure is; at constant volume, or at --pressure");
DEFINE_int32(stress_steps, 20, "with --mode=stress: steps on the way");
DEFINE_bool(dynamics,
            false,
            "instead: relax random starts and sheared packings by damped "
            "motion, too, and compare (Remark 1.1); takes --seeds");
DEFINE_double(phi,
              0.0,
              "packing fraction of a random start; default 0.86 (discs), 0.68 "
              "(spheres)");
DEFINE_double(strain, 0.02, "strain at the end, or where a cycle turns");
DEFINE_string(increments,
              "1e-4",
              "increments of strain, as in 4e-4,2e-4,1e-4: a curve for each");
DEFINE_int32(cycles, 0, "so many times to --strain and back to none");
DEFINE_bool(events,
            false,
            "locate the plastic events of the finest increment to 1e-10 of "
            "strain, draw the largest");
DEFINE_double(event_threshold,
              1e-5,
              "a step that dissipates more than this part of its energy is "
              "searched for events");
DEFINE_double(pressure,
              0.0,
              "shear at this constant pressure: the volume relaxes, too; 0: at "
              "constant volume");
DEFINE_bool(
    stabilize,
    false,
    "with --pressure: the start is relaxed over all shapes of its cell, "
    "so that it bears any small shear");
DEFINE_bool(paper,
            false,
            "Fig. 8: pure shear to 2 % in increments 4e-4, 2e-4, 1e-4; 4096 "
            "discs, phi = 0.86");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out from its last checkpoint; "
            "with --seeds: and do not run again what is complete");

namespace granopt {
namespace {

constexpr double kMostSteps = 1e6;
DeformationMode ReadMode() {
  for (const DeformationMode mode : {DeformationMode::PURE_SHEAR,
                                     DeformationMode::SIMPLE_SHEAR,
                                     DeformationMode::BULK}) {
    if (FLAGS_mode == DeformationModeName(mode)) return mode;
  }
  if (FLAGS_mode == "wall" || FLAGS_mode == "stress") {
    return DeformationMode::SIMPLE_SHEAR;
  }
  BadInput("--mode=" + FLAGS_mode +
           " must be pure, simple, bulk, wall or stress");
}

// Coarsest first.
std::vector<double> CheckFlags(DeformationMode mode) {
  if (FLAGS_paper) {
    for (const char* flag :
         {"mode", "strain", "increments", "cycles", "dimension"}) {
      if (IsGiven(flag)) {
        BadInput(Format("--%s cannot go with --paper, which states it", flag));
      }
    }
  }
  const bool has_particles = IsGiven("particles") || !FLAGS_input.empty();
  const bool has_increments = IsGiven("increments");
  if (IsGiven("phi") && !FLAGS_input.empty()) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  if (!has_particles) {
    if (FLAGS_paper) FLAGS_particles = 4096;
    if (FLAGS_smoke) FLAGS_particles = 64;
  }
  if (!has_increments) {
    if (FLAGS_paper) FLAGS_increments = "4e-4,2e-4,1e-4";
    if (FLAGS_smoke) FLAGS_increments = "1e-3";
    if (FLAGS_paper && FLAGS_smoke) FLAGS_increments = "4e-3,2e-3,1e-3";
  }
  if (FLAGS_phi == 0.0) FLAGS_phi = FLAGS_dimension == 3 ? 0.68 : 0.86;
  CheckPositive("phi", FLAGS_phi);
  if (!std::isfinite(FLAGS_strain) || FLAGS_strain == 0.0) {
    BadInput(Format("--strain=%g must be finite and not 0", FLAGS_strain));
  }
  if (mode != DeformationMode::SIMPLE_SHEAR && !(FLAGS_strain > -1.0)) {
    BadInput(Format("--strain=%g must be above -1", FLAGS_strain));
  }
  CheckRange("cycles", FLAGS_cycles, 0, 1000);
  CheckPositive("event_threshold", FLAGS_event_threshold);
  CheckRange("pressure", FLAGS_pressure, 0.0, 1e6);
  if (FLAGS_pressure > 0.0 && mode == DeformationMode::BULK) {
    BadInput("--pressure cannot go with --mode=bulk");
  }
  if (FLAGS_pressure > 0.0 && FLAGS_events) {
    BadInput("--events are located at constant volume, not with --pressure");
  }
  if (FLAGS_wall != "rough" && FLAGS_wall != "flat") {
    BadInput("--wall=" + FLAGS_wall + " must be rough or flat");
  }
  if (IsGiven("wall") && FLAGS_mode != "wall") {
    BadInput("--wall needs --mode=wall");
  }
  if (FLAGS_mode == "stress") {
    if (!std::isfinite(FLAGS_shear_stress) || FLAGS_shear_stress == 0.0) {
      BadInput(Format("--shear_stress=%g must be finite and not 0",
                      FLAGS_shear_stress));
    }
    CheckRange("stress_steps", FLAGS_stress_steps, 1, 100000);
    for (const char* flag : {"strain",
                             "increments",
                             "cycles",
                             "events",
                             "event_threshold",
                             "stabilize",
                             "dynamics",
                             "paper"}) {
      if (IsGiven(flag)) {
        BadInput(std::string("--") + flag + " cannot go with --mode=stress");
      }
    }
  }
  for (const char* flag : {"shear_stress", "stress_steps"}) {
    if (IsGiven(flag) && FLAGS_mode != "stress") {
      BadInput(std::string("--") + flag + " needs --mode=stress");
    }
  }
  if (FLAGS_mode == "wall" || FLAGS_dynamics) {
    const std::string which = FLAGS_dynamics ? "--dynamics" : "--mode=wall";
    for (const char* flag :
         {"events", "event_threshold", "pressure", "paper"}) {
      if (IsGiven(flag)) {
        BadInput(std::string("--") + flag + " cannot go with " + which);
      }
    }
    for (const char* flag : {"mode", "cycles"}) {
      if (FLAGS_dynamics && IsGiven(flag)) {
        BadInput(std::string("--") + flag +
                 " cannot go with --dynamics, which is pure shear");
      }
    }
  }
  if (FLAGS_stabilize && !(FLAGS_pressure > 0.0)) {
    BadInput("--stabilize needs --pressure");
  }
  std::vector<double> increments;
  std::string error;
  if (!ParsePositives(FLAGS_increments, &increments, &error)) {
    BadInput("--increments: " + error);
  }
  for (const double increment : increments) {
    // Of the whole path.
    const double turns = std::max(1, 2 * FLAGS_cycles);
    const double steps = std::abs(FLAGS_strain) / increment;
    if (!(steps >= 1.0 - 1e-9) || turns * steps > kMostSteps ||
        std::abs(steps - std::round(steps)) > 1e-6 * steps) {
      BadInput(
          Format("--increments: %g does not divide --strain=%g into at "
                 "most %g steps",
                 increment,
                 FLAGS_strain,
                 kMostSteps));
    }
  }
  std::sort(increments.rbegin(), increments.rend());
  return increments;
}

int Main() {
  const Ensemble ensemble = ReadEnsembleFlags();
  const bool has_particles = IsGiven("particles");
  StrainShear shear;
  shear.mode = ReadMode();
  shear.increments = CheckFlags(shear.mode);
  shear.strain = FLAGS_strain;
  shear.cycles = FLAGS_cycles;
  shear.increments_text = FLAGS_increments;
  shear.pressure = FLAGS_pressure;
  shear.stabilize = FLAGS_stabilize;
  shear.events = FLAGS_events;
  shear.event_threshold = FLAGS_event_threshold;
  if (!ensemble.sizes.empty()) BadInput("--sizes is no flag of shear");
  Scene scene = MakeSceneWithSolver(FLAGS_phi);
  if (FLAGS_dynamics) {
    if (!FLAGS_input.empty()) {
      BadInput("--dynamics begins with random starts, not with --input");
    }
    if (IsGiven("jobs")) BadInput("--jobs is of no use with --dynamics");
    return RunDynamics(ensemble.asked ? ensemble.seeds
                                      : std::vector<std::uint64_t>{FLAGS_seed},
                       FLAGS_phi,
                       {shear.increments.back(), shear.strain},
                       std::move(scene.solver));
  }
  if (FLAGS_mode == "wall") {
    if (ensemble.asked) BadInput("--seeds cannot go with --mode=wall");
    if (shear.increments.size() != 1) {
      BadInput("--mode=wall takes one increment");
    }
    return RunWallShear(
        scene, FLAGS_wall, PathOf(shear, shear.increments.front()));
  }
  if (FLAGS_mode == "stress") {
    if (ensemble.asked) BadInput("--seeds cannot go with --mode=stress");
    StressPath path;
    path.stress = FLAGS_shear_stress;
    path.steps = FLAGS_stress_steps;
    return RunStressShear(scene, path, FLAGS_pressure);
  }
  if (ensemble.asked) return RunShearEnsemble(ensemble, has_particles);
  return RunStrainShear(scene, shear);
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "deform a jammed packing quasistatically: stress and "
                      "fabric against strain, plastic events (--paper: Fig. "
                      "8)");
  return granopt::Main();
}
