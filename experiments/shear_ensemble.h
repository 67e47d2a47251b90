// granopt: the curves of many packings: `shear --seeds=1-20`.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_ENSEMBLE_H_
#define GRANOPT_EXPERIMENTS_SHEAR_ENSEMBLE_H_

#include <string>
#include <vector>

#include "experiments/ensemble.h"
#include "experiments/shear_curves.h"

namespace granopt {

// Of one quantity at one step of the curves of one increment.
struct BandPoint {
  double mean = 0.0;
  double standard_error = 0.0;   // 0 for one curve
  double low = 0.0, high = 0.0;  // 20 and 80 % quantiles
};
BandPoint MakeBand(const std::vector<double>& values);

// increment,step,strain,curves, then mean, standard error, 20 % and 80 %
// quantiles of stress_iso, stress_dev, fabric_iso, fabric_dev, conjugate and
// phi.
std::string BandsCsv(const std::vector<std::vector<StrainRow>>& members);

// Runs a copy of this binary for each seed, at most --jobs at a time, in
// OUT/seed<k>; with --resume only those that have no complete result for the
// same flags. Returns the exit status: 0 if all converged, else 1.
// `has_particles`: the user gave --particles.
int RunShearEnsemble(const Ensemble& ensemble, bool has_particles);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_ENSEMBLE_H_
