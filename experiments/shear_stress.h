// granopt: `shear --mode=stress`: a packing that is sheared by a given stress.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_STRESS_H_
#define GRANOPT_EXPERIMENTS_SHEAR_STRESS_H_

#include "experiments/scene.h"

namespace granopt {

// Relaxes the packing, at no shear stress and (if positive) at `pressure`, then
// raises the shear stress in `steps` equal steps to `stress`; where no state is
// found the last step is bisected: there it yields. Returns the exit status.
int RunStressShear(Scene scene, double stress, int steps, double pressure);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_STRESS_H_
