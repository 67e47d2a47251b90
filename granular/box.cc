#include "granular/box.h"

#include <algorithm>
#include <cmath>

#include "Eigen/LU"

namespace granopt {

Box::Box(const SmallMatrix& edges) : edges_(edges) {
  const int d = dimension();
  volume_ = std::abs(edges.determinant());
  inverse_ = edges.inverse();
  // Row k of H^-1 is normal to the faces that edge k connects, and has length
  // 1 / height.
  for (int k = 0; k < d; ++k) heights_[k] = 1.0 / inverse_.row(k).norm();
}

Box Box::Cube(int dimension, double length) {
  return Box(length * SmallMatrix::Identity(dimension, dimension));
}

bool Box::IsValid() const {
  if (dimension() != edges_.cols() || dimension() < 2) return false;
  if (!edges_.allFinite() || !inverse_.allFinite()) return false;
  double product = 1.0, longest = 0.0, least_height = heights_[0];
  for (int k = 0; k < dimension(); ++k) {
    const double length = edges_.col(k).norm();
    product *= length;
    longest = std::max(longest, length);
    least_height = std::min(least_height, heights_[k]);
  }
  // The second bound keeps image numbers and Reduced() within an int.
  return std::isfinite(product) && volume_ > 1e-12 * product &&
         longest < 1e8 * least_height;
}

double Box::Length() const {
  return dimension() == 2 ? std::sqrt(volume_) : std::cbrt(volume_);
}

Image Box::CellOf(const double* x) const {
  Image n = {0, 0, 0};
  const int d = dimension();
  for (int k = 0; k < d; ++k) {
    double fraction = 0.0;
    for (int c = 0; c < d; ++c) fraction += inverse_(k, c) * x[c];
    // Further out (or nowhere, NaN) there is no image to speak of.
    constexpr double kMostCells = 1e9;
    if (std::abs(fraction) < kMostCells) {
      // The floor, which is a call of the library on old machines.
      n[k] = static_cast<int>(fraction);
      if (fraction < n[k]) --n[k];
    }
  }
  return n;
}

Box Box::Deformed(const SmallMatrix& deformation) const {
  return Box(deformation * edges_);
}

Box Box::Reduced(Eigen::Matrix3i* transform) const {
  SmallMatrix h = edges_;
  transform->setIdentity();
  const int d = dimension();
  // Each subtraction shortens an edge, so this ends; the bound is for roundoff.
  for (int sweep = 0; sweep < 200; ++sweep) {
    bool changed = false;
    for (int a = 0; a < d; ++a) {
      for (int b = 0; b < d; ++b) {
        if (a == b) continue;
        const double n =
            std::round(h.col(a).dot(h.col(b)) / h.col(b).squaredNorm());
        if (n == 0.0) continue;
        const SmallVector shorter = h.col(a) - n * h.col(b);
        if (shorter.squaredNorm() < h.col(a).squaredNorm()) {
          h.col(a) = shorter;
          transform->col(a) -= static_cast<int>(n) * transform->col(b);
          changed = true;
        }
      }
    }
    if (!changed) break;
  }
  return Box(h);
}

Box Box::Rounded() const {
  const double most = edges_.cwiseAbs().maxCoeff();
  if (!(most > 0.0) || !std::isfinite(most)) return *this;
  constexpr int kBits = 50;
  const int exponent = std::ilogb(most) - kBits;
  SmallMatrix h = edges_;
  for (int c = 0; c < h.cols(); ++c) {
    for (int r = 0; r < h.rows(); ++r) {
      h(r, c) =
          std::ldexp(std::nearbyint(std::ldexp(h(r, c), -exponent)), exponent);
    }
  }
  return Box(h);
}

}  // namespace granopt
