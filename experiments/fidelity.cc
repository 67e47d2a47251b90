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
#include "granular/flow/start.h"
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

// "ok", "no": the difference is within or beyond what is allowed by two
// standard errors; "?": more starts would tell.
const char* Verdict(double difference, double error, double allowed) {
  const double size = std::abs(difference);
  if (size + 2.0 * error <= allowed) return "ok";
  if (size - 2.0 * error > allowed) return "no";
  return "?";
}

// Of one quantity of one model over all starts.
struct Change {
  MeanDeviation value;
  MeanDeviation difference;  // from the whole model, start by start
  double whole = 0.0;        // size of the whole model's mean
  const char* verdict = "?";
};

Change ChangeOf(const std::vector<double>& values,
                const std::vector<double>& whole) {
  std::vector<double> apart;
  for (std::size_t s = 0; s < values.size(); ++s) {
    apart.push_back(values[s] - whole[s]);
  }
  Change change;
  change.value = MeanAndDeviation(values);
  change.difference = MeanAndDeviation(apart);
  change.whole = std::abs(MeanAndDeviation(whole).mean);
  change.verdict = Verdict(change.difference.mean,
                           change.difference.standard_error,
                           FLAGS_accuracy * change.whole);
  return change;
}

constexpr char kCsvHead[] =
    "model,quantity,mean,standard_error,difference,difference_error,verdict,"
    "cpu_seconds_a_step\n";

std::string CsvRow(const char* model,
                   const char* quantity,
                   const Change& change,
                   double seconds) {
  return Field(model) + "," + quantity +
         Format(",%.9g,%.4g,%.9g,%.4g,%s,%.6g\n",
                change.value.mean,
                change.value.standard_error,
                change.difference.mean,
                change.difference.standard_error,
                change.verdict,
                seconds);
}

// table[m][q], and the median CPU time of a step.
struct Rungs {
  std::vector<std::vector<Change>> table;
  std::vector<double> seconds;
};

Rungs Climb(const FlowPreset& preset) {
  std::vector<std::vector<std::vector<double>>> values(
      kModels, std::vector<std::vector<double>>(kNumQuantities));
  std::vector<std::vector<double>> seconds(kModels);
  std::string error;
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
  Rungs ladder;
  for (int m = 0; m < kModels; ++m) {
    ladder.table.emplace_back();
    for (int q = 0; q < kNumQuantities; ++q) {
      ladder.table[m].push_back(ChangeOf(values[m][q], values[kWhole][q]));
    }
    ladder.seconds.push_back(MedianOf(seconds[m]));
  }
  return ladder;
}

// The cheapest model whose wanted quantities are all right, or -1; `is_open`:
// one below it may be.
int Recommended(const Rungs& ladder,
                const std::vector<bool>& wanted,
                bool* is_open) {
  int recommended = -1;
  *is_open = false;
  for (int m = 0; m < kModels; ++m) {
    bool all = true, open = false;
    for (int q = 0; q < kNumQuantities; ++q) {
      if (!wanted[q]) continue;
      const std::string verdict = ladder.table[m][q].verdict;
      all = all && verdict == "ok";
      open = open || verdict == "?";
    }
    if (!all) {
      *is_open = *is_open || (open && recommended < 0);
      continue;
    }
    if (recommended < 0 || ladder.seconds[m] < ladder.seconds[recommended]) {
      recommended = m;
    }
  }
  return recommended;
}

void WriteResults(const std::string& csv, const Json& json, Output* output) {
  output->Write("fidelity.csv", csv);
  output->WriteJson("summary.json", json);
  output->Plot({"fidelity",
                output->Path("fidelity.csv"),
                output->Path("fidelity"),
                Format("--accuracy=%g", FLAGS_accuracy)},
               {"fidelity.svg", "fidelity.png"});
}

int RunFlows(const FlowPreset& preset,
             const std::vector<bool>& wanted,
             Output* output) {
  const Rungs ladder = Climb(preset);
  bool is_open = false;
  const int recommended = Recommended(ladder, wanted, &is_open);

  std::string csv = kCsvHead;
  std::vector<std::vector<std::string>> rows = {{"model", "us a step"}};
  for (const Quantity& quantity : kQuantities) {
    rows[0].push_back(quantity.name);
    rows[0].push_back("change");
  }
  Json json;
  json["scene"] = preset.name;
  json["accuracy"] = FLAGS_accuracy;
  json["starts"] = FLAGS_seeds;
  json["recommended"] =
      recommended < 0 ? "none" : std::string(kLadder[recommended].name);
  json["models"] = Json::array();
  for (int m = 0; m < kModels; ++m) {
    rows.push_back({kLadder[m].name, Format("%.2f", 1e6 * ladder.seconds[m])});
    Json model = {{"model", kLadder[m].name},
                  {"cpu_seconds_a_step", ladder.seconds[m]}};
    for (int q = 0; q < kNumQuantities; ++q) {
      const Change& t = ladder.table[m][q];
      csv += CsvRow(kLadder[m].name, kQuantities[q].name, t, ladder.seconds[m]);
      rows.back().push_back(
          Format("%.4f(%.0f)", t.value.mean, 1e4 * t.value.standard_error));
      rows.back().push_back(
          m == kWhole ? "-"
                      : Format("%+.1f +- %.1f %% %s",
                               100.0 * t.difference.mean / t.whole,
                               100.0 * t.difference.standard_error / t.whole,
                               t.verdict));
      model[kQuantities[q].name] = {
          {"mean", t.value.mean},
          {"standard_error", t.value.standard_error},
          {"difference", t.difference.mean},
          {"difference_error", t.difference.standard_error},
          {"verdict", t.verdict}};
    }
    json["models"].push_back(model);
  }
  json["schema"] = "granopt/fidelity/1";
  json["provenance"] = Provenance();
  WriteResults(csv, json, output);
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
        ladder.seconds[recommended] / ladder.seconds[kWhole]);
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

constexpr const char* kPackingQuantities[] = {"z", "G", "B", "p"};
constexpr int kPackingQuantityCount = 4;

// Of one model, over all packings.
struct Observed {
  std::vector<double> values[kPackingQuantityCount];
  std::vector<double> seconds;  // CPU, of the relaxation
};

std::vector<Observed> ObservePackings(Output* output) {
  std::vector<Observed> observed(kPackingModelCount);
  std::string error;
  const std::unique_ptr<Solver> first_order = MakeSolver("solver", "lbfgs");
  Progress progress;
  for (int s = 0; s < FLAGS_seeds; ++s) {
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
      o.values[0].push_back(run.observables.coordination);
      o.values[1].push_back(r.shear_mean / kappa);
      o.values[2].push_back(r.bulk_growth / kappa);
      o.values[3].push_back(run.observables.pressure / kappa);
      o.seconds.push_back(cost);
    }
    if (progress.Due()) {
      progress.Show(Format("packing %d of %d", s + 1, FLAGS_seeds));
    }
  }
  return observed;
}

int RunPackings(Output* output) {
  const std::vector<Observed> observed = ObservePackings(output);
  std::string csv = kCsvHead;
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
    const char* const model = kPackingModels[m].name;
    const double seconds = MedianOf(observed[m].seconds);
    rows.push_back({model, Format("%.2f", 1e3 * seconds)});
    Json of_model = {{"model", model}, {"cpu_seconds", seconds}};
    for (int q = 0; q < kPackingQuantityCount; ++q) {
      const char* const quantity = kPackingQuantities[q];
      const Change t = ChangeOf(observed[m].values[q], observed[0].values[q]);
      rows.back().push_back(Format("%.5g", t.value.mean));
      rows.back().push_back(m == 0
                                ? "-"
                                : Format("%+.1e +- %.0e %s",
                                         t.difference.mean / t.whole,
                                         t.difference.standard_error / t.whole,
                                         t.verdict));
      csv += CsvRow(model, quantity, t, seconds);
      of_model[quantity] = {{"mean", t.value.mean},
                            {"difference", t.difference.mean},
                            {"difference_error", t.difference.standard_error},
                            {"verdict", t.verdict}};
    }
    json["models"].push_back(of_model);
  }
  json["accuracy"] = FLAGS_accuracy;
  json["schema"] = "granopt/fidelity/1";
  json["provenance"] = Provenance();
  WriteResults(csv, json, output);
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

// BadInput for flags that would change nothing. Call it before any is changed.
void RefuseForeignFlags() {
  const std::vector<const char*> foreign =
      FLAGS_scene == "packing" ? std::vector<const char*>{"alpha",
                                                          "precision",
                                                          "input",
                                                          "observables",
                                                          "duration",
                                                          "dt"}
                               : std::vector<const char*>{"input",
                                                          "particles",
                                                          "dimension",
                                                          "size_ratio",
                                                          "polydispersity",
                                                          "alpha",
                                                          "precision",
                                                          "tolerance",
                                                          "zero_pressure",
                                                          "threads"};
  for (const char* flag : foreign) {
    if (!IsGiven(flag)) continue;
    BadInput(std::string("--") + flag +
             " cannot go with --scene=" + FLAGS_scene);
  }
}

int Main() {
  RefuseForeignFlags();
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
  for (const std::string& name : Split(FLAGS_observables, ',')) {
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
  const std::vector<std::string> files = {
      "summary.json", "fidelity.csv", "fidelity.svg", "fidelity.png"};
  Output output;
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
    output.Create(FLAGS_out, files);
    return RunFlows(preset, wanted, &output);
  }
  if (FLAGS_scene != "packing") {
    BadInput("--scene=" + FLAGS_scene + " must be sand, powder or packing");
  }
  std::printf("fidelity  packing: %d discs, law, pre-stress, precision\n",
              FLAGS_particles);
  std::fflush(stdout);
  output.Create(FLAGS_out, files);
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
