// granopt: the attraction and repulsion of charged grains.

#ifndef GRANOPT_GRANULAR_FLOW_NEAR_FIELD_H_
#define GRANOPT_GRANULAR_FLOW_NEAR_FIELD_H_

#include <memory>
#include <string>
#include <vector>

#include "granular/flow/near_field_law.h"
#include "granular/flow/near_field_loops.h"
#include "granular/flow/near_field_tree.h"

namespace granopt {

// V, f / d and f' of a pair at unit weights.
struct RadialValues {
  double potential = 0.0;
  double force_over_distance = 0.0;
  double stiffness = 0.0;
};
RadialValues EvaluateLaw(const RadialLaw& law, double distance);

// Of the stable equilibrium of V(d), d_e = (alpha2 / alpha1)^(1 / (beta2 -
// beta1)) (2.7) for beta2 > beta1 (2.8); the Morse distance; 0 where there is
// none.
double EquilibriumDistance(const RadialLaw& law);

struct NearFieldOptions {
  RadialLaw law;
  // From so many grains on a fast multipole method takes the place of the sum
  // over all pairs (near_field_tree.h), where it serves the law and there are
  // no images. 0: never; -1: where it began to be the faster one, for exponents
  // 1 and 2.
  int tree_from = -1;
  // Its error bound, relative to the sum of the magnitudes of the pair forces
  // on a grain.
  double tree_accuracy = 1e-3;
};

// Psi_i = sum_{j != i} w_i w_j f(d_ij) n_ij  (2.2), with weights w the masses
// (alpha_ij = alpha m_i m_j, sec. 7.1), surface areas (footnote 14) or 1.
//
// Coordinates and forces are in the layout of near_field_loops.h, SI units or
// any other consistent ones. Forces are pure functions of the positions and the
// same bits on any number of threads and for every instruction set. Each pair
// is visited once: n^2 / 2 pairs. Grains at one place have no direction:
// LastLeastDistance() is then 0, and their forces are void: not finite for most
// laws, without that pair for others.
//
// Not here: three-body terms of (9.1).
class NearField {
 public:
  // `weights` has FlowStride(n) entries; `period`: side of a periodic cube for
  // nearest images, 0 for none. Null, with one line in `error`, for numbers
  // that are not finite.
  static std::unique_ptr<NearField> Create(const NearFieldOptions& options,
                                           int n,
                                           std::vector<double> weights,
                                           double period,
                                           std::string* error);

  // Writes forces (3 FlowStride(n) entries); `energy` (may be null) is
  // sum_{i<j} w_i w_j V(d).
  void Forces(const double* x, double* force, double* energy) const;
  // Of all other grains on grain i if it were at `at`.
  void ForceOn(int i,
               const double* x,
               const double* at,
               double* force,
               double* energy) const;

  // Of the last Forces(): the least distance of two grains (with a tree, of
  // those in cells near each other), and the bound of the errors of forces over
  // the sums of magnitudes, 0 without a tree.
  double LastLeastDistance() const { return least_distance_; }
  double LastErrorBound() const { return error_bound_; }
  bool UsesTree() const { return tree_ != nullptr; }

  const NearFieldOptions& options() const { return options_; }
  const RadialLaw& law() const { return options_.law; }
  const std::vector<double>& weights() const { return weights_; }

 private:
  NearField() = default;
  NearFieldView View(const double* x) const;

  NearFieldOptions options_;
  int n_ = 0;
  int stride_ = 0;
  std::vector<double> weights_;
  double period_ = 0.0;
  NearFieldLoops loops_;
  std::unique_ptr<NearFieldTree> tree_;
  // Rows of each piece of the work, and a buffer of forces for all but one.
  std::vector<int> piece_start_;
  mutable std::vector<double> buffers_;
  mutable double least_distance_ = 0.0;
  mutable double error_bound_ = 0.0;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_NEAR_FIELD_H_
