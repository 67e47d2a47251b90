#include "granular/flow/stepper.h"

namespace granopt {

bool RunFlow(
    const FlowScene& scene,
    double end,
    Stepper* stepper,
    const std::function<bool(const FlowState&, const StepReport&)>& observer,
    FlowState* state,
    std::string* error,
    StepReport* last) {
  // A rest of roundoff is no step.
  while (end - state->time > 1e-9 * state->step) {
    StepReport report;
    if (!stepper->Step(scene, end - state->time, state, &report, error)) {
      if (last != nullptr) *last = report;
      return false;
    }
    if (observer != nullptr && !observer(*state, report)) return true;
  }
  return true;
}

}  // namespace granopt
