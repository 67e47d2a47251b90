#include "experiments/compare_runs.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "experiments/compare_flags.h"
#include "experiments/crossings.h"
#include "experiments/minima.h"
#include "granular/quad_residual.h"
#include "granular/relaxation.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

constexpr int kCurveBuckets = 95;

struct Records {
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  std::vector<CurveRow> curves;
  std::map<Place, Minima> minima;
  // --resume: energy and minimum of runs whose ends are no longer known.
  std::map<std::pair<Place, std::string>, std::pair<double, std::string>> ends;
};

// The minimum that a run ended in. Repetitions end where the first did.
std::string MinimumOf(const RunKey& key,
                      const Start& start,
                      const Observables& o,
                      double residual,
                      double vanishing,
                      const std::vector<double>& displacements,
                      Records* records) {
  const auto known = records->ends.find({PlaceOf(key), key.label});
  if (known != records->ends.end() && known->second.first == o.energy) {
    return known->second.second;
  }
  const auto [found, is_new] =
      records->minima.try_emplace(PlaceOf(key), Minima());
  if (is_new) {
    // The state as prepared is the first one.
    if (start.step != nullptr) {
      const ShearStep& step = *start.step;
      found->second.Tag(step.energy,
                        step.residual,
                        step.vanishing,
                        step.mean_overlap,
                        step.displacements,
                        step.is_rattler);
    }
    std::set<std::string> letters;
    for (const auto& [place, end] : records->ends) {
      if (place.first == PlaceOf(key)) letters.insert(end.second);
    }
    if (!letters.empty()) {
      found->second.Reserve(static_cast<int>(letters.size()) + 1);
    }
  }
  return found->second.Tag(o.energy,
                           residual,
                           vanishing,
                           o.mean_overlap,
                           displacements,
                           o.is_rattler);
}

// CPU seconds at a wall time, linear between the moments when both were read.
double Interpolate(const std::vector<std::pair<double, double>>& knots,
                   double wall) {
  const auto above = std::lower_bound(
      knots.begin() + 1, knots.end() - 1, std::make_pair(wall, 0.0));
  const auto& [w1, c1] = *above;
  const auto& [w0, c0] = *(above - 1);
  if (!(w1 > w0)) return c1;
  return c0 + (c1 - c0) * std::min(1.0, (wall - w0) / (w1 - w0));
}

// d N entries, grain by grain.
std::vector<double> Moved(const Packing& start, const Packing& end) {
  const int d = end.dimension();
  std::vector<double> displacements(static_cast<std::size_t>(d) * end.size());
  for (int i = 0; i < end.size(); ++i) {
    for (int k = 0; k < d; ++k) {
      const DoubleDouble a = end.Position(i, k), b = start.Position(i, k);
      displacements[d * i + k] = (a.hi - b.hi) + (a.lo - b.lo);
    }
  }
  return displacements;
}

void AddCurve(const RunKey& key,
              const std::vector<TraceRow>& trace,
              const std::vector<std::pair<double, double>>& knots,
              double unit,
              std::vector<CurveRow>* curves) {
  std::vector<double> residuals;
  for (const TraceRow& row : trace) residuals.push_back(row.max_gradient);
  for (const int k : ThinTrace(residuals, kCurveBuckets)) {
    const TraceRow& row = trace[k];
    curves->push_back(
        {key.case_id,
         key.seed,
         key.label,
         row.iteration,
         row.evaluations,
         Interpolate(knots, row.seconds),
         row.gradient_scale > 0.0 ? row.max_gradient / row.gradient_scale : 0.0,
         row.max_gradient / unit,
         row.cost});
  }
}

void RunOne(const RunKey& key,
            int position,
            const Start& start,
            const ContactEnergyOptions& law,
            const Solver& solver,
            const ComparisonSetup& setup,
            const std::function<void(const IterationState&)>& show,
            Records* records) {
  const double unit = ForceUnit(start.packing, law);
  SolveOptions options = MakeSolveOptions();
  if (setup.levels[0].absolute) {
    options.absolute_tolerance = setup.levels[0].value * unit;
  } else {
    options.relative_tolerance = setup.levels[0].value;
  }
  SetLimits(&options);
  // Repetitions differ by their times only; of a chain the first step will do.
  const bool curve = key.repetition == 1 && key.step == 1;
  options.record_trace = curve;

  std::string error;
  const auto energy = ContactEnergy::Create(start.packing, law, &error);
  if (energy == nullptr) BadInput(key.case_id + ": " + error);
  std::vector<double> u(energy->NumParameters(), 0.0);

  Crossings crossings(Ladder(setup.levels), unit);
  std::vector<std::pair<double, double>> knots = {{0.0, 0.0}};
  double begin = 0.0;
  options.callback = [&](const IterationState& state) {
    if (crossings.Due(state.max_gradient, state.scales.gradient)) {
      const double cpu = CpuSeconds() - begin;
      crossings.Note(key,
                     state.max_gradient,
                     state.scales.gradient,
                     MakeWork(state.counters,
                              cpu,
                              state.seconds,
                              state.function_seconds,
                              state.linear_seconds),
                     state.cost,
                     &records->events);
      knots.push_back({state.seconds, cpu});
    }
    show(state);
    return true;
  };
  // Else who comes second in a block would pay less.
  SparseCholesky::ForgetAnalysis();
  begin = CpuSeconds();
  Summary summary = solver.Minimize(energy.get(), options, u.data());
  const double cpu = CpuSeconds() - begin;
  knots.push_back({summary.seconds, cpu});
  const Work work = MakeWork(summary.counters,
                             cpu,
                             summary.seconds,
                             summary.function_seconds,
                             summary.linear_seconds);
  // The iterate that meets the tolerance is not shown to the callback.
  crossings.Note(key,
                 summary.max_gradient,
                 summary.scales.gradient,
                 work,
                 summary.cost,
                 &records->events);

  const std::vector<double> displacements =
      Moved(start.packing, energy->Configuration(u.data()));
  const Relaxation result =
      Conclude(std::move(summary), u.data(), energy.get());
  const Summary& s = result.summary;
  const Observables& o = result.observables;
  QuadResidual judge;
  if (!EvaluateQuad(result.packing, law, nullptr, &judge, &error)) {
    BadInput(key.case_id + ": " + error);
  }
  RunRecord run;
  run.key = key;
  run.position = position;
  run.converged = s.Succeeded();
  run.stop_reason = StopReasonName(s.reason);
  run.message = s.message;
  run.residual =
      s.scales.gradient > 0.0 ? s.max_gradient / s.scales.gradient : 0.0;
  run.quad_residual = judge.Relative();
  run.quad_max_gradient = judge.max_gradient / unit;
  run.energy = o.energy;
  run.pressure = o.pressure;
  run.phi = o.packing_fraction;
  run.rattlers = o.rattlers;
  run.minimum = MinimumOf(key,
                          start,
                          o,
                          judge.Relative(),
                          s.scales.vanishing,
                          displacements,
                          records);
  run.distance = start.distance;
  run.list_builds = result.list_builds;
  run.restarts = s.counters.restarts;
  run.recenters = s.counters.recenters;
  run.rebases = s.counters.rebases;
  run.work = work;
  run.seconds = s.seconds;
  records->runs.push_back(run);

  if (curve) AddCurve(key, s.trace, knots, unit, &records->curves);
}

// Seconds that the runs from `done` on will take, from those before.
class Estimate {
 public:
  // `starts`: all that will be run.
  Estimate(const Plan& plan, const Starts& starts)
      : plan_(plan), starts_(starts) {}

  void Add(const Place& place, int method, double seconds) {
    known_[{place, method}] = seconds;
    auto& [sum, count] = by_method_[method];
    sum += seconds;
    ++count;
    total_ += seconds;
    ++done_;
  }

  double Left() const {
    const std::size_t instances = starts_.size() * plan_.solvers.size();
    if (known_.size() == instances) {
      return total_ / done_ * (Runs() - done_);
    }
    // The first repetition: a method is as slow in other cases as so far.
    double left = -total_;
    for (const auto& [place, start] : starts_) {
      for (int m = 0; m < static_cast<int>(plan_.solvers.size()); ++m) {
        const auto found = known_.find({place, m});
        const auto method = by_method_.find(m);
        left += plan_.setup.repetitions *
                (found != known_.end() ? found->second
                 : method != by_method_.end()
                     ? method->second.first / method->second.second
                     : total_ / done_);
      }
    }
    return left;
  }

  int done() const { return done_; }
  int Runs() const {
    return static_cast<int>(starts_.size() * plan_.solvers.size()) *
           plan_.setup.repetitions;
  }

 private:
  const Plan& plan_;
  const Starts& starts_;
  std::map<std::pair<Place, int>, double> known_;
  std::map<int, std::pair<double, int>> by_method_;
  double total_ = 0.0;
  int done_ = 0;
};

// Takes up what an interrupted comparison has left in `raw`: blocks (repetition
// and packing) in which every method has run. What else is there is run again.
void TakeUp(const Plan& plan, RawRecords raw, Records* records) {
  using Block = std::pair<Place, int>;
  std::map<Block, std::size_t> size;
  for (const RunRecord& run : raw.runs) {
    ++size[{PlaceOf(run.key), run.key.repetition}];
  }
  const auto complete = [&](const RunKey& key) {
    return size[{PlaceOf(key), key.repetition}] == plan.solvers.size();
  };
  for (Event& event : raw.events) {
    if (complete(event.key)) records->events.push_back(std::move(event));
  }
  for (RunRecord& run : raw.runs) {
    if (!complete(run.key)) continue;
    records->ends[{PlaceOf(run.key), run.key.label}] = {run.energy,
                                                        run.minimum};
    records->runs.push_back(std::move(run));
  }
  for (CurveRow& row : raw.curves) {
    if (size[{Place(row.case_id, row.seed, 1), 1}] == plan.solvers.size()) {
      records->curves.push_back(std::move(row));
    }
  }
}

}  // namespace

std::vector<RunRecord> RunAll(const Plan& plan,
                              const Starts& starts,
                              RawRecords before,
                              Output* output) {
  const ComparisonSetup& setup = plan.setup;
  Records records;
  TakeUp(plan, std::move(before), &records);
  if (FLAGS_resume) {
    std::printf("resumed   %zu runs were there\n", records.runs.size());
    std::fflush(stdout);
  }
  Progress progress;
  Estimate estimate(plan, starts);
  const double began = WallSeconds();
  double written = began;
  // Runs last: what they name is in the other two files.
  const auto write = [&] {
    output->Write("events.csv", FormatCsv(records.events));
    output->Write("curves.csv", FormatCsv(records.curves));
    output->Write("runs.csv", FormatCsv(records.runs));
  };
  std::set<std::pair<Place, int>> done;
  for (const RunRecord& run : records.runs) {
    done.insert({PlaceOf(run.key), run.key.repetition});
    for (int m = 0; m < static_cast<int>(plan.solvers.size()); ++m) {
      if (setup.methods[m].label == run.key.label) {
        estimate.Add(PlaceOf(run.key), m, run.seconds);
      }
    }
  }
  const auto run_block = [&](const Place& place, int r) {
    const auto& [id, seed, step] = place;
    int position = 0;
    for (const int m :
         MethodOrder(static_cast<int>(plan.solvers.size()), r + step - 1)) {
      const Method& method = setup.methods[m];
      const double run_began = WallSeconds();
      const std::string what =
          id + (setup.steps > 1 ? Format(", step %d", step) : "");
      const auto show = [&](const IterationState& state) {
        if (!progress.Due()) return;
        progress.Show(
            Format("run %d of %d, %.0f s gone%s | %s, %s, iteration %lld: "
                   "|g| / mean force %.1e",
                   estimate.done() + 1,
                   estimate.Runs(),
                   WallSeconds() - began,
                   estimate.done() > 0
                       ? Format(", about %.0f s left", estimate.Left()).c_str()
                       : "",
                   what.c_str(),
                   method.label.c_str(),
                   static_cast<long long>(state.counters.iterations),
                   state.scales.gradient > 0.0
                       ? state.max_gradient / state.scales.gradient
                       : 0.0));
      };
      RunOne({id, seed, r + 1, method.label, method.spec, step},
             ++position,
             starts.at(place),
             plan.scene.energy,
             *plan.solvers[m],
             setup,
             show,
             &records);
      estimate.Add(place, m, WallSeconds() - run_began);
    }
  };
  for (int r = 0; r < setup.repetitions; ++r) {
    for (const Case& c : setup.cases) {
      for (const std::uint64_t seed : SeedsOf(setup, c)) {
        for (int step = 1; step <= setup.steps; ++step) {
          const Place place(c.id, seed, step);
          // A chain may end early, other cases have one step.
          if (starts.count(place) == 0 || done.count({place, r + 1}) > 0) {
            continue;
          }
          run_block(place, r);
          // What is on disk is never old, and of whole blocks.
          const double now = WallSeconds();
          if (now - written > 10.0) {
            write();
            written = now;
          }
        }
      }
    }
  }
  write();
  return std::move(records.runs);
}

}  // namespace granopt
