#include "experiments/minima.h"

#include <cmath>

namespace granopt {

double RigidDistance(const std::vector<double>& a,
                     const std::vector<bool>& is_rattler_a,
                     const std::vector<double>& b,
                     const std::vector<bool>& is_rattler_b) {
  const int grains = static_cast<int>(is_rattler_a.size());
  const int d = grains == 0 ? 0 : static_cast<int>(a.size()) / grains;
  double largest = 0.0;
  for (int k = 0; k < d; ++k) {
    const auto difference = [&](int i) { return a[d * i + k] - b[d * i + k]; };
    double mean = 0.0;
    int rigid = 0;
    for (int i = 0; i < grains; ++i) {
      if (is_rattler_a[i] || is_rattler_b[i]) continue;
      mean += difference(i);
      ++rigid;
    }
    if (rigid > 0) mean /= rigid;
    for (int i = 0; i < grains; ++i) {
      if (is_rattler_a[i] || is_rattler_b[i]) continue;
      largest = std::max(largest, std::abs(difference(i) - mean));
    }
  }
  return largest;
}

std::string Minima::Tag(double energy,
                        double residual,
                        double vanishing,
                        double mean_overlap,
                        const std::vector<double>& displacements,
                        const std::vector<bool>& is_rattler) {
  if (energy == 0.0) return "0";
  if (!(residual <= kResidualBound)) {
    return vanishing <= kVanishingBound ? "0" : "-";
  }
  for (const Minimum& other : minima_) {
    if (std::abs(energy - other.energy) >
        kEnergyBound * std::max(std::abs(energy), std::abs(other.energy))) {
      continue;
    }
    if (RigidDistance(
            displacements, is_rattler, other.displacements, other.is_rattler) <=
        kOverlapBound * mean_overlap) {
      return other.name;
    }
  }
  std::string name;
  for (int k = ++next_; k > 0; k = (k - 1) / 26) {
    name.insert(name.begin(), static_cast<char>('A' + (k - 1) % 26));
  }
  minima_.push_back({name, energy, displacements, is_rattler});
  return name;
}

}  // namespace granopt
