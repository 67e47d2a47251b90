#include "granular/force_network.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "solvers/normalize.h"

namespace granopt {
namespace {

// A removed grain counts all the same if one of its contacts carries more than
// this many residuals and this part of the mean force: rattlers that a
// minimization left in touch carry about a residual.
constexpr double kLoadedResiduals = 1e3;
constexpr double kLoadedForce = 1e-8;

}  // namespace

LinkBlock BlockOf(const Link& link) {
  if (!(link.overlap > 0.0)) return {};
  const double tension = link.force / link.distance;
  return {link.stiffness + tension, -tension};
}

std::vector<bool> CountingGrains(const Observables& observables,
                                 const std::vector<Contact>& contacts) {
  std::vector<bool> counts = observables.is_rattler;
  counts.flip();
  const double loaded =
      observables.mean_force *
      std::max(kLoadedForce, kLoadedResiduals * observables.relative_residual);
  for (const Contact& c : contacts) {
    if (c.force > loaded) counts[c.id.i] = counts[c.id.j] = true;
  }
  return counts;
}

ForceNetwork MakeForceNetwork(int dimension,
                              double alpha,
                              const Observables& observables,
                              const std::vector<Contact>& contacts) {
  ForceNetwork network;
  network.dimension = dimension;
  const std::vector<bool> counts = CountingGrains(observables, contacts);
  network.place.assign(observables.grains, -1);
  for (int i = 0; i < observables.grains; ++i) {
    if (!counts[i]) continue;
    network.place[i] = network.size();
    network.grains.push_back(i);
  }

  double force = 0.0;
  double overlap = 0.0;
  double other = 0.0;
  double smallest = std::numeric_limits<double>::infinity();
  int links = 0;
  std::vector<int> degree(network.size(), 0);
  for (const Contact& c : contacts) {
    if (!network.BothCount(c.id)) {
      other = std::max(other, c.force);
      continue;
    }
    ++links;
    force += c.force;
    overlap += c.overlap;
    smallest = std::min(smallest, c.overlap);
    ++degree[network.place[c.id.i]];
    ++degree[network.place[c.id.j]];
  }
  if (links == 0) return network;
  force /= links;
  overlap /= links;
  const double stiffness = (alpha - 1.0) * force / overlap;
  network.other_force = other / force;
  network.held = static_cast<int>(
      std::max_element(degree.begin(), degree.end()) - degree.begin());

  network.stiffness_unit = NormalizingPower(stiffness);
  network.length_unit = NormalizingPower(overlap);
  const double force_unit = network.stiffness_unit * network.length_unit;
  network.stiffness = network.stiffness_unit * stiffness;
  network.mean_overlap = network.length_unit * overlap;
  network.smallest_overlap = network.length_unit * smallest;
  network.mean_force = force_unit * force;
  network.links.reserve(links);
  for (const Contact& c : contacts) {
    if (!network.BothCount(c.id)) continue;
    Link link;
    link.i = network.place[c.id.i];
    link.j = network.place[c.id.j];
    link.normal = c.normal;
    link.overlap = network.length_unit * c.overlap;
    link.distance = network.length_unit * c.distance;
    link.force = force_unit * c.force;
    link.stiffness = network.stiffness_unit * c.stiffness;
    network.links.push_back(link);
  }
  return network;
}

SparseMatrix AssembleBlocks(const ForceNetwork& network,
                            const std::vector<LinkBlock>& blocks,
                            int held) {
  const int d = network.dimension;
  const int n = network.size() - (held < 0 ? 0 : 1);
  const auto place = [&](int i) {
    return held < 0 || i < held ? i : (i == held ? -1 : i - 1);
  };
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(network.links.size() * (2 * d * d + d) +
                  static_cast<std::size_t>(n) * d);
  // The diagonal is there even if it is zero.
  for (int v = 0; v < n * d; ++v) entries.emplace_back(v, v, 0.0);
  for (std::size_t l = 0; l < network.links.size(); ++l) {
    const Link& link = network.links[l];
    const LinkBlock& block = blocks[l];
    if (link.i == link.j || (block.a == 0.0 && block.b == 0.0)) continue;
    const int i = place(link.i);
    const int j = place(link.j);
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        const double value = block.a * link.normal[r] * link.normal[c] +
                             (r == c ? block.b : 0.0);
        if (i >= 0 && r >= c) entries.emplace_back(d * i + r, d * i + c, value);
        if (j >= 0 && r >= c) entries.emplace_back(d * j + r, d * j + c, value);
        if (i >= 0 && j >= 0) {
          entries.emplace_back(
              d * std::max(i, j) + r, d * std::min(i, j) + c, -value);
        }
      }
    }
  }
  SparseMatrix matrix(n * d, n * d);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

std::vector<int> Pieces(const ForceNetwork& network) {
  std::vector<int> root(network.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&root](int i) {
    while (root[i] != i) i = root[i] = root[root[i]];
    return i;
  };
  for (const Link& link : network.links) {
    if (link.overlap > 0.0) root[find(link.i)] = find(link.j);
  }
  std::vector<int> size(network.size(), 0);
  for (int i = 0; i < network.size(); ++i) ++size[find(i)];
  size.erase(std::remove(size.begin(), size.end(), 0), size.end());
  std::sort(size.rbegin(), size.rend());
  return size;
}

}  // namespace granopt
