// granopt: the flags of `identify` beside those of a flow.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_FLAGS_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_FLAGS_H_

#include "gflags/gflags.h"

DECLARE_string(search);
DECLARE_string(target);
DECLARE_string(target_energies);
DECLARE_string(weights);
DECLARE_string(recover);
DECLARE_string(method);
DECLARE_bool(list_methods);
DECLARE_int32(budget);
DECLARE_string(ensemble);
DECLARE_double(ensemble_tolerance);
DECLARE_int32(most_runs);
DECLARE_int32(most_steps);
DECLARE_int32(winners);
DECLARE_int32(fresh);
DECLARE_bool(gradient);
DECLARE_int32(gradient_runs);
DECLARE_int32(gradient_budget);
DECLARE_bool(profile);
DECLARE_int32(profile_points);
DECLARE_int32(profile_budget);
DECLARE_bool(alternatives);
DECLARE_int32(repeats);
DECLARE_bool(recovery);
DECLARE_bool(paper);
DECLARE_int32(threads);
DECLARE_bool(resume);
DECLARE_bool(external);
DECLARE_bool(worker);
DECLARE_string(strings);
DECLARE_string(share);

namespace granopt::identify {

// BadInput for those that do not go together; then sets what --paper and
// --smoke say.
void CheckFlags();

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_FLAGS_H_
