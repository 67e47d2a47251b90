#include "granular/quad_residual.h"

#include <quadmath.h>

#include <algorithm>
#include <cmath>

#include "granular/neighbor_list.h"

namespace granopt {
namespace {

using Quad = __float128;

// k delta^(alpha-1) and k delta^alpha / alpha by definition.
struct QuadLaw {
  double alpha;
  Quad Power(Quad delta, Quad exponent) const {
    if (exponent == 1) return delta;
    if (exponent == 2) return delta * delta;
    return powq(delta, exponent);
  }
  Quad Force(Quad delta) const { return Power(delta, Quad(alpha) - 1); }
  Quad Energy(Quad delta) const {
    return Power(delta, Quad(alpha)) / Quad(alpha);
  }
};

}  // namespace

bool EvaluateQuad(const Packing& packing,
                  const ContactEnergyOptions& options,
                  const double* displacements,
                  QuadResidual* result,
                  std::string* error) {
  if (!packing.IsValid(error)) return false;
  if (!(options.alpha >= 2.0)) {
    *error = "alpha = " + std::to_string(options.alpha) + " must be >= 2";
    return false;
  }
  const int d = packing.dimension();
  const int n = packing.size();
  std::vector<Quad> x(static_cast<std::size_t>(d) * n);
  Eigen::MatrixXd rounded(d, n);
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < d; ++k) {
      const DoubleDouble p = packing.Position(i, k);
      Quad& coordinate = x[d * i + k];
      coordinate = Quad(p.hi) + Quad(p.lo);
      if (displacements != nullptr) {
        if (!std::isfinite(displacements[d * i + k])) {
          *error = "a displacement is not finite";
          return false;
        }
        coordinate += displacements[d * i + k];
      }
      rounded(k, i) = static_cast<double>(coordinate);
    }
  }
  // The plain list in double precision, with a skin far above its rounding.
  NeighborList list;
  if (!BuildNeighborList(packing.box,
                         rounded,
                         packing.radii,
                         1e-6 * packing.radii.minCoeff(),
                         &list,
                         error)) {
    return false;
  }
  const QuadLaw law{options.alpha};
  std::vector<Quad> gradient(x.size(), Quad(0));
  Quad energy = 0;
  Quad force_sum = 0;
  result->contacts = 0;
  for (int i = 0; i < n; ++i) {
    for (int p = list.row_start[i]; p < list.row_start[i + 1]; ++p) {
      const int j = list.j[p];
      Quad r[3];
      Quad square = 0;
      for (int k = 0; k < d; ++k) {
        r[k] = x[d * i + k] - x[d * j + k];
        for (int c = 0; c < d; ++c) {
          r[k] += Quad(packing.box.edges()(k, c)) * list.image[p][c];
        }
        square += r[k] * r[k];
      }
      const Quad distance = sqrtq(square);
      const Quad delta =
          Quad(packing.radii[i]) + Quad(packing.radii[j]) - distance;
      if (!(delta > 0)) continue;
      Quad k_pair = options.stiffness;
      if (packing.stiffness.size() > 0) {
        const Quad ki = packing.stiffness[i];
        const Quad kj = packing.stiffness[j];
        switch (options.rule) {
          case StiffnessRule::MEAN:
            k_pair *= (ki + kj) / 2;
            break;
          case StiffnessRule::SERIES:
            k_pair *= 2 * ki * kj / (ki + kj);
            break;
          case StiffnessRule::GEOMETRIC:
            k_pair *= sqrtq(ki * kj);
            break;
        }
      }
      const Quad force = k_pair * law.Force(delta);
      energy += k_pair * law.Energy(delta);
      force_sum += force;
      ++result->contacts;
      if (distance == 0) continue;
      for (int k = 0; k < d; ++k) {
        const Quad component = force * r[k] / distance;
        gradient[d * i + k] -= component;
        gradient[d * j + k] += component;
      }
    }
  }
  result->energy = static_cast<double>(energy);
  result->mean_force = result->contacts > 0
                           ? static_cast<double>(force_sum / result->contacts)
                           : 0.0;
  result->gradient.resize(gradient.size());
  result->max_gradient = 0.0;
  for (std::size_t v = 0; v < gradient.size(); ++v) {
    result->gradient[v] = static_cast<double>(gradient[v]);
    result->max_gradient =
        std::max(result->max_gradient, std::abs(result->gradient[v]));
  }
  return true;
}

}  // namespace granopt
