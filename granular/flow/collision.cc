#include "granular/flow/collision.h"

#include <algorithm>
#include <cmath>

#include "granular/flow/ingredients.h"

namespace granopt {

FrictionImpulse EvaluateFriction(const FrictionOptions& options,
                                 double effective_mass,
                                 double normal_impulse,
                                 const double* slide,
                                 const double* pull) {
  FrictionImpulse result;
  double square = 0.0;
  for (int k = 0; k < 3; ++k) {
    result.impulse[k] = effective_mass * (slide[k] + pull[k]);
    square += result.impulse[k] * result.impulse[k];
  }
  const double trial = std::sqrt(square);
  result.sticks = trial <= options.mu_static * normal_impulse;
  if (result.sticks || trial == 0.0) return result;
  const double factor = options.mu_dynamic * normal_impulse / trial;
  for (int k = 0; k < 3; ++k) result.impulse[k] *= factor;
  return result;
}

double Restitution(const ImpactOptions& options, double normal_speed) {
  if (!kHasRestitutionLaw || !options.is_velocity_dependent) {
    return options.restitution;
  }
  return std::max(
      options.restitution * (1.0 - normal_speed / options.velocity_scale),
      std::min(options.least_restitution, options.restitution));
}

double NormalImpulse(double restitution,
                     double effective_mass,
                     double approach,
                     double pull) {
  return std::max(0.0,
                  effective_mass * ((1.0 + restitution) * approach + pull));
}

void FreezeImpacts(const std::vector<ClosePair>& pairs,
                   const ImpactOptions& options,
                   int stride,
                   const double* v,
                   std::vector<Impact>* impacts) {
  impacts->clear();
  for (const ClosePair& pair : pairs) {
    Impact impact;
    impact.i = pair.i;
    impact.j = pair.j;
    double approach = 0.0;
    for (int k = 0; k < 3; ++k) {
      impact.normal[k] = pair.normal[k];
      approach +=
          (v[k * stride + pair.i] - v[k * stride + pair.j]) * pair.normal[k];
    }
    impact.restitution = Restitution(options, std::fabs(approach));
    impacts->push_back(impact);
  }
}

ImpactWork ApplyImpacts(const std::vector<Impact>& impacts,
                        const ImpactOptions& options,
                        double step,
                        int stride,
                        const double* inverse_mass,
                        const double* force,
                        double* u) {
  ImpactWork work;
  const double duration = options.duration * step;
  for (const Impact& impact : impacts) {
    const double wi = inverse_mass[impact.i];
    const double wj = inverse_mass[impact.j];
    if (wi + wj == 0.0) continue;
    const double effective_mass = 1.0 / (wi + wj);
    double slide[3], pull[3] = {0.0, 0.0, 0.0};
    double approach = 0.0, pull_n = 0.0;
    for (int k = 0; k < 3; ++k) {
      const int i = k * stride + impact.i, j = k * stride + impact.j;
      slide[k] = u[i] - u[j];
      if (force != nullptr) {
        pull[k] = (force[i] * wi - force[j] * wj) * duration;
      }
      approach += slide[k] * impact.normal[k];
      pull_n += pull[k] * impact.normal[k];
    }
    const double e = impact.restitution;
    const double p = NormalImpulse(e, effective_mass, approach, pull_n);
    if (p == 0.0) continue;
    ++work.impulses;
    const double after = approach - p * (wi + wj);
    work.normal -= 0.5 * p * (approach + after);
    // 1: grain i is held in place, so that j alone takes the impulse; -1: j is.
    const double pinned = wi == 0.0 ? 1.0 : wj == 0.0 ? -1.0 : 0.0;
    for (int k = 0; k < 3; ++k) {
      work.fixed[k] += pinned * p * impact.normal[k];
      u[k * stride + impact.i] -= p * wi * impact.normal[k];
      u[k * stride + impact.j] += p * wj * impact.normal[k];
    }
    if (!kHasFriction || !options.friction.IsPresent()) continue;
    for (int k = 0; k < 3; ++k) {
      slide[k] -= approach * impact.normal[k];
      pull[k] -= pull_n * impact.normal[k];
    }
    const FrictionImpulse friction =
        EvaluateFriction(options.friction, effective_mass, p, slide, pull);
    work.sticking += friction.sticks ? 1 : 0;
    for (int k = 0; k < 3; ++k) {
      const double q = friction.impulse[k];
      work.fixed[k] += pinned * q;
      work.friction -= q * (slide[k] - 0.5 * q * (wi + wj));
      u[k * stride + impact.i] -= q * wi;
      u[k * stride + impact.j] += q * wj;
    }
  }
  return work;
}

}  // namespace granopt
