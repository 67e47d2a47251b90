// granopt: grains in a periodic cell.

#ifndef GRANOPT_GRANULAR_PACKING_H_
#define GRANOPT_GRANULAR_PACKING_H_

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "Eigen/Core"
#include "granular/box.h"
#include "granular/double_double.h"

namespace granopt {

// Coordinates and near pairs are counted by an int.
constexpr int kMostGrains = std::numeric_limits<int>::max() / 64;

// Discs (d = 2) or spheres (d = 3). Positions are exact sums of two doubles,
// see double_double.h. A grain's index is its name: nothing here reorders
// grains.
struct Packing {
  Box box;
  Eigen::MatrixXd positions;         // d x N, any image
  Eigen::MatrixXd positions_low;     // d x N, or empty: all zero
  Eigen::VectorXd radii;             // N, > 0
  Eigen::VectorXd stiffness;         // N, > 0, or empty: 1 for every grain
  std::vector<std::string> species;  // N, or empty: all "A"
  // Further key=value pairs of a file's comment line (alpha, k, seed, ...).
  std::map<std::string, std::string> attributes;

  int dimension() const { return box.dimension(); }
  int size() const { return static_cast<int>(radii.size()); }

  DoubleDouble Position(int i, int k) const {
    return {positions(k, i),
            positions_low.size() == 0 ? 0.0 : positions_low(k, i)};
  }
  void SetPosition(int i, int k, const DoubleDouble& x) {
    if (positions_low.size() == 0) {
      positions_low.setZero(dimension(), size());
    }
    positions(k, i) = x.hi;
    positions_low(k, i) = x.lo;
  }

  // True if the packing can be simulated; otherwise one line in `error` with
  // the grain and the value at fault: sizes that disagree, no grain, a singular
  // cell, a non-finite coordinate, a radius or stiffness that is not positive.
  bool IsValid(std::string* error) const;

  // phi = sum_i v_i / V with v = pi r^2 (eq. 1) or 4 pi r^3 / 3.
  double PackingFraction() const;
  double MeanRadius() const;

  // Multiplies every radius.
  void ScaleRadii(double factor);
  // Scales the radii so that PackingFraction() is phi, up to rounding.
  void SetPackingFraction(double phi);

  // x -> D x for cell and positions, D d x d.
  void Deform(const SmallMatrix& deformation);

  // Adds independent uniform displacements in [-amplitude, amplitude] to every
  // coordinate. The same seed gives the same numbers on every machine.
  void Perturb(double amplitude, std::uint64_t seed);

  // n^d copies side by side in a cell n times as long: the same structure,
  // whose relaxations are free to break its period. Grain i of copy c is c
  // size() + i.
  Packing Copies(int n) const;

  // Moves every grain into the cell (exactly, by lattice vectors); returns n_i
  // of x_i <- x_i - H n_i.
  std::vector<Image> Wrap();

  // Gives the lattice its shortest edges, H -> H T with Box::Reduced(), and
  // moves every grain into that cell: grains, contacts and forces stay what
  // they are (exactly, if the cell is Box::Rounded()), only images have other
  // names. Returns false, and changes nothing, if the edges are the shortest
  // already; else T is written to `transform`.
  bool Fold(Eigen::Matrix3i* transform);
};

// D = 1 + gamma e_1 (x) e_2 (sec. 2.3) and D = diag(1 + gamma, 1 / (1 + gamma))
// (sec. 4.3), padded with 1 in 3D.
SmallMatrix SimpleShear(int dimension, double gamma);
SmallMatrix PureShear(int dimension, double gamma);

// pi r^2 or 4 pi r^3 / 3.
double GrainVolume(int dimension, double radius);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PACKING_H_
