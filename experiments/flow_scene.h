// granopt: the flags that describe a near-field flow, and what they describe.

#ifndef GRANOPT_EXPERIMENTS_FLOW_SCENE_H_
#define GRANOPT_EXPERIMENTS_FLOW_SCENE_H_

#include <memory>
#include <string>
#include <vector>

#include "experiments/flow_work.h"
#include "gflags/gflags.h"
#include "granular/flow/flow.h"
#include "granular/flow/stepper.h"

DECLARE_int32(particles);
DECLARE_double(side);
DECLARE_double(length_ratio);
DECLARE_double(density);
DECLARE_string(mean_velocity);
DECLARE_string(perturbation);
DECLARE_int32(attempts);
DECLARE_string(input);
DECLARE_bool(relax_overlaps);
DECLARE_string(law);
DECLARE_double(alpha1);
DECLARE_double(beta1);
DECLARE_double(alpha2);
DECLARE_double(beta2);
DECLARE_string(weight);
DECLARE_double(depth);
DECLARE_double(sigma);
DECLARE_double(mie_repulsion);
DECLARE_double(mie_attraction);
DECLARE_double(morse_steepness);
DECLARE_double(morse_distance);
DECLARE_double(field_accuracy);
DECLARE_int32(multipole_from);
DECLARE_string(contacts);
DECLARE_double(restitution);
DECLARE_bool(velocity_dependent);
DECLARE_double(velocity_scale);
DECLARE_double(least_restitution);
DECLARE_double(impact_duration);
DECLARE_double(mu_s);
DECLARE_double(mu_d);
DECLARE_double(stiffness);
DECLARE_double(contact_alpha);
DECLARE_string(gravity);
DECLARE_string(force);
DECLARE_double(force_frequency);
DECLARE_double(damping);
DECLARE_string(domain);
DECLARE_string(stepper);
DECLARE_double(duration);
DECLARE_double(dt);
DECLARE_double(first_dt);
DECLARE_double(tolerance);
DECLARE_int32(iterations);
DECLARE_string(sweep);
DECLARE_int32(groups);
DECLARE_double(relaxation);
DECLARE_double(safety);
DECLARE_string(solver);

namespace granopt {

// The scene that the flags describe, started from --seed or --input; not begun.
// False with one line in `error` where numbers do not go together (mu_d > mu_s)
// or a start is impossible; BadInput for a flag that is wrong by itself.
// `relaxed`: what --relax_overlaps did.
bool MakeCase(FlowCase* made, std::string* relaxed, std::string* error);

// What the flags of steps describe; BadInput for one that is wrong.
StepperOptions MakeStepperOptions();
std::unique_ptr<Stepper> MakeStepper();

// One frame of extended XYZ with velocities; 9 digits are enough to look at, 17
// hold every bit. (--input takes centres and radii of it only; a run goes on
// from its checkpoint.)
std::string Frame(const FlowScene& scene, const FlowState& state, int digits);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_SCENE_H_
