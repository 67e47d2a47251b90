#include "granular/flow/backward_euler.h"

#include <algorithm>

#include "solvers/format.h"

namespace granopt {
namespace {

// Dt below this part of its limit, or so many tries, end a run.
constexpr double kFloor = 1e-9;
constexpr int kMostTries = 200;

}  // namespace

bool BackwardEuler::Step(const FlowScene& scene,
                         double limit,
                         FlowState* state,
                         StepReport* report,
                         std::string* error) {
  Begin(scene, state);
  impacts_.clear();
  if (scene.options().impact) {
    scene.FindContacts(state->x.data(), &pairs_);
    FreezeImpacts(pairs_,
                  *scene.options().impact,
                  scene.stride(),
                  state->v.data(),
                  &impacts_);
  }
  double wanted = options_.is_adaptive ? std::min(state->step, options_.step)
                                       : options_.step;
  for (int k = 0; k < kMostTries; ++k) {
    const double dt = std::min(wanted, limit);
    Failure failure;
    if (Solve(scene, dt, state, report, &failure)) {
      scene.Book(used_, dt, u_.data(), v_.data(), state);
      scene.BookDamping(v_.data(), dt, u_.data(), v_.data(), state);
      scene.EndStep(dt, work_, &used_, &x_, &v_, state);
      if (options_.is_adaptive) {
        state->step = std::min(options_.step, NextStep(dt, wanted));
      }
      report->step = dt;
      return !scene.HasCollapsed(state->x.data(), state->time, error);
    }
    ++state->rejected;
    report->rejections.push_back(
        {state->time, dt, failure.iterations, failure.ratio, failure.reason});
    if (!options_.is_adaptive) {
      *error =
          Format("step %.3g at t = %.9g", dt, state->time) + failure.message;
      return false;
    }
    wanted = failure.factor * dt;
    if (wanted < kFloor * options_.step) break;
  }
  double ratio;
  const std::string closest = scene.DescribeClosest(state->x.data(), &ratio);
  *error = Format("%s at t = %.9g: Dt would fall below %.1e of its limit; %s",
                  ratio < kCollapsedDistance ? "collapse" : "step floor",
                  state->time,
                  kFloor,
                  closest.c_str());
  return false;
}

void BackwardEuler::ApplyContacts(const FlowScene& scene,
                                  double dt,
                                  const FlowState& state) {
  u_ = state.v;
  work_ = {};
  if (impacts_.empty()) return;
  work_ = ApplyImpacts(impacts_,
                       *scene.options().impact,
                       dt,
                       scene.stride(),
                       scene.inverse_mass().data(),
                       used_.total.data(),
                       u_.data());
}

}  // namespace granopt
