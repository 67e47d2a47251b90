// fidelity: the smallest model that a scene needs. Climbs the ladder of
// ingredients of a flow, contacts -> restitution law -> friction -> near field
// -> images, from the same starts, and says what each costs a step and how far
// each observable is from that of the whole model, with its statistical error.
//
//   fidelity --scene=sand|powder --accuracy=0.05 --seeds=20 --out=DIR
//   fidelity --scene=packing                 a jammed packing: law, pre-stress,
//                                            precision
//
// Differences are paired: the same start, model against model. A model is good
// enough if its difference and two standard errors stay within the accuracy.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "experiments/cases.h"
#include "experiments/preparation.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/flow/flow.h"
#include "granular/flow/stepper.h"
#include "granular/linear_response.h"

DEFINE_string(scene,
              "sand",
              "sand (dense, dry, hardly charged), powder (the paper's grains, "
              "strengths 0.5, 0.25) or packing");
DEFINE_double(accuracy,
              0.05,
              "of every observable, relative to that of the whole model");
DEFINE_string(observables,
              "T,relative_fraction,dissipated,spread",
              "of a flow, that must be right");
DEFINE_int32(seeds, 20, "starts");
DEFINE_double(duration, 1.0, "end of each run, s");
DEFINE_double(dt, 0.002, "time step of velocity Verlet, s");

namespace granopt {
namespace {

// ------------------------------------------------------------ flows

struct FlowPreset {
  const char* name;
  const char* what;
  double length_ratio;
  double alpha1, alpha2;
};
const FlowPreset kPresets[] = {
    {"sand",
     "100 grains, volume fraction 0.18, (alpha1, alpha2) = (1e-4, 5e-5)",
     0.35,
     1e-4,
     5e-5},
    {"powder",
     "100 grains, volume fraction 0.065, (alpha1, alpha2) = (0.5, 0.25)",
     0.25,
     0.5,
     0.25},
};

struct Model {
  const char* name;
  bool contacts, restitution_law, friction, near_field, images;
  double soft_alpha;  // 0: impacts
};
// The last rung is the whole model; below it others that change one thing.
const Model kLadder[] = {
    {"free flight", false, false, false, false, false, 0.0},
    {"contacts", true, false, false, false, false, 0.0},
    {"+ restitution law", true, true, false, false, false, 0.0},
    {"+ friction", true, true, true, false, false, 0.0},
    {"+ near field", true, true, true, true, false, 0.0},
    {"+ images (whole)", true, true, true, true, true, 0.0},
    {"whole, no friction", true, true, false, true, true, 0.0},
    {"whole, e constant", true, false, true, true, true, 0.0},
    {"whole, no near field", true, true, true, false, true, 0.0},
    {"whole, soft Hooke", true, false, false, true, true, 2.0},
    {"whole, soft Hertz", true, false, false, true, true, 2.5},
};
constexpr int kWhole = 5;
constexpr int kModels = 11;

struct Quantity {
  const char* name;
  const char* what;
};
const Quantity kQuantities[] = {
    {"T", "kinetic energy a mass"},
    {"relative_fraction", "of it relative to the centre of mass"},
    {"dissipated", "energy a mass that contacts took"},
    {"spread", "root mean square distance from the centre of mass"},
};
constexpr int kNumQuantities = 4;

// One run, or false with one line in `error`.
bool RunModel(const FlowPreset& preset,
              const Model& model,
              std::uint64_t seed,
              double* values,
              double* seconds_a_step,
              std::string* error) {
  FlowStart start;
  start.length_ratio = preset.length_ratio;
  start.seed = seed;
  start.period = start.side;  // the same start for every model
  FlowSceneOptions options;
  options.domain.kind =
      model.images ? Domain::Kind::NEAREST_IMAGE : Domain::Kind::REENTRY;
  options.domain.side = start.side;
  FlowState state;
  if (!MakeStart(start, &options.grains, &state, error)) return false;
  if (model.near_field) {
    options.near_field = NearFieldOptions();
    options.near_field->law =
        RadialLaw::Powers(preset.alpha1, 1.0, preset.alpha2, 2.0);
  }
  if (model.contacts && model.soft_alpha == 0.0) {
    ImpactOptions impact;
    impact.is_velocity_dependent = model.restitution_law;
    if (model.friction) {
      impact.friction = {0.2, 0.1};
    } else {
      impact.friction = {0.0, 0.0};
    }
    options.impact = impact;
  } else if (model.contacts) {
    options.soft_contact = SoftContactOptions();
    options.soft_contact->alpha = model.soft_alpha;
    // An impact at the mean speed lasts some ten steps and overlaps by less
    // than a tenth of a radius.
    const double mass = options.grains.mass[0];
    const double radius = options.grains.radius[0];
    const double overlap = 0.1 * radius;
    options.soft_contact->stiffness =
        0.5 * mass * model.soft_alpha / std::pow(overlap, model.soft_alpha);
  }
  const auto scene = FlowScene::Create(options, error);
  if (scene == nullptr || !scene->Begin(FLAGS_dt, &state, error)) return false;
  StepperOptions stepping;
  stepping.step = FLAGS_dt;
  const auto stepper = CreateVerletStepper(stepping);
  const double begin = CpuSeconds();
  const std::int64_t first = state.steps;
  StepReport report;
  while (state.time < FLAGS_duration * (1.0 - 1e-12)) {
    if (!stepper->Step(
            *scene, FLAGS_duration - state.time, &state, &report, error)) {
      return false;
    }
  }
  *seconds_a_step =
      (CpuSeconds() - begin) / static_cast<double>(state.steps - first);
  const double mass = scene->total_mass();
  const KineticEnergy kinetic = scene->Kinetic(state.v.data());
  values[0] = kinetic.total() / mass;
  values[1] = kinetic.relative / kinetic.total();
  values[2] = -(state.energy.impact + state.energy.friction) / mass;
  // With and without images grains are in the cube.
  double spread = 0.0;
  const int n = scene->size(), stride = scene->stride();
  for (int k = 0; k < 3; ++k) {
    double sum = 0.0, squares = 0.0;
    for (int i = 0; i < n; ++i) {
      const double x = state.x[k * stride + i];
      sum += x;
      squares += x * x;
    }
    spread += squares / n - (sum / n) * (sum / n);
  }
  values[3] = std::sqrt(spread);
  return true;
}

struct Change {
  double mean = 0.0, error = 0.0;  // of one quantity of one model
  double difference = 0.0, difference_error = 0.0;  // from the whole model
};

int RunFlows(const FlowPreset& preset,
             const std::vector<bool>& wanted,
             Output* output) {
  std::vector<std::vector<std::vector<double>>> values(
      kModels, std::vector<std::vector<double>>(kNumQuantities));
  std::vector<std::vector<double>> seconds(kModels);
  std::string error;
  {
    Progress progress;
    for (int s = 1; s <= FLAGS_seeds; ++s) {
      for (const int m : MethodOrder(kModels, s - 1)) {
        if (progress.Due()) {
          progress.Show(
              Format("start %d of %d, %s", s, FLAGS_seeds, kLadder[m].name));
        }
        double observed[kNumQuantities];
        double cost = 0.0;
        if (!RunModel(preset,
                      kLadder[m],
                      FLAGS_seed + static_cast<std::uint64_t>(s) - 1,
                      observed,
                      &cost,
                      &error)) {
          BadInput(std::string(kLadder[m].name) + ": " + error);
        }
        for (int q = 0; q < kNumQuantities; ++q) {
          values[m][q].push_back(observed[q]);
        }
        seconds[m].push_back(cost);
      }
    }
  }
  std::vector<std::vector<Change>> table(kModels,
                                         std::vector<Change>(kNumQuantities));
  for (int m = 0; m < kModels; ++m) {
    for (int q = 0; q < kNumQuantities; ++q) {
      std::vector<double> apart;
      for (int s = 0; s < FLAGS_seeds; ++s) {
        apart.push_back(values[m][q][s] - values[kWhole][q][s]);
      }
      const MeanDeviation value = MeanAndDeviation(values[m][q]);
      const MeanDeviation difference = MeanAndDeviation(apart);
      table[m][q] = {value.mean,
                     value.standard_error,
                     difference.mean,
                     difference.standard_error};
    }
  }
  // Good enough, too far, or more starts are needed to tell.
  const auto verdict = [&](int m, int q) -> const char* {
    const double allowed = FLAGS_accuracy * std::abs(table[kWhole][q].mean);
    const Change& t = table[m][q];
    const double two = 2.0 * t.difference_error;
    if (std::abs(t.difference) + two <= allowed) return "ok";
    if (std::abs(t.difference) - two > allowed) return "no";
    return "?";
  };
  int recommended = -1;
  bool is_open = false;
  for (int m = 0; m < kModels; ++m) {
    bool all = true, open = false;
    for (int q = 0; q < kNumQuantities; ++q) {
      if (!wanted[q]) continue;
      const std::string v = verdict(m, q);
      all = all && v == "ok";
      open = open || v == "?";
    }
    if (!all) {
      is_open = is_open || (open && recommended < 0);
      continue;
    }
    if (recommended < 0 ||
        MedianOf(seconds[m]) < MedianOf(seconds[recommended])) {
      recommended = m;
    }
  }

  std::string csv =
      "model,quantity,mean,standard_error,difference,difference_error,verdict,"
      "cpu_seconds_a_step\n";
  std::vector<std::vector<std::string>> rows = {{"model", "us a step"}};
  for (const Quantity& quantity : kQuantities) {
    rows[0].push_back(quantity.name);
    rows[0].push_back("change");
  }
  for (int m = 0; m < kModels; ++m) {
    rows.push_back(
        {kLadder[m].name, Format("%.2f", 1e6 * MedianOf(seconds[m]))});
    for (int q = 0; q < kNumQuantities; ++q) {
      const Change& t = table[m][q];
      csv += Field(kLadder[m].name) + "," + kQuantities[q].name +
             Format(",%.9g,%.4g,%.9g,%.4g,%s,%.6g\n",
                    t.mean,
                    t.error,
                    t.difference,
                    t.difference_error,
                    verdict(m, q),
                    MedianOf(seconds[m]));
      rows.back().push_back(Format("%.4f(%.0f)", t.mean, 1e4 * t.error));
      const double whole = std::abs(table[kWhole][q].mean);
      rows.back().push_back(m == kWhole
                                ? "-"
                                : Format("%+.1f +- %.1f %% %s",
                                         100.0 * t.difference / whole,
                                         100.0 * t.difference_error / whole,
                                         verdict(m, q)));
    }
  }
  Json json;
  json["scene"] = preset.name;
  json["accuracy"] = FLAGS_accuracy;
  json["starts"] = FLAGS_seeds;
  json["recommended"] =
      recommended < 0 ? "none" : std::string(kLadder[recommended].name);
  json["models"] = Json::array();
  for (int m = 0; m < kModels; ++m) {
    Json model = {{"model", kLadder[m].name},
                  {"cpu_seconds_a_step", MedianOf(seconds[m])}};
    for (int q = 0; q < kNumQuantities; ++q) {
      model[kQuantities[q].name] = {
          {"mean", table[m][q].mean},
          {"standard_error", table[m][q].error},
          {"difference", table[m][q].difference},
          {"difference_error", table[m][q].difference_error},
          {"verdict", verdict(m, q)}};
    }
    json["models"].push_back(model);
  }
  json["schema"] = "granopt/fidelity/1";
  json["provenance"] = Provenance();
  output->Write("fidelity.csv", csv);
  output->WriteJson("summary.json", json);
  output->Plot({"fidelity",
                output->Path("fidelity.csv"),
                output->Path("fidelity"),
                Format("--accuracy=%g", FLAGS_accuracy)},
               {"fidelity.svg", "fidelity.png"});
  std::printf("\n%s\n", Grid(rows, 0, false).c_str());
  std::printf(
      "  means (standard error in the last digits) at t = %g s over %d starts; "
      "change: from the whole model, start by start,\n  +- its standard error; "
      "ok, no: within or beyond %g %% by two of those, ?: more --seeds would "
      "tell\n",
      FLAGS_duration,
      FLAGS_seeds,
      100.0 * FLAGS_accuracy);
  for (const Quantity& quantity : kQuantities) {
    std::printf("  %s: %s\n", quantity.name, quantity.what);
  }
  if (recommended >= 0) {
    std::printf(
        "\n  cheapest model within %g %%: %s, %.2f of the cost of the "
        "whole\n",
        100.0 * FLAGS_accuracy,
        kLadder[recommended].name,
        MedianOf(seconds[recommended]) / MedianOf(seconds[kWhole]));
  }
  if (is_open) {
    std::printf("  cheaper ones are undecided: more --seeds would tell\n");
  }
  output->PrintFiles();
  return kConverged;
}

// ------------------------------------------------------------ a packing

struct PackingModel {
  const char* name;
  double alpha;
  Precision precision;
  double tolerance;
  bool prestress;
};
const PackingModel kPackingModels[] = {
    {"whole: double, pre-stress", 2.0, Precision::DOUBLE, 1e-10, true},
    {"no pre-stress in moduli", 2.0, Precision::DOUBLE, 1e-10, false},
    {"mixed precision", 2.0, Precision::MIXED, 1e-10, true},
    {"single precision, 1e-5", 2.0, Precision::FLOAT, 1e-5, true},
    {"double precision, 1e-5", 2.0, Precision::DOUBLE, 1e-5, true},
    {"Hertz instead of Hooke", 2.5, Precision::DOUBLE, 1e-10, true},
};
constexpr int kPackingModelCount = 6;

int RunPackings(Output* output) {
  struct Observed {
    std::vector<double> z, g, b, p, seconds;
  };
  std::vector<Observed> observed(kPackingModelCount);
  std::string error;
  const std::unique_ptr<Solver> first_order = MakeSolver("solver", "lbfgs");
  {
    Progress progress;
    for (int s = 0; s < FLAGS_seeds; ++s) {
      FLAGS_alpha = 2.0;
      const Scene scene =
          MakeScene(0.86, FLAGS_seed + static_cast<std::uint64_t>(s));
      const std::unique_ptr<Solver> prepare =
          MakeSolver("solver", kDefaultSolver);
      Preparation preparation(scene, *prepare, 0.86, output);
      std::vector<Packing> states;
      if (!preparation.NearJamming(FLAGS_seed + static_cast<std::uint64_t>(s),
                                   {1e-3},
                                   &states,
                                   &error)) {
        BadInput(error);
      }
      preparation.ClearProgress();
      Packing start = states[0];
      start.Deform(SimpleShear(start.dimension(), 1e-5));
      for (int m = 0; m < kPackingModelCount; ++m) {
        const PackingModel& model = kPackingModels[m];
        ContactEnergyOptions law;
        law.alpha = model.alpha;
        law.precision = model.precision;
        SolveOptions options = MakeSolveOptions();
        options.relative_tolerance = model.tolerance;
        options.max_evaluations = 200000;
        Relaxation run;
        const double begin = CpuSeconds();
        if (!Relax(start, law, *first_order, options, &run, &error)) {
          BadInput(error);
        }
        const double cost = CpuSeconds() - begin;
        const ElasticResponse r =
            ComputeElasticResponse(run.packing, law, model.prestress);
        if (!r.found) {
          BadInput(Format("packing %d, %s: no moduli: %s",
                          s + 1,
                          model.name,
                          r.message.c_str()));
        }
        Observed& o = observed[m];
        // Moduli in units of kappa, so that laws compare.
        const double kappa = (model.alpha - 1.0) * run.observables.mean_force /
                             run.observables.mean_overlap;
        o.z.push_back(run.observables.coordination);
        o.g.push_back(r.shear_mean / kappa);
        o.b.push_back(r.bulk_growth / kappa);
        o.p.push_back(run.observables.pressure / kappa);
        o.seconds.push_back(cost);
      }
      if (progress.Due()) {
        progress.Show(Format("packing %d of %d", s + 1, FLAGS_seeds));
      }
    }
  }
  std::string csv =
      "model,quantity,mean,standard_error,difference,difference_error,verdict,"
      "cpu_seconds_a_step\n";
  std::vector<std::vector<std::string>> rows = {{"model",
                                                 "CPU ms",
                                                 "z",
                                                 "change",
                                                 "G / kappa",
                                                 "change",
                                                 "B / kappa",
                                                 "change",
                                                 "p / kappa",
                                                 "change"}};
  Json json;
  json["scene"] = "packing";
  json["models"] = Json::array();
  for (int m = 0; m < kPackingModelCount; ++m) {
    rows.push_back({kPackingModels[m].name,
                    Format("%.2f", 1e3 * MedianOf(observed[m].seconds))});
    Json of_model = {{"model", kPackingModels[m].name},
                     {"cpu_seconds", MedianOf(observed[m].seconds)}};
    const std::vector<double>* const mine[] = {
        &observed[m].z, &observed[m].g, &observed[m].b, &observed[m].p};
    const std::vector<double>* const whole[] = {
        &observed[0].z, &observed[0].g, &observed[0].b, &observed[0].p};
    const char* const names[] = {"z", "G", "B", "p"};
    for (int q = 0; q < 4; ++q) {
      std::vector<double> apart;
      for (std::size_t s = 0; s < mine[q]->size(); ++s) {
        apart.push_back((*mine[q])[s] - (*whole[q])[s]);
      }
      const MeanDeviation value = MeanAndDeviation(*mine[q]);
      const MeanDeviation difference = MeanAndDeviation(apart);
      const double size = std::abs(MeanAndDeviation(*whole[q]).mean);
      const double e = difference.standard_error;
      const char* verdict =
          std::abs(difference.mean) + 2.0 * e <= FLAGS_accuracy * size  ? "ok"
          : std::abs(difference.mean) - 2.0 * e > FLAGS_accuracy * size ? "no"
                                                                        : "?";
      rows.back().push_back(Format("%.5g", value.mean));
      rows.back().push_back(m == 0 ? "-"
                                   : Format("%+.1e +- %.0e %s",
                                            difference.mean / size,
                                            e / size,
                                            verdict));
      csv += Field(kPackingModels[m].name) + "," + names[q] +
             Format(",%.9g,%.4g,%.9g,%.4g,%s,%.6g\n",
                    value.mean,
                    value.standard_error,
                    difference.mean,
                    e,
                    verdict,
                    MedianOf(observed[m].seconds));
      of_model[names[q]] = {{"mean", value.mean},
                            {"difference", difference.mean},
                            {"difference_error", e},
                            {"verdict", verdict}};
    }
    json["models"].push_back(of_model);
  }
  json["accuracy"] = FLAGS_accuracy;
  json["schema"] = "granopt/fidelity/1";
  json["provenance"] = Provenance();
  output->Write("fidelity.csv", csv);
  output->WriteJson("summary.json", json);
  std::printf("\n%s\n", Grid(rows, 0, false).c_str());
  std::printf(
      "  medians and means over %d packings of %d discs, 1e-3 above "
      "jamming, sheared by 1e-5, relaxed by lbfgs; changes relative to "
      "the whole model,\n  ok, no: within or beyond %g by two standard "
      "errors\n",
      FLAGS_seeds,
      FLAGS_particles,
      FLAGS_accuracy);
  output->PrintFiles();
  return kConverged;
}

int Main() {
  CheckPositive("accuracy", FLAGS_accuracy);
  CheckRange("seeds", FLAGS_seeds, 2, 100000);
  CheckPositive("duration", FLAGS_duration);
  CheckPositive("dt", FLAGS_dt);
  CheckRange("dt", FLAGS_dt, 0.0, FLAGS_duration);
  if (FLAGS_smoke) {
    if (!IsGiven("seeds")) FLAGS_seeds = 3;
    if (!IsGiven("duration")) FLAGS_duration = 0.2;
    if (!IsGiven("particles")) FLAGS_particles = 128;
  }
  std::vector<bool> wanted(kNumQuantities, false);
  std::string rest = FLAGS_observables + ",";
  while (!rest.empty()) {
    const std::string name = rest.substr(0, rest.find(','));
    rest = rest.substr(rest.find(',') + 1);
    bool known = false;
    for (int q = 0; q < kNumQuantities; ++q) {
      if (name != kQuantities[q].name) continue;
      wanted[q] = known = true;
    }
    if (!known) {
      BadInput("--observables: '" + name +
               "' is none of T, relative_fraction, dissipated, spread");
    }
  }
  for (const FlowPreset& preset : kPresets) {
    if (FLAGS_scene != preset.name) continue;
    std::printf(
        "fidelity  %s: %s\n          %d starts to t = %g s by velocity "
        "Verlet, dt = %g s\n",
        preset.name,
        preset.what,
        FLAGS_seeds,
        FLAGS_duration,
        FLAGS_dt);
    std::fflush(stdout);
    Output output;
    output.Create(
        FLAGS_out,
        {"summary.json", "fidelity.csv", "fidelity.svg", "fidelity.png"});
    return RunFlows(preset, wanted, &output);
  }
  if (FLAGS_scene != "packing") {
    BadInput("--scene=" + FLAGS_scene + " must be sand, powder or packing");
  }
  std::printf("fidelity  packing: %d discs, law, pre-stress, precision\n",
              FLAGS_particles);
  std::fflush(stdout);
  Output output;
  output.Create(
      FLAGS_out,
      {"summary.json", "fidelity.csv", "fidelity.svg", "fidelity.png"});
  return RunPackings(&output);
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "what each ingredient of a model costs and what "
                      "leaving it out does to the answer");
  return granopt::Main();
}
