// The method that a user need not choose: first-order steps where they are
// cheap, second-order ones where they are not.
//
//   newton          small loads, and the end of what lbfgs has settled
//   interior_point  loads that are about to change many contacts
//   barrier         lbfgs:preconditioner=barrier,shift=1e-6: what
//                   interior_point does not find its way through near jamming
//   lbfgs           (memory=8) where contacts change all over, and far from
//                   jamming
//
// Each starts from the best point of the one before it, so that none returns a
// worse one. Which one begins is read off two numbers at the start: the
// residual r (max|g| in units of Scales::gradient) and v = Scales::vanishing,
// about the distance from jamming,
//   r <= kSmall                        newton
//   r <= kLarge, but for
//     r > kMany with v > kFar          interior_point
//   else                               lbfgs
// unless lbfgs is forecast to be cheaper. Each of the others is left once it
// has cost some times what it promised. While lbfgs goes on, the closed terms
// among objects that hold each other are compared from look to look: where
// hardly any opens or closes any more, newton will end the run within a few
// factors; before, it would follow one instability into the next. Costs are
// counts in units of an evaluation, never times.
//
// Deviations from the methods' own defaults: none but that they are stopped
// from outside.

#include <algorithm>
#include <cmath>
#include <cstdint>
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
constexpr double kMany = 0.4;
constexpr double kLarge = 3.0;
constexpr double kFar = 3e-3;
// Above this lbfgs goes on where interior_point has failed.
constexpr double kFarForBarrier = 1.5e-3;
// newton ends what lbfgs has settled once so many terms change from look to
// look at most.
constexpr int kCalm = 4;

// A decade of max|g| takes lbfgs kDecade v^(-1/3) evaluations: towards jamming
// the lowest frequencies fall, and the steps of first-order methods with them.
// Where many contacts change it takes kManyTimes as many.
constexpr double kDecade = 18.0;
constexpr double kManyTimes = 2.0;
// What its progress says is believed up to so many times that.
constexpr double kSlowest = 20.0;

// Iterations that newton, one more for each term that changed lately, and
// interior_point are expected to take.
constexpr double kNewtonIterations = 4.0;
constexpr double kInteriorIterations = 9.0;
// They may take so many times what they promised, at the start also what lbfgs
// was forecast to take; barrier so many times the latter, and twice as much
// each time that it is tried again.
constexpr double kPatience = 2.0;
constexpr double kBarrierPatience = 10.0;
// After a newton that did not end the run lbfgs first takes so many times what
// that took.
constexpr double kWait = 2.0;

// Iterations of lbfgs between two looks.
constexpr std::int64_t kLook = 100;

enum class Kind { FIRST, NEWTON, INTERIOR, BARRIER };
constexpr const char* kNames[] = {
    "lbfgs", "newton", "interior_point", "barrier"};

// Costs in evaluations of n unknowns in blocks, as measured with 1024 to 65536
// discs (README, where the time goes), a million, for which approximate minimum
// degree fills far more, and 300 to 2000 spheres.
struct Costs {
  Costs(int n, int block)
      : factor(block > 2 ? 0.3 * (n / block)
                         : 42.0 * std::sqrt(n / 8192.0) *
                               std::max(1.0, std::pow(n / 262144.0, 2.0))),
        solve(0.2 * factor) {}

  double First(const Counters& c) const {
    return 2.0 * static_cast<double>(c.evaluations);
  }
  double NewtonIteration() const { return factor + solve + 3.0 * hessian; }
  double InteriorIteration() const {
    return 1.3 * factor + 3.5 * solve + hessian + gaps;
  }
  double SecondOrder(Kind kind, const Counters& c) const {
    const double vectors = kind == Kind::INTERIOR  ? gaps
                           : kind == Kind::BARRIER ? 4.0
                                                   : 0.0;
    return (c.factorizations > 0 ? analysis : 0.0) +
           factor * static_cast<double>(c.factorizations) +
           solve * static_cast<double>(c.solves) +
           hessian * static_cast<double>(c.hessians) +
           vectors * static_cast<double>(c.iterations) +
           static_cast<double>(c.evaluations);
  }

  const double factor, solve;
  const double analysis = 70.0;
  const double hessian = 4.0;
  const double gaps = 30.0;  // and vectors: of interior_point's iteration
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
  std::unique_ptr<Solver> of[4];  // by Kind
  const Solver& operator[](Kind kind) const {
    return *of[static_cast<int>(kind)];
  }
};

int BlockSizeOf(const FirstOrderFunction& function) {
  const auto* second = dynamic_cast<const SecondOrderFunction*>(&function);
  return second == nullptr ? 1 : second->BlockSize();
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
        costs_(function->NumParameters(), BlockSizeOf(*function)) {
    std::string why;
    has_newton_ = methods[Kind::NEWTON].Supports(*function, &why);
    has_interior_ = methods[Kind::INTERIOR].Supports(*function, &why) &&
                    methods[Kind::BARRIER].Supports(*function, &why);
  }

  Summary Run(double* x) {
    Kind kind = Kind::FIRST;
    bool is_stuck = false;  // lbfgs gave up, and newton has its last word
    for (;;) {
      next_ = Kind::FIRST;
      Summary phase =
          kind == Kind::FIRST ? FirstOrder(x) : SecondOrder(kind, x);
      scales_ = phase.scales;
      SetResidual(phase.max_gradient);
      Tell(kind, phase);
      const StopReason reason = phase.reason;
      total_ = is_first_ ? std::move(phase)
                         : Joined(std::move(total_), std::move(phase));
      is_first_ = false;
      if (reason == StopReason::MAX_MEMORY) {
        has_newton_ = has_interior_ = false;
        next_ = Kind::FIRST;
      } else if (reason == StopReason::NO_PROGRESS) {
        if (is_stuck || (kind == Kind::FIRST && !has_newton_)) break;
        is_stuck = kind == Kind::FIRST;
        if (is_stuck) next_ = Kind::NEWTON;
      } else if (reason != StopReason::CALLBACK || is_stopped_by_caller_) {
        break;
      }
      if (total_.counters.evaluations >= options_.max_evaluations) break;
      kind = next_;
    }
    if (!is_lbfgs_alone_) total_.message = story_ + ": " + total_.message;
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

  // What methods would still take.
  double FirstDecade() const {
    return kDecade * std::pow(scales_.vanishing, -1.0 / 3.0);
  }
  double FirstForecast() const {
    return FirstDecade() * Decades() * (residual_ > kMany ? kManyTimes : 1.0);
  }
  double NewtonForecast(int changes) const {
    return costs_.analysis +
           (kNewtonIterations + changes) * costs_.NewtonIteration();
  }
  double InteriorForecast() const {
    return costs_.analysis + kInteriorIterations * costs_.InteriorIteration();
  }

  Kind First() {
    const double first = FirstForecast();
    if (residual_ <= kSmall) {
      budget_ = std::max(kPatience * NewtonForecast(0), first);
      return has_newton_ && NewtonForecast(0) <= first ? Kind::NEWTON
                                                       : Kind::FIRST;
    }
    budget_ = std::max(kPatience * InteriorForecast(), first);
    const bool buckles = residual_ > kMany && scales_.vanishing > kFar;
    return has_interior_ && residual_ <= kLarge && !buckles &&
                   InteriorForecast() <= first
               ? Kind::INTERIOR
               : Kind::FIRST;
  }

  // After lbfgs has run for a while. `work` is its own in this phase.
  Kind AtLook(const Progress& progress,
              double work,
              ClosedTerms* terms,
              const double* x) {
    if (has_interior_ && barrier_budget_ > 0.0 && work > barrier_budget_) {
      return Barrier();
    }
    const double decade = std::clamp(
        progress.PerDecade(), FirstDecade(), kSlowest * FirstDecade());
    const double rest = decade * Decades();
    if (!has_newton_ || NewtonForecast(0) > rest || work < wait_) {
      return Kind::FIRST;
    }
    const int changes = terms->Changes(x);
    budget_ = kPatience * NewtonForecast(changes);
    return changes <= kCalm && NewtonForecast(changes) <= rest ? Kind::NEWTON
                                                               : Kind::FIRST;
  }

  Kind Barrier() {
    barrier_budget_ = barrier_budget_ > 0.0
                          ? 2.0 * barrier_budget_
                          : kBarrierPatience * FirstForecast();
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

  Summary FirstOrder(double* x) {
    Progress progress;
    ClosedTerms terms(*function_);
    double highest = 0.0;  // of the residuals since the last look
    return Minimize(Kind::FIRST, x, [&](const IterationState& state) {
      const std::int64_t iterations = state.counters.iterations;
      if (iterations == 0) {
        if (!is_first_) return false;
        story_ = Format("from %.1e at v = %.1e", residual_, scales_.vanishing);
        next_ = First();
        return next_ != Kind::FIRST;
      }
      highest = std::max(highest, residual_);
      if (iterations % kLook != 0) return false;
      const double work = costs_.First(state.counters);
      progress.Add(work, highest);
      highest = 0.0;
      next_ = AtLook(progress, work, &terms, state.x);
      return next_ != Kind::FIRST;
    });
  }

  Summary SecondOrder(Kind kind, double* x) {
    is_lbfgs_alone_ = false;
    Summary summary = Minimize(kind, x, [&](const IterationState& state) {
      return costs_.SecondOrder(kind, state.counters) > budget_;
    });
    wait_ = kWait * costs_.SecondOrder(kind, summary.counters);
    if (kind == Kind::INTERIOR && summary.scales.vanishing < kFarForBarrier) {
      next_ = Barrier();
    }
    return summary;
  }

  void Tell(Kind kind, const Summary& phase) {
    const Counters& c = phase.counters;
    if (kind == Kind::FIRST && c.iterations == 0 && !phase.Succeeded()) return;
    if (!story_.empty()) story_ += ", ";
    story_ += Format("%s %lld iterations",
                     kNames[static_cast<int>(kind)],
                     static_cast<long long>(c.iterations));
    if (kind != Kind::FIRST) {
      story_ +=
          Format(" (%lld factors)", static_cast<long long>(c.factorizations));
    }
    if (scales_.gradient > 0.0) story_ += Format(" to %.1e", residual_);
  }

  const Methods& methods_;
  FirstOrderFunction* const function_;
  const SolveOptions& options_;
  const Costs costs_;
  bool has_newton_ = false;
  bool has_interior_ = false;
  bool is_stopped_by_caller_ = false;
  bool is_first_ = true;
  bool is_lbfgs_alone_ = true;
  Kind next_ = Kind::FIRST;
  Summary total_;
  std::string story_;

  // At the last accepted iterate; max|g| in units of its scale.
  Scales scales_;
  double residual_ = std::numeric_limits<double>::infinity();

  double budget_ = 0.0;          // of the next phase, if it is not lbfgs'
  double barrier_budget_ = 0.0;  // of its last phase
  double wait_ = 0.0;            // lbfgs' work before newton is thought of
};

class Auto : public Solver {
 public:
  explicit Auto(Parameters* /*parameters*/) {
    std::string error;
    const char* const specs[] = {"lbfgs:memory=8",
                                 "newton",
                                 "interior_point",
                                 "lbfgs:preconditioner=barrier,shift=1e-6"};
    for (int k = 0; k < 4; ++k) methods_.of[k] = CreateSolver(specs[k], &error);
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
    "lbfgs, newton, interior_point or lbfgs:preconditioner=barrier, "
    "by what each would still cost",
    "Nocedal, Math. Comp. 35 (1980) 773; Mehrotra, SIAM J. Optim. 2 "
    "(1992) 575; the choice: this project");

}  // namespace granopt
