// flow: near-field granular flow (granular/flow/flow.h).
//
//   flow                 one run of one scene: energies, ledger, trajectory
//   flow --paper         Figs 4 to 6 of Zohdi, Int. J. Solids Struct. 42 (2005)
//                        539: four strengths, 20 starts each, mean and spread
//   flow --study=NAME    work_precision, remark8, oscillator or throughput

#include "experiments/flow.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/packing_io.h"
#include "solvers/registry.h"
#include "solvers/threads.h"

DEFINE_bool(list_solvers, false, "print the methods and exit");
DEFINE_int32(threads, 1, "results are the same bits on any number");
// ---- modes
DEFINE_bool(paper, false, "Figs 4 to 6 with the parameters of sec. 7.1");
DEFINE_int32(seeds,
             20,
             "starts of --paper and of studies (work_precision: 10)");
DEFINE_string(study, "", "work_precision, remark8, oscillator or throughput");
DEFINE_int32(frames, 101, "of the trajectory, and rows of energy.csv");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out; ends in the same bits");
DEFINE_int64(
    checkpoint_every,
    0,
    "steps between checkpoints of one run (0: as many as take some 2e9 "
    "pairs, 100 at least)");

namespace granopt {

namespace {

const char kEnergyHeader[] =
    "time,step,kinetic,bulk,relative,potential,near_field,soft_contact,impact,"
    "friction,external,damping,boundary,numerical,closure\n";

// A row of energy.csv, all per mass (J / kg).
std::string EnergyRow(const FlowScene& scene, const FlowState& state) {
  const KineticEnergy k = scene.Kinetic(state.v.data());
  const double potential = scene.Potential(state.x.data());
  const EnergyLedger& e = state.energy;
  const double m = scene.total_mass();
  std::string row = Format("%.17g,%.17g", state.time, state.step);
  for (const double value : {k.total(),
                             k.bulk,
                             k.relative,
                             potential,
                             e.near_field,
                             e.soft_contact,
                             e.impact,
                             e.friction,
                             e.external,
                             e.damping,
                             e.boundary,
                             scene.Numerical(state, potential),
                             scene.Closure(state, k.total())}) {
    row += Format(",%.17g", value / m);
  }
  return row + "\n";
}

std::string RejectionRows(const StepReport& report) {
  std::string rows;
  for (const Rejection& r : report.rejections) {
    rows += Format("%.17g,%.17g,%d,%.6g,%s\n",
                   r.time,
                   r.step,
                   r.iterations,
                   r.ratio,
                   r.reason.c_str());
  }
  return rows;
}

Json LedgerJson(const FlowScene& scene, const FlowState& state) {
  const KineticEnergy k = scene.Kinetic(state.v.data());
  const double potential = scene.Potential(state.x.data());
  const double m = scene.total_mass();
  const EnergyLedger& e = state.energy;
  double p[3], drift = 0.0;
  scene.Momentum(state.v.data(), p);
  for (int c = 0; c < 3; ++c) {
    const double rest = p[c] - state.momentum_start[c] -
                        state.momentum.external[c] - state.momentum.damping[c] -
                        state.momentum.fixed[c];
    drift += rest * rest;
  }
  // Over the momentum of grains that all go one way with that energy: a flow
  // whose mean velocity is 0 has a drift too.
  const double size =
      std::sqrt(2.0 * m * std::max(k.total(), state.kinetic_start));
  return {{"kinetic_change", (k.total() - state.kinetic_start) / m},
          {"potential_change", (potential - state.potential_start) / m},
          {"boundary", e.boundary / m},
          {"impact", e.impact / m},
          {"friction", e.friction / m},
          {"external", e.external / m},
          {"damping", e.damping / m},
          {"numerical", scene.Numerical(state, potential) / m},
          {"closure", scene.Closure(state, k.total()) / m},
          {"momentum_drift", size > 0.0 ? std::sqrt(drift) / size : 0.0},
          {"momentum",
           {{"external", state.momentum.external},
            {"damping", state.momentum.damping},
            {"fixed", state.momentum.fixed}}},
          {"worst_force_balance", state.worst_balance}};
}

Json CountsJson(const FlowState& state) {
  return {{"steps", state.steps},
          {"rejected_steps", state.rejected},
          {"force_sweeps", state.sweeps},
          {"impulses", state.impulses},
          {"sticking_impulses", state.sticking},
          {"boundary_crossings", state.jumps},
          {"steps_beyond_a_radius", state.fast}};
}

void WarnOfFastGrains(const FlowState& state) {
  if (state.fast == 0) return;
  std::printf(
      "  warning       in %lld of %lld steps a grain moved by more than its "
      "radius: contacts may be missed; a smaller --dt sees them\n",
      static_cast<long long>(state.fast),
      static_cast<long long>(state.steps));
}

void PrintLedger(const Json& ledger) {
  const auto get = [&](const char* key) {
    return ledger.at(key).get<double>();
  };
  // What the scene does not contain is not listed.
  std::string text;
  for (const auto& [key, name] : {std::pair{"boundary", "boundary"},
                                  {"impact", "impact"},
                                  {"friction", "friction"},
                                  {"external", "external"},
                                  {"damping", "damping"},
                                  {"numerical", "integrator"}}) {
    if (get(key) != 0.0) text += Format("%s %+.4f, ", name, get(key));
  }
  std::printf(
      "  ledger        J/kg: %+.4f kinetic = %spotential %+.4f\n"
      "                closes to %.1e, momentum to %.1e\n",
      get("kinetic_change"),
      text.c_str(),
      -get("potential_change"),
      std::fabs(get("closure")),
      get("momentum_drift"));
}

int RunOne() {
  std::string relaxed, error;
  const std::unique_ptr<Stepper> stepper = MakeStepper();
  CheckRange("frames", FLAGS_frames, 2, 1000000);
  CheckRange("checkpoint_every", FLAGS_checkpoint_every, 0, 1e15);
  if (FLAGS_smoke && !IsGiven("duration")) FLAGS_duration = 0.1;
  FlowCase flow;
  if (!MakeCase(&flow, &relaxed, &error)) BadInput(error);
  const FlowScene& scene = *flow.scene;
  FlowState& state = flow.state;
  const int n = scene.size();
  if (!scene.Begin(stepper->FirstStep(), &state, &error)) BadInput(error);
  const NearField* const field = scene.near_field();

  std::printf(
      "flow      %d spheres, radius %.4g, volume fraction %.4f, "
      "domain %s of side %g\n",
      n,
      scene.grains().radius[0],
      [&] {
        double v = 0.0;
        for (const double b : scene.grains().radius) {
          v += GrainVolume(3, b);
        }
        return v / std::pow(scene.options().domain.side, 3);
      }(),
      FLAGS_domain.c_str(),
      scene.options().domain.side);
  if (field == nullptr) {
    std::printf("          no near field\n");
  } else {
    const double d = EquilibriumDistance(field->law());
    std::printf("          near field %s per %s, %s\n",
                FLAGS_law.c_str(),
                WeightName(scene.options().weight),
                d > 0.0 ? Format("two grains rest at d = %.4g", d).c_str()
                        : "without a stable distance (2.8)");
  }
  if (field != nullptr && field->UsesTree()) {
    std::printf(
        "          its sum by fast multipoles, errors below %g of the "
        "magnitudes of pair forces\n",
        FLAGS_field_accuracy);
  }
  std::printf("          contacts %s; stepper %s, dt <= %g\n",
              FLAGS_contacts.c_str(),
              FLAGS_stepper.c_str(),
              FLAGS_dt);
  if (!relaxed.empty()) {
    std::printf("          overlaps relaxed: %s\n", relaxed.c_str());
  }

  const std::string start_frame = Frame(scene, state, 17);
  std::string csv = kEnergyHeader,
              rejections = "time,step,iterations,ratio,reason\n";
  std::string frames;
  int next_frame = 0;
  Json setup = {{"start", Crc32(start_frame)},
                {"duration", FLAGS_duration},
                {"frames", FLAGS_frames}};
  // All that describes a scene or a step, whatever is added to it.
  std::vector<gflags::CommandLineFlagInfo> flags;
  gflags::GetAllFlags(&flags);
  for (const auto& flag : flags) {
    if (flag.name == "tolerance" ||
        flag.filename.find("experiments/flow_scene") != std::string::npos) {
      setup[flag.name] = flag.current_value;
    }
  }
  const Checkpoint checkpoint(CheckpointPath(), setup);
  Json written;
  if (FLAGS_resume && Resume(checkpoint, &written)) {
    try {
      state = FlowStateOf(written.at("flow"));
      written.at("energy").get_to(csv);
      written.at("rejections").get_to(rejections);
      written.at("trajectory").get_to(frames);
      written.at("next_frame").get_to(next_frame);
    } catch (const Json::exception& exception) {
      RefuseState(checkpoint, exception);
    }
    std::printf("          resumed at t = %.6g\n", state.time);
  }
  std::fflush(stdout);
  std::vector<std::string> names = {"summary.json",
                                    "energy.csv",
                                    "rejections.csv",
                                    "start.xyz",
                                    "final.xyz",
                                    "trajectory.xyz",
                                    "energy.svg",
                                    "energy.png",
                                    "start.svg",
                                    "start.png"};
  const std::vector<std::string> kept = CheckpointFiles();
  if (!FLAGS_resume) names.insert(names.end(), kept.begin(), kept.end());
  Output output;
  output.Create(FLAGS_out, names, kept);
  CatchStopSignals();

  const std::int64_t every =
      FLAGS_checkpoint_every > 0
          ? FLAGS_checkpoint_every
          : std::max<std::int64_t>(
                100, static_cast<std::int64_t>(2e9 / (1.0 * n * n + 1e3 * n)));
  const auto show = [&] {
    while (next_frame < FLAGS_frames &&
           state.time >= FLAGS_duration * next_frame / (FLAGS_frames - 1) *
                             (1.0 - 1e-12)) {
      csv += EnergyRow(scene, state);
      frames += Frame(scene, state, 9);
      // The next one that is not passed yet.
      while (next_frame < FLAGS_frames &&
             state.time >= FLAGS_duration * next_frame / (FLAGS_frames - 1) *
                               (1.0 - 1e-12)) {
        ++next_frame;
      }
    }
  };
  if (next_frame == 0) show();
  bool stopped = false;
  bool done;
  const double cpu = CpuSeconds();
  StepReport last;
  {
    Progress progress;
    done = RunFlow(
        scene,
        FLAGS_duration,
        stepper.get(),
        [&](const FlowState& now, const StepReport& report) {
          rejections += RejectionRows(report);
          show();
          stopped = StopRequested();
          if (stopped || now.steps % every == 0) {
            std::string fault;
            if (!checkpoint.Write({{"flow", ToJson(now)},
                                   {"energy", csv},
                                   {"rejections", rejections},
                                   {"trajectory", frames},
                                   {"next_frame", next_frame}},
                                  &fault)) {
              BadInput(fault);
            }
          }
          if (progress.Due()) {
            progress.Show(Format(
                "t = %.5g of %g, step %lld of %.3g s, %lld rejected, T = %.5g "
                "J/kg, about %.0f s left",
                now.time,
                FLAGS_duration,
                static_cast<long long>(now.steps),
                report.step,
                static_cast<long long>(now.rejected),
                scene.Kinetic(now.v.data()).total() / scene.total_mass(),
                (CpuSeconds() - cpu) * (FLAGS_duration - now.time) /
                    std::max(now.time, 1e-300)));
          }
          return !stopped;
        },
        &state,
        &error,
        &last);
  }
  rejections += RejectionRows(last);
  if (stopped) {
    std::printf(
        "\nstopped as asked, at t = %.6g: the same command with --resume goes "
        "on\n",
        state.time);
    return kNotConverged;
  }
  const KineticEnergy k = scene.Kinetic(state.v.data());
  const double m = scene.total_mass();
  Json json = {{"completed", done}};
  if (!done) json["error"] = error;
  json["particles"] = n;
  json["time"] = state.time;
  json["kinetic"] = k.total() / m;
  json["bulk"] = k.bulk / m;
  json["relative"] = k.relative / m;
  json["relative_fraction"] = k.total() > 0.0 ? k.relative / k.total() : 0.0;
  json["ledger"] = LedgerJson(scene, state);
  json["counts"] = CountsJson(state);
  json["seconds"] = CpuSeconds() - cpu;
  json["domain"] = FLAGS_domain;
  json["stepper"] = FLAGS_stepper;
  json["law"] = field != nullptr ? FLAGS_law : "none";
  json["contacts"] = FLAGS_contacts;
  json["schema"] = "granopt/flow/1";
  json["provenance"] = Provenance();
  json["provenance"]["threads"] = FLAGS_threads;
  output.Write("energy.csv", csv);
  output.Write("rejections.csv", rejections);
  output.Write("start.xyz", start_frame);
  output.Write("final.xyz", Frame(scene, state, 17));
  output.Write("trajectory.xyz", frames);
  output.WriteJson("summary.json", json);
  output.Plot({"flow_run", output.Path("energy.csv"), output.Path("energy")},
              {"energy.svg", "energy.png"});
  output.Plot({"flow_start", output.Path("start.xyz"), output.Path("start")},
              {"start.svg", "start.png"});
  if (!done) std::fprintf(stderr, "flow: %s\n", error.c_str());
  std::printf("\nT(%.4g s) = %.4f J/kg, of which relative motion %.3f\n",
              state.time,
              k.total() / m,
              k.total() > 0.0 ? k.relative / k.total() : 0.0);
  PrintLedger(json["ledger"]);
  std::printf(
      "  work          %lld steps, %lld rejected (rejections.csv says why), "
      "%lld force sweeps, %.3g s\n",
      static_cast<long long>(state.steps),
      static_cast<long long>(state.rejected),
      static_cast<long long>(state.sweeps),
      json["seconds"].get<double>());
  std::printf(
      "  contacts      %lld impulses, %lld of them sticking; %lld "
      "crossings of the boundary\n",
      static_cast<long long>(state.impulses),
      static_cast<long long>(state.sticking),
      static_cast<long long>(state.jumps));
  WarnOfFastGrains(state);
  output.PrintFiles();
  return done ? kConverged : kNotConverged;
}

// ---------------------------------------------------------------- the paper

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

// What a run leaves: numbers for the tables and energies on the grid of times.
struct PaperRun {
  double T0, T1, fraction0, fraction1;
  double boundary, impact, friction, numerical, potential, closure, drift;
  double steps, rejected, sweeps, impulses, jumps;
  std::vector<double> bulk, relative, wrap;  // kGrid each
  std::string error;  // why it did not reach its end: all else is void
};

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

std::vector<double> Numbers(const PaperRun& r) {
  return {r.T0,
          r.T1,
          r.fraction0,
          r.fraction1,
          r.boundary,
          r.impact,
          r.friction,
          r.numerical,
          r.potential,
          r.closure,
          r.drift,
          r.steps,
          r.rejected,
          r.sweeps,
          r.impulses,
          r.jumps};
}

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
                      std::string* trajectory,
                      std::string* start) {
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
  run.T0 = k0.total() / m;
  run.fraction0 = k0.relative / k0.total();
  if (start != nullptr) *start = Frame(scene, state, 17);
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
    PaperRun failed = {};
    failed.error = error;
    return failed;
  }
  const KineticEnergy k = scene.Kinetic(state.v.data());
  run.T1 = k.total() / m;
  run.fraction1 = k.relative / k.total();
  const Json ledger = LedgerJson(scene, state);
  run.boundary = ledger["boundary"];
  run.impact = ledger["impact"];
  run.friction = ledger["friction"];
  run.numerical = ledger["numerical"];
  run.potential = ledger["potential_change"];
  run.closure = ledger["closure"];
  run.drift = ledger["momentum_drift"];
  run.steps = state.steps;
  run.rejected = state.rejected;
  run.sweeps = state.sweeps;
  run.impulses = state.impulses;
  run.jumps = state.jumps;
  return run;
}

Json RunJson(const PaperRun& r) {
  return {{"numbers", Numbers(r)},
          {"bulk", r.bulk},
          {"relative", r.relative},
          {"wrap", r.wrap},
          {"error", r.error}};
}
PaperRun RunOf(const Json& json) {
  PaperRun r;
  const std::vector<double> v = json.at("numbers").get<std::vector<double>>();
  if (v.size() != Numbers({}).size()) {
    throw Json::other_error::create(501, "another number of columns", &json);
  }
  double* const to[] = {&r.T0,
                        &r.T1,
                        &r.fraction0,
                        &r.fraction1,
                        &r.boundary,
                        &r.impact,
                        &r.friction,
                        &r.numerical,
                        &r.potential,
                        &r.closure,
                        &r.drift,
                        &r.steps,
                        &r.rejected,
                        &r.sweeps,
                        &r.impulses,
                        &r.jumps};
  for (std::size_t k = 0; k < v.size(); ++k) *to[k] = v[k];
  json.at("bulk").get_to(r.bulk);
  json.at("relative").get_to(r.relative);
  json.at("wrap").get_to(r.wrap);
  json.at("error").get_to(r.error);
  return r;
}

// BadInput for a flag of a flow that the user gave and a mode has no use for.
void RefuseOtherFlags(const std::vector<std::string>& used,
                      const std::string& mode) {
  std::vector<gflags::CommandLineFlagInfo> all;
  gflags::GetAllFlags(&all);
  for (const auto& flag : all) {
    if (flag.is_default ||
        flag.filename.find("experiments/flow") == std::string::npos ||
        std::find(used.begin(), used.end(), flag.name) != used.end()) {
      continue;
    }
    BadInput("--" + flag.name + " cannot go with " + mode);
  }
}

int RunPaper() {
  RefuseOtherFlags({"paper",
                    "resume",
                    "threads",
                    "seeds",
                    "particles",
                    "duration",
                    "dt",
                    "first_dt",
                    "tolerance",
                    "iterations",
                    "sweep",
                    "groups",
                    "relaxation",
                    "safety"},
                   "--paper, which sets the parameters of sec. 7.1");
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
      "0.1 of (5.13), several contacts at once: see README\n",
      FLAGS_particles,
      seeds,
      FLAGS_dt,
      FLAGS_tolerance);
  const Checkpoint checkpoint(CheckpointPath(),
                              {{"particles", FLAGS_particles},
                               {"seeds", seeds},
                               {"seed", FLAGS_seed},
                               {"dt", FLAGS_dt},
                               {"first_dt", FLAGS_first_dt},
                               {"tolerance", FLAGS_tolerance},
                               {"iterations", FLAGS_iterations},
                               {"sweep", FLAGS_sweep},
                               {"groups", FLAGS_groups},
                               {"safety", FLAGS_safety},
                               {"relaxation", FLAGS_relaxation},
                               {"duration", FLAGS_duration}});
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
  std::string start;
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
                                  is_first ? &trajectory : nullptr,
                                  nullptr));
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
  {
    FlowCase flow = MakePaperCase(kPaperStrengths[0],
                                  FLAGS_seed,
                                  Domain::Kind::REENTRY,
                                  false,
                                  FLAGS_particles);
    start = Frame(*flow.scene, flow.state, 17);
  }

  // Tables.
  std::string runs_csv = "variant,strength,alpha1,alpha2,seed";
  for (const char* name : kRunNumbers) runs_csv += std::string(",") + name;
  runs_csv += ",error\n";
  Json failed = Json::array();
  std::string energy_csv =
      "variant,strength,time,kinetic,kinetic_deviation,relative_fraction,"
      "relative_fraction_deviation,boundary,boundary_deviation,first_kinetic,"
      "first_relative_fraction\n";
  Json json;
  Json variants = Json::object();
  for (int v = 0; v < kNumVariants; ++v) {
    Json table = Json::array();
    for (int c = 0; c < 4; ++c) {
      const PaperRun* const first = runs.data() + (v * 4 + c) * seeds;
      std::vector<std::vector<double>> columns(Numbers({}).size());
      for (int s = 0; s < seeds; ++s) {
        const std::vector<double> numbers = Numbers(first[s]);
        runs_csv += Format("%s,%d,%g,%g,%llu",
                           kVariants[v].name,
                           c + 1,
                           kPaperStrengths[c].alpha1,
                           kPaperStrengths[c].alpha2,
                           static_cast<unsigned long long>(FLAGS_seed + s));
        const std::string& fault = first[s].error;
        for (std::size_t k = 0; k < numbers.size(); ++k) {
          if (fault.empty()) columns[k].push_back(numbers[k]);
          runs_csv += fault.empty() ? Format(",%.17g", numbers[k]) : ",";
        }
        runs_csv += "," + Field(fault) + "\n";
        if (!fault.empty()) {
          failed.push_back({{"variant", kVariants[v].name},
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
    variants[kVariants[v].name] = table;
  }
  json["strengths"] = variants[kVariants[0].name];
  json["variants"] = variants;
  json["failed"] = failed;
  json["particles"] = FLAGS_particles;
  json["seeds"] = seeds;
  json["duration"] = FLAGS_duration;
  json["dt"] = FLAGS_dt;
  json["tolerance"] = FLAGS_tolerance;
  json["seconds"] = CpuSeconds() - cpu;
  json["schema"] = "granopt/flow_paper/1";
  json["provenance"] = Provenance();
  output.Write("runs.csv", runs_csv);
  output.Write("energy.csv", energy_csv);
  output.Write("start.xyz", start);
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

  std::printf(
      "\n  kinetic energy per mass (J/kg), the part of relative motion in it, "
      "mean "
      "+- deviation of one start,\n  and what the energy came from and went "
      "to. "
      "'Before': T and relative part from an independent\n  program with the "
      "same reading of the paper, 20 starts\n");
  for (int v = 0; v < kNumVariants; ++v) {
    std::printf(
        "\n  %s\n    alpha1  T(0)            T(%g)            relative part    "
        "boundary contacts potential integrator  before\n",
        kVariants[v].title,
        FLAGS_duration);
    for (int c = 0; c < 4; ++c) {
      const Json& row = variants[kVariants[v].name][c];
      const auto get = [&](const char* key) { return row[key].get<double>(); };
      std::printf(
          "    %-6g  %.3f +- %.3f  %.3f +- %.3f  %.3f +- %.3f   %+.3f   %+.3f  "
          " "
          "%+.3f    %+.3f     ",
          kPaperStrengths[c].alpha1,
          get("T0"),
          get("T0_sd"),
          get("T1"),
          get("T1_sd"),
          get("relative_fraction1"),
          get("relative_fraction1_sd"),
          get("boundary"),
          get("impact") + get("friction"),
          -get("potential_change"),
          get("numerical"));
      const Independent& before = kIndependent[v][c];
      std::printf("%s%s\n",
                  before.T1 > 0.0 ? Format("%.3f  ", before.T1).c_str() : "",
                  before.fraction1 > 0.0
                      ? Format("%.3g", before.fraction1).c_str()
                      : "-");
    }
  }
  std::printf("\n  the start has relative part %.3f; %.3g s\n",
              json["strengths"][0]["relative_fraction0"].get<double>(),
              json["seconds"].get<double>());
  for (const Json& run : failed) {
    std::printf("  failed: %s, alpha1 = %g, seed %llu: %s\n",
                run.at("variant").get<std::string>().c_str(),
                run.at("alpha1").get<double>(),
                run.at("seed").get<unsigned long long>(),
                run.at("error").get<std::string>().c_str());
  }
  output.PrintFiles();
  return failed.empty() ? kConverged : kNotConverged;
}

int Main() {
  if (FLAGS_list_solvers) {
    std::fputs(SolverTable().c_str(), stdout);
    return kConverged;
  }
  if (FLAGS_threads < 1 || FLAGS_threads > 1024) {
    BadInput(Format("--threads=%d must be in [1, 1024]", FLAGS_threads));
  }
  if (!SetNumThreads(FLAGS_threads)) {
    BadInput(Format("--threads=%d: built without OpenMP", FLAGS_threads));
  }
  if (!FLAGS_study.empty()) {
    if (FLAGS_paper) BadInput("--study and --paper exclude each other");
    if (FLAGS_resume) BadInput("--study has no --resume: studies take minutes");
    if (!IsStudy(FLAGS_study)) {
      BadInput("--study=" + FLAGS_study +
               " must be work_precision, remark8, oscillator or throughput");
    }
    std::vector<std::string> used = StudyFlags(FLAGS_study);
    used.insert(used.end(), {"study", "threads"});
    RefuseOtherFlags(used, "--study=" + FLAGS_study);
    CheckRange("seeds", FLAGS_seeds, 1, 100000);
    Output output;
    std::vector<std::string> names = StudyFiles(FLAGS_study);
    names.push_back("summary.json");
    output.Create(FLAGS_out, names);
    return RunStudy(FLAGS_study, &output);
  }
  return FLAGS_paper ? RunPaper() : RunOne();
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "near-field granular flow: charged grains that collide "
                      "and rub (--paper: Figs 4-6 of Zohdi 2005)");
  return granopt::Main();
}
