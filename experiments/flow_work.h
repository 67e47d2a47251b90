// granopt: flows of known setup, run in one way or another and measured: the
// paper's simulations, steppers by name, work and error. What the studies of
// `flow` and `tradeoff --flow` share.

#ifndef GRANOPT_EXPERIMENTS_FLOW_WORK_H_
#define GRANOPT_EXPERIMENTS_FLOW_WORK_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "granular/flow/flow.h"
#include "granular/flow/stepper.h"

namespace granopt {

// A scene and its start.
struct FlowCase {
  std::unique_ptr<FlowScene> scene;
  FlowState state;
};

// (alpha1, alpha2) of the four simulations of figures 5 and 6.
struct Strength {
  double alpha1, alpha2;
};
constexpr Strength kPaperStrengths[] = {
    {0.0, 0.0}, {0.1, 0.05}, {0.25, 0.125}, {0.5, 0.25}};

// One of the paper's simulations (sec. 7.1) from that seed, begun; strengths of
// 0 have no near field. BadInput where there is no place for so many grains.
FlowCase MakePaperCase(const Strength& strength,
                       std::uint64_t seed,
                       Domain::Kind domain,
                       bool velocity_dependent,
                       int particles);

// A way to take steps.
struct StepperSetting {
  // "verlet"; "jacobi", "gauss_seidel" or "groups", sweeps of the implicit
  // step; or a method that minimizes it, "lbfgs", "ncg", "newton".
  std::string name;
  double tolerance = 1e-8;  // TOL of an implicit step
  double dt = 0.01;         // its limit where steps are adapted
  double relaxation = 1.0;
  double first_step = 0.001;
  int iterations = 10;  // K_d
};
// "jacobi", "gauss_seidel", "groups"; false for another word.
bool ParseSweep(const std::string& word, StepperOptions::Sweep* sweep);
// Null with one line in `error` for an unknown name.
std::unique_ptr<Stepper> MakeStepper(const StepperSetting& setting,
                                     std::string* error);

// What a run costs and ends in.
struct FlowMeasurement {
  std::string error;     // why it did not reach its end; empty: it did
  double seconds = 0.0;  // CPU
  double wall = 0.0;     // and by the clock
  FlowState state;
  // At each of the times asked for, per mass; of a run that failed, until then.
  std::vector<KineticEnergy> kinetic;
  // What the integrator made or took, over the energy that moves: numerical of
  // (L2) over the largest kinetic energy, at the end.
  double drift = 0.0;
};
// From the start of `flow` through all `times` (> 0, increasing), each of them
// the end of a step.
FlowMeasurement MeasureFlow(const FlowCase& flow,
                            const StepperSetting& setting,
                            const std::vector<double>& times);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_FLOW_WORK_H_
