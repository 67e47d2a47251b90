#include "experiments/compare_protocol_runs.h"

#include <cstddef>
#include <cstdio>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "experiments/compare_flags.h"
#include "experiments/tabular.h"
#include "granular/jamming.h"
#include "granular/quasistatic_shear.h"

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The branch below a jammed state is followed to this part of epsilon, with
// relaxations to this many mean forces.
constexpr double kBranchError = 1e-2;
constexpr double kBranchTolerance = 1e-8;

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
  SetLimits(&options);
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

}  // namespace

void RunProtocols(const ProtocolPlan& plan,
                  const std::vector<Packing>& starts,
                  Output* output,
                  ProtocolRecords* records) {
  const ProtocolSetup& setup = plan.setup;
  std::set<ProtocolPlace> done;
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
    output->Write("protocol_steps.csv", FormatCsv(records->steps));
    output->Write("protocol_runs.csv", FormatCsv(records->runs));
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
  output->Write("protocol_steps.csv", FormatCsv(records->steps));
  output->Write("protocol_runs.csv", FormatCsv(records->runs));
}

}  // namespace granopt
