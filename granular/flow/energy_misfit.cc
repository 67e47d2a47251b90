#include "granular/flow/energy_misfit.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// int of |d| w over a step h, both linear: d from p to q, w from u to v.
double IntegrateStep(double h, double p, double q, double u, double v) {
  const double a = std::fabs(p), b = std::fabs(q);
  const auto one_sign = [](double h, double a, double b, double u, double v) {
    return h * (2.0 * (a * u + b * v) + a * v + b * u) / 6.0;
  };
  if (p * q >= 0.0) return one_sign(h, a, b, u, v);
  const double s = a / (a + b), w = u + s * (v - u);
  return one_sign(s * h, a, 0.0, u, w) + one_sign((1.0 - s) * h, 0.0, b, w, v);
}

struct Part {
  double weight;
  const std::vector<double>*is, *wanted, *error;
  double *misfit, *errors;
};

}  // namespace

EnergyCurve ConstantTarget(double total,
                           double bulk,
                           double relative,
                           double duration) {
  return {{0.0, duration}, {total, total}, {bulk, bulk}, {relative, relative}};
}

bool HasErrors(const EnergyCurve& target, const MisfitWeights& weights) {
  return (weights.total == 0.0 || !target.total_error.empty()) &&
         (weights.bulk == 0.0 || !target.bulk_error.empty()) &&
         (weights.relative == 0.0 || !target.relative_error.empty());
}

double Interpolate(const std::vector<double>& time,
                   const std::vector<double>& y,
                   double at) {
  const std::size_t after =
      std::upper_bound(time.begin(), time.end(), at) - time.begin();
  if (after == 0) return y.front();
  if (after == time.size()) return y.back();
  const double s = (at - time[after - 1]) / (time[after] - time[after - 1]);
  return y[after - 1] + s * (y[after] - y[after - 1]);
}

double IntegrateDifference(const std::vector<double>& time_a,
                           const std::vector<double>& a,
                           const std::vector<double>& time_b,
                           const std::vector<double>& b,
                           double end,
                           const std::vector<double>& weight) {
  std::vector<double> times = {0.0, end};
  for (const auto* list : {&time_a, &time_b}) {
    for (const double t : *list) {
      if (t > 0.0 && t < end) times.push_back(t);
    }
  }
  std::sort(times.begin(), times.end());
  double sum = 0.0;
  double before = Interpolate(time_a, a, 0.0) - Interpolate(time_b, b, 0.0);
  double w = weight.empty() ? 1.0 : Interpolate(time_b, weight, 0.0);
  for (std::size_t k = 1; k < times.size(); ++k) {
    const double t = times[k], h = t - times[k - 1];
    if (h <= 0.0) continue;
    const double now = Interpolate(time_a, a, t) - Interpolate(time_b, b, t);
    if (weight.empty()) {
      const double p = std::fabs(before), q = std::fabs(now);
      // Two triangles where the difference changes sign.
      sum += before * now >= 0.0 ? 0.5 * h * (p + q)
                                 : 0.5 * h * (p * p + q * q) / (p + q);
    } else {
      const double w_now = Interpolate(time_b, weight, t);
      sum += IntegrateStep(h, before, now, w, w_now);
      w = w_now;
    }
    before = now;
  }
  return sum;
}

Misfit ComputeMisfit(const EnergyCurve& curve,
                     const EnergyCurve& target,
                     const MisfitWeights& weights,
                     double duration) {
  Misfit misfit;
  if (curve.time.empty() || curve.time.back() < duration * (1.0 - 1e-9)) {
    misfit.total = misfit.bulk = misfit.relative = misfit.value = kInfinity;
    return misfit;
  }
  const bool has_errors = HasErrors(target, weights);
  const Part parts[] = {{weights.total,
                         &curve.total,
                         &target.total,
                         &target.total_error,
                         &misfit.total,
                         &misfit.total_errors},
                        {weights.bulk,
                         &curve.bulk,
                         &target.bulk,
                         &target.bulk_error,
                         &misfit.bulk,
                         &misfit.bulk_errors},
                        {weights.relative,
                         &curve.relative,
                         &target.relative,
                         &target.relative_error,
                         &misfit.relative,
                         &misfit.relative_errors}};
  const std::vector<double> zero(target.time.size(), 0.0);
  double sum = 0.0, whole = 0.0;
  for (const Part& part : parts) {
    if (!(part.weight > 0.0)) continue;
    std::vector<double> inverse;
    if (has_errors) {
      for (const double s : *part.error) inverse.push_back(1.0 / s);
    }
    const double difference = IntegrateDifference(
        curve.time, *part.is, target.time, *part.wanted, duration, inverse);
    // The target's are the times of the weight.
    const double size = IntegrateDifference(
        target.time, *part.wanted, target.time, zero, duration, inverse);
    *part.misfit = difference / size;
    if (has_errors) *part.errors = difference / duration;
    const double weight = has_errors ? part.weight * size : part.weight;
    sum += weight * *part.misfit;
    whole += weight;
  }
  misfit.value = sum / whole;
  if (!std::isfinite(misfit.value)) misfit.value = kInfinity;
  return misfit;
}

}  // namespace granopt
