// One run of the scene that the flags describe: energies, ledger, trajectory.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/flow.h"
#include "experiments/tabular.h"

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

// What is written along a run.
struct FlowRecord {
  std::string energy = kEnergyHeader;
  std::string rejections = "time,step,iterations,ratio,reason\n";
  std::string trajectory;
  int next_frame = 0;

  void AddRejections(const StepReport& report) {
    for (const Rejection& r : report.rejections) {
      rejections += Format("%.17g,%.17g,%d,%.6g,%s\n",
                           r.time,
                           r.step,
                           r.iterations,
                           r.ratio,
                           r.reason.c_str());
    }
  }
  // A frame and a row if the time of the next one has come.
  void AddFrame(const FlowScene& scene, const FlowState& state) {
    const auto has_come = [&] {
      return next_frame < FLAGS_frames &&
             state.time >= FLAGS_duration * next_frame / (FLAGS_frames - 1) *
                               (1.0 - 1e-12);
    };
    if (!has_come()) return;
    energy += EnergyRow(scene, state);
    trajectory += Frame(scene, state, 9);
    while (has_come()) ++next_frame;
  }
  Json ToState(const FlowState& state) const {
    return {{"flow", ToJson(state)},
            {"energy", energy},
            {"rejections", rejections},
            {"trajectory", trajectory},
            {"next_frame", next_frame}};
  }
  // Throws Json::exception if it is not of that form.
  void Load(const Json& written, FlowState* state) {
    *state = FlowStateOf(written.at("flow"));
    written.at("energy").get_to(energy);
    written.at("rejections").get_to(rejections);
    written.at("trajectory").get_to(trajectory);
    written.at("next_frame").get_to(next_frame);
  }
};

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

void PrintScene(const FlowScene& scene, const std::string& relaxed) {
  const NearField* const field = scene.near_field();
  double volume = 0.0;
  for (const double b : scene.grains().radius) volume += GrainVolume(3, b);
  std::printf(
      "flow      %d spheres, radius %.4g, volume fraction %.4f, "
      "domain %s of side %g\n",
      scene.size(),
      scene.grains().radius[0],
      volume / std::pow(scene.options().domain.side, 3),
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
}

// What a run that goes on from a checkpoint must have in common with it.
Json Setup(const std::string& start_frame) {
  Json setup = {{"start", Crc32(start_frame)},
                {"duration", FLAGS_duration},
                {"frames", FLAGS_frames}};
  // All that describes a scene or a step, whatever is added to it.
  for (const auto& flag : FlagsDefinedIn("experiments/flow_scene")) {
    setup[flag.name] = flag.current_value;
  }
  setup["tolerance"] = Number(FLAGS_tolerance);
  return setup;
}

Json SummaryJson(const FlowScene& scene,
                 const FlowState& state,
                 const std::string& fault,
                 double seconds) {
  const KineticEnergy k = scene.Kinetic(state.v.data());
  const double m = scene.total_mass();
  Json json = {{"completed", fault.empty()}};
  if (!fault.empty()) json["error"] = fault;
  json["particles"] = scene.size();
  json["time"] = state.time;
  json["kinetic"] = k.total() / m;
  json["bulk"] = k.bulk / m;
  json["relative"] = k.relative / m;
  json["relative_fraction"] = k.total() > 0.0 ? k.relative / k.total() : 0.0;
  json["ledger"] = LedgerJson(scene, state);
  json["counts"] = CountsJson(state);
  json["seconds"] = seconds;
  json["domain"] = FLAGS_domain;
  json["stepper"] = FLAGS_stepper;
  json["law"] = scene.near_field() != nullptr ? FLAGS_law : "none";
  json["contacts"] = FLAGS_contacts;
  json["schema"] = "granopt/flow/1";
  json["provenance"] = Provenance();
  json["provenance"]["threads"] = FLAGS_threads;
  return json;
}

void PrintResults(const FlowState& state, const Json& json) {
  std::printf("\nT(%.4g s) = %.4f J/kg, of which relative motion %.3f\n",
              state.time,
              json["kinetic"].get<double>(),
              json["relative_fraction"].get<double>());
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
}

}  // namespace

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

int RunScene() {
  std::string relaxed, error;
  const std::unique_ptr<Stepper> stepper = MakeStepper();
  CheckRange("frames", FLAGS_frames, 2, 1000000);
  CheckRange("checkpoint_every", FLAGS_checkpoint_every, 0, 1e15);
  if (FLAGS_smoke && !IsGiven("duration")) FLAGS_duration = 0.1;
  FlowCase flow;
  if (!MakeCase(&flow, &relaxed, &error)) BadInput(error);
  const FlowScene& scene = *flow.scene;
  FlowState& state = flow.state;
  if (!scene.Begin(stepper->FirstStep(), &state, &error)) BadInput(error);
  PrintScene(scene, relaxed);
  const std::string start_frame = Frame(scene, state, 17);
  const Checkpoint checkpoint(CheckpointPath(), Setup(start_frame));
  FlowRecord record;
  Json written;
  if (FLAGS_resume && Resume(checkpoint, &written)) {
    try {
      record.Load(written, &state);
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

  const int n = scene.size();
  const std::int64_t every =
      FLAGS_checkpoint_every > 0
          ? FLAGS_checkpoint_every
          : std::max<std::int64_t>(
                100, static_cast<std::int64_t>(2e9 / (1.0 * n * n + 1e3 * n)));
  if (record.next_frame == 0) record.AddFrame(scene, state);
  bool stopped = false;
  bool done;
  const double cpu = CpuSeconds(), begin = state.time;
  StepReport last;
  {
    Progress progress;
    done = RunFlow(
        scene,
        FLAGS_duration,
        stepper.get(),
        [&](const FlowState& now, const StepReport& report) {
          record.AddRejections(report);
          record.AddFrame(scene, now);
          stopped = StopRequested();
          if (stopped || now.steps % every == 0) {
            std::string fault;
            if (!checkpoint.Write(record.ToState(now), &fault)) {
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
                    (now.time - begin)));
          }
          return !stopped;
        },
        &state,
        &error,
        &last);
  }
  record.AddRejections(last);
  if (stopped) {
    std::printf(
        "\nstopped as asked, at t = %.6g: the same command with --resume goes "
        "on\n",
        state.time);
    return kNotConverged;
  }
  const Json json =
      SummaryJson(scene, state, done ? "" : error, CpuSeconds() - cpu);
  output.Write("energy.csv", record.energy);
  output.Write("rejections.csv", record.rejections);
  output.Write("start.xyz", start_frame);
  output.Write("final.xyz", Frame(scene, state, 17));
  output.Write("trajectory.xyz", record.trajectory);
  output.WriteJson("summary.json", json);
  output.Plot({"flow_run", output.Path("energy.csv"), output.Path("energy")},
              {"energy.svg", "energy.png"});
  output.Plot({"flow_start", output.Path("start.xyz"), output.Path("start")},
              {"start.svg", "start.png"});
  if (!done) std::fprintf(stderr, "flow: %s\n", error.c_str());
  PrintResults(state, json);
  output.PrintFiles();
  return done ? kConverged : kNotConverged;
}

}  // namespace granopt
