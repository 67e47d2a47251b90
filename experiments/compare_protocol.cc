// compare --protocol: each method drives a whole protocol by itself.
//
//   compare --protocol=jamming --particles=256 --seeds=1-3
//           --solvers="label@spec;spec;..." --tolerances=1e-4,1e-6,1e-8
//   compare --protocol=shear --phi=0.86 --strain=0.02 --strain_steps=200
//
// jamming: Algorithm 1 as published; then, with one method for all and outside
// of what is counted, the branch of the state that came out is followed down to
// its own jamming point. shear: quasistatic pure shear of one relaxed packing.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "experiments/compare.h"
#include "experiments/preparation.h"
#include "experiments/protocols.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/atomic_file.h"
#include "granular/jamming.h"
#include "granular/quasistatic_shear.h"

DEFINE_string(protocol,
              "",
              "compare over a whole protocol instead: jamming (Algorithm 1) or "
              "shear (quasistatic pure shear)");
DEFINE_string(tolerances,
              "",
              "of a protocol: tolerances separated by commas, each with every "
              "method; default: --tolerance (jamming: 1e-8)");
DEFINE_double(phi_init,
              0.0,
              "jamming: packing fraction of the start; default 0.80 (discs), "
              "0.58 (spheres)");
DEFINE_double(dphi, 1e-3, "jamming: increment delta phi of the growth");
DEFINE_double(epsilon, 1e-6, "jamming: accuracy of the bisection");
DEFINE_double(strain, 0.02, "shear: pure shear strain at the end");
DEFINE_int32(strain_steps, 200, "shear: equal increments of the strain");

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// A relaxation of a protocol gives up after that many evaluations unless
// --max_evaluations says other: one that stalls would never end.
constexpr int kProtocolEvaluations = 200000;
// The branch below a jammed state is followed to this part of epsilon, with
// relaxations to this many mean forces.
constexpr double kBranchError = 1e-2;
constexpr double kBranchTolerance = 1e-8;
constexpr double kShearPhi = 0.86;
constexpr double kShearPhi3d = 0.70;

// Flags of one protocol, or of ordinary comparisons only.
constexpr const char* kJammingFlags[] = {"phi_init", "dphi", "epsilon"};
constexpr const char* kShearFlags[] = {"strain", "strain_steps", "phi"};
constexpr const char* kOrdinaryFlags[] = {"cases",
                                          "absolute_tolerance",
                                          "distances",
                                          "shear",
                                          "steps",
                                          "prepare_evaluations",
                                          "paper"};

struct ProtocolPlan {
  ProtocolSetup setup;
  std::vector<std::unique_ptr<Solver>> solvers;  // as setup.methods
  std::unique_ptr<Solver> prepare;
  Scene scene;  // the input, or the random start of the first seed
  double phi_init = 0.0;
  double phi = 0.0;  // shear

  bool jamming() const { return setup.protocol == kJammingProtocol; }
};

struct ProtocolRecords {
  std::vector<ProtocolStep> steps;
  std::vector<ProtocolRun> runs;
};

ProtocolPlan MakeProtocolPlan() {
  ProtocolPlan plan;
  ProtocolSetup& setup = plan.setup;
  std::string error;
  const auto require = [&error](bool good, const char* flag) {
    if (!good) BadInput(std::string("--") + flag + ": " + error);
  };
  setup.protocol = FLAGS_protocol;
  if (setup.protocol != kJammingProtocol && setup.protocol != kShearProtocol) {
    BadInput("--protocol=" + setup.protocol + " must be jamming or shear");
  }
  const bool jamming = plan.jamming();
  for (const char* flag : kOrdinaryFlags) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag + " cannot go with --protocol");
    }
  }
  for (const char* flag : kJammingFlags) {
    if (!jamming && IsGiven(flag)) {
      BadInput(std::string("--") + flag + " is of --protocol=jamming");
    }
  }
  for (const char* flag : kShearFlags) {
    if (jamming && IsGiven(flag)) {
      BadInput(std::string("--") + flag + " is of --protocol=shear" +
               (std::string(flag) == "phi" ? "; --phi_init is the start of "
                                             "Algorithm 1"
                                           : ""));
    }
  }
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("dphi")) FLAGS_dphi = 5e-3;
    if (!IsGiven("epsilon")) FLAGS_epsilon = 1e-4;
    if (!IsGiven("strain_steps")) FLAGS_strain_steps = 10;
  }
  if (!IsGiven("repetitions")) FLAGS_repetitions = 1;
  if (!IsGiven("max_evaluations")) FLAGS_max_evaluations = kProtocolEvaluations;
  CheckRange("max_seconds", FLAGS_max_seconds, 0.0, 1e300);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 0.0, 9e18);
  CheckRange("repetitions", FLAGS_repetitions, 1.0, 1e6);
  CheckRange("phi_init", FLAGS_phi_init, 0.0, 4.0);
  CheckPositive("dphi", FLAGS_dphi);
  CheckRange("dphi", FLAGS_dphi, 0.0, 1.0);
  CheckPositive("epsilon", FLAGS_epsilon);
  CheckRange("epsilon", FLAGS_epsilon, 0.0, 1.0);
  CheckPositive("strain", FLAGS_strain);
  CheckRange("strain", FLAGS_strain, 0.0, 10.0);
  CheckRange("strain_steps", FLAGS_strain_steps, 1.0, 1e6);
  CheckPositive("phi", FLAGS_phi);

  require(ParseMethods(FLAGS_solvers, &setup.methods, &error), "solvers");
  for (const Method& method : setup.methods) {
    plan.solvers.push_back(MakeSolver("solvers", method.spec));
  }
  plan.prepare = MakeSolver("prepare_solver", FLAGS_prepare_solver);
  if (IsGiven("tolerances")) {
    if (IsGiven("tolerance")) {
      BadInput("--tolerance cannot go with --tolerances");
    }
    require(ParseNumbers(FLAGS_tolerances, &setup.tolerances, &error),
            "tolerances");
  } else {
    CheckPositive("tolerance", FLAGS_tolerance);
    if (jamming && !IsGiven("tolerance")) FLAGS_tolerance = 1e-8;
    setup.tolerances = {FLAGS_tolerance};
  }
  setup.seeds = {FLAGS_seed};
  if (IsGiven("seeds")) {
    require(ParseSeeds(FLAGS_seeds, &setup.seeds, &error), "seeds");
  }
  if (!FLAGS_input.empty() && setup.seeds.size() > 1) {
    BadInput("--seeds are of random starts and cannot go with --input");
  }
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  setup.repetitions = FLAGS_repetitions;
  setup.baseline = IsGiven("baseline")
                       ? LabelOf(setup.methods, "baseline", FLAGS_baseline)
                       : setup.methods[0].label;
  setup.reference = IsGiven("reference")
                        ? LabelOf(setup.methods, "reference", FLAGS_reference)
                        : setup.baseline;
  const bool flat = FLAGS_dimension != 3;
  plan.phi_init = FLAGS_phi_init > 0.0 ? FLAGS_phi_init : flat ? 0.80 : 0.58;
  plan.phi = IsGiven("phi") ? FLAGS_phi : flat ? kShearPhi : kShearPhi3d;
  // A state that close to jamming cannot be told from one at it.
  if (jamming && !IsGiven("zero_pressure")) {
    FLAGS_zero_pressure = 1e-3 * FLAGS_epsilon;
  }
  plan.scene = MakeScene(jamming ? plan.phi_init : plan.phi, setup.seeds[0]);
  const Packing& packing = plan.scene.packing;
  // A wrong dimension would be found late.
  if (jamming && !FLAGS_input.empty() && !IsGiven("phi_init")) {
    plan.phi_init = packing.dimension() == 3 ? 0.58 : 0.80;
  }
  const std::string random = packing.dimension() == 2 ? "discs" : "spheres";
  setup.what = FLAGS_input.empty()
                   ? Format("%d %s", packing.size(), random.c_str())
                   : Describe(packing) + " (" + FLAGS_input + ")";
  setup.what += Format(", alpha = %g", plan.scene.energy.alpha);
  if (jamming) {
    setup.epsilon = FLAGS_epsilon;
    setup.what += Format(", from phi = %s by %s, epsilon = %s",
                         Neat(plan.phi_init).c_str(),
                         Neat(FLAGS_dphi).c_str(),
                         Neat(FLAGS_epsilon).c_str());
  } else {
    setup.strain = FLAGS_strain;
    setup.strain_steps = FLAGS_strain_steps;
    setup.what +=
        Format(", phi = %s, pure shear to %s in %d steps",
               Neat(FLAGS_input.empty() ? plan.phi : packing.PackingFraction())
                   .c_str(),
               Neat(FLAGS_strain).c_str(),
               FLAGS_strain_steps);
  }
  setup.conditions =
      (jamming ? "branches followed by " : "prepared by ") +
      plan.prepare->name() +
      Format("; zero pressure %s", Neat(FLAGS_zero_pressure).c_str());
  if (FLAGS_max_seconds > 0.0) {
    setup.conditions +=
        Format("; at most %s s a relaxation", Neat(FLAGS_max_seconds).c_str());
  }
  if (FLAGS_max_evaluations > 0) {
    setup.conditions += Format("; at most %lld evaluations a relaxation",
                               static_cast<long long>(FLAGS_max_evaluations));
  }
  return plan;
}

// ---------------------------------------------------------------- runs

void AddWork(const Work& part, Work* sum) {
  sum->iterations += part.iterations;
  sum->evaluations += part.evaluations;
  sum->hessians += part.hessians;
  sum->factorizations += part.factorizations;
  sum->solves += part.solves;
  sum->linear_iterations += part.linear_iterations;
  sum->cpu_seconds += part.cpu_seconds;
}

// What one run of a protocol notes down. The time of the notes is not in it.
class Recorder {
 public:
  Recorder(ProtocolRun* run, ProtocolRecords* records)
      : run_(run), records_(records), since_(CpuSeconds()) {}

  // A relaxation has ended; `counted`: it belongs to the protocol.
  void Note(ProtocolStep step, const Relaxation& state, bool counted) {
    const double cpu = CpuSeconds() - since_;
    const Summary& s = state.summary;
    const Observables& o = state.observables;
    step.key = run_->key;
    step.stop_reason = StopReasonName(s.reason);
    step.converged = s.Succeeded();
    step.phi = o.packing_fraction;
    step.residual = o.relative_residual;
    step.energy = o.energy;
    step.pressure = o.pressure;
    step.deviatoric = o.stress_parts.deviatoric;
    step.shear_stress = o.shear_stress;
    step.work = MakeWork(
        s.counters, cpu, s.seconds, s.function_seconds, s.linear_seconds);
    if (counted) {
      AddWork(step.work, &run_->work);
      run_->seconds += s.seconds;
      function_seconds_ += s.function_seconds;
      linear_seconds_ += s.linear_seconds;
      if (run_->seconds > 0.0) {
        run_->work.function_share = function_seconds_ / run_->seconds;
        run_->work.linear_share = linear_seconds_ / run_->seconds;
      }
      ++run_->relaxations;
      run_->gave_up += step.converged ? 0 : 1;
    }
    if (run_->key.repetition == 1) records_->steps.push_back(std::move(step));
    since_ = CpuSeconds();
  }

 private:
  ProtocolRun* const run_;
  ProtocolRecords* const records_;
  double since_;
  double function_seconds_ = 0.0, linear_seconds_ = 0.0;
};

SolveOptions MakeProtocolOptions(double tolerance) {
  SolveOptions options = MakeSolveOptions();
  options.relative_tolerance = tolerance;
  if (FLAGS_max_seconds > 0.0) options.max_seconds = FLAGS_max_seconds;
  if (FLAGS_max_evaluations > 0) {
    options.max_evaluations = FLAGS_max_evaluations;
  }
  return options;
}

// Follows the branch of `jammed` down: branch and phi_j of the run.
void FollowBranch(const ProtocolPlan& plan,
                  const Packing& jammed,
                  ProtocolRun* run) {
  JammingOptions options;
  options.energy = plan.scene.energy;
  options.solve = MakeProtocolOptions(kBranchTolerance);
  options.phi_init = 0.0;  // as it is: jammed, so it is followed at once
  options.accuracy = plan.setup.epsilon;
  options.error_bar = kBranchError * plan.setup.epsilon;
  run->branch = kUnknown;
  run->phi_j = kNan;
  double least = kNan;
  bool lost = false, unjammed = false;
  const auto observer = [&](const JammingStep& step) {
    if (step.stage == JammingStage::GROWTH) {
      lost = true;  // what follows is another branch
      return false;
    }
    if (step.verdict == JammingVerdict::JAMMED) {
      least = step.phi;
    } else if (step.stage == JammingStage::START &&
               step.verdict == JammingVerdict::UNJAMMED) {
      unjammed = true;
      return false;
    }
    return true;
  };
  JammingResult result;
  std::string error;
  const bool found =
      FindJamming(jammed, options, *plan.prepare, observer, &result, &error);
  if (lost) {
    run->branch = kLost;
    run->phi_j = least;
  } else if (found) {
    run->branch = kFollowed;
    run->phi_j = result.phi_j;
  } else if (unjammed) {
    run->branch = kSpurious;
  }
}

void Jam(const ProtocolPlan& plan,
         const Packing& start,
         const Solver& solver,
         const SolveOptions& solve,
         ProtocolRun* run,
         ProtocolRecords* records) {
  JammingOptions options;
  options.energy = plan.scene.energy;
  options.solve = solve;
  options.phi_init = plan.phi_init;
  options.phi_increment = FLAGS_dphi;
  options.accuracy = plan.setup.epsilon;
  options.error_bar = std::numeric_limits<double>::infinity();
  // The last jammed state of growth and bisection, which is what the published
  // algorithm returns whether or not p' can be measured on it.
  Relaxation jammed;
  double phi_jammed = 0.0, phi_unjammed = 0.0;
  int count = 0;
  Recorder recorder(run, records);
  const auto observer = [&](const JammingStep& step) {
    const bool counted = step.stage != JammingStage::DECOMPRESSION;
    ProtocolStep row;
    row.step = ++count;
    row.stage = JammingStageName(step.stage);
    row.verdict = JammingVerdictName(step.verdict);
    recorder.Note(std::move(row), *step.result, counted);
    if (!counted) return true;
    switch (step.verdict) {
      case JammingVerdict::JAMMED:
        jammed = *step.result;
        phi_jammed = step.phi;
        break;
      case JammingVerdict::UNJAMMED:
        phi_unjammed = step.phi;
        break;
      case JammingVerdict::UNDECIDED:
        ++run->undecided;
        break;
    }
    return true;
  };
  JammingResult result;
  std::string error;
  const bool found =
      FindJamming(start, options, solver, observer, &result, &error);
  // A start that is jammed has no bracket.
  run->finished = phi_jammed > 0.0 && phi_unjammed > 0.0 &&
                  phi_jammed - phi_unjammed <= plan.setup.epsilon;
  run->branch = kUnknown;
  run->phi_j = run->distance = kNan;
  if (!run->finished) {
    run->message = found ? "no bracket" : error;
    return;
  }
  const Observables& o = jammed.observables;
  run->phi_cr = phi_jammed;
  run->phi_unjammed = phi_unjammed;
  run->energy = o.energy;
  run->pressure = o.pressure;
  run->contacts_excess = o.rigid_contacts - o.isostatic_contacts;
  run->rattlers = o.rattlers;
  if (found) run->distance = result.distance;
  FollowBranch(plan, jammed.packing, run);
}

void ShearOnce(const ProtocolPlan& plan,
               const Packing& start,
               const Solver& solver,
               const SolveOptions& solve,
               ProtocolRun* run,
               ProtocolRecords* records) {
  QuasistaticShearOptions options;
  options.energy = plan.scene.energy;
  options.solve = solve;
  options.strain = plan.setup.strain;
  options.steps = plan.setup.strain_steps;
  Recorder recorder(run, records);
  const auto observer = [&](const QuasistaticShearStep& step) {
    ProtocolStep row;
    row.step = step.step;
    row.stage = kShearProtocol;
    row.strain = step.strain;
    row.work_done = step.work;
    row.dissipated = step.dissipated;
    recorder.Note(std::move(row), *step.result, step.step > 0);
    return true;
  };
  QuasistaticShearResult result;
  std::string error;
  run->branch = "-";
  run->finished =
      ShearQuasistatically(start, options, solver, observer, &result, &error);
  if (!run->finished) {
    run->message = error;
    return;
  }
  // A curve with states that are not minima is not the one asked for.
  if (result.gave_up > 0) {
    run->finished = false;
    run->message = Format("%d of %d relaxations gave up, the last step: ",
                          result.gave_up,
                          result.relaxations) +
                   result.last.summary.message;
  }
  const Observables& o = result.last.observables;
  run->strain = result.strain;
  run->energy = o.energy;
  run->pressure = o.pressure;
  run->deviatoric = o.stress_parts.deviatoric;
  run->shear_stress = o.shear_stress;
  run->rattlers = o.rattlers;
  run->contacts_excess = o.rigid_contacts - o.isostatic_contacts;
}

using Place = std::tuple<double, std::uint64_t, int, std::string>;
Place PlaceOf(const ProtocolKey& key) {
  return {key.tolerance, key.seed, key.repetition, key.label};
}

void RunProtocols(const ProtocolPlan& plan,
                  const std::vector<Packing>& starts,
                  Output* output,
                  ProtocolRecords* records) {
  const ProtocolSetup& setup = plan.setup;
  std::set<Place> done;
  for (const ProtocolRun& run : records->runs) done.insert(PlaceOf(run.key));
  const int methods = static_cast<int>(setup.methods.size());
  const int all = methods * static_cast<int>(setup.tolerances.size()) *
                  static_cast<int>(setup.seeds.size()) * setup.repetitions;
  const double began = WallSeconds();
  int count = 0, fresh = 0;
  Progress progress;
  const auto run_one = [&](const ProtocolKey& key,
                           int position,
                           const Packing& start,
                           const Solver& solver) {
    ProtocolRun run;
    run.key = key;
    run.position = position;
    SolveOptions solve = MakeProtocolOptions(key.tolerance);
    solve.callback = [&](const IterationState& state) {
      if (progress.Due()) {
        progress.Show(Format(
            "run %d of %d, %.0f s gone%s | %s, tolerance %s, seed %llu, "
            "relaxation %d, iteration %lld: |g| / mean force %.1e",
            count + 1,
            all,
            WallSeconds() - began,
            fresh > 0 ? Format(", about %.0f s left",
                               (WallSeconds() - began) / fresh * (all - count))
                            .c_str()
                      : "",
            key.label.c_str(),
            Neat(key.tolerance).c_str(),
            static_cast<unsigned long long>(key.seed),
            run.relaxations + 1,
            static_cast<long long>(state.counters.iterations),
            state.scales.gradient > 0.0
                ? state.max_gradient / state.scales.gradient
                : 0.0));
      }
      return true;
    };
    if (plan.jamming())
      Jam(plan, start, solver, solve, &run, records);
    else
      ShearOnce(plan, start, solver, solve, &run, records);
    records->runs.push_back(run);
    ++fresh;
    // Runs last: what they name is in the other file.
    output->Write("protocol_steps.csv", ProtocolStepsCsv(records->steps));
    output->Write("protocol_runs.csv", ProtocolRunsCsv(records->runs));
  };
  for (int r = 0; r < setup.repetitions; ++r) {
    for (std::size_t t = 0; t < setup.tolerances.size(); ++t) {
      for (std::size_t s = 0; s < setup.seeds.size(); ++s) {
        int position = 0;
        // Another order in each block.
        const int turn = r + static_cast<int>(t * setup.seeds.size() + s);
        for (const int m : MethodOrder(methods, turn)) {
          const Method& method = setup.methods[m];
          const ProtocolKey key = {setup.tolerances[t],
                                   setup.seeds[s],
                                   r + 1,
                                   method.label,
                                   method.spec};
          ++position;
          if (done.count(PlaceOf(key)) == 0) {
            run_one(key, position, starts[s], *plan.solvers[m]);
          }
          ++count;
        }
      }
    }
  }
  output->Write("protocol_steps.csv", ProtocolStepsCsv(records->steps));
  output->Write("protocol_runs.csv", ProtocolRunsCsv(records->runs));
}

// ---------------------------------------------------------------- reports

// The raw files in `data`.
ProtocolRecords ReadProtocolRecords(const std::string& data) {
  ProtocolRecords records;
  std::string text, error;
  const std::string steps = data + "/protocol_steps.csv",
                    runs = data + "/protocol_runs.csv";
  if (!ReadFile(steps, &text, &error) ||
      !ParseProtocolSteps(text, steps, &records.steps, &error) ||
      !ReadFile(runs, &text, &error) ||
      !ParseProtocolRuns(text, runs, &records.runs, &error)) {
    BadInput(error);
  }
  return records;
}

void ReportProtocols(const ProtocolSetup& setup,
                     const std::string& data,
                     const ProtocolRecords& records,
                     Output* output) {
  output->Write("protocol_tables.csv",
                ProtocolTablesCsv(TabulateProtocols(setup, records.runs)));
  std::vector<std::string> arguments = {
      "protocol", setup.protocol, data, output->Path("protocol")};
  if (setup.protocol == kJammingProtocol) {
    output->Write("jamming_table.csv",
                  JammingTableCsv(TabulateJamming(setup, records.runs)));
    arguments.push_back("--epsilon=" + Neat(setup.epsilon));
  } else {
    output->Write("shear_table.csv",
                  ShearTableCsv(TabulateShear(setup, records.steps)));
    arguments.push_back("--reference=" + setup.reference);
  }
  output->Write("tables.md",
                ProtocolText(setup, records.steps, records.runs, true));
  std::fputs(ProtocolText(setup, records.steps, records.runs, false).c_str(),
             stdout);
  WriteProfiles(MakeProtocolProfiles(setup, records.steps, records.runs),
                output);
  output->Plot(arguments, {"protocol.svg", "protocol.png"});
  int finished = 0;
  for (const ProtocolRun& run : records.runs) finished += run.finished ? 1 : 0;
  std::printf(
      "\n%d of %zu protocols finished\n", finished, records.runs.size());
}

Json SummaryJson(const ProtocolPlan& plan, const ProtocolRecords& records) {
  int finished = 0;
  for (const ProtocolRun& run : records.runs) finished += run.finished ? 1 : 0;
  Json json;
  json["protocol"] = plan.setup.protocol;
  json["converged"] = finished == static_cast<int>(records.runs.size());
  json["runs"] = records.runs.size();
  json["runs_finished"] = finished;
  json["alpha"] = plan.scene.energy.alpha;
  json["k"] = plan.scene.energy.stiffness;
  json["dimension"] = plan.scene.packing.dimension();
  json["particles"] = plan.scene.packing.size();
  json["prepare_solver"] = plan.prepare->name();
  json["rows"] = Json::array();
  for (const ProtocolRow& row : TabulateProtocols(plan.setup, records.runs)) {
    // Infinite (never finished) is null in JSON.
    json["rows"].push_back({{"solver", row.method.label},
                            {"tolerance", row.tolerance},
                            {"runs", row.runs},
                            {"finished", row.finished},
                            {"relaxations", row.relaxations.median},
                            {"iterations", row.iterations.median},
                            {"evaluations", row.evaluations.median},
                            {"factorizations", row.factorizations.median},
                            {"cpu_seconds", row.cpu_seconds.median},
                            {"ratio", row.ratio.median}});
  }
  json["setup"] = Json::parse(FormatProtocolSetup(plan.setup));
  json["schema"] = "granopt/compare-protocol/1";
  json["provenance"] = Provenance();
  return json;
}

// What an interrupted comparison has left: whole protocols. False if nothing;
// BadInput if it was another comparison.
bool ReadInterrupted(const ProtocolPlan& plan, ProtocolRecords* records) {
  const std::string setup = FLAGS_out + "/setup.json";
  std::string text, error;
  if (!Exists(setup)) return false;
  if (!ReadFile(setup, &text, &error)) BadInput("--resume: " + error);
  if (text != FormatProtocolSetup(plan.setup)) {
    BadInput("--resume: " + setup +
             " is of a comparison with other flags; give the same ones, or "
             "another --out");
  }
  if (!Exists(FLAGS_out + "/protocol_runs.csv")) return true;
  *records = ReadProtocolRecords(FLAGS_out);
  // Steps of a run that is not there will come again.
  std::set<Place> whole;
  for (const ProtocolRun& run : records->runs) whole.insert(PlaceOf(run.key));
  std::vector<ProtocolStep>& steps = records->steps;
  steps.erase(std::remove_if(steps.begin(),
                             steps.end(),
                             [&whole](const ProtocolStep& step) {
                               return whole.count(PlaceOf(step.key)) == 0;
                             }),
              steps.end());
  return true;
}

void PrintPlan(const ProtocolPlan& plan) {
  const ProtocolSetup& setup = plan.setup;
  std::printf("compare   %s: %s\n", setup.protocol.c_str(), setup.what.c_str());
  const char* head = "methods";
  for (const Method& method : setup.methods) {
    std::printf("%-9s %s%s%s\n",
                head,
                method.label.c_str(),
                method.label == method.spec ? "" : ("  " + method.spec).c_str(),
                method.label == setup.baseline ? "  (baseline)" : "");
    head = "";
  }
  std::string tolerances;
  for (const double tolerance : setup.tolerances) {
    tolerances += (tolerances.empty() ? "" : ", ") + Neat(tolerance);
  }
  std::printf(
      "runs      %zu: %zu methods x tolerances %s x %zu seeds x %d "
      "repetitions; each a whole protocol\n",
      setup.methods.size() * setup.tolerances.size() * setup.seeds.size() *
          setup.repetitions,
      setup.methods.size(),
      tolerances.c_str(),
      setup.seeds.size(),
      setup.repetitions);
  std::fflush(stdout);
}

}  // namespace

std::vector<std::string> ProtocolFiles(bool raw) {
  std::vector<std::string> names = {"protocol_tables.csv",
                                    "jamming_table.csv",
                                    "shear_table.csv",
                                    "protocol.svg",
                                    "protocol.png"};
  if (raw) {
    names.insert(names.end(), {"protocol_steps.csv", "protocol_runs.csv"});
  }
  return names;
}

int CompareProtocols() {
  const ProtocolPlan plan = MakeProtocolPlan();
  ProtocolRecords records;
  const bool resumed = FLAGS_resume && ReadInterrupted(plan, &records);
  std::vector<std::string> names = ProtocolFiles(/*raw=*/!resumed);
  for (const std::string& name : ComparisonFiles(/*raw=*/!resumed)) {
    names.push_back(name);
  }
  Output output;
  output.Create(FLAGS_out, names);
  PrintPlan(plan);
  output.Write("setup.json", FormatProtocolSetup(plan.setup));
  std::vector<Packing> starts;
  if (plan.jamming()) {
    for (const std::uint64_t seed : plan.setup.seeds) {
      starts.push_back(MakeScene(plan.phi_init, seed).packing);
    }
  } else {
    Preparation preparation(plan.scene, *plan.prepare, plan.phi, &output);
    for (const std::uint64_t seed : plan.setup.seeds) {
      starts.push_back(preparation.Relaxed(seed));
    }
    preparation.ClearProgress();
    const char* head = "prepared";
    for (const std::string& line : preparation.lines()) {
      std::printf("%-9s %s\n", head, line.c_str());
      head = "";
    }
    std::fflush(stdout);
  }
  if (resumed) {
    std::printf("resumed   %zu protocols were there\n", records.runs.size());
    std::fflush(stdout);
  }
  RunProtocols(plan, starts, &output, &records);
  // As they were written.
  records = ReadProtocolRecords(output.folder());
  ReportProtocols(plan.setup, output.folder(), records, &output);
  const Json json = SummaryJson(plan, records);
  output.WriteJson("summary.json", json);
  output.PrintFiles();
  return json["converged"].get<bool>() ? kConverged : kNotConverged;
}

int ReplotProtocols(const std::string& data, const std::string& text) {
  ProtocolSetup setup;
  std::string error;
  if (!ParseProtocolSetup(text, data + "/setup.json", &setup, &error)) {
    BadInput("--replot: " + error);
  }
  if (IsGiven("protocol") && FLAGS_protocol != setup.protocol) {
    BadInput("--replot: " + data + " is of --protocol=" + setup.protocol);
  }
  for (const char* flag : {"tolerance", "absolute_tolerance"}) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag +
               " cannot go with --replot of a protocol");
    }
  }
  if (IsGiven("baseline")) {
    setup.baseline = LabelOf(setup.methods, "baseline", FLAGS_baseline);
  }
  if (IsGiven("reference")) {
    setup.reference = LabelOf(setup.methods, "reference", FLAGS_reference);
  }
  const ProtocolRecords records = ReadProtocolRecords(data);
  std::vector<std::string> names = ProtocolFiles(/*raw=*/false);
  for (const std::string& name : ComparisonFiles(/*raw=*/false)) {
    if (name != "summary.json") names.push_back(name);
  }
  Output output;
  output.Create(IsGiven("out") ? FLAGS_out : data, names);
  std::printf("compare   tables and figures of %s again\n", data.c_str());
  ReportProtocols(setup, data, records, &output);
  output.PrintFiles();
  return kConverged;
}

}  // namespace granopt
