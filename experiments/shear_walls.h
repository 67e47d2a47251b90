// granopt: `shear --mode=wall`: a cell that is sheared by one of its walls.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_WALLS_H_
#define GRANOPT_EXPERIMENTS_SHEAR_WALLS_H_

#include <string>
#include <vector>

#include "experiments/scene.h"

namespace granopt {

// Relaxes the packing, gives it walls ("rough" or "flat") and moves the upper
// one through `path`. Returns the exit status.
int RunWallShear(const Scene& scene,
                 const std::string& kind,
                 const std::vector<double>& path);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_WALLS_H_
