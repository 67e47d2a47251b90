// granopt: power laws of the distance from jamming, over many packings.

#ifndef GRANOPT_EXPERIMENTS_SCALING_LAWS_H_
#define GRANOPT_EXPERIMENTS_SCALING_LAWS_H_

#include <string>
#include <vector>

namespace granopt {

// What is measured on one packing at one distance from its jamming point.
struct ScalingState {
  double particles = 0, seed = 0, alpha = 2.0, dimension = 2;
  double asked = 0;         // the distance asked for
  double phi_j = 0;         // the jamming point, from below its branch
  double distance = 0;      // phi - phi_J
  double pressure = 0;      // (10), (11)
  double reduced = 0;       // (p / (k r^(alpha - d)))^(1 / (alpha - 1))
  double bulk = 0;          // phi dp/dphi, (12)
  double bulk_box = 0;      // -V dp/dV
  double bulk_affine = 0;   // (12) at fixed grains
  double shear = 0;         // (13)
  double shear_mean = 0;    // over all directions
  double shear_least = 0;   // of all shears at fixed volume
  double shear_affine = 0;  // (13) at fixed grains
  double coordination = 0;  // (14)
  double excess = 0;        // 2 (N_c - N_iso) / N'
  double excess_contacts = 0;
  double rigid_grains = 0, rattlers = 0;
  double fabric_isotropic = 0, fabric_deviatoric = 0;
  double stress_deviatoric = 0;
  double mean_force = 0, mean_overlap = 0;
  double stiffness = 0;  // kappa = (alpha - 1) mean force / mean overlap
  double residual = 0;   // of a quadruple evaluation, in mean forces
};

// states.csv: a row a state, a column a member of that name.
std::string StatesCsv(const std::vector<ScalingState>& states);
// Appends them, all or none: false with one line in `error` ("name:line:
// what").
bool ReadStates(const std::string& text,
                const std::string& name,
                std::vector<ScalingState>* states,
                std::string* error);

// y ~ distance^exponent: the least-squares line through the logarithms of the
// medians over packings at each distance asked for, within a window. Medians,
// since G has a tail: -1 / lowest eigenvalue towards the end of a branch.
struct Exponent {
  std::string quantity;  // "pressure", "bulk", "shear", "shear_mean", "excess"
  double alpha = 2.0;
  int particles = 0;
  double value = 0.0;
  double prefactor = 0.0;        // of the same line
  double low = 0.0, high = 0.0;  // 95 % of the bootstrap; 0, 0: none
  double from = 0.0, to = 0.0;   // distances used
  int distances = 0;             // how many; less than 2: there is no fit
  int packings = 0;
  int negative = 0;    // values <= 0 in the window, which the medians count
  int left_out = 0;    // distances whose median is not positive
  double paper = 0.0;  // what the paper finds or, for bulk, the theory says
  bool from_paper = false;
};

struct ExponentOptions {
  // The smallest P N^2 of a distance, the median over packings of the reduced
  // pressure times N^2: below, G and z - z_iso level off.
  double least_size = 10.0;
  double most_distance = 1e-2;
  int resamples = 2000;
};

// Intervals are those of resampling packings with replacement (percentiles 2.5
// and 97.5); from three packings on. A resample in which no line can be drawn
// is drawn again, at most ten times as many in all. Deterministic.
//
// Source: Efron, Tibshirani, An Introduction to the Bootstrap (1993), ch. 13;
// the window: Goodrich, Liu, Nagel, Phys. Rev. Lett. 109 (2012) 095704.
Exponent FitExponent(const std::vector<ScalingState>& states,
                     const std::string& quantity,
                     double alpha,
                     int particles,
                     const ExponentOptions& options);

// The quantities that FitExponent() knows.
const std::vector<std::string>& ScalingQuantities();

std::string ExponentsCsv(const std::vector<Exponent>& exponents);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SCALING_LAWS_H_
