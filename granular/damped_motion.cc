#include "granular/damped_motion.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <vector>

#include "solvers/format.h"

namespace granopt {

bool RelaxByDampedMotion(const Packing& start,
                         const DampedMotionOptions& options,
                         Relaxation* result,
                         std::string* error) {
  if (!(options.damping > 0.0) || !(options.time_step > 0.0)) {
    *error = Format("damping = %g and time_step = %g must be positive",
                    options.damping,
                    options.time_step);
    return false;
  }
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(start, options.energy, error);
  if (energy == nullptr) return false;
  const auto begin = std::chrono::steady_clock::now();
  const int d = start.dimension();
  const int n = energy->NumParameters();
  const double radius = start.MeanRadius();
  Eigen::VectorXd mass(n);
  for (int v = 0; v < n; ++v) mass[v] = GrainVolume(d, start.radii[v / d]);
  const double mean_mass = mass.mean();
  double stiffness = 0.0, force = 0.0;
  const double overlap = 0.1 * radius;
  energy->EvaluateLaw(1, &overlap, &force, &stiffness);
  stiffness *= options.energy.stiffness;
  if (start.stiffness.size() > 0) stiffness *= start.stiffness.maxCoeff();
  const double unit = std::sqrt(mean_mass / stiffness);
  const double dt = options.time_step * unit;
  // Damping in proportion to mass: every velocity decays alike.
  const double decay = std::exp(-0.5 * options.damping * options.time_step);

  Summary summary;
  summary.solver = "damped motion";
  Eigen::VectorXd u = Eigen::VectorXd::Zero(n);
  Eigen::VectorXd velocity = Eigen::VectorXd::Zero(n);
  Eigen::VectorXd gradient(n);
  Eigen::VectorXd last = u;  // the last point where the energy is defined
  const auto evaluate = [&]() {
    ++summary.counters.evaluations;
    return energy->EvaluateWithScales(
        u.data(), &summary.cost, gradient.data(), &summary.scales);
  };
  bool is_defined = evaluate();
  summary.initial_cost = summary.cost;
  for (;;) {
    if (!is_defined) {
      u = last;
      summary.reason = StopReason::EVALUATION_FAILED;
      summary.message = "grains have left every bound: the step is too long";
      break;
    }
    summary.max_gradient = gradient.cwiseAbs().maxCoeff();
    summary.tolerance = options.tolerance * summary.scales.gradient;
    if (summary.scales.vanishing <= options.vanishing_tolerance) {
      summary.reason = StopReason::VANISHED;
      summary.message = "no contact carries a force";
      break;
    }
    if (summary.max_gradient <= summary.tolerance) {
      summary.reason = StopReason::CONVERGED;
      summary.message =
          Format("|g| = %.1e <= %.1e", summary.max_gradient, summary.tolerance);
      break;
    }
    if (summary.counters.iterations >= options.max_steps) {
      summary.reason = StopReason::MAX_ITERATIONS;
      summary.message = Format("|g| = %.1e > %.1e after %lld steps",
                               summary.max_gradient,
                               summary.tolerance,
                               static_cast<long long>(options.max_steps));
      break;
    }
    ++summary.counters.iterations;
    velocity *= decay;
    velocity.array() -= 0.5 * dt * gradient.array() / mass.array();
    last = u;
    u += dt * velocity;
    if (energy->Recenter(u.data())) ++summary.counters.recenters;
    is_defined = evaluate();
    velocity.array() -= 0.5 * dt * gradient.array() / mass.array();
    velocity *= decay;
  }
  summary.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin)
          .count();
  *result = Conclude(std::move(summary), u.data(), energy.get());
  return true;
}

}  // namespace granopt
