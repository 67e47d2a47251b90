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

// Those that others look at.
DECLARE_int32(particles);
DECLARE_string(input);
DECLARE_string(law);
DECLARE_double(field_accuracy);
DECLARE_string(contacts);
DECLARE_string(domain);
DECLARE_string(stepper);
DECLARE_double(duration);
DECLARE_double(dt);
DECLARE_double(tolerance);

namespace granopt {

// The scene that the flags describe, started from --seed or --input; not begun.
// False with one line in `error` where numbers do not go together (mu_d > mu_s)
// or a start is impossible; BadInput for a flag that is wrong by itself.
// `relaxed`: what --relax_overlaps did.
bool MakeCase(FlowCase* made, std::string* relaxed, std::string* error);

// What the flags of steps describe; BadInput for one that is wrong.
StepperOptions MakeStepperOptions();
std::unique_ptr<Stepper> MakeStepper();
// The flags that MakeStepperOptions() takes.
const std::vector<std::string>& StepFlags();

// All flags defined in source files with that in their names.
std::vector<gflags::CommandLineFlagInfo> FlagsDefinedIn(
    const std::string& file);

// One frame of extended XYZ with velocities, which --input takes; 9 digits are
// enough to look at, 17 hold every bit.
std::string Frame(const FlowScene& scene, const FlowState& state, int digits);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_SCENE_H_
