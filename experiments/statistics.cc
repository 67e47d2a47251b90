#include "experiments/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double QuantileOfSorted(const std::vector<double>& values, double part) {
  if (values.empty()) return kNan;
  const double place = part * static_cast<double>(values.size() - 1);
  const std::size_t below = static_cast<std::size_t>(place);
  const double weight = place - static_cast<double>(below);
  if (weight < 1e-9) return values[below];
  if (std::isinf(values[below + 1])) return values[below + 1];
  return values[below] + weight * (values[below + 1] - values[below]);
}

}  // namespace

double QuantileOf(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return QuantileOfSorted(values, part);
}

double MedianOf(std::vector<double> values) {
  return QuantileOf(std::move(values), 0.5);
}

Quantiles QuantilesOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {QuantileOfSorted(values, 0.2),
          QuantileOfSorted(values, 0.5),
          QuantileOfSorted(values, 0.8)};
}

MedianWorst MedianAndWorst(const std::vector<double>& values) {
  if (values.empty()) return {kNan, kNan};
  return {MedianOf(values), *std::max_element(values.begin(), values.end())};
}

MeanDeviation MeanAndDeviation(const std::vector<double>& values) {
  if (values.empty()) return {kNan, kNan, kNan};
  const double n = static_cast<double>(values.size());
  double sum = 0.0;
  for (const double value : values) sum += value - values[0];
  MeanDeviation result;
  result.mean = values[0] + sum / n;
  if (values.size() < 2) return result;
  double squares = 0.0;
  for (const double value : values) {
    squares += (value - result.mean) * (value - result.mean);
  }
  result.deviation = std::sqrt(squares / (n - 1.0));
  result.standard_error = result.deviation / std::sqrt(n);
  return result;
}

double ConfidenceFactor(int n) {
  // Student's quantile by powers of 1 / (n - 1) (Abramowitz, Stegun 26.7.5).
  const double z = 1.959963984540054, v = std::max(1, n - 1);
  const double z2 = z * z;
  return z *
         (1.0 + (z2 + 1.0) / (4.0 * v) +
          ((5.0 * z2 + 16.0) * z2 + 3.0) / (96.0 * v * v) +
          (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / (384.0 * v * v * v));
}

bool AreEqual(double difference, double error, int n) {
  return std::isfinite(difference) &&
         std::fabs(difference) <= ConfidenceFactor(n) * error;
}

Interval Wilson(int count, int trials) {
  if (trials <= 0) return {};
  constexpr double kZ = 1.959963984540054;  // two-sided 95 % of a normal
  const double n = trials, p = count / n, z2 = kZ * kZ / n;
  const double centre = (p + 0.5 * z2) / (1.0 + z2);
  const double half =
      kZ / (1.0 + z2) * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / n);
  // Exact where the formula is so but for roundoff.
  return {count == 0 ? 0.0 : std::max(0.0, centre - half),
          count == trials ? 1.0 : std::min(1.0, centre + half)};
}

}  // namespace granopt
