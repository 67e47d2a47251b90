// granopt: sums over all pairs of many grains in O(n), with an error bound.

#ifndef GRANOPT_GRANULAR_FLOW_NEAR_FIELD_TREE_H_
#define GRANOPT_GRANULAR_FLOW_NEAR_FIELD_TREE_H_

#include <memory>
#include <vector>

#include "granular/flow/near_field_loops.h"

namespace granopt {

// A fast multipole method for powers d^-beta, beta >= 1, without images. Cells
// of a binary tree that are far from each other act through the Taylor series
// of V in the difference s - t of places in the two cells, to total order P in
// both; others act pair by pair. The series is antisymmetric in the two cells,
// so that momentum is kept to roundoff.
//
// Bound. At distance D of the centres and with q = |s - t| / D the m-th term of
// the force of a grain of weight w is at most
//   w alpha (beta)_m / m! D^-beta q^m,   (beta)_m = beta (beta + 1) ...,
// since a symmetric tensor is largest on equal arguments and Gegenbauer (for
// beta = 1, Chebyshev) polynomials at 1. All terms from P on are bounded by a
// geometric series with the moments sum w |s|^m of the source. Two cells are
// far if this bound is, both ways, at most `accuracy` times what the forces of
// the source amount to at least, W alpha (D + R_s + R_t)^-beta. So the error of
// each grain's force is at most
//   accuracy * sum_j w_i w_j (alpha1 d_ij^-beta1 + alpha2 d_ij^-beta2),
// and was some thousand times smaller for grains at random places.
//
// Sources: Greengard, Rokhlin, J. Comput. Phys. 73 (1987) 325; the mutual,
// momentum-conserving form: Dehnen, J. Comput. Phys. 179 (2002) 27.
class NearFieldTree {
 public:
  // Null if the law is none that it serves.
  static std::unique_ptr<NearFieldTree> Create(
      const RadialLaw& law,
      int n,
      const std::vector<double>& weights,
      double accuracy);
  ~NearFieldTree();

  // As NearField::Forces(). `least_distance`: of grains in cells that are near
  // each other. `bound`: what the bound came to, <= accuracy.
  void Forces(const double* x,
              double* force,
              double* energy,
              double* least_distance,
              double* bound) const;

 private:
  class Impl;
  explicit NearFieldTree(std::unique_ptr<Impl> impl);

  const std::unique_ptr<Impl> impl_;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_NEAR_FIELD_TREE_H_
