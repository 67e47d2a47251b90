// granopt: `shear --mode=stress`: a packing that is sheared by a given stress.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_STRESS_H_
#define GRANOPT_EXPERIMENTS_SHEAR_STRESS_H_

#include "experiments/scene.h"
#include "granular/stress_shear.h"

namespace granopt {

// ShearByStress() of the packing, at `pressure` if that is positive. Returns
// the exit status.
int RunStressShear(const Scene& scene, const StressPath& path, double pressure);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_STRESS_H_
