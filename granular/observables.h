// granopt: what is measured on a packing.

#ifndef GRANOPT_GRANULAR_OBSERVABLES_H_
#define GRANOPT_GRANULAR_OBSERVABLES_H_

#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"

namespace granopt {

// Half the sum and half the difference of the extreme eigenvalues of a
// symmetric tensor: in 2D the isotropic (l1 + l2) / 2 and deviatoric |l1 - l2|
// / 2 of the paper's Fig. 8; in 3D the mean of the three and (l_max - l_min)
// / 2.
struct TensorParts {
  double isotropic = 0.0;
  double deviatoric = 0.0;
};
TensorParts SplitTensor(const SmallMatrix& tensor);

struct Observables {
  double packing_fraction = 0.0;  // phi (1)
  double energy = 0.0;            // (5)

  // sigma = (1 / V) sum_c l_c (x) f_c (10): positive in compression.
  SmallMatrix stress;
  double pressure = 0.0;      // tr sigma / d (11)
  double shear_stress = 0.0;  // -sigma_12 (sec. 2.3)
  TensorParts stress_parts;

  // F = (1 / V) sum_c (v_i + v_j) n_c (x) n_c (2), v = pi r^2 or 4 pi r^3 / 3.
  SmallMatrix fabric;
  TensorParts fabric_parts;

  int grains = 0;           // N
  int contacts = 0;         // all pairs with delta > 0
  double mean_force = 0.0;  // over those
  double mean_overlap = 0.0;
  double smallest_force = 0.0;  // over the rigid part, see below

  // The rigid part: grains left after removing, again and again, those with
  // fewer than d + 1 contacts.
  int rattlers = 0;           // N - N'
  int rigid_grains = 0;       // N'
  int rigid_contacts = 0;     // N_c, among them
  double coordination = 0.0;  // z = 2 N_c / N' (14); 0 without a rigid part
  // d N' - d + 1: the number of contacts of a packing in a fixed periodic cell
  // exactly at jamming (2 N' - 1 in 2D, 3 N' - 2 in 3D).
  int isostatic_contacts = 0;

  // max|sum of forces on a grain|, and relative to the mean force.
  double max_residual = 0.0;
  double relative_residual = 0.0;

  std::vector<bool> is_rattler;  // N
};

// Deviations: (14) is read as z = 2 N_c / N' (each contact counts for both of
// its grains), since only then does it tend to the paper's z_0 = 4; and grains
// with too few contacts are removed recursively, the paper removes them once.
//
// Grains that are `fixed` (N, or empty) need no contacts to be part of the
// rigid part, and what holds them is no residual.
Observables Measure(const Packing& packing,
                    const std::vector<Contact>& contacts,
                    double energy,
                    const std::vector<bool>& fixed = {});

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_OBSERVABLES_H_
