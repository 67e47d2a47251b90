// granopt: seeded random starts.

#ifndef GRANOPT_GRANULAR_PACKING_GENERATOR_H_
#define GRANOPT_GRANULAR_PACKING_GENERATOR_H_

#include <cstdint>
#include <string>
#include <vector>

#include "granular/packing.h"

namespace granopt {

// One kind of grain.
struct SpeciesOptions {
  std::string name = "A";
  double number_fraction = 1.0;
  double relative_radius = 1.0;
};

struct GeneratorOptions {
  int dimension = 2;
  int particles = 1024;
  double packing_fraction = 0.84;
  std::uint64_t seed = 1;
  // w in [0, 1): every radius times an independent uniform factor in
  // [1 - w, 1 + w].
  double polydispersity = 0.0;
  // Half of the grains 1.4 times as large as the others (paper, sec. 4).
  std::vector<SpeciesOptions> species = {{"A", 0.5, 1.0}, {"B", 0.5, 1.4}};
};

// Uniform random centres in the unit square or cube, radii so that the packing
// fraction is the one asked for; grains overlap. Grains are numbered along a
// Morton curve through the cell, so that neighbours in space are neighbours in
// memory; species are drawn independently of place. Returns false and one line
// in `error` for options out of range.
bool GeneratePacking(const GeneratorOptions& options,
                     Packing* packing,
                     std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PACKING_GENERATOR_H_
