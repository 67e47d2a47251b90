// `flow --paper`: Figs 4 to 6 of Zohdi, Int. J. Solids Struct. 42 (2005) 539.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/flow.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

// The variants of --paper: the paper's rule at its boundary with constant e,
// with e of (5.13) and with steps so short that they leave no trace, and
// nearest images.
struct Variant {
  const char* name;
  const char* title;
  Domain::Kind domain;
  bool velocity_dependent;
  double step;  // 0: --dt
};
constexpr Variant kVariants[] = {
    {"constant_e", "x -> -x, e = 0.5", Domain::Kind::REENTRY, false, 0.0},
    {"velocity_dependent_e",
     "x -> -x, e of (5.13)",
     Domain::Kind::REENTRY,
     true,
     0.0},
    {"nearest_image",
     "nearest image, e = 0.5",
     Domain::Kind::NEAREST_IMAGE,
     false,
     0.0},
    {"short_steps",
     "x -> -x, e = 0.5, steps of at most 0.0005 s",
     Domain::Kind::REENTRY,
     false,
     5e-4}};
constexpr int kNumVariants = 4;
constexpr int kGrid = 101;  // times in energy.csv

constexpr const char* kRunNumbers[] = {"T0",
                                       "T1",
                                       "relative_fraction0",
                                       "relative_fraction1",
                                       "boundary",
                                       "impact",
                                       "friction",
                                       "numerical",
                                       "potential_change",
                                       "closure",
                                       "momentum_drift",
                                       "steps",
                                       "rejected_steps",
                                       "force_sweeps",
                                       "impulses",
                                       "boundary_crossings"};

constexpr std::size_t kNumNumbers = std::size(kRunNumbers);

// What a run leaves.
struct PaperRun {
  std::vector<double> numbers;               // kRunNumbers
  std::vector<double> bulk, relative, wrap;  // kGrid each
  std::string error;  // why it did not reach its end: all else is void
};

// T(1) and the relative part from an independent program with the same reading
// of the paper, means of 20 starts; NaN where it has none.
struct Independent {
  double T1, fraction1;
};
constexpr Independent kIndependent[kNumVariants][4] = {
    {{0.592, 0.138}, {0.774, 0.341}, {1.069, 0.523}, {1.395, 0.634}},
    {{NAN, NAN}, {NAN, NAN}, {NAN, NAN}, {NAN, NAN}},
    {{NAN, 0.13}, {NAN, 0.21}, {NAN, 0.23}, {NAN, 0.22}},
    {{0.588, 0.13}, {0.806, 0.37}, {1.147, 0.56}, {1.685, 0.70}}};

PaperRun RunPaperCase(const Variant& variant,
                      const Strength& strength,
                      std::uint64_t seed,
                      int particles,
                      double duration,
                      std::string* trajectory) {
  FlowCase flow = MakePaperCase(
      strength, seed, variant.domain, variant.velocity_dependent, particles);
  const FlowScene& scene = *flow.scene;
  FlowState& state = flow.state;
  StepperOptions stepping = MakeStepperOptions();
  if (variant.step > 0.0) {
    stepping.step = std::min(stepping.step, variant.step);
    stepping.first_step = std::min(stepping.first_step, variant.step);
  }
  const std::unique_ptr<Stepper> stepper = CreateImplicitStepper(stepping);
  state.step = stepper->FirstStep();
  const double m = scene.total_mass();
  PaperRun run;
  const KineticEnergy k0 = scene.Kinetic(state.v.data());
  if (trajectory != nullptr) *trajectory = Frame(scene, state, 9);
  double before = 0.0, bulk = k0.bulk / m, relative = k0.relative / m,
         wrap = 0.0;
  run.bulk = {bulk};
  run.relative = {relative};
  run.wrap = {0.0};
  std::string error;
  const bool done = RunFlow(
      scene,
      duration,
      stepper.get(),
      [&](const FlowState& now, const StepReport&) {
        const KineticEnergy k = scene.Kinetic(now.v.data());
        const double next[3] = {
            k.bulk / m, k.relative / m, now.energy.boundary / m};
        bool is_frame = false;
        while (static_cast<int>(run.bulk.size()) < kGrid) {
          const double t = duration * run.bulk.size() / (kGrid - 1);
          if (t > now.time * (1.0 + 1e-12)) break;
          const double s = (t - before) / (now.time - before);
          run.bulk.push_back(bulk + s * (next[0] - bulk));
          run.relative.push_back(relative + s * (next[1] - relative));
          run.wrap.push_back(wrap + s * (next[2] - wrap));
          is_frame = true;
        }
        if (is_frame && trajectory != nullptr) {
          *trajectory += Frame(scene, now, 9);
        }
        before = now.time;
        bulk = next[0];
        relative = next[1];
        wrap = next[2];
        return true;
      },
      &state,
      &error);
  if (!done) {
    PaperRun failed;
    failed.numbers.assign(kNumNumbers, 0.0);
    failed.error = error;
    return failed;
  }
  const KineticEnergy k = scene.Kinetic(state.v.data());
  run.numbers = {k0.total() / m,
                 k.total() / m,
                 k0.relative / k0.total(),
                 k.relative / k.total()};
  const Json ledger = LedgerJson(scene, state);
  for (const char* entry : {"boundary",
                            "impact",
                            "friction",
                            "numerical",
                            "potential_change",
                            "closure",
                            "momentum_drift"}) {
    run.numbers.push_back(ledger.at(entry));
  }
  for (const std::int64_t count : {state.steps,
                                   state.rejected,
                                   state.sweeps,
                                   state.impulses,
                                   state.jumps}) {
    run.numbers.push_back(static_cast<double>(count));
  }
  return run;
}

Json RunJson(const PaperRun& r) {
  return {{"numbers", r.numbers},
          {"bulk", r.bulk},
          {"relative", r.relative},
          {"wrap", r.wrap},
          {"error", r.error}};
}
PaperRun RunOf(const Json& json) {
  PaperRun r;
  json.at("numbers").get_to(r.numbers);
  if (r.numbers.size() != kNumNumbers) {
    throw Json::other_error::create(501, "another number of columns", &json);
  }
  json.at("bulk").get_to(r.bulk);
  json.at("relative").get_to(r.relative);
  json.at("wrap").get_to(r.wrap);
  json.at("error").get_to(r.error);
  return r;
}

// Runs are in the order of variants, strengths, starts.
struct PaperTables {
  std::string runs_csv;
  Json variants = Json::object();  // of each strength means and deviations
  Json failed = Json::array();
};
PaperTables Tabulate(const std::vector<PaperRun>& runs, int seeds) {
  PaperTables tables;
  tables.runs_csv = "variant,strength,alpha1,alpha2,seed";
  for (const char* name : kRunNumbers) {
    tables.runs_csv += std::string(",") + name;
  }
  tables.runs_csv += ",error\n";
  for (int v = 0; v < kNumVariants; ++v) {
    Json table = Json::array();
    for (int c = 0; c < 4; ++c) {
      const PaperRun* const first = runs.data() + (v * 4 + c) * seeds;
      std::vector<std::vector<double>> columns(kNumNumbers);
      for (int s = 0; s < seeds; ++s) {
        const std::vector<double>& numbers = first[s].numbers;
        tables.runs_csv +=
            Format("%s,%d,%g,%g,%llu",
                   kVariants[v].name,
                   c + 1,
                   kPaperStrengths[c].alpha1,
                   kPaperStrengths[c].alpha2,
                   static_cast<unsigned long long>(FLAGS_seed + s));
        const std::string& fault = first[s].error;
        for (std::size_t k = 0; k < numbers.size(); ++k) {
          if (fault.empty()) columns[k].push_back(numbers[k]);
          tables.runs_csv += fault.empty() ? Format(",%.17g", numbers[k]) : ",";
        }
        tables.runs_csv += "," + Field(fault) + "\n";
        if (!fault.empty()) {
          tables.failed.push_back({{"variant", kVariants[v].name},
                                   {"alpha1", kPaperStrengths[c].alpha1},
                                   {"seed", FLAGS_seed + s},
                                   {"error", fault}});
        }
      }
      Json row = {{"alpha1", kPaperStrengths[c].alpha1},
                  {"alpha2", kPaperStrengths[c].alpha2}};
      for (std::size_t k = 0; k < columns.size(); ++k) {
        const MeanDeviation m = MeanAndDeviation(columns[k]);
        row[kRunNumbers[k]] = m.mean;
        row[std::string(kRunNumbers[k]) + "_sd"] = m.deviation;
      }
      table.push_back(row);
    }
    tables.variants[kVariants[v].name] = table;
  }
  return tables;
}

// Means and deviations over starts, on the grid of times.
std::string EnergyCsv(const std::vector<PaperRun>& runs, int seeds) {
  std::string energy_csv =
      "variant,strength,time,kinetic,kinetic_deviation,relative_fraction,"
      "relative_fraction_deviation,boundary,boundary_deviation,first_kinetic,"
      "first_relative_fraction\n";
  for (int v = 0; v < kNumVariants; ++v) {
    for (int c = 0; c < 4; ++c) {
      const PaperRun* const first = runs.data() + (v * 4 + c) * seeds;
      for (int t = 0; t < kGrid; ++t) {
        std::vector<double> kinetic, fraction, wrap;
        for (int s = 0; s < seeds; ++s) {
          const PaperRun& r = first[s];
          if (!r.error.empty()) continue;
          if (t >= static_cast<int>(r.bulk.size())) continue;
          kinetic.push_back(r.bulk[t] + r.relative[t]);
          fraction.push_back(r.relative[t] / (r.bulk[t] + r.relative[t]));
          wrap.push_back(r.wrap[t]);
        }
        if (kinetic.empty()) continue;
        const MeanDeviation k = MeanAndDeviation(kinetic),
                            f = MeanAndDeviation(fraction),
                            w = MeanAndDeviation(wrap);
        energy_csv += Format(
            "%s,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,"
            "%.17g,%.17g\n",
            kVariants[v].name,
            c + 1,
            FLAGS_duration * t / (kGrid - 1),
            k.mean,
            k.deviation,
            f.mean,
            f.deviation,
            w.mean,
            w.deviation,
            kinetic[0],
            fraction[0]);
      }
    }
  }
  return energy_csv;
}

void PrintTables(const Json& variants) {
  std::printf(
      "\n  kinetic energy per mass (J/kg), the part of relative motion in it, "
      "mean +- deviation of one start,\n  and what the energy came from and "
      "went to. 'Before': T and relative part from an independent\n  program "
      "with the same reading of the paper, 20 starts\n");
  for (int v = 0; v < kNumVariants; ++v) {
    std::vector<std::vector<std::string>> table = {
        {"alpha1",
         "T(0)",
         Format("T(%g)", FLAGS_duration),
         "relative part",
         "boundary",
         "contacts",
         "potential",
         "integrator",
         "before"}};
    for (int c = 0; c < 4; ++c) {
      const Json& row = variants.at(kVariants[v].name).at(c);
      const auto get = [&](const char* key) {
        return row.at(key).get<double>();
      };
      const auto mean = [&](const std::string& key) {
        return Format(
            "%.3f +- %.3f", get(key.c_str()), get((key + "_sd").c_str()));
      };
      const Independent& before = kIndependent[v][c];
      table.push_back(
          {Format("%g", kPaperStrengths[c].alpha1),
           mean("T0"),
           mean("T1"),
           mean("relative_fraction1"),
           Format("%+.3f", get("boundary")),
           Format("%+.3f", get("impact") + get("friction")),
           Format("%+.3f", -get("potential_change")),
           Format("%+.3f", get("numerical")),
           (before.T1 > 0.0 ? Format("%.3f, ", before.T1) : "") +
               (before.fraction1 > 0.0 ? Format("%.3g", before.fraction1)
                                       : "-")});
    }
    std::printf(
        "\n  %s\n%s", kVariants[v].title, Grid(table, 0, false).c_str());
  }
}

}  // namespace

int RunPaper() {
  CheckRange("seeds", FLAGS_seeds, 1, 100000);
  CheckRange("particles", FLAGS_particles, 1, 100000);
  if (FLAGS_smoke) {
    if (!IsGiven("seeds")) FLAGS_seeds = 2;
    if (!IsGiven("particles")) FLAGS_particles = 30;
  }
  MakeStepperOptions();
  const int seeds = FLAGS_seeds;
  std::printf(
      "flow      Figs 4-6: %d spheres, L = 0.25, e = 0.5, mu_s = 0.2, mu_d = "
      "0.1, beta = 1, 2, four strengths, %d starts each\n"
      "          implicit steps of at most %g s, TOL = %g; x -> -x at the "
      "boundary without images, and nearest images to compare\n"
      "          the paper leaves open: the rule for images, v* = 1 and e- = "
      "0.1 of (5.13), several contacts at once: see experiments/flow.md\n",
      FLAGS_particles,
      seeds,
      FLAGS_dt,
      FLAGS_tolerance);
  Json setup = {{"particles", FLAGS_particles},
                {"seeds", seeds},
                {"seed", FLAGS_seed},
                {"duration", FLAGS_duration}};
  std::string value;
  for (const std::string& name : StepFlags()) {
    gflags::GetCommandLineOption(name.c_str(), &value);
    setup[name] = value;
  }
  const Checkpoint checkpoint(CheckpointPath(), setup);
  Json done = Json::array();
  std::vector<std::string> trajectories;
  Json written;
  std::vector<PaperRun> runs;
  if (FLAGS_resume && Resume(checkpoint, &written)) {
    try {
      done = written.at("runs");
      written.at("trajectories").get_to(trajectories);
      for (const Json& json : done) runs.push_back(RunOf(json));
    } catch (const Json::exception& exception) {
      RefuseState(checkpoint, exception);
    }
    std::printf("          resumed after run %zu\n", runs.size());
  }
  std::fflush(stdout);
  std::vector<std::string> names = {
      "summary.json", "runs.csv", "energy.csv", "start.xyz"};
  for (int c = 1; c <= 4; ++c) {
    names.push_back(Format("trajectory_%d.xyz", c));
  }
  for (const char* figure : {"start", "fractions", "energy", "boundary"}) {
    names.push_back(std::string(figure) + ".svg");
    names.push_back(std::string(figure) + ".png");
  }
  const std::vector<std::string> kept = CheckpointFiles();
  if (!FLAGS_resume) names.insert(names.end(), kept.begin(), kept.end());
  Output output;
  output.Create(FLAGS_out, names, kept);
  CatchStopSignals();
  const std::size_t total = 4u * seeds * kNumVariants;
  const double cpu = CpuSeconds();
  const std::size_t before = runs.size();
  {
    Progress progress;
    for (std::size_t r = runs.size(); r < total; ++r) {
      const int variant = static_cast<int>(r / (4 * seeds));
      const int number = static_cast<int>(r / seeds % 4);
      const int seed = static_cast<int>(r % seeds);
      const bool is_first = variant == 0 && seed == 0;
      std::string trajectory;
      runs.push_back(RunPaperCase(kVariants[variant],
                                  kPaperStrengths[number],
                                  FLAGS_seed + seed,
                                  FLAGS_particles,
                                  FLAGS_duration,
                                  is_first ? &trajectory : nullptr));
      done.push_back(RunJson(runs.back()));
      if (is_first) trajectories.push_back(std::move(trajectory));
      if (progress.Due()) {
        progress.Show(Format(
            "run %zu of %zu: %s, strength %d, seed %llu; about %.0f s left",
            r + 1,
            total,
            kVariants[variant].title,
            number + 1,
            static_cast<unsigned long long>(FLAGS_seed + seed),
            (CpuSeconds() - cpu) * (total - r - 1) / (r + 1 - before)));
      }
      const bool stop = StopRequested();
      if (stop || (r + 1) % 20 == 0) {
        std::string fault;
        if (!checkpoint.Write({{"runs", done}, {"trajectories", trajectories}},
                              &fault)) {
          BadInput(fault);
        }
      }
      if (stop && r + 1 < total) {
        std::printf(
            "\nstopped as asked, after run %zu of %zu: the same "
            "command with --resume goes on\n",
            r + 1,
            total);
        return kNotConverged;
      }
    }
  }
  const PaperTables tables = Tabulate(runs, seeds);
  Json json;
  json["strengths"] = tables.variants.at(kVariants[0].name);
  json["variants"] = tables.variants;
  json["failed"] = tables.failed;
  json["particles"] = FLAGS_particles;
  json["seeds"] = seeds;
  json["duration"] = FLAGS_duration;
  json["dt"] = FLAGS_dt;
  json["tolerance"] = FLAGS_tolerance;
  json["seconds"] = CpuSeconds() - cpu;
  json["schema"] = "granopt/flow_paper/1";
  json["provenance"] = Provenance();
  output.Write("runs.csv", tables.runs_csv);
  output.Write("energy.csv", EnergyCsv(runs, seeds));
  const FlowCase flow = MakePaperCase(kPaperStrengths[0],
                                      FLAGS_seed,
                                      Domain::Kind::REENTRY,
                                      false,
                                      FLAGS_particles);
  output.Write("start.xyz", Frame(*flow.scene, flow.state, 17));
  for (std::size_t c = 0; c < trajectories.size(); ++c) {
    output.Write(Format("trajectory_%zu.xyz", c + 1), trajectories[c]);
  }
  output.WriteJson("summary.json", json);
  output.Plot({"flow_start", output.Path("start.xyz"), output.Path("start")},
              {"start.svg", "start.png"});
  for (const char* figure : {"fractions", "energy", "boundary"}) {
    output.Plot({std::string("flow_") + figure,
                 output.Path("energy.csv"),
                 output.Path(figure)},
                {std::string(figure) + ".svg", std::string(figure) + ".png"});
  }

  PrintTables(tables.variants);
  std::printf("\n  the start has relative part %.3f; %.3g s\n",
              json["strengths"][0]["relative_fraction0"].get<double>(),
              json["seconds"].get<double>());
  for (const Json& run : tables.failed) {
    std::printf("  failed: %s, alpha1 = %g, seed %llu: %s\n",
                run.at("variant").get<std::string>().c_str(),
                run.at("alpha1").get<double>(),
                run.at("seed").get<unsigned long long>(),
                run.at("error").get<std::string>().c_str());
  }
  output.PrintFiles();
  return tables.failed.empty() ? kConverged : kNotConverged;
}

}  // namespace granopt
