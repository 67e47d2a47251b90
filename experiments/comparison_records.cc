#include "experiments/comparison_records.h"

#include <limits>

#include "experiments/statistics.h"
#include "solvers/format.h"

namespace granopt {
namespace {

void Columns(RunKey* key, CsvColumns* columns) {
  columns->Add("case", &key->case_id);
  columns->Add("seed", &key->seed);
  // Files of comparisons without chains may lack it.
  const CsvReader* reader = columns->reader();
  if (reader == nullptr || reader->Has("step")) {
    columns->Add("step", &key->step);
  }
  columns->Add("repetition", &key->repetition);
  columns->Add("solver", &key->label);
  columns->Add("spec", &key->spec);
}

std::string Share(double value) { return Format("%.4f", value); }

}  // namespace

Work MakeWork(const Counters& counters,
              double cpu_seconds,
              double seconds,
              double function_seconds,
              double linear_seconds) {
  Work work;
  work.iterations = counters.iterations;
  work.evaluations = counters.evaluations;
  work.hessians = counters.hessians;
  work.factorizations = counters.factorizations;
  work.solves = counters.solves;
  work.linear_iterations = counters.linear_iterations;
  work.cpu_seconds = cpu_seconds;
  if (seconds > 0.0) {
    work.function_share = function_seconds / seconds;
    work.linear_share = linear_seconds / seconds;
  }
  return work;
}

void Columns(Work* work, CsvColumns* columns) {
  columns->Add("iterations", &work->iterations);
  columns->Add("evaluations", &work->evaluations);
  columns->Add("hessians", &work->hessians);
  columns->Add("factorizations", &work->factorizations);
  columns->Add("solves", &work->solves);
  columns->Add("linear_iterations", &work->linear_iterations);
  columns->Add("cpu_seconds", &work->cpu_seconds, 9);
  columns->Add("function_share", &work->function_share, Share);
  columns->Add("linear_share", &work->linear_share, Share);
}

Costs<double> CostsOf(const Work& work) {
  return {static_cast<double>(work.iterations),
          static_cast<double>(work.evaluations),
          static_cast<double>(work.hessians),
          static_cast<double>(work.factorizations),
          static_cast<double>(work.solves),
          static_cast<double>(work.linear_iterations),
          work.cpu_seconds};
}

Costs<double> InfiniteCosts() {
  Costs<double> costs;
  costs.fill(std::numeric_limits<double>::infinity());
  return costs;
}

void Append(const Costs<double>& costs, Costs<std::vector<double>>* columns) {
  for (int k = 0; k < kCosts; ++k) (*columns)[k].push_back(costs[k]);
}

void Columns(Event* event, CsvColumns* columns) {
  Columns(&event->key, columns);
  std::string kind = KindOf(event->level);
  columns->Add("kind", &kind);
  if (kind != "absolute" && kind != "relative") {
    columns->reader()->Complain("kind '" + kind +
                                "' is neither absolute nor relative");
  }
  event->level.absolute = kind == "absolute";
  columns->Add("level", &event->level.value, Neat);
  Columns(&event->work, columns);
  columns->Add("energy", &event->energy);
}

void Columns(RunRecord* run, CsvColumns* columns) {
  Columns(&run->key, columns);
  columns->Add("position", &run->position);
  columns->Add("converged", &run->converged);
  columns->Add("stop_reason", &run->stop_reason);
  columns->Add("message", &run->message);
  columns->Add("residual", &run->residual);
  columns->Add("quad_residual", &run->quad_residual);
  columns->Add("quad_max_gradient", &run->quad_max_gradient);
  columns->Add("energy", &run->energy);
  columns->Add("pressure", &run->pressure);
  columns->Add("phi", &run->phi);
  columns->Add("rattlers", &run->rattlers);
  columns->Add("minimum", &run->minimum);
  columns->Add("distance", &run->distance);
  columns->Add("list_builds", &run->list_builds);
  columns->Add("restarts", &run->restarts);
  columns->Add("recenters", &run->recenters);
  columns->Add("rebases", &run->rebases);
  Columns(&run->work, columns);
  columns->Add("seconds", &run->seconds, 9);
}

void Columns(CurveRow* row, CsvColumns* columns) {
  columns->Add("case", &row->case_id);
  columns->Add("seed", &row->seed);
  columns->Add("solver", &row->label);
  columns->Add("iteration", &row->iteration);
  columns->Add("evaluations", &row->evaluations);
  columns->Add("cpu_seconds", &row->cpu_seconds, 7);
  columns->Add("residual", &row->residual, 7);
  columns->Add("max_gradient", &row->max_gradient, 7);
  columns->Add("energy", &row->energy);
}

void Columns(StepRecord* step, CsvColumns* columns) {
  columns->Add("case", &step->case_id);
  columns->Add("seed", &step->seed);
  columns->Add("step", &step->step);
  columns->Add("strain", &step->strain);
  columns->Add("kind", &step->kind);
  columns->Add("apart", &step->apart);
  columns->Add("contacts", &step->contacts);
  columns->Add("contacts_changed", &step->contacts_changed);
  columns->Add("energy", &step->energy);
  columns->Add("half_energy", &step->half_energy);
  columns->Add("residual", &step->residual);
  columns->Add("half_residual", &step->half_residual);
  columns->Add("pressure", &step->pressure);
  columns->Add("minimum", &step->minimum);
  if (columns->reader() == nullptr) return;
  for (const char* kind : kStepKinds) {
    if (step->kind == kind) return;
  }
  columns->reader()->Complain("kind '" + step->kind + "' is not known");
}

Place PlaceOf(const RunKey& key) { return {key.case_id, key.seed, key.step}; }
Place PlaceOf(const StepRecord& step) {
  return {step.case_id, step.seed, step.step};
}

std::map<Place, const StepRecord*> StepIndex(
    const std::vector<StepRecord>& steps) {
  std::map<Place, const StepRecord*> index;
  for (const StepRecord& step : steps) index[PlaceOf(step)] = &step;
  return index;
}

double MedianDistance(const std::vector<RunRecord>& runs,
                      const std::string& case_id) {
  std::vector<double> distances;
  for (const RunRecord& run : runs) {
    if (run.key.case_id == case_id) distances.push_back(run.distance);
  }
  return distances.empty() ? 0.0 : MedianOf(distances);
}

RunIndex::RunIndex(const std::vector<Event>& events,
                   const std::vector<RunRecord>& runs) {
  const auto place_of = [](const RunKey& key) {
    return RunPlace(PlaceOf(key), key.label, key.repetition);
  };
  for (const RunRecord& run : runs) runs_[place_of(run.key)] = &run;
  for (const Event& event : events) {
    events_[{place_of(event.key), event.level.absolute, event.level.value}] =
        &event;
  }
}

const RunRecord* RunIndex::Find(const Place& place,
                                const std::string& label,
                                int repetition) const {
  const auto found = runs_.find({place, label, repetition});
  return found == runs_.end() ? nullptr : found->second;
}

const Work* RunIndex::Reached(const RunRecord& run, const Level& level) const {
  const RunKey& key = run.key;
  const auto found =
      events_.find({RunPlace(PlaceOf(key), key.label, key.repetition),
                    level.absolute,
                    level.value});
  if (found != events_.end()) return &found->second->work;
  return run.stop_reason == StopReasonName(StopReason::VANISHED) ? &run.work
                                                                 : nullptr;
}

}  // namespace granopt
