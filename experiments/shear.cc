// shear: quasistatic deformation of a jammed packing: pure shear (sec. 4.3,
// Fig. 8), simple shear in a Lees-Edwards cell, or cycles of compression, with
// stress and fabric against strain; the plastic events on the way, located.
// Also by walls, and by a given stress. With --seeds: the same for many
// packings, and the mean curves (shear_ensemble.h).

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "experiments/cases.h"
#include "experiments/checkpoint.h"
#include "experiments/ensemble.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/shear_curves.h"
#include "experiments/shear_dynamics.h"
#include "experiments/shear_ensemble.h"
#include "experiments/shear_events.h"
#include "experiments/shear_stress.h"
#include "experiments/shear_walls.h"
#include "granular/cell_energy.h"
#include "granular/linear_response.h"
#include "granular/packing_io.h"
#include "granular/quasistatic_shear.h"

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
// Of a relaxation in the search for an event.
constexpr std::int64_t kEventEvaluations = 100000;

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
  if (!ParseNumbers(FLAGS_increments, &increments, &error)) {
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

std::vector<double> PathOf(double increment) {
  const int steps =
      static_cast<int>(std::round(std::abs(FLAGS_strain) / increment));
  std::vector<double> path;
  for (int k = 1; k <= steps; ++k) path.push_back(FLAGS_strain * k / steps);
  if (FLAGS_cycles == 0) return path;
  for (int k = steps - 1; k >= 0; --k) {
    // Not -0.
    path.push_back(k == 0 ? 0.0 : FLAGS_strain * k / steps);
  }
  std::vector<double> all;
  for (int cycle = 0; cycle < FLAGS_cycles; ++cycle) {
    all.insert(all.end(), path.begin(), path.end());
  }
  return all;
}

// All that is kept between two steps.
struct Run {
  int curve = 0;  // of the increments, that in work
  bool begun = false;
  Packing start;  // relaxed
  QuasistaticShearState state;
  std::vector<StrainRow> rows;
  EventCatalogue events;
  int relaxations = 0, gave_up = 0;
  std::int64_t evaluations = 0, factorizations = 0;
  double seconds = 0.0;
};

Json ToJson(const Run& run) {
  QuasistaticShearState start;
  start.packing = run.start;
  return {{"curve", run.curve},
          {"begun", run.begun},
          {"start", granopt::ToJson(start)},
          {"state", granopt::ToJson(run.state)},
          {"rows", CurvesCsv(run.rows)},
          {"events", granopt::ToJson(run.events)},
          {"relaxations", run.relaxations},
          {"gave_up", run.gave_up},
          {"evaluations", run.evaluations},
          {"factorizations", run.factorizations},
          {"seconds", run.seconds}};
}

void ReadCheckpoint(const Checkpoint& checkpoint, Run* run) {
  Json json;
  if (!Resume(checkpoint, &json)) return;
  try {
    json.at("curve").get_to(run->curve);
    json.at("begun").get_to(run->begun);
    run->start = ShearStateOf(json.at("start")).packing;
    run->state = ShearStateOf(json.at("state"));
    run->events = EventCatalogueOf(json.at("events"));
    json.at("relaxations").get_to(run->relaxations);
    json.at("gave_up").get_to(run->gave_up);
    json.at("evaluations").get_to(run->evaluations);
    json.at("factorizations").get_to(run->factorizations);
    json.at("seconds").get_to(run->seconds);
    std::string error;
    if (!ParseCurves(json.at("rows").get<std::string>(), &run->rows, &error)) {
      BadInput("--resume: " + checkpoint.path() + ": " + error);
    }
  } catch (const Json::exception& exception) {
    RefuseState(checkpoint, exception);
  }
  std::printf("          resumed at strain %g of curve %d\n",
              run->state.strain,
              run->curve + 1);
}

// What the start resists: contacts beyond those of an isostatic packing, and
// its least shear modulus. Empty where a factor would be large, or for no
// answer.
Json StartJson(const Packing& packing, const ContactEnergyOptions& options) {
  Json json;
  const int many = packing.dimension() == 3 ? 2000 : 20000;
  std::string error;
  Relaxation as_it_is;
  if (packing.size() > many ||
      !MeasureAsItIs(packing, options, &as_it_is, &error)) {
    return json;
  }
  const Observables& o = as_it_is.observables;
  json["rigid_grains"] = o.rigid_grains;
  json["rigid_contacts"] = o.rigid_contacts;
  json["isostatic_contacts"] = o.isostatic_contacts;
  const ElasticResponse response = ComputeElasticResponse(packing, options);
  if (!response.found) return json;
  json["shear_modulus"] = response.shear;
  json["least_shear_modulus"] = response.shear_principal.minCoeff();
  json["most_shear_modulus"] = response.shear_principal.maxCoeff();
  return json;
}

int Main() {
  const Ensemble ensemble = ReadEnsembleFlags();
  const bool has_particles = IsGiven("particles");
  const DeformationMode mode = ReadMode();
  const std::vector<double> increments = CheckFlags(mode);
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
                       {increments.back(), FLAGS_strain},
                       std::move(scene.solver));
  }
  if (FLAGS_mode == "wall") {
    if (ensemble.asked) BadInput("--seeds cannot go with --mode=wall");
    if (increments.size() != 1) {
      BadInput("--mode=wall takes one increment");
    }
    return RunWallShear(
        std::move(scene), FLAGS_wall, PathOf(increments.front()));
  }
  if (FLAGS_mode == "stress") {
    if (ensemble.asked) BadInput("--seeds cannot go with --mode=stress");
    return RunStressShear(std::move(scene),
                          FLAGS_shear_stress,
                          FLAGS_stress_steps,
                          FLAGS_pressure);
  }
  if (ensemble.asked) return RunShearEnsemble(ensemble, has_particles);
  const SolveOptions solve = MakeSolveOptions();

  std::printf("shear     %s (%s), alpha = %g, phi = %.6f\n",
              Describe(scene.packing).c_str(),
              scene.origin.c_str(),
              scene.energy.alpha,
              scene.packing.PackingFraction());
  std::printf("          %s, strain %s%g%s in increments of %s\n",
              mode == DeformationMode::BULK ? "compression and expansion"
                                            : (FLAGS_mode + " shear").c_str(),
              FLAGS_cycles > 0 ? "0 to " : "to ",
              FLAGS_strain,
              FLAGS_cycles > 0
                  ? Format(" and back, %d times,", FLAGS_cycles).c_str()
                  : "",
              FLAGS_increments.c_str());
  if (FLAGS_paper) {
    std::printf(
        "          the paper states neither phi, alpha nor the number of "
        "grains of Fig. 8: assumed here\n");
  }
  if (FLAGS_pressure > 0.0) {
    std::printf("          at constant pressure %g%s\n",
                FLAGS_pressure,
                FLAGS_stabilize ? ", from a cell relaxed in every shape" : "");
  }
  std::printf(
      "          each state relaxed to |g| <= %g mean forces; method "
      "%s\n",
      solve.relative_tolerance,
      scene.solver->name().c_str());

  QuasistaticShearOptions options;
  options.energy = scene.energy;
  options.solve = solve;
  options.mode = mode;
  options.pressure = FLAGS_pressure;
  Json setup = {{"packing", Crc32(FormatPacking(scene.packing))},
                {"alpha", scene.energy.alpha},
                {"solver", scene.solver->name()},
                {"tolerance", solve.relative_tolerance},
                {"mode", FLAGS_mode},
                {"strain", FLAGS_strain},
                {"increments", FLAGS_increments},
                {"cycles", FLAGS_cycles},
                {"pressure", FLAGS_pressure},
                {"stabilize", FLAGS_stabilize},
                {"events", FLAGS_events},
                {"event_threshold", FLAGS_event_threshold},
                {"precision", PrecisionName(scene.energy.precision)}};
  const Checkpoint checkpoint(CheckpointPath(), setup);
  Run run;
  if (FLAGS_resume) ReadCheckpoint(checkpoint, &run);
  std::fflush(stdout);
  std::vector<std::string> names = WithEventFiles({"summary.json",
                                                   "curves.csv",
                                                   "agreement.csv",
                                                   "start.xyz",
                                                   "packing.xyz",
                                                   "contacts.csv",
                                                   "curves.svg",
                                                   "curves.png",
                                                   "packing.svg",
                                                   "packing.png"});
  const std::vector<std::string> kept = CheckpointFiles();
  if (!FLAGS_resume) names.insert(names.end(), kept.begin(), kept.end());
  Output output;
  output.Create(FLAGS_out, names, kept);
  CatchStopSignals();

  std::string error;
  Relaxation last;
  bool stopped = false;
  {
    Progress progress;
    std::string stage;
    options.solve.callback = [&](const IterationState& state) {
      if (progress.Due()) {
        progress.Show(Format("%s | iteration %lld: |g| / mean force %.1e",
                             stage.c_str(),
                             static_cast<long long>(state.counters.iterations),
                             state.scales.gradient > 0
                                 ? state.max_gradient / state.scales.gradient
                                 : 0.0));
      }
      return true;
    };
    if (run.start.size() == 0) {
      stage = "the start";
      Relaxation start;
      if (!Relax(scene.packing,
                 scene.energy,
                 *scene.solver,
                 options.solve,
                 &start,
                 &error)) {
        BadInput(error);
      }
      run.relaxations = 1;
      run.gave_up = start.summary.Succeeded() ? 0 : 1;
      if (FLAGS_pressure > 0.0) {
        ConstantStressOptions stress;
        stress.energy = scene.energy;
        stress.solve = options.solve;
        stress.pressure = FLAGS_pressure;
        const int d = scene.packing.dimension();
        stress.strains = FLAGS_stabilize ? AllStrains(d) : IsotropicStrain(d);
        ConstantStressResult result;
        if (!RelaxAtStress(
                start.packing, stress, *scene.solver, &result, &error)) {
          BadInput(error);
        }
        ++run.relaxations;
        result.relaxation.summary.counters = result.counters;
        result.relaxation.summary.counters += start.summary.counters;
        result.relaxation.summary.seconds =
            result.seconds + start.summary.seconds;
        start = std::move(result.relaxation);
        run.gave_up = result.converged ? 0 : 1;
      }
      run.start = start.packing;
      run.evaluations = start.summary.counters.evaluations;
      run.factorizations = start.summary.counters.factorizations;
      run.seconds = start.summary.seconds;
    }
    for (; run.curve < static_cast<int>(increments.size()) && !stopped;
         ++run.curve) {
      const double increment = increments[run.curve];
      const bool is_finest =
          run.curve + 1 == static_cast<int>(increments.size());
      options.path = PathOf(increment);
      const auto observer = [&](const QuasistaticShearStep& step) {
        run.rows.push_back(RowOf(increment, mode, step));
        run.begun = true;
        run.state = *step.state;
        stage = Format("increment %g, step %d of %zu",
                       increment,
                       step.step + 1,
                       options.path.size());
        if (step.step == 0) return true;
        ++run.relaxations;
        const QuasistaticShearState& now = *step.state;
        const QuasistaticShearState& before = *step.before;
        run.gave_up += now.gave_up - before.gave_up;
        run.evaluations +=
            now.counters.evaluations - before.counters.evaluations;
        run.factorizations +=
            now.counters.factorizations - before.counters.factorizations;
        run.seconds += now.seconds - before.seconds;
        if (FLAGS_events && is_finest &&
            step.dissipated > FLAGS_event_threshold * step.before->energy) {
          stage += ", events";
          PlasticEventOptions event_options;
          event_options.energy = scene.energy;
          event_options.solve = options.solve;
          event_options.solve.max_evaluations = kEventEvaluations;
          event_options.mode = mode;
          if (!NoteEvents(*step.before,
                          step.strain,
                          FLAGS_event_threshold,
                          event_options,
                          *scene.solver,
                          &run.events,
                          &error)) {
            BadInput(error);
          }
        }
        // Not after the very last one, which a resumed run does again: that is
        // where its results come from.
        const bool is_end =
            is_finest && step.step == static_cast<int>(options.path.size());
        if (is_end) return true;
        std::string fault;
        if (!checkpoint.Write(ToJson(run), &fault)) BadInput(fault);
        return !StopRequested();
      };
      QuasistaticShearResult result;
      bool finished;
      if (run.begun) {
        finished = ContinueShear(
            options, *scene.solver, observer, &run.state, &result, &error);
      } else {
        stage = Format("increment %g, step 1", increment);
        finished = ShearQuasistatically(
            run.start, options, *scene.solver, observer, &result, &error);
      }
      stopped = !finished && StopRequested();
      if (!finished && !stopped) BadInput(error);
      last = std::move(result.last);
      if (!stopped) run.begun = false;
    }
  }
  if (stopped) {
    std::printf(
        "\nstopped as asked, at strain %g: the same command with --resume "
        "goes on\n",
        run.state.strain);
    return kNotConverged;
  }

  const std::vector<Agreement> agreement = CompareIncrements(run.rows);
  Json json;
  json["converged"] = run.gave_up == 0;
  json["mode"] = FLAGS_mode;
  json["strain"] = FLAGS_strain;
  json["increments"] = increments;
  json["cycles"] = FLAGS_cycles;
  json["pressure"] = FLAGS_pressure;
  json["stabilized"] = FLAGS_stabilize;
  json["relaxations"] = run.relaxations;
  json["gave_up"] = run.gave_up;
  json["evaluations"] = run.evaluations;
  json["factorizations"] = run.factorizations;
  json["seconds"] = run.seconds;
  json["solver"] = scene.solver->name();
  json["alpha"] = scene.energy.alpha;
  json["precision"] = PrecisionName(scene.energy.precision);
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["tolerance"] = solve.relative_tolerance;
  json["start"] = StartJson(run.start, scene.energy);
  json["curves"] = CurvesJson(run.rows);
  json["agreement"] = AgreementJson(agreement);
  json["state"] = RelaxationJson(last);
  json["schema"] = "granopt/shear/1";
  output.Write("curves.csv", CurvesCsv(run.rows));
  if (!agreement.empty()) {
    output.Write("agreement.csv", AgreementCsv(agreement));
  }
  output.WritePacking("start.xyz", run.start);
  output.WritePacking("packing.xyz", Annotated(last, scene.energy));
  output.Write("contacts.csv", ContactsCsv(last));
  PlasticEventOptions event_options;
  event_options.energy = scene.energy;
  event_options.solve = solve;
  event_options.solve.max_evaluations = kEventEvaluations;
  event_options.mode = mode;
  std::string event_lines;
  if (FLAGS_events) {
    event_lines =
        PublishEvents(run.events, event_options, *scene.solver, &output, &json);
  }
  json["provenance"] = Provenance();
  output.WriteJson("summary.json", json);
  output.Plot(
      {"shear",
       output.Path("curves.csv"),
       output.Path("curves"),
       "--mode=" + FLAGS_mode,
       Format("--first=%s", FLAGS_pressure > 0.0 ? "phi" : "stress_iso")},
      {"curves.svg", "curves.png"});
  output.Plot({"packing",
               output.Path("packing.xyz"),
               output.Path("contacts.csv"),
               output.Path("packing")},
              {"packing.svg", "packing.png"});

  const Json& start_json = json["start"];
  if (start_json.contains("least_shear_modulus")) {
    const double least = start_json["least_shear_modulus"].get<double>();
    std::printf(
        "\n  start         %d contacts among %d rigid grains (isostatic: %d); "
        "shear moduli from %.3e to %.3e over all directions%s\n",
        start_json["rigid_contacts"].get<int>(),
        start_json["rigid_grains"].get<int>(),
        start_json["isostatic_contacts"].get<int>(),
        least,
        start_json["most_shear_modulus"].get<double>(),
        least < 0.0 ? ": it is held by its cell" : "");
  }
  if (!run.rows.empty() && run.rows.front().contacts == 0) {
    std::printf(
        "\n  start         carries no force: it is not jammed (--phi=%g)\n",
        run.rows.front().phi);
  }
  std::printf("%s", CurvesTable(run.rows, mode).c_str());
  std::printf("%s", AgreementTable(agreement).c_str());
  std::printf("%s", event_lines.c_str());
  std::printf(
      "  work          %d relaxations, %lld evaluations, %lld factors, %.3g "
      "s%s\n",
      run.relaxations,
      static_cast<long long>(run.evaluations),
      static_cast<long long>(run.factorizations),
      run.seconds,
      run.gave_up > 0 ? Format("; %d DID NOT CONVERGE", run.gave_up).c_str()
                      : "");
  output.PrintFiles();
  return run.gave_up == 0 ? kConverged : kNotConverged;
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
