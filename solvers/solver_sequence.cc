#include "solvers/solver_sequence.h"

#include <cmath>
#include <utility>

namespace granopt {
namespace {

Counters operator+(Counters a, const Counters& b) { return a += b; }

}  // namespace

SolveOptions Remaining(const SolveOptions& options, const Summary& done) {
  SolveOptions rest = options;
  rest.max_iterations -= done.counters.iterations;
  rest.max_evaluations -= done.counters.evaluations;
  rest.max_seconds -= done.seconds;
  if (options.callback) {
    rest.callback = [&options, &done](const IterationState& state) {
      IterationState whole = state;
      whole.counters = done.counters + state.counters;
      whole.seconds += done.seconds;
      whole.function_seconds += done.function_seconds;
      whole.linear_seconds += done.linear_seconds;
      return options.callback(whole);
    };
  }
  return rest;
}

Summary Joined(Summary first, Summary second) {
  for (TraceRow& row : second.trace) {
    row.iteration += first.counters.iterations;
    row.evaluations += first.counters.evaluations;
    row.seconds += first.seconds;
  }
  first.trace.insert(
      first.trace.end(), second.trace.begin(), second.trace.end());
  second.trace = std::move(first.trace);
  if (second.reason == StopReason::EVALUATION_FAILED &&
      second.counters.iterations == 0) {
    // It knows nothing of its start, which is the end of the first.
    second.cost = first.cost;
    second.max_gradient = first.max_gradient;
    second.tolerance = first.tolerance;
    second.scales = first.scales;
  }
  second.initial_cost = first.initial_cost;
  second.counters = first.counters + second.counters;
  second.seconds += first.seconds;
  second.function_seconds += first.function_seconds;
  second.linear_seconds += first.linear_seconds;
  return second;
}

bool SolverSequence::Supports(const FirstOrderFunction& function,
                              std::string* error) const {
  for (const auto& solver : solvers_) {
    if (solver->Supports(function, error)) return true;
  }
  return false;
}

Summary SolverSequence::Minimize(FirstOrderFunction* function,
                                 const SolveOptions& options,
                                 double* x) const {
  Summary total;
  bool is_first = true;
  for (const auto& solver : solvers_) {
    std::string why;
    const bool is_last_hope = is_first && solver == solvers_.back();
    if (!solver->Supports(*function, &why) && !is_last_hope) continue;
    Summary next = solver->Minimize(function, Remaining(options, total), x);
    total =
        is_first ? std::move(next) : Joined(std::move(total), std::move(next));
    is_first = false;
    const bool gave_up = total.reason == StopReason::NO_PROGRESS ||
                         total.reason == StopReason::MAX_MEMORY ||
                         total.reason == StopReason::EVALUATION_FAILED;
    total.message = solver->name() + ": " + total.message;
    if (!gave_up) break;
  }
  total.solver = name();
  return total;
}

}  // namespace granopt
