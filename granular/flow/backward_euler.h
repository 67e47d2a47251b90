// granopt: what the steppers of backward Euler share: steps that are tried,
// shorter and shorter, until one can be solved.

#ifndef GRANOPT_GRANULAR_FLOW_BACKWARD_EULER_H_
#define GRANOPT_GRANULAR_FLOW_BACKWARD_EULER_H_

#include <string>
#include <vector>

#include "granular/flow/stepper.h"

namespace granopt {

class BackwardEuler : public Stepper {
 public:
  bool Step(const FlowScene& scene,
            double limit,
            FlowState* state,
            StepReport* report,
            std::string* error) final;

 protected:
  // Why a step was not solved, and what to try next.
  struct Failure {
    int iterations = 0;
    double ratio = 0.0;  // measure of error over what is tolerated
    std::string reason;
    std::string message;  // after "step 0.01 at t = 0.3" where Dt is fixed
    double factor = 0.5;  // on Dt
  };

  explicit BackwardEuler(const StepperOptions& options) : options_(options) {}

  // Before the first try.
  virtual void Begin(const FlowScene&, FlowState*) {}
  // From r^L: fills x_, v_, u_, used_ and work_, which are then booked.
  virtual bool Solve(const FlowScene& scene,
                     double dt,
                     FlowState* state,
                     StepReport* report,
                     Failure* failure) = 0;
  // Dt after a step that took dt where `wanted` was wanted: less if it was cut
  // short by the end of the run, which says nothing about the next.
  virtual double NextStep(double dt, double wanted) const = 0;

  // u_ and work_: velocities after impacts, by the forces of used_.
  void ApplyContacts(const FlowScene& scene, double dt, const FlowState& state);

  const StepperOptions options_;
  std::vector<double> x_, v_, u_;
  SmoothForces used_;
  std::vector<Impact> impacts_;  // found at r^L
  ImpactWork work_;

 private:
  std::vector<ClosePair> pairs_;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_BACKWARD_EULER_H_
