// granopt: the grains of a packing that carry forces, and their Hessian.

#ifndef GRANOPT_GRANULAR_FORCE_NETWORK_H_
#define GRANOPT_GRANULAR_FORCE_NETWORK_H_

#include <vector>

#include "granular/contact_energy.h"
#include "granular/observables.h"
#include "solvers/second_order.h"

namespace granopt {

// Two grains that count, a contact or a gap, in the units of its network.
struct Link {
  int i = 0;  // among those that count
  int j = 0;
  SmallVector normal;    // from j to i
  double overlap = 0.0;  // negative: a gap
  double distance = 0.0;
  double force = 0.0;
  double stiffness = 0.0;  // of a contact; k of a gap
};

// Its block of the Hessian: a n (x) n + b 1.
struct LinkBlock {
  double a = 0.0;
  double b = 0.0;
};

// Of a contact a = stiffness + f / l and b = -f / l (9), of a gap zero.
LinkBlock BlockOf(const Link& link);

// The grains that count, N flags: those of the rigid part (observables.h: fewer
// than d + 1 contacts removed, again and again), and those removed that carry
// forces all the same, such as a grain squeezed between two: that is no rattler
// but about to buckle.
std::vector<bool> CountingGrains(const Observables& observables,
                                 const std::vector<Contact>& contacts);

// Those grains and their contacts with each other. Energies and lengths are in
// units in which kappa and the mean overlap lie in [1, 2): powers of two, so
// that nothing is rounded.
struct ForceNetwork {
  int dimension = 0;
  std::vector<int> grains;  // that count, by their index in the packing
  std::vector<int> place;   // N: where a grain is in `grains`, or -1
  std::vector<Link> links;  // contacts, in the order of the packing's
  int held = 0;             // that with most contacts, in `grains`
  double stiffness_unit = 1.0;
  double length_unit = 1.0;
  // Over the contacts, in those units; kappa = (alpha - 1) f / delta.
  double stiffness = 0.0;
  double mean_force = 0.0;
  double mean_overlap = 0.0;
  double smallest_overlap = 0.0;
  double other_force = 0.0;  // largest of any other contact, in mean forces

  int size() const { return static_cast<int>(grains.size()); }
  bool BothCount(const GapId& id) const {
    return place[id.i] >= 0 && place[id.j] >= 0;
  }
};

// No links and zeros if no two grains that count touch.
ForceNetwork MakeForceNetwork(int dimension,
                              double alpha,
                              const Observables& observables,
                              const std::vector<Contact>& contacts);

// The lower triangle of the sum of blocks, one for each link: d n x d n without
// the rows and columns of grain `held` unless that is < 0. The diagonal is
// there even where it is zero.
SparseMatrix AssembleBlocks(const ForceNetwork& network,
                            const std::vector<LinkBlock>& blocks,
                            int held);

// Grains in each piece that contacts connect, largest first.
std::vector<int> Pieces(const ForceNetwork& network);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FORCE_NETWORK_H_
