#include "experiments/shear_strain.h"

#include <cmath>
#include <cstdio>
#include <utility>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "experiments/shear_curves.h"
#include "experiments/shear_events.h"
#include "granular/constant_stress.h"
#include "granular/linear_response.h"

DECLARE_bool(paper);
DECLARE_bool(resume);

namespace granopt {
namespace {

// Of a relaxation in the search for an event.
constexpr std::int64_t kEventEvaluations = 100000;

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

Run RunOf(const Json& json) {
  Run run;
  json.at("curve").get_to(run.curve);
  json.at("begun").get_to(run.begun);
  run.start = ShearStateOf(json.at("start")).packing;
  run.state = ShearStateOf(json.at("state"));
  run.events = EventCatalogueOf(json.at("events"));
  json.at("relaxations").get_to(run.relaxations);
  json.at("gave_up").get_to(run.gave_up);
  json.at("evaluations").get_to(run.evaluations);
  json.at("factorizations").get_to(run.factorizations);
  json.at("seconds").get_to(run.seconds);
  std::string error;
  if (!ParseCurves(json.at("rows").get<std::string>(), &run.rows, &error)) {
    throw Json::other_error::create(501, error, &json);
  }
  return run;
}

void PrintTask(const Scene& scene, const StrainShear& shear) {
  std::printf("shear     %s (%s), alpha = %g, phi = %.6f\n",
              Describe(scene.packing).c_str(),
              scene.origin.c_str(),
              scene.energy.alpha,
              scene.packing.PackingFraction());
  std::printf("          %s, strain %s%g%s in increments of %s\n",
              shear.mode == DeformationMode::BULK
                  ? "compression and expansion"
                  : Format("%s shear", DeformationModeName(shear.mode)).c_str(),
              shear.cycles > 0 ? "0 to " : "to ",
              shear.strain,
              shear.cycles > 0
                  ? Format(" and back, %d times,", shear.cycles).c_str()
                  : "",
              shear.increments_text.c_str());
  if (FLAGS_paper) {
    std::printf(
        "          the paper states neither phi, alpha nor the number of "
        "grains of Fig. 8: assumed here\n");
  }
  if (shear.pressure > 0.0) {
    std::printf("          at constant pressure %g%s\n",
                shear.pressure,
                shear.stabilize ? ", from a cell relaxed in every shape" : "");
  }
  std::printf(
      "          each state relaxed to |g| <= %g mean forces; method "
      "%s\n",
      MakeSolveOptions().relative_tolerance,
      scene.solver->name().c_str());
}

// At constant volume, then, if asked for, at the pressure.
void RelaxStart(const Scene& scene,
                const StrainShear& shear,
                const SolveOptions& solve,
                Run* run) {
  std::string error;
  Relaxation start;
  if (!Relax(
          scene.packing, scene.energy, *scene.solver, solve, &start, &error)) {
    BadInput(error);
  }
  run->relaxations = 1;
  run->gave_up = start.summary.Succeeded() ? 0 : 1;
  Counters counters = start.summary.counters;
  run->seconds = start.summary.seconds;
  run->start = std::move(start.packing);
  if (shear.pressure > 0.0) {
    ConstantStressOptions stress;
    stress.energy = scene.energy;
    stress.solve = solve;
    stress.pressure = shear.pressure;
    const int d = scene.packing.dimension();
    stress.strains = shear.stabilize ? AllStrains(d) : IsotropicStrain(d);
    ConstantStressResult result;
    if (!RelaxAtStress(run->start, stress, *scene.solver, &result, &error)) {
      BadInput(error);
    }
    ++run->relaxations;
    run->gave_up = result.converged ? 0 : 1;
    counters += result.counters;
    run->seconds += result.seconds;
    run->start = std::move(result.relaxation.packing);
  }
  run->evaluations = counters.evaluations;
  run->factorizations = counters.factorizations;
}

PlasticEventOptions EventOptions(const Scene& scene,
                                 const StrainShear& shear,
                                 const SolveOptions& solve) {
  PlasticEventOptions options;
  options.energy = scene.energy;
  options.solve = solve;
  options.solve.max_evaluations = kEventEvaluations;
  options.mode = shear.mode;
  return options;
}

// From where `run` stands to the end of the last curve, `last`. False if the
// user stopped it.
bool Deform(const Scene& scene,
            const StrainShear& shear,
            const Checkpoint& checkpoint,
            Run* run,
            Relaxation* last) {
  QuasistaticShearOptions options;
  options.energy = scene.energy;
  options.solve = MakeSolveOptions();
  options.mode = shear.mode;
  options.pressure = shear.pressure;
  std::string error;
  Progress progress;
  std::string stage = "the start";
  options.solve.callback = [&](const IterationState& state) {
    if (progress.Due()) progress.Show(stage + " | " + IterationLine(state));
    return true;
  };
  if (run->start.size() == 0) RelaxStart(scene, shear, options.solve, run);
  for (; run->curve < static_cast<int>(shear.increments.size()); ++run->curve) {
    const double increment = shear.increments[run->curve];
    const bool is_finest =
        run->curve + 1 == static_cast<int>(shear.increments.size());
    options.path = PathOf(shear, increment);
    const auto observer = [&](const QuasistaticShearStep& step) {
      run->rows.push_back(RowOf(increment, shear.mode, step));
      run->begun = true;
      run->state = *step.state;
      stage = Format("increment %g, step %d of %zu",
                     increment,
                     step.step + 1,
                     options.path.size());
      if (step.step == 0) return true;
      ++run->relaxations;
      const QuasistaticShearState& now = *step.state;
      const QuasistaticShearState& before = *step.before;
      run->gave_up += now.gave_up - before.gave_up;
      run->evaluations +=
          now.counters.evaluations - before.counters.evaluations;
      run->factorizations +=
          now.counters.factorizations - before.counters.factorizations;
      run->seconds += now.seconds - before.seconds;
      if (shear.events && is_finest &&
          step.dissipated > shear.event_threshold * before.energy) {
        stage += ", events";
        if (!NoteEvents(before,
                        step.strain,
                        shear.event_threshold,
                        EventOptions(scene, shear, options.solve),
                        *scene.solver,
                        &run->events,
                        &error)) {
          BadInput(error);
        }
      }
      // A resumed run does the very last one again: there its results come
      // from.
      if (is_finest && step.step == static_cast<int>(options.path.size())) {
        return true;
      }
      const bool stop = StopRequested();
      if (stop || IsCheckpointStep(run->rows.size())) {
        Save(checkpoint, ToJson(*run));
      }
      return !stop;
    };
    QuasistaticShearResult result;
    bool finished;
    if (run->begun) {
      finished = ContinueShear(
          options, *scene.solver, observer, &run->state, &result, &error);
    } else {
      stage = Format("increment %g, step 1", increment);
      finished = ShearQuasistatically(
          run->start, options, *scene.solver, observer, &result, &error);
    }
    if (!finished && StopRequested()) return false;
    if (!finished) BadInput(error);
    *last = std::move(result.last);
    run->begun = false;
  }
  return true;
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

void PrintStart(const Json& start, const std::vector<StrainRow>& rows) {
  if (start.contains("least_shear_modulus")) {
    const double least = start["least_shear_modulus"].get<double>();
    std::printf(
        "\n  start         %d contacts among %d rigid grains (isostatic: %d); "
        "shear moduli from %.3e to %.3e over all directions%s\n",
        start["rigid_contacts"].get<int>(),
        start["rigid_grains"].get<int>(),
        start["isostatic_contacts"].get<int>(),
        least,
        start["most_shear_modulus"].get<double>(),
        least < 0.0 ? ": it is held by its cell" : "");
  }
  if (!rows.empty() && rows.front().contacts == 0) {
    std::printf(
        "\n  start         carries no force: it is not jammed (--phi=%g)\n",
        rows.front().phi);
  }
}

void Publish(const Scene& scene,
             const StrainShear& shear,
             const Run& run,
             const Relaxation& last,
             Output* output) {
  const SolveOptions solve = MakeSolveOptions();
  const std::vector<Agreement> agreement = CompareIncrements(run.rows);
  Json json;
  json["converged"] = run.gave_up == 0;
  json["mode"] = DeformationModeName(shear.mode);
  json["strain"] = shear.strain;
  json["increments"] = shear.increments;
  json["cycles"] = shear.cycles;
  json["pressure"] = shear.pressure;
  json["stabilized"] = shear.stabilize;
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
  output->Write("curves.csv", CurvesCsv(run.rows));
  if (!agreement.empty()) {
    output->Write("agreement.csv", AgreementCsv(agreement));
  }
  output->WritePacking("start.xyz", run.start);
  output->WriteRelaxation(last, scene.energy);
  std::string event_lines;
  if (shear.events) {
    event_lines = PublishEvents(run.events,
                                EventOptions(scene, shear, solve),
                                *scene.solver,
                                output,
                                &json);
  }
  json["provenance"] = Provenance();
  output->WriteJson("summary.json", json);
  output->Plot(
      {"shear",
       output->Path("curves.csv"),
       output->Path("curves"),
       Format("--mode=%s", DeformationModeName(shear.mode)),
       Format("--first=%s", shear.pressure > 0.0 ? "phi" : "stress_iso")},
      {"curves.svg", "curves.png"});
  output->PlotPacking();

  PrintStart(json["start"], run.rows);
  std::printf("%s", CurvesTable(run.rows, shear.mode).c_str());
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
  output->PrintFiles();
}

}  // namespace

std::vector<double> PathOf(const StrainShear& shear, double increment) {
  const int steps =
      static_cast<int>(std::round(std::abs(shear.strain) / increment));
  std::vector<double> path;
  for (int k = 1; k <= steps; ++k) path.push_back(shear.strain * k / steps);
  if (shear.cycles == 0) return path;
  for (int k = steps - 1; k >= 0; --k) {
    // Not -0.
    path.push_back(k == 0 ? 0.0 : shear.strain * k / steps);
  }
  std::vector<double> all;
  for (int cycle = 0; cycle < shear.cycles; ++cycle) {
    all.insert(all.end(), path.begin(), path.end());
  }
  return all;
}

int RunStrainShear(const Scene& scene, const StrainShear& shear) {
  PrintTask(scene, shear);
  Json setup = SceneSetup(scene, MakeSolveOptions());
  setup.update({{"mode", DeformationModeName(shear.mode)},
                {"strain", shear.strain},
                {"increments", shear.increments_text},
                {"cycles", shear.cycles},
                {"pressure", shear.pressure},
                {"stabilize", shear.stabilize},
                {"events", shear.events},
                {"event_threshold", shear.event_threshold}});
  const Checkpoint checkpoint(CheckpointPath(), setup);
  Run run;
  if (FLAGS_resume &&
      Resume(checkpoint, [&run](const Json& json) { run = RunOf(json); })) {
    std::printf("          resumed at strain %g of curve %d\n",
                run.state.strain,
                run.curve + 1);
  }
  std::fflush(stdout);
  Output output;
  CreateOutput(WithEventFiles({"summary.json",
                               "curves.csv",
                               "agreement.csv",
                               "start.xyz",
                               "packing.xyz",
                               "contacts.csv",
                               "curves.svg",
                               "curves.png",
                               "packing.svg",
                               "packing.png"}),
               FLAGS_resume,
               &output);
  Relaxation last;
  if (!Deform(scene, shear, checkpoint, &run, &last)) {
    return StoppedAsAsked(Format("at strain %g", run.state.strain));
  }
  Publish(scene, shear, run, last, &output);
  return run.gave_up == 0 ? kConverged : kNotConverged;
}

}  // namespace granopt
