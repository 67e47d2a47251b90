#include "experiments/flow_work.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "experiments/run.h"
#include "granular/flow/start.h"
#include "solvers/registry.h"

namespace granopt {

FlowCase MakePaperCase(const Strength& strength,
                       std::uint64_t seed,
                       Domain::Kind domain,
                       bool velocity_dependent,
                       int particles) {
  FlowSceneOptions options;
  options.domain.kind = domain;
  FlowStart start;
  start.particles = particles;
  start.seed = seed;
  start.period = options.domain.period();
  if (strength.alpha1 > 0.0 || strength.alpha2 > 0.0) {
    options.near_field = NearFieldOptions();
    options.near_field->law =
        RadialLaw::Powers(strength.alpha1, 1.0, strength.alpha2, 2.0);
  }
  ImpactOptions impact;
  impact.is_velocity_dependent = velocity_dependent;
  impact.friction = {0.2, 0.1};
  options.impact = impact;
  FlowCase flow;
  std::string error;
  if (!MakeStart(start, &options.grains, &flow.state, &error)) BadInput(error);
  flow.scene = FlowScene::Create(options, &error);
  if (flow.scene == nullptr || !flow.scene->Begin(0.001, &flow.state, &error)) {
    BadInput(error);
  }
  return flow;
}

bool ParseSweep(const std::string& word, StepperOptions::Sweep* sweep) {
  using Sweep = StepperOptions::Sweep;
  for (const auto& [name, known] : {std::pair{"jacobi", Sweep::JACOBI},
                                    {"gauss_seidel", Sweep::GAUSS_SEIDEL},
                                    {"groups", Sweep::GROUPS}}) {
    if (word != name) continue;
    *sweep = known;
    return true;
  }
  return false;
}

std::unique_ptr<Stepper> MakeStepper(const StepperSetting& setting,
                                     std::string* error) {
  StepperOptions options;
  options.step = setting.dt;
  options.first_step = std::min(setting.first_step, setting.dt);
  options.tolerance = setting.tolerance;
  options.relaxation = setting.relaxation;
  options.desired_iterations = setting.iterations;
  if (setting.name == "verlet") return CreateVerletStepper(options);
  if (ParseSweep(setting.name, &options.sweep)) {
    return CreateImplicitStepper(options);
  }
  std::unique_ptr<Solver> solver = CreateSolver(setting.name, error);
  if (solver == nullptr) return nullptr;
  return CreateMinimizingStepper(options, std::move(solver));
}

FlowMeasurement MeasureFlow(const FlowCase& flow,
                            const StepperSetting& setting,
                            const std::vector<double>& times) {
  FlowMeasurement result;
  const FlowScene& scene = *flow.scene;
  result.state = flow.state;
  FlowState& state = result.state;
  const std::unique_ptr<Stepper> stepper = MakeStepper(setting, &result.error);
  if (stepper == nullptr) return result;
  state.step = stepper->FirstStep();
  double largest = state.kinetic_start;
  const double m = scene.total_mass();
  for (const double time : times) {
    const double cpu = CpuSeconds();
    const auto clock = std::chrono::steady_clock::now();
    const bool done =
        RunFlow(scene, time, stepper.get(), nullptr, &state, &result.error);
    result.seconds += CpuSeconds() - cpu;
    result.wall +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - clock)
            .count();
    if (!done) return result;
    KineticEnergy k = scene.Kinetic(state.v.data());
    largest = std::max(largest, k.total());
    k.bulk /= m;
    k.relative /= m;
    result.kinetic.push_back(k);
  }
  result.drift =
      largest > 0.0
          ? std::fabs(scene.Numerical(state, scene.Potential(state.x.data()))) /
                largest
          : 0.0;
  return result;
}

}  // namespace granopt
