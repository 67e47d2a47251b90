// granopt: packings at the ends of what a user may ask for.

#ifndef GRANOPT_EXPERIMENTS_EXTREME_SCENES_H_
#define GRANOPT_EXPERIMENTS_EXTREME_SCENES_H_

#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"

namespace granopt {

struct ExtremeScene {
  std::string name;    // "distance_1e-8"
  std::string group;   // "distance from jamming"
  std::string what;    // one line
  bool smoke = false;  // among the few that are run with --smoke
  bool large = false;  // run only if asked for
};
const std::vector<ExtremeScene>& ExtremeScenes();

// What a method is to minimize.
struct ExtremeStart {
  Packing packing;
  ContactEnergyOptions energy;
  // Under which it counts as unjammed.
  double vanishing_tolerance = 1e-13;
};

// Builds it; the same on every machine up to rounding. Returns false with one
// line in `error` for an unknown name, or where the packing that it begins with
// could not be prepared.
bool MakeExtremeStart(const std::string& name,
                      ExtremeStart* start,
                      std::string* error);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_EXTREME_SCENES_H_
