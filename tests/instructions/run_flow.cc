// Steps a flow of impacts alone a number of times, for ingredients_test.py:
//
//   run_flow TIMES
//
// Built twice: with the library as it is, and with sources from which every
// other ingredient is left out (granular/flow/ingredients.h).

#include <cstdio>
#include <cstdlib>
#include <string>

#include "granular/flow/flow.h"
#include "granular/flow/start.h"
#include "granular/flow/stepper.h"

int main(int argc, char** argv) {
  using namespace granopt;
  if (argc != 2) return 2;
  FlowSceneOptions options;
  options.domain.kind = Domain::Kind::REENTRY;
  options.impact = ImpactOptions();
  FlowStart start;
  start.particles = 200;
  start.length_ratio = 0.35;
  FlowState state;
  std::string error;
  if (!MakeStart(start, &options.grains, &state, &error)) return 2;
  const auto scene = FlowScene::Create(options, &error);
  StepperOptions stepping;
  stepping.step = 0.002;
  const auto stepper = CreateVerletStepper(stepping);
  if (scene == nullptr || !scene->Begin(0.002, &state, &error)) return 2;
  StepReport report;
  for (int k = 0; k < std::atoi(argv[1]); ++k) {
    if (!stepper->Step(*scene, 1.0, &state, &report, &error)) return 2;
  }
  std::printf("%s %.17g %lld\n",
              kHasIngredients ? "whole" : "contacts only",
              scene->Kinetic(state.v.data()).total(),
              static_cast<long long>(state.impulses));
  return 0;
}
