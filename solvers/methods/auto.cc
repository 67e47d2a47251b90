// The method that a user need not choose: first-order steps where they are
// cheap, second-order ones where they are not.
//
//   fire            where contacts change all over, and far from jamming
//   barrier         lbfgs:preconditioner=barrier,shift=1e-6: small loads, and
//                   the end of what fire has settled
//   interior_point  loads that are about to change many contacts
//
// Each starts from the best point of the one before it, so that none returns a
// worse one. Costs are counts in units of an evaluation of discs, never times.
// A decade of max|g| is forecast to take fire
//   kDecade v^(-1/3) evaluations,   v = Scales::vanishing,
// v being about the distance from jamming: towards it the lowest frequencies
// fall, and the steps of first-order methods with them, but not those of the
// others. What a phase has done so far replaces the forecast, within bounds.
// Where a second-order phase fails at the start, the other one is tried, then
// fire. The message of the summary tells residual (in mean forces) and v at the
// start, and each phase with its work and its last residual.
//
// Deviations from the methods' own defaults: none but that they are stopped
// from outside.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "solvers/format.h"
#include "solvers/registry.h"
#include "solvers/solver_sequence.h"

namespace granopt {
namespace {

// Costs, as measured with 1024 to 65536 discs (README, where the time goes).
constexpr double kFireStep = 1.4;  // an evaluation included
constexpr double kVectors = 4.0;   // an iteration of lbfgs
constexpr double kSolve = 9.0;
constexpr double kFactor = 42.0;
constexpr double kMatrix = 75.0;  // with the analysis of its pattern

constexpr double kDecade = 25.0;
// What fire's progress says is believed up to so many times the forecast.
constexpr double kSlowest = 20.0;
// Loads are small, and many contacts are about to change, where max|g| is below
// and above so many mean forces; fire then takes so many times as long.
constexpr double kSmall = 0.03;
constexpr double kMany = 0.4;
constexpr double kManyTimes = 2.0;
// Contacts change all over above this, ...
constexpr double kCalm = 3.0;
// ... and too many of them to leave fire above this.
constexpr double kSettled = 0.1;

// barrier begins if fire promises to take longer, and interior_point, which
// many contact changes may defeat, if it promises to take so many times as
// long.
constexpr double kDeep = 2.0;
// barrier may take so many times its forecast before it is compared with fire,
// and interior_point so many times what fire was forecast to take.
constexpr double kPatience = 3.0;
constexpr double kMostInterior = 2.0;
// After a phase that did not end the run there is no other before fire has
// taken so many times what all of them took: they cost a fifth of a run at
// most, and the first one.
constexpr double kWait = 4.0;

// Iterations between two decisions, and before the first.
constexpr std::int64_t kFireLook = 200;
constexpr std::int64_t kFireLeast = 1000;
constexpr std::int64_t kBarrierLook = 20;
constexpr std::int64_t kBarrierLeast = 40;

enum class Kind { FIRE, BARRIER, INTERIOR };

double SecondOrderWork(const Counters& c) {
  return static_cast<double>(c.evaluations) +
         kVectors * static_cast<double>(c.iterations) +
         kSolve * static_cast<double>(c.solves) +
         kFactor * static_cast<double>(c.factorizations) +
         kMatrix * static_cast<double>(c.hessians);
}

// Work and residual of a phase so far.
class Progress {
 public:
  void Add(double work, double residual) {
    points_.push_back({work, std::log10(residual)});
  }
  // Work a decade over the second half; infinite without progress.
  double PerDecade() const {
    const auto& last = points_.back();
    std::size_t middle = 0;
    while (points_[middle].first < 0.5 * last.first) ++middle;
    const double decades = points_[middle].second - last.second;
    return decades > 0.0 ? (last.first - points_[middle].first) / decades
                         : std::numeric_limits<double>::infinity();
  }

 private:
  std::vector<std::pair<double, double>> points_;
};

// One run, its phases and what they are decided on.
class Phases {
 public:
  Phases(const Solver& fire,
         const Solver& barrier,
         const Solver& interior,
         FirstOrderFunction* function,
         const SolveOptions& options)
      : fire_(fire),
        barrier_(barrier),
        interior_(interior),
        function_(function),
        options_(options) {
    std::string why;
    has_second_order_ =
        barrier.Supports(*function, &why) && interior.Supports(*function, &why);
  }

  Summary Run(double* x) {
    Kind kind = Kind::FIRE;
    bool gave_up_before = false;
    for (;;) {
      const double before = residual_;
      Summary next = kind == Kind::FIRE      ? Fire(x)
                     : kind == Kind::BARRIER ? Barrier(x)
                                             : InteriorPoint(x);
      scales_ = next.scales;
      SetResidual(next.max_gradient);
      Tell(kind, next);
      const bool no_memory = next.reason == StopReason::MAX_MEMORY;
      const bool gave_up = next.reason == StopReason::NO_PROGRESS;
      const bool is_over =
          !gave_up && !no_memory &&
          (next.reason != StopReason::CALLBACK || is_stopped_by_caller_);
      total_ = is_first_ ? std::move(next)
                         : Joined(std::move(total_), std::move(next));
      is_first_ = false;
      has_second_order_ = has_second_order_ && !no_memory;
      // Neither of two in a row knows how to go on.
      const bool is_stuck =
          gave_up && kind != Kind::INTERIOR &&
          (gave_up_before || !has_second_order_ || kind == Kind::BARRIER);
      const bool is_spent =
          total_.counters.evaluations >= options_.max_evaluations;
      if (is_over || is_stuck || is_spent) break;
      gave_up_before = gave_up && kind == Kind::FIRE && !(residual_ < before);
      kind = Next(kind);
    }
    if (second_order_work_ > 0.0) {
      total_.message = story_ + ": " + total_.message;
    }
    return std::move(total_);
  }

 private:
  Kind Next(Kind kind) {
    const bool is_start = fire_iterations_ == 0;
    if (kind != Kind::FIRE) fire_work_at_failure_ = fire_work_;
    if (!has_second_order_) return Kind::FIRE;
    if (kind == Kind::FIRE) {
      return is_start && residual_ > kMany ? Kind::INTERIOR : Kind::BARRIER;
    }
    // From the start on the other one may do; after fire it does not.
    if (is_start && kind == Kind::INTERIOR && !has_tried_barrier_) {
      return Kind::BARRIER;
    }
    if (is_start && kind == Kind::BARRIER && !has_tried_interior_) {
      return Kind::INTERIOR;
    }
    return Kind::FIRE;
  }

  void SetResidual(double max_gradient) {
    residual_ = scales_.gradient > 0.0
                    ? max_gradient / scales_.gradient
                    : std::numeric_limits<double>::infinity();
  }
  double Decades() const {
    const double tolerance =
        options_.absolute_tolerance > 0.0
            ? options_.absolute_tolerance / scales_.gradient
            : options_.relative_tolerance;
    return std::max(0.0, std::log10(residual_ / tolerance));
  }

  double FireDecade() const {
    return kFireStep * kDecade * std::pow(scales_.vanishing, -1.0 / 3.0);
  }
  double FireForecast() const {
    return FireDecade() * Decades() * (residual_ > kMany ? kManyTimes : 1.0);
  }
  double BarrierForecast() const {
    const double iterations =
        residual_ < kSmall ? 8.0 + 2.0 * Decades() : 20.0 + 4.0 * Decades();
    return iterations * (1.0 + kVectors + kSolve) +
           std::ceil(iterations / 20.0) * (kFactor + kMatrix);
  }
  static constexpr double kInteriorForecast =
      10.0 * (1.0 + kFactor + kMatrix + 2.0 * kSolve);

  // fire: what fire would still take.
  bool IsWorthIt(double fire) const {
    return has_second_order_ && BarrierForecast() <= fire &&
           fire_work_ >= fire_work_at_failure_ + kWait * second_order_work_;
  }
  bool IsWorthItAtOnce() const {
    if (residual_ <= kMany) return IsWorthIt(FireForecast());
    return has_second_order_ && residual_ <= kCalm &&
           kDeep * kInteriorForecast <= FireForecast();
  }

  // Minimizes until stop(counters of this phase) at an accepted iterate.
  template <typename Stop>
  Summary Minimize(const Solver& solver, double* x, const Stop& stop) {
    SolveOptions rest = Remaining(options_, total_);
    const auto caller = rest.callback;
    const std::int64_t rest_evaluations = rest.max_evaluations;
    rest.callback = [&](const IterationState& state) {
      // The start of a phase is the end of the one before.
      const bool is_known = !is_first_ && state.counters.iterations == 0;
      if (caller && !is_known && !caller(state)) {
        is_stopped_by_caller_ = true;
        return false;
      }
      scales_ = state.scales;
      SetResidual(state.max_gradient);
      // A spent budget ends the phase with its own reason.
      return state.counters.evaluations >= rest_evaluations ||
             !stop(state.counters);
    };
    return solver.Minimize(function_, rest, x);
  }

  Summary Fire(double* x) {
    Progress progress;
    const double before = fire_work_;
    const bool is_start = fire_iterations_ == 0 && second_order_work_ == 0.0;
    double highest = 0.0;  // of the residuals since the last look
    const auto work = [](const Counters& c) {
      return kFireStep * static_cast<double>(c.evaluations);
    };
    Summary summary = Minimize(fire_, x, [&](const Counters& c) {
      if (!has_second_order_) return false;
      if (c.iterations == 0) {
        if (is_start)
          story_ =
              Format("from %.1e at v = %.1e", residual_, scales_.vanishing);
        return is_start && IsWorthItAtOnce();
      }
      highest = std::max(highest, residual_);
      if (c.iterations % kFireLook != 0) return false;
      progress.Add(work(c), highest);
      fire_work_ = before + work(c);
      fire_highest_ = highest;
      highest = 0.0;
      if (c.iterations < kFireLeast || !(fire_highest_ <= kSettled))
        return false;
      const double decade = std::clamp(
          progress.PerDecade(), FireDecade(), kSlowest * FireDecade());
      return IsWorthIt(decade * Decades());
    });
    fire_iterations_ += summary.counters.iterations;
    fire_work_ = before + (fire_iterations_ > 0 ? work(summary.counters) : 0.0);
    return summary;
  }

  Summary Barrier(double* x) {
    has_tried_barrier_ = true;
    Progress progress;
    const double fire = FireForecast();
    const double forecast = BarrierForecast();
    // fire's residual goes up and down.
    const double start = std::max(residual_, fire_highest_);
    double least = residual_;
    Summary summary = Minimize(barrier_, x, [&](const Counters& c) {
      least = std::min(least, residual_);
      if (c.iterations % kBarrierLook != 0 || c.iterations == 0) return false;
      const double work = SecondOrderWork(c);
      progress.Add(work, least);
      // What fire had settled has to go on at once.
      if (fire_iterations_ > 0 && c.iterations >= kBarrierLeast &&
          least >= start) {
        return true;
      }
      return work > std::max(kPatience * forecast, 0.5 * fire) &&
             progress.PerDecade() * Decades() > FireForecast();
    });
    second_order_work_ += SecondOrderWork(summary.counters);
    return summary;
  }

  Summary InteriorPoint(double* x) {
    has_tried_interior_ = true;
    const double most = kMostInterior * FireForecast();
    Summary summary = Minimize(interior_, x, [&](const Counters& c) {
      return SecondOrderWork(c) > most;
    });
    second_order_work_ += SecondOrderWork(summary.counters);
    return summary;
  }

  void Tell(Kind kind, const Summary& phase) {
    const Counters& c = phase.counters;
    if (kind == Kind::FIRE && c.iterations == 0 && !phase.Succeeded()) return;
    if (!story_.empty()) story_ += ", ";
    const char* const names[] = {"fire", "barrier", "interior_point"};
    story_ += Format("%s %lld iterations",
                     names[static_cast<int>(kind)],
                     static_cast<long long>(c.iterations));
    if (kind != Kind::FIRE) {
      story_ +=
          Format(" (%lld factors)", static_cast<long long>(c.factorizations));
    }
    if (scales_.gradient > 0.0) story_ += Format(" to %.1e", residual_);
  }

  const Solver& fire_;
  const Solver& barrier_;
  const Solver& interior_;
  FirstOrderFunction* const function_;
  const SolveOptions& options_;
  bool has_second_order_ = false;
  bool has_tried_barrier_ = false;
  bool has_tried_interior_ = false;
  bool is_stopped_by_caller_ = false;
  bool is_first_ = true;
  Summary total_;
  std::string story_;

  // At the last accepted iterate; max|g| in units of its scale.
  Scales scales_;
  double residual_ = std::numeric_limits<double>::infinity();

  std::int64_t fire_iterations_ = 0;
  double fire_work_ = 0.0;
  double fire_highest_ = 0.0;  // between the last two looks
  double fire_work_at_failure_ = 0.0;
  double second_order_work_ = 0.0;
};

class Auto : public Solver {
 public:
  explicit Auto(Parameters* /*parameters*/) {
    std::string error;
    fire_ = CreateSolver("fire", &error);
    barrier_ = CreateSolver("lbfgs:preconditioner=barrier,shift=1e-6", &error);
    interior_ = CreateSolver("interior_point", &error);
  }

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override {
    Phases phases(*fire_, *barrier_, *interior_, function, options);
    Summary summary = phases.Run(x);
    summary.solver = name();
    return summary;
  }

 private:
  std::unique_ptr<Solver> fire_, barrier_, interior_;
};

}  // namespace

REGISTER_SOLVER(auto,
                Auto,
                "fire, interior_point or lbfgs:preconditioner=barrier, by what "
                "each would still cost",
                "Bitzek et al., Phys. Rev. Lett. 97 (2006) 170201; Mehrotra, "
                "SIAM J. Optim. 2 (1992) 575; the choice: this project");

}  // namespace granopt
