#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "granular/flow/backward_euler.h"
#include "solvers/format.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

using Sweep = StepperOptions::Sweep;

class ImplicitStepper : public BackwardEuler {
 public:
  explicit ImplicitStepper(const StepperOptions& options)
      : BackwardEuler(options) {}

  double FirstStep() const override {
    return options_.is_adaptive ? std::min(options_.first_step, options_.step)
                                : options_.step;
  }

 protected:
  void Begin(const FlowScene& scene, FlowState* state) override {
    scene.Forces(state->x.data(), state->time, false, &start_);
    ++state->sweeps;
  }

  bool Solve(const FlowScene& scene,
             double dt,
             FlowState* state,
             StepReport* report,
             Failure* failure) override {
    x_ = state->x;
    v_.assign(state->x.size(), 0.0);
    const Outcome outcome = Iterate(scene, dt, state, report);
    if (outcome == Outcome::CONVERGED) return true;
    failure->iterations = iterations_;
    failure->ratio = change_ / options_.tolerance;
    failure->reason =
        outcome == Outcome::NOT_FINITE ? "not finite" : "not converged";
    failure->message =
        Format(" did not converge: change %.2e > %.2e after %d iterations",
               change_,
               options_.tolerance,
               iterations_);
    failure->factor = factor_;
    return false;
  }

  double NextStep(double dt, double wanted) const override {
    return dt < wanted ? std::max(wanted, factor_ * dt) : factor_ * dt;
  }

 private:
  enum class Outcome { CONVERGED, NOT_CONVERGED, NOT_FINITE };

  // The fixed point of one step from x_ = r^L; v_ and used_ are those of its
  // last iterate.
  Outcome Iterate(const FlowScene& scene,
                  double dt,
                  FlowState* state,
                  StepReport* report) {
    const int n = scene.size(), stride = scene.stride();
    const std::vector<double>& w = scene.inverse_mass();
    const double shrink = 1.0 / (1.0 + dt * scene.options().damping);
    const double gamma = options_.relaxation;
    double first_change = 1.0;
    factor_ = 0.5;
    change_ = std::numeric_limits<double>::infinity();
    for (int k = 1; k <= options_.desired_iterations; ++k) {
      iterations_ = k;
      ++report->iterations;
      // Sweeps grain by grain leave each grain's last near field in used_.
      const bool is_known = k > 1 && options_.sweep != Sweep::JACOBI &&
                            scene.near_field() != nullptr &&
                            !scene.options().soft_contact;
      if (k == 1 && !scene.options().external) {
        used_ = start_;
      } else if (!is_known) {
        scene.Forces(x_.data(), state->time + dt, false, &used_);
        ++state->sweeps;
      }
      ApplyContacts(scene, dt, *state);
      last_ = x_;
      if (options_.sweep == Sweep::JACOBI || scene.near_field() == nullptr) {
        for (int c = 0; c < 3; ++c) {
          for (int i = 0; i < n; ++i) {
            const int e = c * stride + i;
            if (w[i] == 0.0) continue;
            v_[e] = (u_[e] + dt * used_.total[e] * w[i]) * shrink;
            x_[e] = gamma * (state->x[e] + dt * v_[e]) + (1.0 - gamma) * x_[e];
          }
        }
      } else {
        SweepGroups(scene, dt, shrink, state);
      }
      double moved = 0.0, way = 0.0;
      for (int i = 0; i < n; ++i) {
        double a = 0.0, b = 0.0;
        for (int c = 0; c < 3; ++c) {
          const int e = c * stride + i;
          a += (x_[e] - last_[e]) * (x_[e] - last_[e]);
          b += (x_[e] - state->x[e]) * (x_[e] - state->x[e]);
        }
        moved += std::sqrt(a);
        way += std::sqrt(b);
      }
      if (!std::isfinite(moved) || !std::isfinite(way)) {
        return Outcome::NOT_FINITE;
      }
      change_ = way > 0.0 ? moved / way : 0.0;
      if (k == 1) first_change = change_;
      if (change_ <= options_.tolerance) break;
    }
    factor_ = options_.safety * Phi(first_change);
    return change_ <= options_.tolerance ? Outcome::CONVERGED
                                         : Outcome::NOT_CONVERGED;
  }

  // (6.8) over Dt. An iteration that changes nothing says that any step would
  // do: ten times, for one.
  double Phi(double first_change) const {
    constexpr double kMost = 10.0;
    constexpr double p = 2.0;  // of eta = S Dt^p
    if (first_change <= options_.tolerance || change_ <= 0.0) return kMost;
    const double target = std::pow(options_.tolerance / first_change,
                                   1.0 / (p * options_.desired_iterations));
    const double reached =
        std::pow(change_ / first_change, 1.0 / (p * iterations_));
    return std::clamp(target / reached, 0.1, kMost);
  }

  // Gauss-Seidel, grain by grain; in groups, each with the other groups frozen
  // and iterated by itself until it has converged.
  void SweepGroups(const FlowScene& scene,
                   double dt,
                   double shrink,
                   FlowState* state) {
    const int n = scene.size(), stride = scene.stride();
    const int groups = options_.sweep == Sweep::GAUSS_SEIDEL
                           ? 1
                           : std::min(options_.groups, n);
    const auto first_of = [n, groups](int g) {
      return static_cast<int>(static_cast<long long>(n) * g / groups);
    };
    std::vector<std::vector<double>> frozen(groups);
    std::vector<int> inner(groups, 0);
    ForEach(groups, [&](int g) {
      const int first = first_of(g), end = first_of(g + 1);
      std::vector<double>& x = frozen[g];
      x = x_;
      const int most = options_.sweep == Sweep::GAUSS_SEIDEL ? 1 : kMostInner;
      for (int pass = 0; pass < most; ++pass) {
        ++inner[g];
        double moved = 0.0, way = 0.0;
        for (int i = first; i < end; ++i) {
          if (scene.inverse_mass()[i] == 0.0) continue;
          UpdateGrain(scene, i, dt, shrink, *state, &x, &moved, &way);
        }
        if (!(moved > options_.tolerance * way)) break;
      }
    });
    // Work in sweeps over all grains.
    state->sweeps += *std::max_element(inner.begin(), inner.end());
    for (int g = 0; g < groups; ++g) {
      const int first = first_of(g), end = first_of(g + 1);
      for (int c = 0; c < 3; ++c) {
        std::copy(frozen[g].begin() + c * stride + first,
                  frozen[g].begin() + c * stride + end,
                  x_.begin() + c * stride + first);
      }
    }
  }

  // One grain with the near field of all others where they are in x. Soft
  // contacts and external forces are those of the last sweep.
  void UpdateGrain(const FlowScene& scene,
                   int i,
                   double dt,
                   double shrink,
                   const FlowState& state,
                   std::vector<double>* x,
                   double* moved,
                   double* way) {
    const int stride = scene.stride();
    const double gamma = options_.relaxation;
    double at[3], force[3];
    for (int c = 0; c < 3; ++c) at[c] = (*x)[c * stride + i];
    scene.near_field()->ForceOn(i, x->data(), at, force, nullptr);
    double a = 0.0, b = 0.0;
    for (int c = 0; c < 3; ++c) {
      const int e = c * stride + i;
      // used_ holds what the ledger books.
      used_.total[e] += force[c] - used_.near_field[e];
      used_.near_field[e] = force[c];
      v_[e] = (u_[e] + dt * used_.total[e] * scene.inverse_mass()[i]) * shrink;
      const double next =
          gamma * (state.x[e] + dt * v_[e]) + (1.0 - gamma) * at[c];
      a += (next - at[c]) * (next - at[c]);
      b += (next - state.x[e]) * (next - state.x[e]);
      (*x)[e] = next;
    }
    *moved += std::sqrt(a);
    *way += std::sqrt(b);
  }

  static constexpr int kMostInner = 20;

  std::vector<double> last_;
  SmoothForces start_;  // at r^L
  int iterations_ = 0;
  double change_ = 0.0;
  double factor_ = 1.0;  // on Dt
};

}  // namespace

std::unique_ptr<Stepper> CreateImplicitStepper(const StepperOptions& options) {
  return std::make_unique<ImplicitStepper>(options);
}

}  // namespace granopt
