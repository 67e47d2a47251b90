#include "granular/jamming.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "solvers/format.h"

namespace granopt {
namespace {

void Add(const Counters& part, Counters* sum) {
  sum->iterations += part.iterations;
  sum->evaluations += part.evaluations;
  sum->hessians += part.hessians;
  sum->factorizations += part.factorizations;
  sum->solves += part.solves;
  sum->linear_iterations += part.linear_iterations;
  sum->restarts += part.restarts;
  sum->recenters += part.recenters;
  sum->rebases += part.rebases;
}

// A run of the protocol.
class Protocol {
 public:
  Protocol(const JammingOptions& options,
           const Solver& solver,
           const std::function<bool(const JammingStep&)>& observer,
           JammingResult* result,
           std::string* error)
      : options_(options),
        solver_(solver),
        observer_(observer),
        result_(result),
        error_(error) {}

  bool Run(Packing packing) {
    // Start.
    packing.SetPackingFraction(options_.phi_init);
    Relaxation state;
    JammingVerdict verdict;
    if (!RelaxAndJudge(JammingStage::START, packing, &state, &verdict)) {
      return false;
    }
    if (verdict == JammingVerdict::JAMMED) {
      return Fail(
          Format("the start is jammed already at phi_init = %.6f (p = %.3e): "
                 "begin lower",
                 options_.phi_init,
                 state.observables.pressure));
    }
    result_->start = state.packing;
    result_->unjammed = state.packing;

    Packing reference = state.packing;
    phi_unjammed_ = options_.phi_init;
    return Cycles(&reference);
  }

  bool RunFromJammed(const Packing& packing) {
    Relaxation state;
    JammingVerdict verdict;
    if (!RelaxAndJudge(JammingStage::START, packing, &state, &verdict)) {
      return false;
    }
    if (verdict != JammingVerdict::JAMMED) {
      return Fail(Format("the start is not jammed at phi = %.6f",
                         packing.PackingFraction()));
    }
    result_->start = state.packing;
    result_->unjammed = state.packing;
    result_->jammed = std::move(state);
    phi_jammed_ = packing.PackingFraction();
    bool fell = false;
    Packing reference;
    if (!Descend(&fell, &reference)) return false;
    if (fell) return Cycles(&reference);
    Conclude();
    return true;
  }

 private:
  // Growth, bisection and decompression from the unjammed `reference`, until a
  // branch lasts down to its jamming point.
  bool Cycles(Packing* reference) {
    for (int cycle = 1;; ++cycle) {
      if (!Grow(reference) || !Bisect(reference)) return false;
      result_->cycles = cycle;
      bool fell = false;
      if (!Descend(&fell, reference)) return false;
      if (!fell || cycle == kMaxCycles) break;
    }
    Conclude();
    return true;
  }

  // From the jammed state.
  bool Descend(bool* fell, Packing* reference) {
    result_->phi_cr = phi_jammed_;
    UpdateDistance(AffineSlope(), /*secant=*/false);
    return Decompress(fell, reference);
  }

  void Conclude() {
    result_->converged =
        result_->distance <= std::min(options_.error_bar, options_.accuracy);
  }

  // The branch of a jammed state may end at a finite pressure, where it loses
  // stability: the search then goes on from the unjammed state it falls to.
  static constexpr int kMaxCycles = 20;
  static constexpr int kMaxDecompressions = 60;

  // Relaxes `reference` with the packing fraction phi. Unjammed, the result
  // becomes the reference; jammed, it becomes the result.
  bool Try(JammingStage stage, double phi, Packing* reference) {
    Packing packing = *reference;
    packing.SetPackingFraction(phi);
    Relaxation state;
    JammingVerdict verdict;
    if (!RelaxAndJudge(stage, packing, &state, &verdict)) return false;
    if (verdict == JammingVerdict::JAMMED) {
      phi_jammed_ = phi;
      result_->jammed = std::move(state);
    } else {
      phi_unjammed_ = phi;
      *reference = std::move(state.packing);
    }
    return true;
  }

  // Increment step: from the unjammed `reference` to the first jammed state.
  bool Grow(Packing* reference) {
    phi_jammed_ = 0.0;
    const double phi_start = phi_unjammed_;
    for (int step = 1; phi_jammed_ == 0.0; ++step) {
      if (!Try(JammingStage::GROWTH,
               phi_start + step * options_.phi_increment,
               reference)) {
        return false;
      }
    }
    return true;
  }

  // Bisection step.
  bool Bisect(Packing* reference) {
    while (phi_jammed_ - phi_unjammed_ > options_.accuracy) {
      const double phi = 0.5 * (phi_jammed_ + phi_unjammed_);
      if (!(phi > phi_unjammed_) || !(phi < phi_jammed_)) break;
      if (!Try(JammingStage::BISECTION, phi, reference)) return false;
    }
    result_->unjammed = *reference;
    return true;
  }

  bool Fail(const std::string& line) {
    *error_ = line;
    return false;
  }

  // x = p^(1/(alpha-1)), which is linear in phi - phi_J.
  double Linear(double pressure) const {
    return std::pow(pressure, 1.0 / (options_.energy.alpha - 1.0));
  }

  // dx/dphi from the affine dp/dphi.
  double AffineSlope() const {
    const double p = result_->jammed.observables.pressure;
    const double alpha = options_.energy.alpha;
    return Linear(p) / p / (alpha - 1.0) *
           AffinePressureSlope(result_->jammed.packing,
                               result_->jammed.contacts);
  }

  void UpdateDistance(double slope, bool secant) {
    result_->secant = secant;
    result_->distance = Linear(result_->jammed.observables.pressure) / slope;
    result_->phi_j = result_->phi_cr - result_->distance;
  }

  // Down the branch; at least one step, which measures p'. The affine slope is
  // too steep, so the first step stays on the branch. Sets `fell`, with the
  // unjammed state in `reference`, if the branch ends well above its
  // extrapolation.
  bool Decompress(bool* fell, Packing* reference) {
    const bool follow = std::isfinite(options_.error_bar);
    double fraction = 0.5;
    int failures = 0;
    for (int step = 0; step < kMaxDecompressions &&
                       (!result_->secant ||
                        (follow && result_->distance > options_.error_bar));
         ++step) {
      const double phi = result_->phi_cr - fraction * result_->distance;
      if (!(phi < result_->phi_cr)) return true;  // below the last digit
      Packing packing = result_->jammed.packing;
      packing.SetPackingFraction(phi);
      Relaxation state;
      JammingVerdict verdict;
      if (!RelaxAndJudge(
              JammingStage::DECOMPRESSION, packing, &state, &verdict)) {
        return false;
      }
      if (verdict != JammingVerdict::JAMMED) {
        fraction *= 0.5;
        if (++failures < 4) continue;
        if (follow) {
          *fell = true;
          *reference = std::move(state.packing);
          phi_unjammed_ = phi;
        }
        return true;
      }
      const double slope = (Linear(result_->jammed.observables.pressure) -
                            Linear(state.observables.pressure)) /
                           (result_->phi_cr - phi);
      if (follow) {
        result_->jammed = std::move(state);
        result_->phi_cr = phi;
        phi_jammed_ = phi;
      }
      if (slope > 0.0) {
        UpdateDistance(slope, /*secant=*/true);
        if (failures == 0) fraction = 0.9;
      } else {
        // It rearranged upwards: another branch, whose slope is not known yet.
        UpdateDistance(AffineSlope(), /*secant=*/false);
        fraction = 0.5;
        if (!follow) return true;
      }
    }
    return true;
  }

  bool RelaxAndJudge(JammingStage stage,
                     const Packing& packing,
                     Relaxation* state,
                     JammingVerdict* verdict) {
    SolveOptions solve = options_.solve;
    if (stage == JammingStage::DECOMPRESSION) {
      solve.vanishing_tolerance =
          std::min(solve.vanishing_tolerance, 1e-2 * options_.error_bar);
    }
    const Packing* start = &packing;
    Packing again;
    for (int attempt = 1;; ++attempt) {
      if (!Relax(*start, options_.energy, solver_, solve, state, error_)) {
        return false;
      }
      ++result_->relaxations;
      Add(state->summary.counters, &result_->counters);
      result_->seconds += state->summary.seconds;
      *verdict = Judge(*state);
      if (observer_) {
        JammingStep step;
        step.stage = stage;
        step.relaxation = result_->relaxations;
        step.phi = packing.PackingFraction();
        step.verdict = *verdict;
        step.result = state;
        step.phi_unjammed = phi_unjammed_;
        step.phi_jammed = phi_jammed_;
        step.distance = result_->distance;
        if (!observer_(step)) return Fail("stopped by the caller");
      }
      if (*verdict != JammingVerdict::UNDECIDED) return true;
      if (attempt == options_.max_attempts) {
        return Fail(
            Format("undecided at phi = %.10f after %d attempts: max|g| = %.2e "
                   "mean forces > %.1e, p = %.3e (%s)",
                   packing.PackingFraction(),
                   attempt,
                   state->observables.relative_residual,
                   options_.undecided_residual,
                   state->observables.pressure,
                   state->summary.message.c_str()));
      }
      again = state->packing;
      start = &again;
    }
  }

  JammingVerdict Judge(const Relaxation& state) const {
    switch (state.summary.reason) {
      case StopReason::VANISHED:
        return JammingVerdict::UNJAMMED;
      case StopReason::CONVERGED:
        return JammingVerdict::JAMMED;
      default:
        return state.observables.relative_residual <=
                       options_.undecided_residual
                   ? JammingVerdict::JAMMED
                   : JammingVerdict::UNDECIDED;
    }
  }

  const JammingOptions& options_;
  const Solver& solver_;
  const std::function<bool(const JammingStep&)>& observer_;
  JammingResult* result_;
  std::string* error_;
  double phi_unjammed_ = 0.0;
  double phi_jammed_ = 0.0;
};

}  // namespace

const char* JammingStageName(JammingStage stage) {
  switch (stage) {
    case JammingStage::START:
      return "start";
    case JammingStage::GROWTH:
      return "growth";
    case JammingStage::BISECTION:
      return "bisection";
    case JammingStage::DECOMPRESSION:
      return "decompression";
  }
  return "unknown";
}

const char* JammingVerdictName(JammingVerdict verdict) {
  switch (verdict) {
    case JammingVerdict::UNJAMMED:
      return "unjammed";
    case JammingVerdict::JAMMED:
      return "jammed";
    case JammingVerdict::UNDECIDED:
      return "undecided";
  }
  return "unknown";
}

double AffinePressureSlope(const Packing& packing,
                           const std::vector<Contact>& contacts) {
  const int d = packing.dimension();
  double sum = 0.0;
  for (const Contact& c : contacts) {
    sum += c.stiffness * c.distance *
           (packing.radii[c.id.i] + packing.radii[c.id.j]);
  }
  return sum / (d * packing.box.Volume()) / (d * packing.PackingFraction());
}

namespace {

bool CheckOptions(const Packing& start,
                  const JammingOptions& options,
                  std::string* error) {
  const auto positive = [error](const char* name, double value) {
    if (value > 0.0 && std::isfinite(value)) return true;
    *error = Format("%s = %g must be positive", name, value);
    return false;
  };
  return positive("phi_init", options.phi_init) &&
         positive("dphi", options.phi_increment) &&
         positive("epsilon", options.accuracy) &&
         (std::isinf(options.error_bar) ||
          positive("error_bar", options.error_bar)) &&
         start.IsValid(error);
}

}  // namespace

bool FindJamming(const Packing& start,
                 const JammingOptions& options,
                 const Solver& solver,
                 const std::function<bool(const JammingStep&)>& observer,
                 JammingResult* result,
                 std::string* error) {
  if (!CheckOptions(start, options, error)) return false;
  *result = JammingResult();
  return Protocol(options, solver, observer, result, error).Run(start);
}

bool DecompressToJamming(
    const Packing& start,
    const JammingOptions& options,
    const Solver& solver,
    const std::function<bool(const JammingStep&)>& observer,
    JammingResult* result,
    std::string* error) {
  if (!CheckOptions(start, options, error)) return false;
  if (std::isinf(options.error_bar)) {
    *error = "error_bar must be finite";
    return false;
  }
  *result = JammingResult();
  return Protocol(options, solver, observer, result, error)
      .RunFromJammed(start);
}

}  // namespace granopt
