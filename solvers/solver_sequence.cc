#include "solvers/solver_sequence.h"

#include <cmath>
#include <utility>

namespace granopt {
namespace {

Counters operator+(Counters a, const Counters& b) { return a += b; }

}  // namespace

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
    if (!solver->Supports(*function, &why) && solver != solvers_.back()) {
      continue;
    }
    // What is left of the budgets, and the whole run for the callback.
    SolveOptions rest = options;
    rest.max_iterations -= total.counters.iterations;
    rest.max_evaluations -= total.counters.evaluations;
    rest.max_seconds -= total.seconds;
    if (options.callback) {
      rest.callback = [&](const IterationState& state) {
        IterationState whole = state;
        whole.counters = total.counters + state.counters;
        whole.seconds += total.seconds;
        whole.function_seconds += total.function_seconds;
        whole.linear_seconds += total.linear_seconds;
        return options.callback(whole);
      };
    }
    Summary summary = solver->Minimize(function, rest, x);
    for (TraceRow& row : summary.trace) {
      row.iteration += total.counters.iterations;
      row.evaluations += total.counters.evaluations;
      row.seconds += total.seconds;
    }
    summary.counters = total.counters + summary.counters;
    summary.seconds += total.seconds;
    summary.function_seconds += total.function_seconds;
    summary.linear_seconds += total.linear_seconds;
    if (!is_first) {
      summary.initial_cost = total.initial_cost;
      summary.trace.insert(
          summary.trace.begin(), total.trace.begin(), total.trace.end());
    }
    is_first = false;
    total = std::move(summary);
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
