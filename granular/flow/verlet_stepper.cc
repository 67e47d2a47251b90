#include <cmath>
#include <vector>

#include "granular/flow/stepper.h"
#include "solvers/format.h"

namespace granopt {
namespace {

class VerletStepper : public Stepper {
 public:
  explicit VerletStepper(const StepperOptions& options) : options_(options) {}

  double FirstStep() const override { return options_.step; }

  bool Step(const FlowScene& scene,
            double limit,
            FlowState* state,
            StepReport* report,
            std::string* error) override {
    const int n = scene.size(), stride = scene.stride();
    const std::size_t size = 3 * static_cast<std::size_t>(stride);
    const std::vector<double>& w = scene.inverse_mass();
    const double dt = std::min(options_.step, limit);
    const double damping = kHasDamping ? scene.options().damping : 0.0;
    const bool has_forces = scene.HasForces();
    const auto& impact = scene.options().impact;

    // Forces at the start are those at the end of the last step, unless a grain
    // jumped since or the state is another one.
    if (has_forces &&
        (state->x != evaluated_x_ || state->time != evaluated_time_)) {
      scene.Forces(state->x.data(), state->time, false, &before_);
      // What the step before has paid for is not work of the flow: a run that
      // is resumed counts what it would have without the break.
      if (!state->is_evaluated) ++state->sweeps;
    }
    u_ = state->v;
    ImpactWork work;
    if (impact) {
      scene.FindContacts(state->x.data(), &pairs_);
      if (!pairs_.empty()) {
        FreezeImpacts(pairs_, *impact, stride, state->v.data(), &impacts_);
        work = ApplyImpacts(impacts_,
                            *impact,
                            dt,
                            stride,
                            w.data(),
                            has_forces ? before_.total.data() : nullptr,
                            u_.data());
      }
    }
    half_.assign(size, 0.0);
    v_.assign(size, 0.0);
    x_ = state->x;
    bool is_finite = true;
    // Impacts alone: nothing else changes a velocity.
    const bool is_free = !has_forces && damping == 0.0;
    if (is_free) {
      for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < n; ++i) {
          const int e = k * stride + i;
          if (w[i] == 0.0) continue;
          v_[e] = u_[e];
          x_[e] += dt * u_[e];
          is_finite = is_finite && std::isfinite(x_[e]);
        }
      }
    } else {
      if (!has_forces) before_.total.assign(size, 0.0);
      for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < n; ++i) {
          const int e = k * stride + i;
          if (w[i] == 0.0) continue;
          half_[e] =
              u_[e] + 0.5 * dt * (before_.total[e] * w[i] - damping * u_[e]);
          x_[e] += dt * half_[e];
          is_finite = is_finite && std::isfinite(x_[e]);
        }
      }
      if (is_finite) {
        scene.Forces(x_.data(), state->time + dt, false, &after_);
      }
      ++state->sweeps;
      for (int k = 0; k < 3 && is_finite; ++k) {
        for (int i = 0; i < n; ++i) {
          const int e = k * stride + i;
          if (w[i] == 0.0) continue;
          v_[e] = (half_[e] + 0.5 * dt * after_.total[e] * w[i]) /
                  (1.0 + 0.5 * dt * damping);
          is_finite = is_finite && std::isfinite(v_[e]);
        }
      }
    }
    if (!is_finite) {
      evaluated_x_.clear();
      double ratio;
      const std::string closest =
          scene.DescribeClosest(state->x.data(), &ratio);
      *error = Format(
          "collapse: forces are not finite after t = %.9g with "
          "Dt = %.3g; %s",
          state->time,
          dt,
          closest.c_str());
      return false;
    }
    if (!is_free) {
      scene.Book(before_, 0.5 * dt, u_.data(), v_.data(), state);
      scene.Book(after_, 0.5 * dt, u_.data(), v_.data(), state);
      scene.BookDamping(u_.data(), 0.5 * dt, u_.data(), v_.data(), state);
      scene.BookDamping(v_.data(), 0.5 * dt, u_.data(), v_.data(), state);
    }
    if (has_forces) end_x_ = x_;
    scene.EndStep(dt, work, is_free ? nullptr : &after_, &x_, &v_, state);
    state->step = options_.step;
    // For the next step, which sees by the positions if a grain jumped since.
    std::swap(before_, after_);
    evaluated_x_.swap(end_x_);
    evaluated_time_ = state->time;
    state->is_evaluated = has_forces && state->x == evaluated_x_;
    report->step = dt;
    report->iterations = 1;
    return !scene.HasCollapsed(state->x.data(), state->time, error);
  }

 private:
  const StepperOptions options_;
  std::vector<double> x_, u_, v_, half_;
  SmoothForces before_, after_;
  std::vector<double> evaluated_x_, end_x_;  // where before_ was evaluated
  double evaluated_time_ = -1.0;
  std::vector<ClosePair> pairs_;
  std::vector<Impact> impacts_;
};

}  // namespace

std::unique_ptr<Stepper> CreateVerletStepper(const StepperOptions& options) {
  return std::make_unique<VerletStepper>(options);
}

}  // namespace granopt
