// granopt: a packing that comes to rest by damped motion, as in molecular
// dynamics of soft grains.

#ifndef GRANOPT_GRANULAR_DAMPED_MOTION_H_
#define GRANOPT_GRANULAR_DAMPED_MOTION_H_

#include <cstdint>
#include <string>

#include "granular/relaxation.h"

namespace granopt {

struct DampedMotionOptions {
  ContactEnergyOptions energy;
  // c / sqrt(k m) with the mean mass m: 2 is critical for a grain on one
  // spring.
  double damping = 0.5;
  // dt / sqrt(m / k): 1 is far above what a grain among six neighbours bears.
  double time_step = 0.1;
  // Ends when max|g| <= tolerance mean contact forces.
  double tolerance = 1e-10;
  double vanishing_tolerance = 1e-13;
  std::int64_t max_steps = 10'000'000;
};

// Newton's equations with viscous damping,
//   m_i x_i'' = -dE/dx_i - c m_i / m x_i',   m_i = v_i (density 1),
// by velocity Verlet with the damping in the half steps (its exact decay
// there), from rest at `start`, until the forces balance. k is the largest
// f'(delta) among contacts that overlap by a mean radius times 0.1: for alpha =
// 2 the stiffness itself. `summary` has the reason and, as iterations and
// evaluations, the steps; a step costs one evaluation of the gradient.
//
// This is the physics that energy minimization leaves out (paper, Remark 1.1),
// for comparison: it is no method of solvers/, and slower than any of them.
// Returns false with one line in `error` for a packing that cannot be simulated
// or bad options.
bool RelaxByDampedMotion(const Packing& start,
                         const DampedMotionOptions& options,
                         Relaxation* result,
                         std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_DAMPED_MOTION_H_
