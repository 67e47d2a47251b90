#include "solvers/barrier.h"

#include <algorithm>
#include <cmath>

#include "Eigen/Core"

namespace granopt {

double ComplementarityOf(const UnilateralFunction& function, double length) {
  double force, stiffness;
  function.EvaluateLaw(1, &length, &force, &stiffness);
  return force * length;
}

void CentralClosures(const UnilateralFunction& function,
                     int n,
                     const double* delta,
                     double length,
                     double* closure,
                     double* slack) {
  const double mu = ComplementarityOf(function, length);
  Eigen::VectorXd force(n), stiffness(n);
  // phi(e) (e - delta) is convex and grows with e, and the start is on the far
  // side: Newton's method comes down to the zero without a safeguard.
  constexpr int kMaxIterations = 60;
  constexpr double kAccuracy = 1e-12;
  for (int c = 0; c < n; ++c) closure[c] = std::max(delta[c], 0.0) + length;
  bool done = false;
  for (int iteration = 0; iteration < kMaxIterations && !done; ++iteration) {
    function.EvaluateLaw(n, closure, force.data(), stiffness.data());
    done = true;
    for (int c = 0; c < n; ++c) {
      const double s = closure[c] - delta[c];
      const double step = (force[c] * s - mu) / (stiffness[c] * s + force[c]);
      if (!(step > 0.0)) continue;
      closure[c] -= step;
      if (step > kAccuracy * closure[c]) done = false;
    }
  }
  // By the product: where delta is large the difference has no digits.
  function.EvaluateLaw(n, closure, force.data(), stiffness.data());
  for (int c = 0; c < n; ++c) slack[c] = mu / force[c];
}

}  // namespace granopt
