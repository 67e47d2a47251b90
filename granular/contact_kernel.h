// granopt: the loops over pairs of second-order methods, compiled once per
// dimension and law.
//
// This header and its source include neither Eigen nor Ceres, so that the only
// templated code of the library compiles in a moment.

#ifndef GRANOPT_GRANULAR_CONTACT_KERNEL_H_
#define GRANOPT_GRANULAR_CONTACT_KERNEL_H_

#include <memory>

#include "granular/pair_loops.h"

namespace granopt {

// One pair at some displacement.
struct PairState {
  double delta;      // overlap, negative where open
  double distance;   // l
  double normal[3];  // n = (x_i - x_j) / l; zero where the centres coincide
  double energy;
  double force;
  double stiffness;  // f'(delta)
};

class ContactKernel {
 public:
  virtual ~ContactKernel() = default;

  // The states of all pairs, in order.
  virtual void States(const PairView& pairs,
                      const double* w,
                      PairState* states) const = 0;

  // Adds, for each pair p with rank[p] >= 0, the d x d block
  //   K = first[p] n (x) n - (second[p] / l) (1 - n (x) n)
  // to the lower triangle of a column-compressed matrix with one block row and
  // column a grain: K to the diagonal blocks of i and j, -K to block (j, i).
  // first = f' and second = f make the Hessian (9). `rank[p]` is the place of
  // pair p's block below the diagonal of its column, `column_start` has one
  // entry per scalar column. `values` must be zero before.
  virtual void AddBlocks(const PairView& pairs,
                         const PairState* states,
                         const double* first,
                         const double* second,
                         const int* rank,
                         const int* column_start,
                         double* values) const = 0;

  // Force and stiffness of m overlaps >= 0 at k = 1.
  virtual void Apply(int m,
                     const double* delta,
                     double* force,
                     double* stiffness) const = 0;

  // hv = H v.
  virtual void HessianTimes(const PairView& pairs,
                            const double* w,
                            const double* v,
                            double* hv) const = 0;
};

// Null for a dimension other than 2 or 3 or an alpha that no law handles.
std::unique_ptr<ContactKernel> MakeContactKernel(int dimension, double alpha);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_CONTACT_KERNEL_H_
