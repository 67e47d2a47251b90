#include "granular/jamming.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "granular/contact_changes.h"
#include "solvers/format.h"

namespace granopt {
namespace {

void SetPackingFraction(JammingRoute route, double phi, Packing* packing) {
  if (route == JammingRoute::RADII) {
    packing->SetPackingFraction(phi);
    return;
  }
  const int d = packing->dimension();
  packing->Deform(std::pow(packing->PackingFraction() / phi, 1.0 / d) *
                  SmallMatrix::Identity(d, d));
}

// x = p^(1 / (alpha - 1)), which is linear in phi - phi_J.
double Linear(double pressure, double alpha) {
  return std::pow(pressure, 1.0 / (alpha - 1.0));
}

// dx/dphi from the affine dp/dphi.
double AffineSlope(const Relaxation& state, double alpha) {
  const double p = state.observables.pressure;
  return Linear(p, alpha) / p / (alpha - 1.0) *
         AffinePressureSlope(state.packing, state.contacts);
}

ContactPairs RigidContacts(const Relaxation& state) {
  std::vector<bool> is_rigid = state.observables.is_rattler;
  is_rigid.flip();
  return PairsInTouch(state.contacts, is_rigid);
}

// A relaxation that its method gave up counts as jammed if max|g| is at most
// this part of the mean force, else it is repeated from where it ended.
constexpr double kUndecidedResidual = 1e-3;
constexpr int kMaxAttempts = 5;

// The protocol: what follows from a relaxation.
class Search {
 public:
  Search(const JammingOptions& options, JammingState* state)
      : options_(options), s_(*state) {}

  JammingVerdict Judge(const Relaxation& result) const {
    switch (result.summary.reason) {
      case StopReason::VANISHED:
        return JammingVerdict::UNJAMMED;
      case StopReason::CONVERGED:
        return JammingVerdict::JAMMED;
      default:
        return result.observables.relative_residual <= kUndecidedResidual
                   ? JammingVerdict::JAMMED
                   : JammingVerdict::UNDECIDED;
    }
  }

  // For the next relaxation.
  SolveOptions MakeSolveOptions() const {
    SolveOptions solve = options_.solve;
    if (s_.stage == JammingStage::DECOMPRESSION) {
      const double aim = (1.0 - s_.fraction) * s_.distance;
      solve.vanishing_tolerance = std::min(
          solve.vanishing_tolerance, 1e-2 * std::min(options_.error_bar, aim));
    }
    return solve;
  }

  // Sets the stage and the packing that comes next. Returns false with one line
  // in `error` where the search ends without a result.
  bool Decide(JammingVerdict verdict,
              const Relaxation& result,
              std::string* error) {
    if (verdict == JammingVerdict::UNDECIDED) {
      if (++s_.attempt == kMaxAttempts) {
        *error = Format(
            "undecided at phi = %.10f after %d attempts: max|g| = %.2e mean "
            "forces > %.1e, p = %.3e (%s)",
            s_.phi_next,
            s_.attempt,
            result.observables.relative_residual,
            kUndecidedResidual,
            result.observables.pressure,
            result.summary.message.c_str());
        return false;
      }
      s_.next = result.packing;
      return true;
    }
    s_.attempt = 0;
    const bool jammed = verdict == JammingVerdict::JAMMED;
    switch (s_.stage) {
      case JammingStage::START:
        s_.start = result.packing;
        s_.unjammed = result.packing;
        s_.reference = result.packing;
        if (!jammed) {
          s_.phi_unjammed = s_.phi_next;
          BeginGrowth();
          return true;
        }
        if (!Follow()) {
          *error = Format(
              "the start is jammed already at phi_init = %.6f (p = %.3e): "
              "begin lower",
              s_.phi_next,
              result.observables.pressure);
          return false;
        }
        KeepJammed(result);
        BeginDescent();
        return true;
      case JammingStage::GROWTH:
        if (!jammed) {
          KeepUnjammed(result);
          s_.phi_jammed = 0.0;
          Grow(s_.reference);
          return true;
        }
        if (s_.phi_jammed == 0.0) s_.unjammed = s_.reference;
        KeepJammed(result);
        if (options_.overcompression > 0.0) {
          if (s_.distance < options_.overcompression) {
            Grow(s_.jammed);
          } else {
            BeginDescent();
          }
          return true;
        }
        Bisect();
        return true;
      case JammingStage::BISECTION:
        if (jammed) {
          KeepJammed(result);
        } else {
          KeepUnjammed(result);
        }
        Bisect();
        return true;
      case JammingStage::DECOMPRESSION:
        if (jammed) {
          StepDown(result);
        } else {
          StepTooLong(result);
        }
        return true;
      case JammingStage::FINISHED:
        break;
    }
    return true;
  }

 private:
  // The branch of a jammed state may end at a finite pressure, where it loses
  // stability: the search then goes on from the unjammed state it falls to.
  static constexpr int kMaxCycles = 20;
  static constexpr int kMaxDecompressions = 60;
  static constexpr int kMaxFailures = 4;

  bool Follow() const { return std::isfinite(options_.error_bar); }

  void SetNext(JammingStage stage, const Packing& from, double phi) {
    s_.stage = stage;
    s_.phi_next = phi;
    s_.next = from;
    SetPackingFraction(options_.route, phi, &s_.next);
  }

  void Finish() {
    s_.stage = JammingStage::FINISHED;
    s_.next = Packing();
  }

  void KeepUnjammed(const Relaxation& result) {
    s_.phi_unjammed = s_.phi_next;
    s_.reference = result.packing;
  }

  void KeepJammed(const Relaxation& result) {
    s_.phi_jammed = s_.phi_next;
    s_.jammed = result.packing;
    s_.summary = result.summary;
    s_.summary.trace.clear();
    s_.pressure = result.observables.pressure;
    s_.affine_slope = AffineSlope(result, options_.energy.alpha);
    s_.rigid_contacts = RigidContacts(result);
    s_.excess_contacts = result.observables.rigid_contacts -
                         result.observables.isostatic_contacts;
    UpdateDistance(s_.affine_slope, /*secant=*/false);
  }

  void UpdateDistance(double slope, bool secant) {
    s_.secant = secant;
    s_.distance = Linear(s_.pressure, options_.energy.alpha) / slope;
  }

  // From the unjammed reference.
  void BeginGrowth() {
    ++s_.cycles;
    s_.phi_jammed = 0.0;
    s_.phi_start = s_.phi_unjammed;
    s_.growth_steps = 0;
    Grow(s_.reference);
  }

  void Grow(const Packing& from) {
    ++s_.growth_steps;
    SetNext(JammingStage::GROWTH,
            from,
            s_.phi_start + s_.growth_steps * options_.phi_increment);
  }

  void Bisect() {
    const double phi = 0.5 * (s_.phi_jammed + s_.phi_unjammed);
    if (s_.phi_jammed - s_.phi_unjammed > options_.accuracy &&
        phi > s_.phi_unjammed && phi < s_.phi_jammed) {
      SetNext(JammingStage::BISECTION, s_.reference, phi);
      return;
    }
    s_.unjammed = s_.reference;
    BeginDescent();
  }

  // The affine slope is too steep, so the first step stays on the branch.
  void BeginDescent() {
    s_.fraction = 0.5;
    s_.failures = 0;
    s_.decompressions = 0;
    s_.contacts_kept = false;
    Descend();
  }

  void Descend() {
    const bool exact = s_.excess_contacts == 0 && s_.contacts_kept;
    // At least one step, which measures p'.
    bool on = !s_.secant;
    if (Follow()) {
      on = on || s_.distance > options_.error_bar;
      if (options_.until_isostatic && !exact) {
        on = on || (1.0 - s_.fraction) * s_.distance >=
                       JammingOptions::kFinestDistance;
      }
    }
    const double phi = s_.phi_jammed - s_.fraction * s_.distance;
    if (!on || s_.decompressions == kMaxDecompressions ||
        !(phi < s_.phi_jammed)) {
      Finish();
      return;
    }
    ++s_.decompressions;
    SetNext(JammingStage::DECOMPRESSION, s_.jammed, phi);
  }

  void StepDown(const Relaxation& result) {
    const double alpha = options_.energy.alpha;
    const double slope = (Linear(s_.pressure, alpha) -
                          Linear(result.observables.pressure, alpha)) /
                         (s_.phi_jammed - s_.phi_next);
    if (Follow()) {
      s_.contacts_kept = RigidContacts(result) == s_.rigid_contacts;
      KeepJammed(result);
    }
    if (slope > 0.0) {
      UpdateDistance(slope, /*secant=*/true);
      // After a step that was too long, towards there again by doubling: the
      // part of the branch that it fell off may be behind.
      s_.fraction = s_.failures == 0 ? 0.9 : std::min(0.9, 2.0 * s_.fraction);
    } else if (Follow()) {
      // It rearranged upwards: another branch, whose slope is not known yet.
      s_.fraction = 0.5;
    } else {
      Finish();
      return;
    }
    Descend();
  }

  // Unjammed, well above the extrapolation.
  void StepTooLong(const Relaxation& result) {
    s_.fraction *= 0.5;
    if (++s_.failures < kMaxFailures) {
      Descend();
    } else if (Follow() && s_.cycles < kMaxCycles) {
      KeepUnjammed(result);
      BeginGrowth();
    } else {
      Finish();
    }
  }

  const JammingOptions& options_;
  JammingState& s_;
};

// The jammed state as a relaxation, measured from the packing alone, so that a
// search that was interrupted measures the same.
bool Measured(const JammingState& state,
              const ContactEnergyOptions& options,
              Relaxation* result,
              std::string* error) {
  if (!MeasureAsItIs(state.jammed, options, result, error)) return false;
  result->summary = state.summary;
  return true;
}

bool CheckOptions(const Packing& start,
                  const JammingOptions& options,
                  std::string* error) {
  const auto positive = [error](const char* name, double value) {
    if (value > 0.0 && std::isfinite(value)) return true;
    *error = Format("%s = %g must be positive", name, value);
    return false;
  };
  const auto not_negative = [&](const char* name, double value) {
    return value == 0.0 || positive(name, value);
  };
  return not_negative("phi_init", options.phi_init) &&
         not_negative("overcompression", options.overcompression) &&
         positive("dphi", options.phi_increment) &&
         positive("epsilon", options.accuracy) &&
         (std::isinf(options.error_bar) ||
          positive("error_bar", options.error_bar)) &&
         start.IsValid(error);
}

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
    case JammingStage::FINISHED:
      return "finished";
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

const char* JammingRouteName(JammingRoute route) {
  return route == JammingRoute::CELL ? "cell" : "radii";
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

bool BeginJamming(const Packing& start,
                  const JammingOptions& options,
                  JammingState* state,
                  std::string* error) {
  if (!CheckOptions(start, options, error)) return false;
  *state = JammingState();
  state->next = start;
  if (options.phi_init > 0.0) {
    SetPackingFraction(options.route, options.phi_init, &state->next);
    state->phi_next = options.phi_init;
  } else {
    state->phi_next = start.PackingFraction();
  }
  return true;
}

bool ContinueJamming(const JammingOptions& options,
                     const Solver& solver,
                     const JammingObserver& observer,
                     JammingState* state,
                     JammingResult* result,
                     std::string* error) {
  *result = JammingResult();
  Search search(options, state);
  bool ok = true;
  while (ok && state->stage != JammingStage::FINISHED) {
    Relaxation relaxation;
    if (!Relax(state->next,
               options.energy,
               solver,
               search.MakeSolveOptions(),
               &relaxation,
               error)) {
      return false;
    }
    ++state->relaxations;
    state->counters += relaxation.summary.counters;
    state->seconds += relaxation.summary.seconds;
    JammingStep step;
    step.stage = state->stage;
    step.relaxation = state->relaxations;
    step.phi = state->phi_next;
    step.verdict = search.Judge(relaxation);
    ok = search.Decide(step.verdict, relaxation, error);
    if (observer) {
      step.result = &relaxation;
      step.state = state;
      step.phi_unjammed = state->phi_unjammed;
      step.phi_jammed = state->phi_jammed;
      step.distance = state->distance;
      if (!observer(step) && ok) {
        *error = "stopped by the caller";
        ok = false;
      }
    }
  }
  result->start = state->start;
  result->unjammed = state->unjammed;
  result->phi_cr = state->phi_jammed;
  result->phi_unjammed = state->phi_unjammed;
  result->distance = state->distance;
  result->phi_j = result->phi_cr - result->distance;
  result->secant = state->secant;
  result->cycles = state->cycles;
  result->relaxations = state->relaxations;
  result->counters = state->counters;
  result->seconds = state->seconds;
  if (!ok) return false;
  result->converged =
      result->distance <= std::min(options.error_bar, options.accuracy);
  return Measured(*state, options.energy, &result->jammed, error);
}

bool FindJamming(const Packing& start,
                 const JammingOptions& options,
                 const Solver& solver,
                 const JammingObserver& observer,
                 JammingResult* result,
                 std::string* error) {
  JammingState state;
  return BeginJamming(start, options, &state, error) &&
         ContinueJamming(options, solver, observer, &state, result, error);
}

}  // namespace granopt
