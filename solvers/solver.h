// granopt: what every method takes and returns.

#ifndef GRANOPT_SOLVERS_SOLVER_H_
#define GRANOPT_SOLVERS_SOLVER_H_

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "solvers/first_order.h"

namespace granopt {

enum class StopReason {
  // Success.
  CONVERGED,  // max|g| <= tolerance
  VANISHED,   // the function is zero, or under the stated bound
  // Budgets.
  MAX_ITERATIONS,
  MAX_EVALUATIONS,
  MAX_SECONDS,
  MAX_MEMORY,  // a factor would take more than it may
  CALLBACK,    // the caller asked to stop
  // The method gave up by itself; its own words are in the message.
  NO_PROGRESS,
  // The function or its gradient was not finite where a method cannot go on.
  EVALUATION_FAILED,
  // The method cannot serve this function, see Solver::Supports().
  UNSUPPORTED,
};

// "CONVERGED", ...
const char* StopReasonName(StopReason reason);

// Work done, in units that do not depend on the machine.
struct Counters {
  std::int64_t iterations = 0;
  std::int64_t evaluations = 0;  // of the cost, with or without gradient
  std::int64_t hessians = 0;
  std::int64_t factorizations = 0;
  std::int64_t solves = 0;
  std::int64_t linear_iterations = 0;
  std::int64_t restarts = 0;
  std::int64_t recenters = 0;
  std::int64_t rebases = 0;

  Counters& operator+=(const Counters& more) {
    iterations += more.iterations;
    evaluations += more.evaluations;
    hessians += more.hessians;
    factorizations += more.factorizations;
    solves += more.solves;
    linear_iterations += more.linear_iterations;
    restarts += more.restarts;
    recenters += more.recenters;
    rebases += more.rebases;
    return *this;
  }
};

// What a callback sees at each accepted iterate. Pointers are valid during the
// call only.
struct IterationState {
  const double* x = nullptr;
  const double* gradient = nullptr;
  int num_parameters = 0;
  double cost = 0.0;
  double max_gradient = 0.0;
  Scales scales;
  Counters counters;
  double seconds = 0.0;           // wall time so far
  double function_seconds = 0.0;  // of which inside the function
  double linear_seconds = 0.0;    // of which in matrices, factors and solves
};

// One row of the record of a run.
struct TraceRow {
  std::int64_t iteration = 0;
  std::int64_t evaluations = 0;
  double cost = 0.0;
  double max_gradient = 0.0;
  double gradient_scale = 0.0;
  double vanishing = 0.0;
  double seconds = 0.0;
  // That got here, where a run has several; checkpoints keep rows as bytes.
  std::array<char, 16> method = {};
};

struct SolveOptions {
  // A run has converged when
  //   max|g| <= relative_tolerance * Scales::gradient
  // less 16 eps Scales::gradient for the roundoff of g (or a tenth of the
  // bound, if that is less), or, if absolute_tolerance > 0, when
  //   max|g| <= absolute_tolerance
  // (which then replaces the relative test; in the units of the function).
  double relative_tolerance = 1e-10;
  double absolute_tolerance = 0.0;

  // A run has vanished when cost == 0 with gradient 0, or
  //   Scales::vanishing <= vanishing_tolerance.
  double vanishing_tolerance = 1e-13;

  std::int64_t max_iterations = std::numeric_limits<std::int64_t>::max();
  std::int64_t max_evaluations = std::numeric_limits<std::int64_t>::max();
  // The only rule that reads a clock; infinite unless asked for.
  double max_seconds = std::numeric_limits<double>::infinity();

  // Called at each accepted iterate; return false to stop.
  std::function<bool(const IterationState&)> callback;

  // Keep Summary::trace.
  bool record_trace = false;
};

struct Summary {
  std::string solver;  // Solver::name()
  StopReason reason = StopReason::NO_PROGRESS;
  // The test that ended the run with both of its numbers, e.g.
  // "|g| = 3.1e-09 > 1.0e-10 after 500 iterations".
  std::string message;

  double initial_cost = 0.0;
  double cost = 0.0;
  double max_gradient = 0.0;
  double tolerance = 0.0;  // the right-hand side of the convergence test
  Scales scales;           // at the point returned
  Counters counters;
  double seconds = 0.0;           // wall time of the run
  double function_seconds = 0.0;  // of which inside the function
  double linear_seconds = 0.0;    // of which in matrices, factors and solves
  std::vector<TraceRow> trace;

  bool Succeeded() const {
    return reason == StopReason::CONVERGED || reason == StopReason::VANISHED;
  }
  // One line.
  std::string BriefReport() const;
  // A block of `left <= right` lines, one a criterion.
  std::string FullReport() const;
};

// A method. Minimize() starts from x (NumParameters() entries) and leaves there
// the best point found, whatever happened. Best is the least cost; among points
// whose costs differ by less than the cost's roundoff, the least max|g|.
//
// If the method rebased the function (Summary::counters.rebases > 0) x is
// relative to the function's new origin.
class Solver {
 public:
  virtual ~Solver() = default;
  virtual Summary Minimize(FirstOrderFunction* function,
                           const SolveOptions& options,
                           double* x) const = 0;

  // False, with one line in `error`, for a function that the method cannot
  // serve (one without second derivatives for a method that needs them).
  // Minimize() then leaves x alone and returns StopReason::UNSUPPORTED.
  virtual bool Supports(const FirstOrderFunction& function,
                        std::string* error) const {
    (void)function;
    (void)error;
    return true;
  }

  // "name:key=value,...", as given to CreateSolver().
  const std::string& name() const { return name_; }
  void set_name(std::string name) { name_ = std::move(name); }

 private:
  std::string name_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SOLVER_H_
