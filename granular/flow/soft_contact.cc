#include "granular/flow/soft_contact.h"

#include <algorithm>
#include <tuple>

#include "granular/contact_law.h"

namespace granopt {
namespace {

template <std::size_t kLaw = 0>
SoftContactValues Evaluate(const SoftContactOptions& options, double overlap) {
  if constexpr (kLaw == std::tuple_size_v<ContactLaws>) {
    return {};
  } else {
    using Law = std::tuple_element_t<kLaw, ContactLaws>;
    if (!Law::Handles(options.alpha)) {
      return Evaluate<kLaw + 1>(options, overlap);
    }
    const Law law(options.alpha);
    return {options.stiffness * law.Energy(overlap),
            options.stiffness * law.Force(overlap),
            options.stiffness * law.Stiffness(overlap)};
  }
}

}  // namespace

SoftContactValues EvaluateSoftContact(const SoftContactOptions& options,
                                      double overlap) {
  if (!(overlap > 0.0)) return {};
  return Evaluate(options, overlap);
}

double SoftContactForces(const std::vector<ClosePair>& pairs,
                         const SoftContactOptions& options,
                         const double* radius,
                         int stride,
                         double* force) {
  std::fill(force, force + 3 * static_cast<std::size_t>(stride), 0.0);
  double energy = 0.0;
  for (const ClosePair& pair : pairs) {
    const SoftContactValues values = EvaluateSoftContact(
        options, radius[pair.i] + radius[pair.j] - pair.distance);
    energy += values.energy;
    for (int k = 0; k < 3; ++k) {
      const double f = values.force * pair.normal[k];
      force[k * stride + pair.i] -= f;
      force[k * stride + pair.j] += f;
    }
  }
  return energy;
}

}  // namespace granopt
