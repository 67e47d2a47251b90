// granopt: which contacts open and close, between two states and on a way.

#ifndef GRANOPT_GRANULAR_CONTACT_CHANGES_H_
#define GRANOPT_GRANULAR_CONTACT_CHANGES_H_

#include <array>
#include <string>
#include <vector>

#include "Eigen/Core"
#include "granular/contact_energy.h"
#include "granular/packing.h"

namespace granopt {

// Gradient and Hessian at u of the energy E' of contacts between two grains
// that count (CountingGrains()). Returns false where the function is not
// defined.
bool EvaluateAmong(const ContactEnergy& energy,
                   const double* u,
                   const std::vector<bool>& counts,
                   Eigen::VectorXd* gradient,
                   SparseMatrix* hessian);

// What E' cannot see: motions of the grains that do not count, one column a
// coordinate, and the translations of those that do.
Eigen::MatrixXd BlindMotions(int dimension, const std::vector<bool>& counts);

// Pairs i <= j of grains that touch, one entry for each image, sorted.
using ContactPairs = std::vector<std::array<int, 2>>;
ContactPairs PairsInTouch(const std::vector<Contact>& contacts,
                          const std::vector<bool>& counts);

struct ContactChange {
  int opened = 0;
  int closed = 0;
  int total() const { return opened + closed; }
};
ContactChange Compare(const ContactPairs& before, const ContactPairs& after);

// What happens to pairs of grains that count on the straight way
// x + t displacement, 0 < t <= 1 (d N entries, grain by grain).
struct WayChanges {
  int opened = 0;      // openings, one pair may have several
  int closed = 0;      // closures
  double first = 0.0;  // t of the first change; infinity: none
  int total() const { return opened + closed; }
};
// Returns false with one line in `error` if the way is too long: more than the
// mean radius for some grain.
bool ChangesOnTheWay(const Packing& packing,
                     const double* displacement,
                     const std::vector<bool>& counts,
                     WayChanges* changes,
                     std::string* error);

// Newton's step for E' at u: -(H + shift 1)^-1 g without blind motions.
struct NewtonStep {
  std::vector<double> displacement;
  // 0 if H is positive definite, else the least of 1e-10 kappa 4^k that makes
  // it so, kappa = (alpha - 1) mean force / mean overlap.
  double shift = 0.0;
  double relative_shift = 0.0;  // in kappa
  // Largest change of a separation of two grains in touch, in mean overlaps.
  double length = 0.0;
};
// Returns false with one line in `error` without a contact.
bool ComputeNewtonStep(const ContactEnergy& energy,
                       const double* u,
                       const std::vector<bool>& counts,
                       NewtonStep* step,
                       std::string* error);

// Where a relaxed state goes to first order as its cell is deformed by
// x -> (1 + gradient) x: displacements from the deformed state, without blind
// motions, -(H + shift 1)^-1 dg of the state before with the change dg of its
// gradient. The contacts are those before. `relative_shift` as above.
bool ComputeLinearResponse(const ContactEnergy& energy,
                           const double* u,
                           const std::vector<bool>& counts,
                           const SmallMatrix& gradient,
                           NewtonStep* step,
                           std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_CONTACT_CHANGES_H_
