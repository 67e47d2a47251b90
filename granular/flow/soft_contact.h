// granopt: contacts of a flow by the energies of packings.

#ifndef GRANOPT_GRANULAR_FLOW_SOFT_CONTACT_H_
#define GRANOPT_GRANULAR_FLOW_SOFT_CONTACT_H_

#include <vector>

#include "granular/flow/contact_search.h"

namespace granopt {

struct SoftContactOptions {
  // k delta^alpha / alpha of an overlap delta > 0 (contact_law.h).
  double stiffness = 0.0;
  double alpha = 2.0;
};

// Value, force and stiffness of one overlap.
struct SoftContactValues {
  double energy = 0.0;
  double force = 0.0;
  double stiffness = 0.0;
};
SoftContactValues EvaluateSoftContact(const SoftContactOptions& options,
                                      double overlap);

// Elastic repulsion of overlapping grains, the laws of contact_law.h: the soft
// alternative to impacts (collision.h), conservative and without friction.
// Returns sum k delta^alpha / alpha and writes forces in the layout of
// near_field_loops.h. `pairs` may hold others than those that overlap.
double SoftContactForces(const std::vector<ClosePair>& pairs,
                         const SoftContactOptions& options,
                         const double* radius,
                         int stride,
                         double* force);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_SOFT_CONTACT_H_
