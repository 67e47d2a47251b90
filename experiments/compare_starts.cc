#include "experiments/compare_starts.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <utility>

#include "experiments/compare_flags.h"

namespace granopt {

bool MakeStarts(const Plan& plan,
                Preparation* preparation,
                Starts* starts,
                std::vector<StepRecord>* steps,
                std::string* error) {
  int expected = 0;
  for (const Case& c : plan.setup.cases) {
    if (c.kind != "near_jamming") continue;
    expected +=
        static_cast<int>(SeedsOf(plan.setup, c).size()) * plan.setup.steps;
  }
  preparation->ExpectSteps(expected);
  for (const std::uint64_t seed : plan.setup.seeds) {
    std::vector<Packing> near;
    for (const Case& c : plan.setup.cases) {
      const std::vector<std::uint64_t> seeds = SeedsOf(plan.setup, c);
      if (std::find(seeds.begin(), seeds.end(), seed) == seeds.end()) continue;
      Start start;
      if (c.kind == "near_jamming") {
        if (near.empty() &&
            !preparation->NearJamming(seed, plan.distances, &near, error)) {
          return false;
        }
        const auto at =
            std::find(plan.distances.begin(), plan.distances.end(), c.distance);
        const Packing& base = near[at - plan.distances.begin()];
        const double distance =
            base.PackingFraction() -
            std::strtod(base.attributes.at("phi_j").c_str(), nullptr);
        for (ShearStep& step : preparation->Shear(
                 base, c, seed, plan.setup.steps, FLAGS_prepare_evaluations)) {
          Start& one = (*starts)[{c.id, seed, step.record.step}];
          one.packing = step.start;
          one.distance = distance;
          steps->push_back(step.record);
          one.step = std::make_unique<ShearStep>(std::move(step));
          one.step->start = Packing();
        }
        continue;
      } else if (c.kind == "fig2") {
        start.packing = preparation->Compressed(seed, plan.phi_fig2);
      } else if (c.kind == "start") {
        start.packing = MakeScene(plan.phi, seed).packing;
      } else {
        start.packing = preparation->Relaxed(seed);
      }
      ApplyLoad(LoadOf(c), seed, &start.packing);
      (*starts)[{c.id, seed, 1}] = std::move(start);
    }
  }
  return true;
}

}  // namespace granopt
