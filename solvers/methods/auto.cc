// The method that a user need not choose: first-order steps where they are
// cheap, second-order ones where they are not.
//
//   newton          small loads, and the end of what others have settled
//   interior_point  loads that are about to open or close many terms
//   barrier         lbfgs:preconditioner=barrier,shift=1e-6: loads in between,
//                   and what interior_point does not find its way through
//   lbfgs           (memory=8) where terms open and close all over
//   fire            far from a zero, where a few digits are enough
//
// Each starts from the best point of the one before it, or, after an
// interior_point that failed next to a zero, from where that started: none
// returns a point worse than its start. Which one begins is read off two
// numbers at the start: the residual r (max|g| in units of Scales::gradient)
// and v = Scales::vanishing, about the distance from a zero. Of the
// second-order methods it is
//   newton          if r <= kSmall, or r <= kFew / size^(1/2) with v > kNear,
//   none            if r > kLarge, or r > kMany with v > kFar / size,
//   barrier         if r <= kMany (alpha - 1)^(5/2) with v <= kNear, where its
//                   forecast is below that of
//   interior_point  else,
// but a first-order method if that is forecast to be cheaper: fire if r <=
// kMany or what is displaced is about single objects (r > kLarge with v <
// kWide), else lbfgs. A second-order method is left once it has cost some times
// what it promised. While a first-order method goes on, the closed terms among
// objects that hold each other are compared from look to look: where hardly any
// opens or closes any more, newton will end the run within a few factors;
// before, it would follow one instability into the next. Costs are counts in
// units of an evaluation, never times.
//
// Deviations from the methods' own defaults: none but the options above, and
// that they are stopped from outside.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "solvers/format.h"
#include "solvers/registry.h"
#include "solvers/rigidity.h"
#include "solvers/solver_sequence.h"
#include "solvers/unilateral.h"

namespace granopt {
namespace {

// See the head of this file.
constexpr double kSmall = 0.01;
constexpr double kFew = 0.1;  // for kSize unknowns; FewFor() others
constexpr double kSome = 0.03;
constexpr double kMany = 0.4;
constexpr double kLarge = 3.0;
constexpr double kNear = 1e-3;
constexpr double kFar = 3e-3;  // for kSize unknowns; FarFor() others
constexpr double kWide = 0.05;
// Above this a first-order method goes on where interior_point has failed.
constexpr double kFarForBarrier = 1.5e-3;
// So near a zero hardly a term opens or closes in a small step: interior_point
// that fails has gone elsewhere, and the next method starts where it started.
constexpr double kNextToZero = 2e-5;
// newton ends what others have settled once so many terms change from look to
// look at most.
constexpr int kCalm = 4;

// A decade of max|g| takes a first-order method kDecade v^(-1/3) evaluations,
// whose steps become smaller as the lowest frequencies fall towards a zero; so
// many times that where some terms change far from it, or many.
constexpr double kDecade = 26.0;
constexpr double kDecadeOfThree = 11.0;  // in blocks of three unknowns
constexpr double kSomeTimes = 1.5;
constexpr double kManyTimes = 2.0;
// What its progress says is believed up to so many times that.
constexpr double kSlowest = 20.0;

// Iterations that newton, one more for each term that changed lately, and,
// times alpha - 1, interior_point are expected to take; those of barrier, and
// per decade, for kSize unknowns; they grow as the root of the size.
constexpr double kNewtonIterations = 4.0;
constexpr double kInteriorIterations = 8.0;
constexpr double kBarrierIterations = 10.0;
constexpr double kBarrierDecade = 4.0;
constexpr double kSize = 2048.0;
// Between two of its factors.
constexpr double kBarrierEvery = 20.0;
// They may take so many times what they promised, at the start also what a
// first-order method was forecast to take; barrier so many times the latter,
// and twice as much each time that it is tried again.
constexpr double kPatience = 2.0;
constexpr double kBarrierPatience = 4.0;
// After a newton that did not end the run a first-order method takes so many
// times what that took.
constexpr double kWait = 2.0;
// From so many such ends on both take turns twice as long each time: where the
// softest mode is very soft, lbfgs began again every 800 iterations and newton
// gave up after 9, for ever.
constexpr int kFewFailures = 4;

// Where the cost is looked at between start and end.
constexpr int kWayPoints = 9;
// Iterations of a first-order method between two looks.
constexpr std::int64_t kLook = 100;

// Nothing was measured that would widen kFar below kSize. The larger a
// function, the more terms open or close, and give way, at once.
double FewFor(int n) { return kFew * std::sqrt(kSize / n); }
double FarFor(int n) { return kFar * std::min(1.0, kSize / n); }

enum class Kind { FIRE, LBFGS, NEWTON, INTERIOR, BARRIER };
constexpr const char* kNames[] = {
    "fire", "lbfgs", "newton", "interior_point", "barrier"};
constexpr const char* kSpecs[] = {"fire",
                                  "lbfgs:memory=8",
                                  "newton",
                                  "interior_point",
                                  "lbfgs:preconditioner=barrier,shift=1e-6"};
constexpr int kKinds = 5;

bool IsFirstOrder(Kind kind) {
  return kind == Kind::FIRE || kind == Kind::LBFGS;
}

// Costs in evaluations of n unknowns in blocks, as measured (comparing.md,
// where the time goes) with 1024 to 65536 blocks of two, a million, for which
// approximate minimum degree fills far more, and 300 to 2000 blocks of three.
struct Costs {
  Costs(int n, int block)
      : factor(block > 2 ? 0.3 * (n / block)
                         : 42.0 * std::sqrt(n / 8192.0) *
                               std::max(1.0, std::pow(n / 262144.0, 2.0))),
        solve(0.2 * factor),
        decade(block > 2 ? kDecadeOfThree : kDecade) {}

  static double FirstOrderStep(Kind kind) {
    return kind == Kind::FIRE ? 1.3 : 2.0;
  }
  double NewtonIteration() const { return factor + solve + 3.0 * hessian; }
  double InteriorIteration() const {
    return 1.3 * factor + 3.5 * solve + hessian + gaps;
  }
  double SecondOrder(Kind kind, const Counters& c) const {
    const double own = kind == Kind::INTERIOR  ? gaps
                       : kind == Kind::BARRIER ? vectors
                                               : 0.0;
    return (c.factorizations > 0 ? analysis : 0.0) +
           factor * static_cast<double>(c.factorizations) +
           solve * static_cast<double>(c.solves) +
           hessian * static_cast<double>(c.hessians) +
           own * static_cast<double>(c.iterations) +
           static_cast<double>(c.evaluations);
  }

  const double factor, solve;
  const double decade;  // of a first-order method, see kDecade
  const double analysis = 70.0;
  const double hessian = 4.0;
  const double gaps = 30.0;    // and vectors: of interior_point's iteration
  const double vectors = 3.0;  // of barrier's
};

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

// The closed terms among objects that hold each other, from look to look.
class ClosedTerms {
 public:
  explicit ClosedTerms(const FirstOrderFunction& function)
      : function_(dynamic_cast<const UnilateralFunction*>(&function)) {}

  // How many have opened or closed since the last look; all at the first one,
  // none if the function has no such terms.
  int Changes(const double* x) {
    if (function_ == nullptr || !function_->EvaluateGaps(x, &gaps_)) return 0;
    const int block = function_->BlockSize();
    const std::vector<bool> held =
        HeldObjects(gaps_, function_->NumParameters() / block, block + 1);
    std::vector<GapId> closed;
    closed.reserve(closed_.size());
    for (std::size_t c = 0; c < gaps_.ids.size(); ++c) {
      const GapId& id = gaps_.ids[c];
      if (gaps_.delta[static_cast<int>(c)] > 0.0 && held[id.i] && held[id.j]) {
        closed.push_back(id);
      }
    }
    std::vector<GapId> changed;
    std::set_symmetric_difference(closed.begin(),
                                  closed.end(),
                                  closed_.begin(),
                                  closed_.end(),
                                  std::back_inserter(changed));
    closed_.swap(closed);
    return static_cast<int>(changed.size());
  }

 private:
  const UnilateralFunction* const function_;
  Gaps gaps_;
  std::vector<GapId> closed_;
};

struct Methods {
  std::unique_ptr<Solver> of[kKinds];  // by Kind
  const Solver& operator[](Kind kind) const {
    return *of[static_cast<int>(kind)];
  }
};

int BlockSizeOf(const FirstOrderFunction& function) {
  const auto* second = dynamic_cast<const SecondOrderFunction*>(&function);
  return second == nullptr ? 1 : second->BlockSize();
}

double ExponentOf(const FirstOrderFunction& function) {
  const auto* terms = dynamic_cast<const UnilateralFunction*>(&function);
  return terms == nullptr ? 2.0 : terms->Exponent();
}

// One run, its phases and what they are decided on.
class Phases {
 public:
  Phases(const Methods& methods,
         FirstOrderFunction* function,
         const SolveOptions& options)
      : methods_(methods),
        function_(function),
        options_(options),
        costs_(function->NumParameters(), BlockSizeOf(*function)),
        exponent_(ExponentOf(*function)) {
    std::string why;
    has_newton_ = methods[Kind::NEWTON].Supports(*function, &why);
    has_interior_ = methods[Kind::INTERIOR].Supports(*function, &why) &&
                    methods[Kind::BARRIER].Supports(*function, &why);
  }

  Summary Run(double* x) {
    const std::vector<double> start(x, x + function_->NumParameters());
    Kind kind = Kind::FIRE;
    bool has_lost_a_start = false;
    bool is_stuck = false;  // that gave up, and newton has its last word
    for (;;) {
      next_ = first_order_;
      // Of the point that this phase begins at.
      const double tolerance = total_.tolerance;
      IterationState before;
      before.cost = total_.cost;
      before.max_gradient = total_.max_gradient;
      before.scales = total_.scales;
      Summary phase =
          IsFirstOrder(kind) ? FirstOrder(kind, x) : SecondOrder(kind, x);
      scales_ = phase.scales;
      SetResidual(phase.max_gradient);
      Tell(kind, phase);
      for (TraceRow& row : phase.trace) {
        std::snprintf(row.method.data(),
                      row.method.size(),
                      "%s",
                      kNames[static_cast<int>(kind)]);
      }
      const StopReason reason = phase.reason;
      const bool lost_its_start = !is_first_ &&
                                  reason == StopReason::EVALUATION_FAILED &&
                                  phase.counters.iterations == 0;
      total_ = is_first_ ? std::move(phase)
                         : Joined(std::move(total_), std::move(phase));
      is_first_ = false;
      if (reason == StopReason::MAX_MEMORY) {
        has_newton_ = has_interior_ = false;
        next_ = first_order_;
      } else if (reason == StopReason::NO_PROGRESS) {
        if (is_stuck || (IsFirstOrder(kind) && !has_newton_)) break;
        is_stuck = IsFirstOrder(kind);
        if (is_stuck) next_ = Kind::NEWTON;
      } else if (lost_its_start && !has_lost_a_start) {
        has_lost_a_start = true;
        next_ = kind;
      } else if (reason != StopReason::CALLBACK || is_stopped_by_caller_) {
        break;
      }
      if (total_.counters.evaluations >= options_.max_evaluations) break;
      if (!restart_.empty()) {
        std::copy(restart_.begin(), restart_.end(), x);
        restart_.clear();
        total_.cost = before.cost;
        total_.max_gradient = before.max_gradient;
        total_.tolerance = tolerance;
        total_.scales = before.scales;
      }
      kind = next_;
    }
    if (!is_first_order_alone_) {
      if (RisesOnTheWay(start, x)) {
        story_ +=
            " (the energy rises on the straight way from the start: a descent "
            "may end elsewhere)";
      }
      total_.message = story_ + ": " + total_.message;
    }
    return std::move(total_);
  }

 private:
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

  // Second-order methods need not stay in the basin of the start. Where the
  // cost is not seen to fall all along the straight way to the end, they may
  // have left it.
  bool RisesOnTheWay(const std::vector<double>& start, const double* end) {
    Counters& counters = total_.counters;
    if (!total_.Succeeded() || counters.rebases > 0 ||
        counters.evaluations + kWayPoints > options_.max_evaluations) {
      return false;
    }
    std::vector<double> x(start.size());
    double before = total_.initial_cost;
    for (int k = 1; k <= kWayPoints; ++k) {
      const double t = k / (kWayPoints + 1.0);
      for (std::size_t i = 0; i < x.size(); ++i) {
        x[i] = start[i] + t * (end[i] - start[i]);
      }
      ++counters.evaluations;
      double cost;
      if (!function_->EvaluateWithScales(x.data(), &cost, nullptr, nullptr) ||
          cost > before) {
        return true;
      }
      before = cost;
    }
    return total_.cost > before;
  }

  // What methods would still take.
  double FirstOrderDecade() const {
    return Costs::FirstOrderStep(Kind::FIRE) * costs_.decade *
           std::pow(scales_.vanishing, -1.0 / 3.0);
  }
  double FirstOrderForecast() const {
    const double times = residual_ > kMany ? kManyTimes
                         : residual_ > kSome && scales_.vanishing > kNear
                             ? kSomeTimes
                             : 1.0;
    return times * FirstOrderDecade() * Decades();
  }
  double NewtonForecast(int changes) const {
    return costs_.analysis +
           (kNewtonIterations + changes) * costs_.NewtonIteration();
  }
  double InteriorForecast() const {
    return costs_.analysis +
           kInteriorIterations * (exponent_ - 1.0) * costs_.InteriorIteration();
  }
  double BarrierForecast() const {
    const double iterations =
        (kBarrierIterations + kBarrierDecade * Decades()) *
        std::sqrt(function_->NumParameters() / kSize);
    return iterations * (1.0 + costs_.vectors + costs_.solve) +
           std::ceil(iterations / kBarrierEvery) *
               (costs_.analysis + costs_.factor + costs_.hessian);
  }

  // What to begin with.
  Kind First() {
    // Of other functions nothing is known that these numbers say.
    if (!has_interior_) return first_order_;
    const double r = residual_, v = scales_.vanishing;
    const int n = function_->NumParameters();
    first_order_ =
        r <= kMany || (r > kLarge && v < kWide) ? Kind::FIRE : Kind::LBFGS;
    Kind second_order;
    double forecast;
    if (r <= kSmall || (r <= FewFor(n) && v > kNear)) {
      second_order = Kind::NEWTON;
      forecast = NewtonForecast(0);
    } else {
      if (r > kLarge || (r > kMany && v > FarFor(n))) {
        return first_order_;
      }
      second_order = Kind::INTERIOR;
      forecast = InteriorForecast();
      if (r <= kMany * std::pow(exponent_ - 1.0, 2.5) && v <= kNear &&
          BarrierForecast() < forecast) {
        second_order = Kind::BARRIER;
        forecast = BarrierForecast();
      }
    }
    const double first_order = FirstOrderForecast();
    if (forecast > first_order) return first_order_;
    budget_ = std::max(kPatience * forecast, first_order);
    return second_order;
  }

  // After a first-order method has run for a while. `work` is its own in this
  // phase.
  Kind AtLook(const Progress& progress,
              double work,
              ClosedTerms* terms,
              const double* x) {
    if (has_interior_ && barrier_budget_ > 0.0 && work > barrier_budget_) {
      return Barrier();
    }
    const double decade = std::clamp(progress.PerDecade(),
                                     FirstOrderDecade(),
                                     kSlowest * FirstOrderDecade());
    const double rest = decade * Decades();
    if (!has_newton_ || NewtonForecast(0) > rest || work < wait_) {
      return first_order_;
    }
    const int changes = terms->Changes(x);
    budget_ = newton_trials_ * kPatience * NewtonForecast(changes);
    return changes <= kCalm && NewtonForecast(changes) <= rest ? Kind::NEWTON
                                                               : first_order_;
  }

  Kind Barrier() {
    barrier_budget_ = barrier_budget_ > 0.0
                          ? 2.0 * barrier_budget_
                          : kBarrierPatience * FirstOrderForecast();
    budget_ = barrier_budget_;
    return Kind::BARRIER;
  }

  // Minimizes until stop(state of this phase) at an accepted iterate.
  template <typename Stop>
  Summary Minimize(Kind kind, double* x, const Stop& stop) {
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
      return state.counters.evaluations >= rest_evaluations || !stop(state);
    };
    return methods_[kind].Minimize(function_, rest, x);
  }

  Summary FirstOrder(Kind kind, double* x) {
    Progress progress;
    ClosedTerms terms(*function_);
    double highest = 0.0;  // of the residuals since the last look
    return Minimize(kind, x, [&](const IterationState& state) {
      const std::int64_t iterations = state.counters.iterations;
      if (iterations == 0) {
        if (!is_first_) return false;
        story_ = Format("from %.1e at v = %.1e", residual_, scales_.vanishing);
        start_vanishing_ = scales_.vanishing;
        next_ = First();
        return next_ != kind;
      }
      highest = std::max(highest, residual_);
      if (iterations % kLook != 0) return false;
      const double work = Costs::FirstOrderStep(kind) *
                          static_cast<double>(state.counters.evaluations);
      progress.Add(work, highest);
      highest = 0.0;
      next_ = AtLook(progress, work, &terms, state.x);
      return next_ != kind;
    });
  }

  Summary SecondOrder(Kind kind, double* x) {
    is_first_order_alone_ = false;
    if (kind == Kind::INTERIOR && start_vanishing_ <= kNextToZero) {
      restart_.assign(x, x + function_->NumParameters());
    }
    Summary summary = Minimize(kind, x, [&](const IterationState& state) {
      return costs_.SecondOrder(kind, state.counters) > budget_;
    });
    wait_ = kWait * costs_.SecondOrder(kind, summary.counters);
    if (kind == Kind::NEWTON && !summary.Succeeded() &&
        ++newton_failures_ >= kFewFailures) {
      // Twice as long each, so that neither can keep the other from its end.
      newton_trials_ *= 2.0;
      wait_ = std::max(wait_, newton_trials_ * kWait * NewtonForecast(0));
    }
    if (kind == Kind::INTERIOR) {
      has_tried_interior_ = true;
      // Where the origin has moved the start is not known any more.
      if (summary.counters.rebases > 0) restart_.clear();
      if (summary.scales.vanishing < kFarForBarrier) next_ = Barrier();
    } else if (kind == Kind::BARRIER && !has_tried_interior_) {
      next_ = Kind::INTERIOR;
      budget_ = kPatience * InteriorForecast();
    } else if (kind == Kind::BARRIER) {
      // Where neither finds its way fire is the fastest, and the most robust.
      next_ = first_order_ = Kind::FIRE;
    }
    return summary;
  }

  void Tell(Kind kind, const Summary& phase) {
    const Counters& c = phase.counters;
    if (IsFirstOrder(kind) && c.iterations == 0 && !phase.Succeeded()) return;
    if (!story_.empty()) story_ += ", ";
    story_ += Format("%s %lld iterations",
                     kNames[static_cast<int>(kind)],
                     static_cast<long long>(c.iterations));
    if (!IsFirstOrder(kind)) {
      story_ +=
          Format(" (%lld factors)", static_cast<long long>(c.factorizations));
    }
    if (scales_.gradient > 0.0) story_ += Format(" to %.1e", residual_);
  }

  const Methods& methods_;
  FirstOrderFunction* const function_;
  const SolveOptions& options_;
  const Costs costs_;
  const double exponent_;
  bool has_newton_ = false;
  bool has_interior_ = false;
  bool is_stopped_by_caller_ = false;
  bool is_first_ = true;
  bool is_first_order_alone_ = true;
  bool has_tried_interior_ = false;
  double start_vanishing_ = 0.0;
  std::vector<double> restart_;  // if not empty, where the next phase begins
  Kind next_ = Kind::FIRE;
  Kind first_order_ = Kind::FIRE;  // of this run
  Summary total_;
  std::string story_;

  // At the last accepted iterate; max|g| in units of its scale.
  Scales scales_;
  double residual_ = std::numeric_limits<double>::infinity();

  double budget_ = 0.0;          // of the next phase, if it is not first-order
  double barrier_budget_ = 0.0;  // of its last phase
  double wait_ = 0.0;            // work before newton is thought of
  int newton_failures_ = 0;
  double newton_trials_ = 1.0;  // how much longer newton may take by now
};

class Auto : public Solver {
 public:
  explicit Auto(Parameters* /*parameters*/) {
    std::string error;
    for (int k = 0; k < kKinds; ++k) {
      methods_.of[k] = CreateSolver(kSpecs[k], &error);
    }
  }

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override {
    Summary summary = Phases(methods_, function, options).Run(x);
    summary.solver = name();
    return summary;
  }

 private:
  Methods methods_;
};

}  // namespace

REGISTER_SOLVER(
    auto,
    Auto,
    "fire, lbfgs, newton, interior_point or lbfgs:preconditioner=barrier, by "
    "what each would still cost",
    "Bitzek et al., Phys. Rev. Lett. 97 (2006) 170201; Nocedal, Math. Comp. 35 "
    "(1980) 773; Mehrotra, SIAM J. Optim. 2 (1992) 575; the choice: this "
    "project");

}  // namespace granopt
