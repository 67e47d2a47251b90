#include "granular/spatial_order.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace granopt {
namespace {

// Positions and forces of so many grains stay in a cache of half a megabyte,
// where their order does not matter.
constexpr int kCachedGrains = 16384;

// Two grains are apart if they are this many mean spacings from each other.
constexpr double kApart = 10.0;

// In units of the cell's edges, in [0, 1].
Eigen::MatrixXd Fractions(const Packing& packing) {
  Eigen::MatrixXd s = packing.box.inverse() * packing.positions;
  return s.array() - s.array().floor();
}

}  // namespace

std::uint64_t MortonCode(const double* x, int dimension) {
  constexpr std::uint64_t kCells = 1 << 20;
  std::uint64_t code = 0;
  std::uint64_t cell[3];
  for (int k = 0; k < dimension; ++k) {
    cell[k] = std::min(static_cast<std::uint64_t>(x[k] * kCells), kCells - 1);
  }
  for (int bit = 19; bit >= 0; --bit) {
    for (int k = 0; k < dimension; ++k) {
      code = (code << 1) | ((cell[k] >> bit) & 1);
    }
  }
  return code;
}

std::vector<int> SpatialOrder(const Packing& packing) {
  const int n = static_cast<int>(packing.positions.cols());
  const Eigen::MatrixXd s = Fractions(packing);
  std::vector<std::pair<std::uint64_t, int>> places(n);
  for (int i = 0; i < n; ++i) {
    places[i] = {MortonCode(s.col(i).data(), packing.dimension()), i};
  }
  std::sort(places.begin(), places.end());
  std::vector<int> order(n);
  for (int k = 0; k < n; ++k) order[k] = places[k].second;
  return order;
}

bool IsScattered(const Packing& packing) {
  const int n = packing.size();
  if (n <= kCachedGrains) return false;
  const Eigen::MatrixXd s = Fractions(packing);
  const double far = kApart * std::pow(n, -1.0 / packing.dimension());
  int apart = 0;
  for (int i = 0; i + 1 < n; ++i) {
    const Eigen::ArrayXd step = (s.col(i + 1) - s.col(i)).array();
    apart += (step - step.round()).abs().maxCoeff() > far;
  }
  return 2 * apart > n;
}

Packing Reordered(const Packing& packing, const std::vector<int>& order) {
  Packing result = packing;
  for (int k = 0; k < packing.size(); ++k) {
    const int i = order[k];
    result.positions.col(k) = packing.positions.col(i);
    if (packing.positions_low.size() > 0) {
      result.positions_low.col(k) = packing.positions_low.col(i);
    }
    result.radii[k] = packing.radii[i];
    if (packing.stiffness.size() > 0) {
      result.stiffness[k] = packing.stiffness[i];
    }
    if (!packing.species.empty()) result.species[k] = packing.species[i];
  }
  return result;
}

Packing Restored(const Packing& packing, const std::vector<int>& order) {
  std::vector<int> inverse(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    inverse[order[k]] = static_cast<int>(k);
  }
  return Reordered(packing, inverse);
}

std::vector<Contact> Restored(std::vector<Contact> contacts,
                              const std::vector<int>& order) {
  for (Contact& c : contacts) {
    c.id.i = order[c.id.i];
    c.id.j = order[c.id.j];
    if (c.id.i > c.id.j) {
      std::swap(c.id.i, c.id.j);
      for (int& n : c.id.image) n = -n;
      c.normal = -c.normal;
    }
  }
  std::sort(contacts.begin(),
            contacts.end(),
            [](const Contact& a, const Contact& b) { return a.id < b.id; });
  return contacts;
}

}  // namespace granopt
