// tradeoff: what accuracy costs. For each method, precision and tolerance: CPU
// time against the error of what users want: energy, pressure, shear stress,
// shear modulus, coordination, places, phi_J; not of the residual alone.
//
//   tradeoff --particles=4096 --seeds=1-3 --out=DIR      two scenes: near
//   jamming
//                                                        and over-jammed
//   tradeoff --input=F.xyz --case=simple_shear=1e-4      a scene of one's own
//   tradeoff --flow      ways to run a near-field flow (tradeoff_flow.cc)
//   tradeoff --recommend --accuracy=1e-6 [--observable=pressure] --input=...
//                        measures briefly, prints the flags of the cheapest
//                        setting that reaches it
//
// A run goes on to the finest tolerance; where it passes a coarser one, its
// state there is measured (that time does not count). Errors are those against
// the minimum that this very run is on its way to, made sharp by Newton's
// method; how far the minima of different methods lie apart is told beside: no
// tolerance removes that.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "experiments/cases.h"
#include "experiments/preparation.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "experiments/tradeoff_flow.h"
#include "granular/jamming.h"
#include "granular/linear_response.h"
#include "granular/plastic_events.h"
#include "solvers/registry.h"
#include "solvers/sparse_cholesky.h"

DEFINE_string(solvers,
              "auto;fire;lbfgs;ncg;newton;interior_point;"
              "barrier@lbfgs:preconditioner=barrier,shift=1e-6",
              "methods, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,...");
DEFINE_string(precisions,
              "double,mixed,float",
              "of the pair kernel, each with every method whose time is mostly "
              "there");
DEFINE_string(case,
              "",
              "with --input: the load, as in simple_shear=1e-4, growth=5e-5, "
              "random=1e-4; default: the packing as it is");
DEFINE_string(seeds, "1-3", "packings of the generated scenes");
DEFINE_double(phi, 0.86, "packing fraction at which random starts are relaxed");
DEFINE_int32(repetitions, 3, "of each run, for its time");
DEFINE_int64(max_evaluations, 200000, "a run ends after this many evaluations");
DEFINE_double(max_seconds, 20.0, "and after this time");
DEFINE_bool(recommend,
            false,
            "print the flags of the cheapest setting that reaches --accuracy");
DEFINE_double(accuracy, 1e-6, "with --recommend: the relative error allowed");
DEFINE_string(
    observable,
    "pressure",
    "with --recommend: energy, pressure, shear_stress, shear_modulus, "
    "coordination or places; of flows kinetic, relative_part, places or "
    "drift");

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Observable {
  const char* name;
  const char* what;  // of the error
};
const Observable kObservables[] = {
    {"energy", "relative"},
    {"pressure", "relative"},
    {"shear_stress", "of sigma_12, in pressures"},
    {"shear_modulus", "of G (13), relative"},
    {"coordination", "of z"},
    {"places", "largest of a rigid grain, in mean overlaps"},
};
constexpr int kNumObservables = 6;

std::vector<double> Ladder() {
  std::vector<double> levels;
  for (int k = 1; k <= 13; ++k) levels.push_back(std::pow(10.0, -k));
  return levels;
}

// What is measured on a state.
struct Measured {
  Observables observables;
  double shear_modulus = kNan;
  Packing packing;
};

Measured MeasurePacking(const Packing& packing,
                        const ContactEnergyOptions& law) {
  Relaxation as_it_is;
  std::string error;
  if (!MeasureAsItIs(packing, law, &as_it_is, &error)) BadInput(error);
  Measured m;
  m.packing = as_it_is.packing;
  m.observables = as_it_is.observables;
  const ElasticResponse response = ComputeElasticResponse(packing, law);
  if (response.found) m.shear_modulus = response.shear;
  return m;
}

// The largest distance of a rigid grain of `sharp` between the two, in mean
// overlaps.
double LargestMove(const Measured& m, const Measured& sharp) {
  const Observables& o = sharp.observables;
  if (!(o.mean_overlap > 0.0)) return 0.0;
  std::vector<bool> counts = o.is_rattler;
  counts.flip();
  const Eigen::MatrixXd moves =
      DisplacementBetween(sharp.packing, m.packing, counts);
  double largest = 0.0;
  for (int i = 0; i < sharp.packing.size(); ++i) {
    if (counts[i]) largest = std::max(largest, moves.col(i).norm());
  }
  return largest / o.mean_overlap;
}

std::vector<double> Errors(const Measured& m, const Measured& sharp) {
  const Observables& a = m.observables;
  const Observables& b = sharp.observables;
  const auto relative = [](double x, double y) {
    return x == y ? 0.0 : std::abs(x - y) / std::abs(y);
  };
  const double g = relative(m.shear_modulus, sharp.shear_modulus);
  return {relative(a.energy, b.energy),
          relative(a.pressure, b.pressure),
          b.pressure > 0.0
              ? std::abs(a.stress(0, 1) - b.stress(0, 1)) / b.pressure
              : 0.0,
          std::isfinite(g) ? g : kInfinity,
          std::abs(a.coordination - b.coordination),
          LargestMove(m, sharp)};
}

// One method and precision on one packing, at one tolerance.
struct Row {
  std::string scene;
  std::uint64_t seed = 0;
  std::string method, spec, precision;
  double tolerance = 0.0;
  bool reached = false;
  double seconds = kInfinity;  // CPU, median over repetitions
  std::int64_t evaluations = 0, factorizations = 0;
  std::vector<double> errors = std::vector<double>(kNumObservables, kInfinity);
};

// Where a run ended, made sharp.
struct End {
  double energy = 0.0;
  double pressure = 0.0;
};

struct Scenario {
  std::string name;
  std::uint64_t seed = 0;
  Packing start;
};

bool DependsOnPrecision(const std::string& spec) {
  // Whatever factors spends its time there, and evaluates Hessians in double.
  return spec.find("newton") != 0 && spec.find("interior_point") != 0 &&
         spec.find("preconditioner") == std::string::npos &&
         spec.find("auto") != 0;
}

// The states of one run at each level, and the CPU time until there.
struct Crossing {
  bool reached = false;
  double seconds = 0.0;
  Counters counters;
  Packing packing;
};

std::vector<Crossing> RunLevels(const Scenario& scenario,
                                const ContactEnergyOptions& law,
                                const Solver& solver,
                                const std::vector<double>& levels,
                                bool keep,
                                Packing* end) {
  std::vector<Crossing> crossings(levels.size());
  std::string error;
  const auto energy = ContactEnergy::Create(scenario.start, law, &error);
  if (energy == nullptr) BadInput(scenario.name + ": " + error);
  std::vector<double> u(energy->NumParameters(), 0.0);
  SolveOptions options = MakeSolveOptions();
  options.relative_tolerance = levels.back();
  options.max_evaluations = FLAGS_max_evaluations;
  options.max_seconds = FLAGS_max_seconds;
  std::size_t next = 0;
  double begin = 0.0, aside = 0.0;
  const auto note = [&](double max_gradient,
                        double scale,
                        const Counters& counters,
                        const double* x) {
    if (next == levels.size() || !(max_gradient <= levels[next] * scale)) {
      return;
    }
    const double now = CpuSeconds();
    Crossing crossing;
    crossing.reached = true;
    crossing.seconds = now - begin - aside;
    crossing.counters = counters;
    if (keep) crossing.packing = energy->Configuration(x);
    while (next < levels.size() && max_gradient <= levels[next] * scale) {
      crossings[next++] = crossing;
    }
    aside += CpuSeconds() - now;
  };
  options.callback = [&](const IterationState& state) {
    note(state.max_gradient, state.scales.gradient, state.counters, state.x);
    return true;
  };
  SparseCholesky::ForgetAnalysis();
  begin = CpuSeconds();
  const Summary summary = solver.Minimize(energy.get(), options, u.data());
  note(summary.max_gradient,
       summary.scales.gradient,
       summary.counters,
       u.data());
  // E = 0: there is nothing finer.
  if (summary.reason == StopReason::VANISHED) {
    note(0.0, 1.0, summary.counters, u.data());
  }
  *end = energy->Configuration(u.data());
  return crossings;
}

// Residual of what counts as sharp, in mean forces.
constexpr double kSharp = 1e-12;

// The minimum that the end of a run is next to; false if Newton's method does
// not get there in a few dozen iterations, as from where a run gave up.
bool Sharpened(const Packing& packing,
               ContactEnergyOptions law,
               Packing* sharp) {
  law.precision = Precision::DOUBLE;
  std::string error;
  const std::unique_ptr<Solver> newton = CreateSolver("newton", &error);
  SolveOptions options = MakeSolveOptions();
  // Of the order of the roundoff of forces.
  options.relative_tolerance = 1e-14;
  options.max_evaluations = 200;
  Relaxation result;
  if (!Relax(packing, law, *newton, options, &result, &error)) BadInput(error);
  *sharp = result.packing;
  return result.observables.relative_residual <= kSharp ||
         result.summary.reason == StopReason::VANISHED;
}

struct Setting {
  Method method;
  Precision precision = Precision::DOUBLE;
  std::unique_ptr<Solver> solver;
};

// All settings on one packing, repetitions interleaved.
void RunScenario(const Scenario& scenario,
                 const ContactEnergyOptions& law,
                 const std::vector<Setting>& settings,
                 int repetitions,
                 Progress* progress,
                 std::vector<Row>* rows,
                 std::vector<End>* ends) {
  const std::vector<double> levels = Ladder();
  std::vector<std::vector<std::vector<double>>> seconds(
      settings.size(), std::vector<std::vector<double>>(levels.size()));
  std::vector<std::vector<Row>> of_setting(settings.size());
  for (int repetition = 0; repetition < repetitions; ++repetition) {
    for (const int s :
         MethodOrder(static_cast<int>(settings.size()), repetition)) {
      const Setting& setting = settings[s];
      if (progress->Due()) {
        progress->Show(Format("%s, seed %llu: %s, %s (repetition %d of %d)",
                              scenario.name.c_str(),
                              static_cast<unsigned long long>(scenario.seed),
                              setting.method.label.c_str(),
                              PrecisionName(setting.precision),
                              repetition + 1,
                              repetitions));
      }
      ContactEnergyOptions options = law;
      options.precision = setting.precision;
      const bool first = repetition == 0;
      Packing end;
      const std::vector<Crossing> crossings =
          RunLevels(scenario, options, *setting.solver, levels, first, &end);
      for (std::size_t k = 0; k < levels.size(); ++k) {
        seconds[s][k].push_back(crossings[k].reached ? crossings[k].seconds
                                                     : kInfinity);
      }
      if (!first) continue;
      Packing sharp_packing;
      const bool is_sharp = Sharpened(end, law, &sharp_packing);
      const Measured sharp = MeasurePacking(sharp_packing, law);
      if (is_sharp) {
        ends->push_back({sharp.observables.energy, sharp.observables.pressure});
      }
      for (std::size_t k = 0; k < levels.size(); ++k) {
        Row row;
        row.scene = scenario.name;
        row.seed = scenario.seed;
        row.method = setting.method.label;
        row.spec = setting.method.spec;
        row.precision = PrecisionName(setting.precision);
        row.tolerance = levels[k];
        row.reached = crossings[k].reached && is_sharp;
        if (row.reached) {
          row.evaluations = crossings[k].counters.evaluations;
          row.factorizations = crossings[k].counters.factorizations;
          row.errors = Errors(MeasurePacking(crossings[k].packing, law), sharp);
        }
        of_setting[s].push_back(row);
      }
    }
  }
  for (std::size_t s = 0; s < settings.size(); ++s) {
    // An error that happens to be small where a finer tolerance has a larger
    // one is luck: the larger one counts.
    for (std::size_t k = levels.size() - 1; k-- > 0;) {
      Row& row = of_setting[s][k];
      const Row& finer = of_setting[s][k + 1];
      if (!finer.reached) continue;
      for (int o = 0; o < kNumObservables; ++o) {
        row.errors[o] = std::max(row.errors[o], finer.errors[o]);
      }
    }
    for (std::size_t k = 0; k < levels.size(); ++k) {
      of_setting[s][k].seconds = MedianOf(seconds[s][k]);
      rows->push_back(of_setting[s][k]);
    }
  }
}

// phi_J against CPU time along a decompression: what error bar was reached
// when, and how far the estimate was from the sharpest one of the same run.
struct JammingRow {
  std::uint64_t seed = 0;
  std::string method;
  double tolerance = 0.0, error_bar = 0.0, error = 0.0, seconds = 0.0;
};

void RunJamming(const Scenario& scenario,
                const ContactEnergyOptions& law,
                const Method& method,
                const Solver& solver,
                double tolerance,
                std::vector<JammingRow>* rows) {
  JammingOptions options;
  options.energy = law;
  options.solve = MakeSolveOptions();
  options.solve.relative_tolerance = tolerance;
  options.solve.vanishing_tolerance = 1e-10;
  options.solve.max_evaluations = FLAGS_max_evaluations;
  options.phi_init = 0.0;
  options.error_bar = 1e-12;
  options.until_isostatic = false;
  struct Estimate {
    double phi_j, error_bar, seconds;
  };
  std::vector<Estimate> estimates;
  const double begin = CpuSeconds();
  options.solve.callback = [&](const IterationState&) {
    return CpuSeconds() - begin < FLAGS_max_seconds;
  };
  const auto observer = [&](const JammingStep& step) {
    if (step.verdict == JammingVerdict::JAMMED && step.distance > 0.0) {
      estimates.push_back({step.state->phi_jammed - step.distance,
                           step.distance,
                           CpuSeconds() - begin});
    }
    return CpuSeconds() - begin < FLAGS_max_seconds;
  };
  JammingResult result;
  std::string error;
  if (!FindJamming(
          scenario.start, options, solver, observer, &result, &error) ||
      !result.converged) {
    return;  // out of time: how far it was from its own end is not known
  }
  for (const Estimate& e : estimates) {
    rows->push_back({scenario.seed,
                     method.label,
                     tolerance,
                     e.error_bar,
                     std::abs(e.phi_j - result.phi_j),
                     e.seconds});
  }
}

std::string RowsCsv(const std::vector<Row>& rows) {
  std::string csv =
      "scene,seed,solver,spec,precision,tolerance,reached,cpu_seconds,"
      "evaluations,factorizations";
  for (const Observable& o : kObservables) csv += std::string(",") + o.name;
  csv += "\n";
  for (const Row& row : rows) {
    csv += Field(row.scene) +
           Format(",%llu,", static_cast<unsigned long long>(row.seed)) +
           Field(row.method) + "," + Field(row.spec) + "," + row.precision +
           Format(",%g,%d,%.6g,%lld,%lld",
                  row.tolerance,
                  row.reached ? 1 : 0,
                  row.seconds,
                  static_cast<long long>(row.evaluations),
                  static_cast<long long>(row.factorizations));
    for (const double error : row.errors) csv += Format(",%.4g", error);
    csv += "\n";
  }
  return csv;
}

// The cheapest setting whose error is at most `accuracy` on every seed: the
// largest error counts, and the median time.
struct Best {
  const Row* row = nullptr;  // of the first seed
  double seconds = kInfinity;
  double error = kInfinity;
};

std::vector<Best> Ranking(const std::vector<Row>& rows,
                          const std::string& scene,
                          int observable,
                          double accuracy) {
  struct Group {
    const Row* first = nullptr;
    std::vector<double> seconds;
    double error = 0.0;
  };
  std::map<std::string, Group> groups;
  for (const Row& row : rows) {
    if (row.scene != scene) continue;
    Group& group = groups[row.method + "\n" + row.precision +
                          Format("\n%g", row.tolerance)];
    if (group.first == nullptr) group.first = &row;
    group.seconds.push_back(row.seconds);
    group.error = std::max(group.error, row.errors[observable]);
  }
  // Of each method and precision the cheapest tolerance.
  std::map<std::string, Best> best;
  for (const auto& [key, group] : groups) {
    if (!(group.error <= accuracy)) continue;
    const double seconds = MedianOf(group.seconds);
    Best& b = best[group.first->method + "\n" + group.first->precision];
    if (seconds < b.seconds) b = {group.first, seconds, group.error};
  }
  std::vector<Best> ranking;
  for (const auto& [key, b] : best) {
    if (b.row != nullptr && std::isfinite(b.seconds)) ranking.push_back(b);
  }
  std::sort(ranking.begin(), ranking.end(), [](const Best& a, const Best& b) {
    return a.seconds < b.seconds;
  });
  return ranking;
}

std::string FlagsOf(const Row& row) {
  return "--solver=" + row.spec +
         (row.precision == "double" ? "" : " --precision=" + row.precision) +
         Format(" --tolerance=%g", row.tolerance);
}

std::vector<Setting> MakeSettings() {
  std::vector<Method> methods;
  std::string error;
  if (!ParseMethods(FLAGS_solvers, &methods, &error)) {
    BadInput("--solvers: " + error);
  }
  std::vector<Precision> precisions;
  for (const std::string& name : Split(FLAGS_precisions, ',')) {
    bool known = false;
    for (const Precision p :
         {Precision::DOUBLE, Precision::MIXED, Precision::FLOAT}) {
      if (name != PrecisionName(p)) continue;
      precisions.push_back(p);
      known = true;
    }
    if (!known) {
      BadInput("--precisions: '" + name + "' is none of double, mixed, float");
    }
  }
  std::vector<Setting> settings;
  for (const Method& method : methods) {
    for (const Precision precision : precisions) {
      if (precision != precisions[0] && !DependsOnPrecision(method.spec)) {
        continue;
      }
      Setting setting;
      setting.method = method;
      setting.precision = precision;
      setting.solver = MakeSolver("solvers", method.spec);
      settings.push_back(std::move(setting));
    }
  }
  return settings;
}

int ObservableOf(const std::string& name) {
  std::string known;
  for (int k = 0; k < kNumObservables; ++k) {
    if (name == kObservables[k].name) return k;
    known += (k == 0 ? "" : ", ") + std::string(kObservables[k].name);
  }
  BadInput("--observable=" + name + " is none of " + known);
}

// Which observable of --recommend is wanted; BadInput for flags that make no
// sense.
int CheckFlags() {
  RefuseFlowFlags();
  CheckPositive("accuracy", FLAGS_accuracy);
  CheckRange("accuracy", FLAGS_accuracy, 0.0, 1.0);
  CheckRange("repetitions", FLAGS_repetitions, 1, 1000);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 1.0, 9e18);
  CheckPositive("max_seconds", FLAGS_max_seconds);
  CheckPositive("phi", FLAGS_phi);
  const int wanted = ObservableOf(FLAGS_observable);
  if (IsGiven("case") && FLAGS_input.empty()) {
    BadInput("--case is a load of --input, which is not given");
  }
  if (IsGiven("seeds") && !FLAGS_input.empty()) {
    BadInput("--seeds describes random starts and cannot go with --input");
  }
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 256;
    if (!IsGiven("seeds")) FLAGS_seeds = "1";
    if (!IsGiven("repetitions")) FLAGS_repetitions = 1;
  } else if (!IsGiven("particles") && FLAGS_input.empty()) {
    FLAGS_particles = 4096;
  }
  if (FLAGS_recommend) {
    if (!IsGiven("repetitions")) FLAGS_repetitions = 1;
    if (!IsGiven("seeds")) FLAGS_seeds = "1";
  }
  return wanted;
}

struct Scenarios {
  std::vector<Scenario> scenes;
  std::vector<Scenario> above_jamming;  // for phi_J
};

// The input under its load, or two scenes for each seed.
Scenarios MakeScenarios(const Scene& scene,
                        const std::vector<std::uint64_t>& seeds,
                        const std::vector<Case>& cases,
                        Output* output) {
  Scenarios all;
  std::string error;
  if (!FLAGS_input.empty()) {
    Scenario scenario;
    scenario.name = FLAGS_case.empty() ? "user" : FLAGS_case;
    scenario.seed = FLAGS_seed;
    scenario.start = scene.packing;
    if (!cases.empty()) {
      ApplyLoad(LoadOf(cases[0]), FLAGS_seed, &scenario.start);
      Scene loaded;
      loaded.packing = scenario.start;
      loaded.energy = scene.energy;
      loaded.origin = scene.origin + ", " + FLAGS_case;
      CheckScene(loaded);
    }
    all.scenes.push_back(scenario);
  } else {
    const std::unique_ptr<Solver> prepare =
        MakeSolver("solver", kDefaultSolver);
    Preparation preparation(scene, *prepare, FLAGS_phi, output);
    for (const std::uint64_t seed : seeds) {
      std::vector<Packing> states;
      if (!preparation.NearJamming(seed, {1e-5, 1e-2}, &states, &error)) {
        BadInput(error);
      }
      const char* const names[] = {"near jamming", "over-jammed"};
      const double distances[] = {1e-5, 1e-2};
      for (int k = 0; k < 2; ++k) {
        Scenario scenario;
        scenario.name = names[k];
        scenario.seed = seed;
        scenario.start = states[k];
        scenario.start.Deform(
            SimpleShear(scene.packing.dimension(), 0.03 * distances[k]));
        all.scenes.push_back(scenario);
      }
      Scenario above;
      above.name = "phi_J";
      above.seed = seed;
      above.start = states[1];
      all.above_jamming.push_back(above);
    }
    preparation.ClearProgress();
  }
  return all;
}

std::string JammingCsv(const std::vector<JammingRow>& rows) {
  std::string csv = "seed,solver,tolerance,error_bar,error,cpu_seconds\n";
  for (const JammingRow& row : rows) {
    csv += Format("%llu,", static_cast<unsigned long long>(row.seed)) +
           Field(row.method) +
           Format(",%g,%.4g,%.4g,%.6g\n",
                  row.tolerance,
                  row.error_bar,
                  row.error,
                  row.seconds);
  }
  return csv;
}

// How far apart the minima are that the runs on a packing ended in; a line a
// scene is added to `text`.
Json MinimaJson(
    const std::vector<std::string>& names,
    const std::map<std::string, std::vector<std::vector<End>>>& ends,
    std::string* text) {
  Json json = Json::object();
  for (const std::string& name : names) {
    int packings = 0, several = 0;
    double widest = 0.0;
    for (const std::vector<End>& of_packing : ends.at(name)) {
      ++packings;
      double low = kInfinity, high = 0.0, p_low = kInfinity, p_high = 0.0;
      for (const End& end : of_packing) {
        low = std::min(low, end.energy);
        high = std::max(high, end.energy);
        p_low = std::min(p_low, end.pressure);
        p_high = std::max(p_high, end.pressure);
      }
      if (high - low > 1e-9 * high) {
        ++several;
        widest = std::max(widest, (p_high - p_low) / p_high);
      }
    }
    *text += Format("  %s: ", name.c_str());
    *text += several == 0
                 ? std::string("all methods end in the same minimum\n")
                 : Format(
                       "methods end in different minima on %d of %d "
                       "packings, whose pressures differ by up to %.1e: no "
                       "tolerance removes that\n",
                       several,
                       packings,
                       widest);
    json[name] = {{"packings", packings},
                  {"with_several_minima", several},
                  {"pressures_differ_by", widest}};
  }
  return json;
}

// The cheapest setting of each scene, observable and accuracy.
std::vector<std::vector<std::string>> Recommendations(
    const std::vector<Row>& rows,
    const std::vector<std::string>& names,
    Json* json) {
  const std::vector<double> accuracies = {1e-2, 1e-4, 1e-6, 1e-8, 1e-10};
  std::vector<std::vector<std::string>> table = {{"scene", "error of"}};
  for (const double accuracy : accuracies) {
    table[0].push_back("<= " + Neat(accuracy));
  }
  for (const std::string& name : names) {
    for (int o = 0; o < kNumObservables; ++o) {
      table.push_back({name, kObservables[o].name});
      for (const double accuracy : accuracies) {
        const std::vector<Best> ranking = Ranking(rows, name, o, accuracy);
        if (ranking.empty()) {
          table.back().push_back("-");
          continue;
        }
        const Best& best = ranking[0];
        table.back().push_back(
            best.row->method +
            (best.row->precision == "double" ? "" : " " + best.row->precision) +
            " " + Neat(best.row->tolerance) +
            Format(": %.3g", 1e3 * best.seconds));
        json->push_back({{"scene", name},
                         {"observable", kObservables[o].name},
                         {"accuracy", accuracy},
                         {"flags", FlagsOf(*best.row)},
                         {"cpu_seconds", best.seconds},
                         {"error", best.error}});
      }
    }
  }
  return table;
}

// For --recommend; returns the exit status.
int PrintRecommended(const std::vector<Row>& rows,
                     const std::vector<std::string>& names,
                     int wanted,
                     Json* json) {
  int status = kConverged;
  for (const std::string& name : names) {
    const std::vector<Best> ranking =
        Ranking(rows, name, wanted, FLAGS_accuracy);
    std::printf("\n%s, error of %s at most %g (%s)\n",
                name.c_str(),
                FLAGS_observable.c_str(),
                FLAGS_accuracy,
                kObservables[wanted].what);
    if (ranking.empty()) {
      std::printf("  no setting reaches it\n");
      status = kNotConverged;
      continue;
    }
    if (name == names[0]) {
      (*json)["recommended"] = FlagsOf(*ranking[0].row);
    }
    std::printf("  use  %s\n\n", FlagsOf(*ranking[0].row).c_str());
    std::vector<std::vector<std::string>> evidence = {
        {"measured", "CPU ms", "ratio", "error"}};
    for (const Best& best : ranking) {
      evidence.push_back({FlagsOf(*best.row),
                          Format("%.3g", 1e3 * best.seconds),
                          Format("%.2f", best.seconds / ranking[0].seconds),
                          Format("%.1e", best.error)});
    }
    std::fputs(Grid(evidence, 0, false).c_str(), stdout);
  }
  return status;
}

void PrintTable(const std::vector<std::vector<std::string>>& table,
                const std::vector<Setting>& settings) {
  std::printf("\nfor this accuracy use this: method, --tolerance: CPU ms\n%s",
              Grid(table, 0, false, 2).c_str());
  for (const Setting& setting : settings) {
    if (setting.method.label == setting.method.spec ||
        setting.precision != Precision::DOUBLE) {
      continue;
    }
    std::printf("  %s is --solver=%s\n",
                setting.method.label.c_str(),
                setting.method.spec.c_str());
  }
  std::printf(
      "  times: medians over packings and repetitions; errors: the largest "
      "over packings, against the minimum that the run\n  ends in: ");
  for (int o = 0; o < kNumObservables; ++o) {
    std::printf("%s%s %s",
                o == 0 ? "" : "; ",
                kObservables[o].name,
                kObservables[o].what);
  }
  std::printf("\n");
}

int Main() {
  if (FLAGS_flow) return FlowTradeoff();
  const int wanted = CheckFlags();
  const std::vector<Setting> settings = MakeSettings();
  std::vector<std::uint64_t> seeds;
  std::vector<Case> cases;
  std::string error;
  if (!ParseSeeds(FLAGS_seeds, &seeds, &error)) BadInput("--seeds: " + error);
  if (!FLAGS_case.empty() && !ParseCases(FLAGS_case, {}, 0.0, &cases, &error)) {
    BadInput("--case: " + error);
  }
  if (cases.size() > 1) BadInput("--case: one load, please");
  if (!FLAGS_input.empty()) seeds = {FLAGS_seed};
  const Scene scene = MakeScene(FLAGS_phi, seeds[0]);
  if (scene.energy.precision != Precision::DOUBLE) {
    BadInput("--precision is --precisions here");
  }

  std::printf("tradeoff  %s (%s), alpha = %g; %zu settings",
              Describe(scene.packing).c_str(),
              FLAGS_input.empty()
                  ? Format("seeds %s", FLAGS_seeds.c_str()).c_str()
                  : scene.origin.c_str(),
              scene.energy.alpha,
              settings.size());
  std::printf(FLAGS_recommend ? ", briefly\n" : "\n");
  std::fflush(stdout);
  Output output;
  output.Create(FLAGS_out,
                {"summary.json",
                 "tradeoff.csv",
                 "jamming.csv",
                 "recommendations.md",
                 "tradeoff.svg",
                 "tradeoff.png",
                 "phi_j.svg",
                 "phi_j.png"});

  const Scenarios all = MakeScenarios(scene, seeds, cases, &output);
  std::vector<Row> rows;
  std::map<std::string, std::vector<std::vector<End>>> ends;
  std::vector<JammingRow> jamming;
  {
    Progress progress;
    for (const Scenario& scenario : all.scenes) {
      std::vector<End> of_scenario;
      RunScenario(scenario,
                  scene.energy,
                  settings,
                  FLAGS_repetitions,
                  &progress,
                  &rows,
                  &of_scenario);
      ends[scenario.name].push_back(of_scenario);
    }
    if (!FLAGS_recommend) {
      for (const Scenario& scenario : all.above_jamming) {
        for (const Setting& setting : settings) {
          if (setting.precision != Precision::DOUBLE) continue;
          for (const double tolerance : {1e-4, 1e-8}) {
            if (progress.Due()) {
              progress.Show("phi_J by " + setting.method.label);
            }
            RunJamming(scenario,
                       scene.energy,
                       setting.method,
                       *setting.solver,
                       tolerance,
                       &jamming);
          }
        }
      }
    }
  }

  output.Write("tradeoff.csv", RowsCsv(rows));
  if (!jamming.empty()) {
    output.Write("jamming.csv", JammingCsv(jamming));
  }
  std::vector<std::string> names;
  for (const Scenario& scenario : all.scenes) {
    if (std::find(names.begin(), names.end(), scenario.name) == names.end()) {
      names.push_back(scenario.name);
    }
  }

  Json json;
  std::string minima;
  json["particles"] = scene.packing.size();
  json["alpha"] = scene.energy.alpha;
  json["minima"] = MinimaJson(names, ends, &minima);
  json["recommendations"] = Json::array();
  const std::vector<std::vector<std::string>> table =
      Recommendations(rows, names, &json["recommendations"]);
  json["schema"] = "granopt/tradeoff/1";
  json["provenance"] = Provenance();
  output.Write("recommendations.md", Grid(table, 0, true, 2));

  int status = kConverged;
  if (FLAGS_recommend) {
    status = PrintRecommended(rows, names, wanted, &json);
  } else {
    output.Plot(
        {"tradeoff", output.Path("tradeoff.csv"), output.Path("tradeoff")},
        {"tradeoff.svg", "tradeoff.png"});
    if (!jamming.empty()) {
      output.Plot({"phi_j", output.Path("jamming.csv"), output.Path("phi_j")},
                  {"phi_j.svg", "phi_j.png"});
    }
    PrintTable(table, settings);
  }
  std::printf("\nminima\n%s", minima.c_str());
  output.WriteJson("summary.json", json);
  output.PrintFiles();
  return status;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "what accuracy costs, in what users want; "
                      "--recommend: the cheapest setting for an accuracy");
  granopt::ListSolversIfAsked();
  return granopt::Main();
}
