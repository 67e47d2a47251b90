#include "solvers/search/noise.h"

#include <algorithm>
#include <cmath>

namespace granopt {

double EstimateNoise(const std::vector<double>& values) {
  const int m = static_cast<int>(values.size()) - 1;
  std::vector<double> table = values;
  std::vector<double> sigma(m + 1, 0.0);
  std::vector<char> changes_sign(m + 1, 0);
  double gamma = 1.0;
  for (int k = 1; k <= m; ++k) {
    gamma *= 0.5 * k / (2.0 * k - 1.0);  // (k!)^2 / (2 k)!
    double sum = 0.0, low = 0.0, high = 0.0;
    for (int i = 0; i + k <= m; ++i) {
      table[i] = table[i + 1] - table[i];
      sum += table[i] * table[i];
      low = std::min(low, table[i]);
      high = std::max(high, table[i]);
    }
    sigma[k] = std::sqrt(gamma * sum / (m + 1 - k));
    changes_sign[k] = low < 0.0 && high > 0.0;
  }
  for (int k = 1; k + 2 <= m; ++k) {
    const double low = std::min({sigma[k], sigma[k + 1], sigma[k + 2]});
    const double high = std::max({sigma[k], sigma[k + 1], sigma[k + 2]});
    if (high <= 4.0 * low && changes_sign[k]) return sigma[k];
  }
  return sigma[m];
}

bool ChooseDifferenceSteps(
    const std::vector<double>& point,
    double spacing,
    UniformRandom* random,
    const std::function<bool(const std::vector<std::vector<double>>&,
                             std::vector<double>*)>& evaluate,
    DifferenceSteps* chosen) {
  const int n = static_cast<int>(point.size());
  std::vector<double> direction(n);
  double norm = 0.0;
  for (double& d : direction) {
    d = 2.0 * (*random)() - 1.0;
    norm += d * d;
  }
  norm = std::sqrt(norm);
  constexpr int kHalf = 4;
  std::vector<std::vector<double>> strings;
  for (int i = -kHalf; i <= kHalf; ++i) {
    std::vector<double> string = point;
    for (int k = 0; k < n; ++k) {
      string[k] += i * spacing * direction[k] / norm;
    }
    strings.push_back(string);
  }
  const auto all_finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double v) {
      return std::isfinite(v);
    });
  };
  std::vector<double> values;
  if (!evaluate(strings, &values) || !all_finite(values)) return false;
  chosen->value = values[kHalf];
  chosen->noise = EstimateNoise(values);
  chosen->scale = 0.0;
  for (const double v : values) {
    chosen->scale = std::max(chosen->scale, std::fabs(v));
  }
  const double wide =
      chosen->scale > 0.0
          ? std::max(0.1, std::pow(chosen->noise / chosen->scale, 0.25))
          : 0.1;
  strings.clear();
  for (int k = 0; k < n; ++k) {
    for (const double sign : {1.0, -1.0}) {
      std::vector<double> string = point;
      string[k] += sign * wide;
      strings.push_back(string);
    }
  }
  if (!evaluate(strings, &values) || !all_finite(values)) return false;
  chosen->steps.resize(n);
  for (int k = 0; k < n; ++k) {
    const double curvature =
        std::fabs(values[2 * k] + values[2 * k + 1] - 2.0 * chosen->value) /
        (wide * wide);
    double h = chosen->noise > 0.0 ? 0.2 : 0.01;
    if (curvature > 0.0) {
      h = std::pow(8.0, 0.25) * std::sqrt(chosen->noise / curvature);
    }
    chosen->steps[k] = std::min(0.2, std::max(0.01, h));
  }
  return true;
}

}  // namespace granopt
