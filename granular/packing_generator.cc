#include "granular/packing_generator.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "granular/spatial_order.h"
#include "solvers/random.h"

namespace granopt {

bool GeneratePacking(const GeneratorOptions& options,
                     Packing* packing,
                     std::string* error) {
  const int d = options.dimension;
  const int n = options.particles;
  const auto fail = [error](const std::string& line) {
    *error = line;
    return false;
  };
  if (d != 2 && d != 3) {
    return fail("dimension = " + std::to_string(d) + " must be 2 or 3");
  }
  if (n < 1 || n > kMostGrains) {
    return fail("particles = " + std::to_string(n) + " must be in [1, " +
                std::to_string(kMostGrains) + "]");
  }
  if (!(options.packing_fraction > 0.0) || !(options.packing_fraction <= 4.0)) {
    return fail("phi = " + std::to_string(options.packing_fraction) +
                " must be in (0, 4]");
  }
  if (!(options.polydispersity >= 0.0) || !(options.polydispersity < 1.0)) {
    return fail("polydispersity = " + std::to_string(options.polydispersity) +
                " must be in [0, 1)");
  }
  double fractions = 0.0;
  for (const SpeciesOptions& s : options.species) {
    if (!(s.number_fraction >= 0.0) || !(s.relative_radius > 0.0) ||
        !std::isfinite(s.number_fraction + s.relative_radius)) {
      return fail("species " + s.name +
                  ": number fraction and radius must be positive");
    }
    fractions += s.number_fraction;
  }
  if (!(fractions > 0.0)) return fail("no species given");

  UniformRandom random(options.seed);
  *packing = Packing();
  packing->box = Box::Cube(d, 1.0);
  Eigen::MatrixXd x(d, n);
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < d; ++k) x(k, i) = random();
  }
  packing->positions = x;
  const std::vector<int> order = SpatialOrder(*packing);

  // Exact numbers of each species, in random order (Fisher-Yates).
  std::vector<int> kind(n);
  double cumulated = 0.0;
  int next = 0;
  for (std::size_t s = 0; s < options.species.size(); ++s) {
    cumulated += options.species[s].number_fraction / fractions;
    const int end =
        s + 1 == options.species.size()
            ? n
            : std::min(n, static_cast<int>(std::lround(cumulated * n)));
    for (; next < end; ++next) kind[next] = static_cast<int>(s);
  }
  for (int i = n - 1; i > 0; --i) {
    std::swap(kind[i], kind[static_cast<int>(random() * (i + 1))]);
  }

  packing->radii.resize(n);
  packing->species.resize(n);
  for (int i = 0; i < n; ++i) {
    packing->positions.col(i) = x.col(order[i]);
    packing->radii[i] = options.species[kind[i]].relative_radius;
    packing->species[i] = options.species[kind[i]].name;
  }
  if (options.polydispersity > 0.0) {
    for (int i = 0; i < n; ++i) {
      packing->radii[i] *=
          1.0 + options.polydispersity * (2.0 * random() - 1.0);
    }
  }
  packing->SetPackingFraction(options.packing_fraction);
  packing->attributes["seed"] = std::to_string(options.seed);
  return true;
}

}  // namespace granopt
