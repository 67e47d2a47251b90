#include "granular/flow/incremental_potential.h"

#include <algorithm>
#include <cmath>

namespace granopt {

IncrementalPotential::IncrementalPotential(const FlowScene& scene,
                                           const FlowState& state,
                                           double dt,
                                           const std::vector<double>& u)
    : scene_(scene),
      state_(state),
      dt_(dt),
      u_(u),
      rank_(scene.size(), -1),
      x_(state.x) {
  for (int i = 0; i < scene.size(); ++i) {
    if (scene.inverse_mass()[i] == 0.0) continue;
    rank_[i] = static_cast<int>(free_.size());
    free_.push_back(i);
  }
  if (scene.options().external) {
    scene.options().external->At(state.time + dt, external_);
  }
}

bool IncrementalPotential::EvaluateWithScales(const double* s,
                                              double* cost,
                                              double* gradient,
                                              Scales* scales) const {
  const int stride = scene_.stride();
  if (!Place(s)) return false;
  scene_.Forces(x_.data(), state_.time + dt_, true, &forces_);
  const double damping = scene_.options().damping;
  double sum = 0.0, size = 0.0;
  bool is_finite = true;
  for (std::size_t f = 0; f < free_.size(); ++f) {
    const int i = free_[f];
    const double m = scene_.grains().mass[i];
    for (int k = 0; k < 3; ++k) {
      const int e = k * stride + i;
      const double d = s[3 * f + k];
      const double lag = d - dt_ * u_[e];
      sum += 0.5 * m / (dt_ * dt_) * lag * lag +
             0.5 * damping * m / dt_ * d * d - m * external_[k] * d;
      const double inertia = m / (dt_ * dt_) * lag + damping * m / dt_ * d;
      const double g = inertia - forces_.total[e];
      is_finite = is_finite && std::isfinite(g);
      size += std::fabs(inertia) + std::fabs(forces_.total[e]);
      if (gradient != nullptr) gradient[3 * f + k] = g;
    }
  }
  sum += forces_.near_field_energy + forces_.soft_contact_energy;
  *cost = sum;
  if (scales != nullptr) {
    *scales = {};
    scales->gradient = size / (2.0 * NumParameters());
    scales->length = length_;
  }
  return is_finite && std::isfinite(sum);
}

template <typename Function>
void IncrementalPotential::ForBlocks(const Function& f) const {
  double block[9];
  for (int i = 0; i < scene_.size(); ++i) {
    for (int j = i + 1; j < scene_.size(); ++j) {
      if (rank_[i] < 0 && rank_[j] < 0) continue;
      if (PairBlock(i, j, block)) f(i, j, block);
    }
  }
}

bool IncrementalPotential::EvaluateHessian(const double* s,
                                           SparseMatrix* hessian) const {
  if (!Place(s)) return false;
  const int m = NumParameters();
  const auto entries = static_cast<Eigen::Index>(m) * (m + 1) / 2;
  if (hessian->rows() != m || hessian->nonZeros() != entries) {
    hessian->resize(m, m);
    // Column c holds rows c ... m - 1.
    hessian->reserve(Eigen::VectorXi::LinSpaced(m, m, 1));
    for (int c = 0; c < m; ++c) {
      for (int r = c; r < m; ++r) hessian->insert(r, c) = 0.0;
    }
    hessian->makeCompressed();
  }
  double* const values = hessian->valuePtr();
  const int* const start = hessian->outerIndexPtr();
  std::fill(values, values + entries, 0.0);
  const auto at = [&](int r, int c) -> double& {
    return r >= c ? values[start[c] + r - c] : values[start[r] + c - r];
  };
  for (int f = 0; 3 * f < m; ++f) {
    for (int k = 0; k < 3; ++k) at(3 * f + k, 3 * f + k) = Inertia(free_[f]);
  }
  ForBlocks([&](int i, int j, const double* block) {
    const int p = 3 * rank_[i], q = 3 * rank_[j];
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) {
        const double value = block[3 * a + b];
        if (a >= b && p >= 0) at(p + a, p + b) += value;
        if (a >= b && q >= 0) at(q + a, q + b) += value;
        if (p >= 0 && q >= 0) at(q + a, p + b) -= value;
      }
    }
  });
  return true;
}

bool IncrementalPotential::HessianTimes(const double* s,
                                        const double* v,
                                        double* hv) const {
  if (!Place(s)) return false;
  const int m = NumParameters();
  for (int e = 0; e < m; ++e) hv[e] = Inertia(free_[e / 3]) * v[e];
  ForBlocks([&](int i, int j, const double* block) {
    const int p = 3 * rank_[i], q = 3 * rank_[j];
    double difference[3];
    for (int k = 0; k < 3; ++k) {
      difference[k] = (p >= 0 ? v[p + k] : 0.0) - (q >= 0 ? v[q + k] : 0.0);
    }
    for (int a = 0; a < 3; ++a) {
      double sum = 0.0;
      for (int b = 0; b < 3; ++b) sum += block[3 * a + b] * difference[b];
      if (p >= 0) hv[p + a] += sum;
      if (q >= 0) hv[q + a] -= sum;
    }
  });
  return true;
}

bool IncrementalPotential::Place(const double* s) const {
  const int stride = scene_.stride();
  for (std::size_t f = 0; f < free_.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const int e = k * stride + free_[f];
      if (!std::isfinite(s[3 * f + k])) return false;
      x_[e] = state_.x[e] + s[3 * f + k];
    }
  }
  return true;
}

double IncrementalPotential::Inertia(int grain) const {
  return scene_.grains().mass[grain] / dt_ *
         (1.0 / dt_ + scene_.options().damping);
}

bool IncrementalPotential::PairBlock(int i, int j, double* block) const {
  const int stride = scene_.stride();
  double r[3], square = 0.0;
  const double period = scene_.options().domain.period();
  for (int k = 0; k < 3; ++k) {
    r[k] = x_[k * stride + j] - x_[k * stride + i];
    if (period > 0.0) r[k] -= period * std::nearbyint(r[k] / period);
    square += r[k] * r[k];
  }
  const double d = std::sqrt(square);
  double first = 0.0, second = 0.0;
  if (const NearField* const field = scene_.near_field()) {
    const RadialValues values = EvaluateLaw(field->law(), d);
    const double weight = field->weights()[i] * field->weights()[j];
    first += weight * values.stiffness;
    second += weight * values.force_over_distance;
  }
  if (scene_.options().soft_contact) {
    const SoftContactValues values = EvaluateSoftContact(
        *scene_.options().soft_contact,
        scene_.grains().radius[i] + scene_.grains().radius[j] - d);
    first += values.stiffness;
    second -= values.force / d;
  }
  if (first == 0.0 && second == 0.0) return false;
  for (int a = 0; a < 3; ++a) {
    for (int b = 0; b < 3; ++b) {
      block[3 * a + b] =
          (first - second) * r[a] * r[b] / square + (a == b ? second : 0.0);
    }
  }
  return true;
}

}  // namespace granopt
