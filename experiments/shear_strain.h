// granopt: `shear` by a given strain: curves of stress and fabric, one for each
// increment, and the plastic events of the finest.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_STRAIN_H_
#define GRANOPT_EXPERIMENTS_SHEAR_STRAIN_H_

#include <string>
#include <vector>

#include "experiments/scene.h"
#include "granular/quasistatic_shear.h"

namespace granopt {

struct StrainShear {
  DeformationMode mode = DeformationMode::PURE_SHEAR;
  double strain = 0.02;  // at the end, or where a cycle turns
  int cycles = 0;        // 0: only there
  // Coarsest first, and as the user wrote them.
  std::vector<double> increments;
  std::string increments_text;
  double pressure = 0.0;  // 0: at constant volume
  bool stabilize = false;
  bool events = false;
  double event_threshold = 1e-5;
};

// The strains of steps 1, 2, ...
std::vector<double> PathOf(const StrainShear& shear, double increment);

// Relaxes the packing of `scene` and deforms it along each path, from the same
// state. Returns the exit status.
int RunStrainShear(const Scene& scene, const StrainShear& shear);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_STRAIN_H_
