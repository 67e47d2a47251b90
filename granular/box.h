// granopt: the periodic cell.

#ifndef GRANOPT_GRANULAR_BOX_H_
#define GRANOPT_GRANULAR_BOX_H_

#include <array>

#include "Eigen/Core"

namespace granopt {

// d x d and d x 1 with d = 2 or 3, no allocation.
using SmallMatrix = Eigen::
    Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 3, 3>;
using SmallVector =
    Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 3, 1>;
// Integer coefficients of the lattice vectors; entries beyond d are zero.
using Image = std::array<int, 3>;

// A parallelogram (d = 2) or parallelepiped (d = 3), periodic in every
// direction and sheared at will: the columns of H are its edges, positions x
// and x + H n are the same for every integer n.
class Box {
 public:
  Box() : Box(SmallMatrix::Identity(2, 2)) {}
  // H must be invertible, d x d with d = 2 or 3 (checked by IsValid()).
  explicit Box(const SmallMatrix& edges);

  static Box Cube(int dimension, double length);

  int dimension() const { return static_cast<int>(edges_.rows()); }
  const SmallMatrix& edges() const { return edges_; }
  const SmallMatrix& inverse() const { return inverse_; }

  // True if every entry is finite, |det H| > 1e-12 times the product of the
  // edge lengths (below that inverse() has lost its digits) and the longest
  // edge is less than 1e8 times the smallest height (above that images outgrow
  // an int).
  bool IsValid() const;

  // |det H|: an area in 2D, a volume in 3D.
  double Volume() const { return volume_; }
  // V^(1/d), the unit of length in which "box = 1".
  double Length() const;
  // Distance between the two faces that edge k connects.
  double Height(int k) const { return heights_[k]; }

  // The image n for which x - H n lies in the cell (fractional coordinates in
  // [0, 1) up to rounding).
  Image CellOf(const double* x) const;

  // The cell D H.
  Box Deformed(const SmallMatrix& deformation) const;

  // A cell of the same lattice with short edges (Lagrange-Gauss reduction in
  // 2D, pairwise in 3D): what a neighbour search wants when the shear is large.
  // Its edges are H T up to rounding; T (d x d, integer, |det T| = 1) is
  // written to `transform`, so that its images can be named exactly by those of
  // this cell.
  Box Reduced(Eigen::Matrix3i* transform) const;

  // The cell with its entries rounded to multiples of 2^-50 times a power of
  // two near the largest of them. Sums of such edges as long as they are
  // themselves are exact: Reduced() then has the very same lattice, without
  // roundoff.
  Box Rounded() const;

 private:
  SmallMatrix edges_, inverse_;
  double volume_ = 0.0;
  std::array<double, 3> heights_ = {0.0, 0.0, 0.0};
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_BOX_H_
