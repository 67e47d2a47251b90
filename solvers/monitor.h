// granopt: what every run of every method shares.

#ifndef GRANOPT_SOLVERS_MONITOR_H_
#define GRANOPT_SOLVERS_MONITOR_H_

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "solvers/solver.h"

namespace granopt {

// Stands between a method and its function: counts and times evaluations, names
// values that are not finite, applies the stopping test to the function's own
// gradient, keeps the best point and the trace, and writes the Summary.
//
//   Monitor monitor(function, options, "name");
//   ... monitor.Evaluate(x, &cost, gradient.data(), &scales) ...
//   if (monitor.Accept(x, cost, gradient.data(), scales)) return
//   monitor.Finish(x_out);
//
// A method that ends by itself says why with GiveUp() before Finish().
class Monitor {
 public:
  // A method that asks for cost and gradient one after the other, as most
  // libraries do, keeps the last evaluation: two copies of a vector.
  enum class Cache { NONE, LAST_EVALUATION };

  Monitor(FirstOrderFunction* function,
          const SolveOptions& options,
          std::string solver_name,
          Cache cache = Cache::NONE);

  FirstOrderFunction* function() const { return function_; }
  int n() const { return n_; }
  const SolveOptions& options() const { return options_; }
  Counters& counters() { return counters_; }

  // How a run starts: refuses a function that `solver` does not support, else
  // evaluates and accepts x. False if the run is over already.
  bool Begin(const Solver& solver,
             const double* x,
             double* cost,
             double* gradient,
             Scales* scales);
  // The same with Cache::LAST_EVALUATION, see EvaluateCached().
  bool BeginCached(const Solver& solver,
                   const double* x,
                   double* cost,
                   const double** gradient,
                   Scales* scales);

  // One counted evaluation. `gradient` and `scales` may be null. Returns false,
  // and remembers the offending entry, if x, the cost or the gradient is not
  // finite.
  bool Evaluate(const double* x,
                double* cost,
                double* gradient,
                Scales* scales);

  // With Cache::LAST_EVALUATION: true if x is, bit for bit, the last point
  // evaluated with a gradient.
  bool IsCached(const double* x) const;

  // With Cache::LAST_EVALUATION: cost, gradient and scales at x, from the cache
  // if x was the last point evaluated, else by a counted evaluation.
  bool EvaluateCached(const double* x,
                      double* cost,
                      const double** gradient,
                      Scales* scales);

  // Tells the monitor of an accepted iterate: the first call is the start,
  // every further one counts an iteration. Where x or gradient is the memory of
  // the last Evaluate(), it must be as that left it. Returns true if the run
  // must stop; the reason is then set. A point above the least cost, which is
  // not the one returned, has not converged. A run without a better point for
  // 200 iterations while max|g| is within Roundoff(), or for 10000 iterations
  // whatever it is, makes no progress.
  bool Accept(const double* x,
              double cost,
              const double* gradient,
              const Scales& scales);

  // True once the budget of evaluations or seconds is spent (sets the reason).
  bool BudgetSpent();

  // The method's own end. Ignored if a reason is already set.
  void GiveUp(const std::string& why);
  // The method cannot serve this function (Solver::Supports()).
  void Refuse(const std::string& why);
  // The method cannot go on with the memory that it may take; `why` has both
  // numbers.
  void RunOutOfMemory(const std::string& why);
  // The method cannot go on since the last evaluation was not finite, or, if
  // that was well, for what `what` says.
  void FailEvaluation(const std::string& what = "");
  bool LastEvaluationFailed() const { return !not_finite_.empty(); }

  // Time spent while one of these lives counts as linear algebra. Evaluations
  // must not happen meanwhile.
  class LinearTimer {
   public:
    explicit LinearTimer(Monitor* monitor)
        : monitor_(monitor), start_(monitor->Seconds()) {}
    ~LinearTimer() {
      monitor_->linear_seconds_ += monitor_->Seconds() - start_;
    }
    LinearTimer(const LinearTimer&) = delete;
    LinearTimer& operator=(const LinearTimer&) = delete;

   private:
    Monitor* monitor_;
    const double start_;
  };

  // For a library that keeps its own clock.
  void AddLinearSeconds(double seconds) { linear_seconds_ += seconds; }

  // Calls function->Recenter(x), counted.
  void Recenter(const double* x);
  // True once the rounding of x itself is about to limit the run: at the last
  // accepted iterate
  //   eps * max|x| > 0.05 * step * (max|g| / Scales::gradient) * Scales::length
  // for a method whose steps are `step` times a gradient in these units; or
  // once the function is to be refined, Scales::refine_below.
  bool WantsRebase(double step = 1.0) const;
  // Calls function->Rebase(x), counted; moves the best point along. Refines the
  // function if that was wanted; the next point accepted is then the best one.
  bool Rebase(double* x);
  // For a method that is about to give up: Rebase(x) if the function can still
  // be refined, whatever the gradient.
  bool Refine(double* x);

  bool stopped() const { return stopped_; }
  const Scales& scales() const { return last_scales_; }
  // The least cost accepted, and whether another is above it by more than its
  // roundoff.
  double least_cost() const { return least_cost_; }
  bool IsAbove(double cost) const;
  // max|g| at the last accepted iterate and the bound that it must reach.
  double max_gradient() const { return last_max_gradient_; }
  double Tolerance(const Scales& scales) const;
  // 20 rounding errors of the gradient's terms at the last accepted iterate,
  //   20 Scales::gradient (Scales::epsilon + eps max|x| / Scales::length).
  // 0 where the function states no scales.
  double Roundoff() const;
  // Scales::length / Scales::gradient at the last accepted iterate: times a
  // gradient it is a step over which that gradient changes by its own size.
  // Where the function states no scales, cost / |g|^2, the step to a zero of
  // the linear model, as long as the cost is not zero.
  double StepUnit() const;

  // Writes the best point to x and returns the summary.
  Summary Finish(double* x);

 private:
  void Stop(StopReason reason, std::string message);
  double Seconds() const;
  bool IsBetter(double cost, double max_gradient);
  double CostRoundoff() const;
  bool WantsRefinement() const;

  FirstOrderFunction* function_;
  const SolveOptions options_;
  const int n_;
  const std::chrono::steady_clock::time_point start_;
  double function_seconds_ = 0.0;
  double linear_seconds_ = 0.0;
  Counters counters_;
  std::string solver_name_;

  bool started_ = false;
  bool stopped_ = false;
  StopReason reason_ = StopReason::NO_PROGRESS;
  std::string message_;
  std::string not_finite_;  // "gradient[17] = nan at evaluation 3"
  double initial_cost_ = 0.0;

  // The last evaluation with a gradient.
  const Cache cache_;
  bool cache_valid_ = false;
  std::vector<double> cache_x_, cache_gradient_;
  double cache_cost_ = 0.0;
  Scales cache_scales_;
  std::vector<double> scratch_;

  // Of the last evaluation with a gradient.
  struct {
    const double* x = nullptr;
    const double* gradient = nullptr;
    double max_x = 0.0;
    double max_gradient = 0.0;
  } evaluated_;

  double last_max_gradient_ = 0.0;
  double last_step_unit_ = 1.0;  // where the function states no scales
  double last_max_x_ = 0.0;
  bool can_rebase_ = true;
  bool is_refined_ = false;  // since the last accepted iterate
  Scales last_scales_;

  std::vector<double> best_x_;
  double least_cost_ = 0.0;
  double best_cost_ = 0.0;
  double best_max_gradient_ = 0.0;
  std::int64_t best_iteration_ = 0;
  Scales best_scales_;
  std::vector<TraceRow> trace_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_MONITOR_H_
