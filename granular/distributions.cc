#include "granular/distributions.h"

#include <algorithm>
#include <cmath>

#include "granular/double_double.h"
#include "granular/neighbor_list.h"
#include "granular/observables.h"
#include "solvers/format.h"

namespace granopt {
namespace {

// |x_i - x_j + H n| - r_i - r_j, from double-double positions.
double Gap(const Packing& packing, int i, int j, const Image& image) {
  const int d = packing.dimension();
  DoubleDouble square;
  for (int k = 0; k < d; ++k) {
    DoubleDouble r = packing.Position(i, k) - packing.Position(j, k);
    for (int c = 0; c < d; ++c) {
      if (image[c] != 0) {
        r = r + TwoProduct(image[c], packing.box.edges()(k, c));
      }
    }
    square = square + r * r;
  }
  return (Sqrt(square) - TwoSum(packing.radii[i], packing.radii[j])).Value();
}

// The mean of t in [0, 1] with a density proportional to e^(v t):
// 1 / (1 - e^-v) - 1 / v, and its variance; both by series where they cancel.
double MeanOfExponential(double v) {
  if (std::abs(v) < 1e-2) return 0.5 + v / 12.0 - v * v * v / 720.0;
  return 1.0 / -std::expm1(-v) - 1.0 / v;
}

double VarianceOfExponential(double v) {
  if (std::abs(v) < 1e-2) return 1.0 / 12.0 - v * v / 240.0;
  const double sinh = 2.0 * std::sinh(0.5 * v);
  return 1.0 / (v * v) - 1.0 / (sinh * sinh);
}

// Kolmogorov's distance of sorted samples in (low, high] from x^exponent.
double KolmogorovDistance(
    const double* x, int n, double low, double high, double exponent) {
  const double s = 1.0 + exponent;
  double distance = 0.0;
  for (int i = 0; i < n; ++i) {
    double f;
    if (low == 0.0) {
      f = std::pow(x[i] / high, s);
    } else {
      const double t = std::log(x[i] / low), length = std::log(high / low);
      f = std::abs(s * length) < 1e-9
              ? t / length
              : std::expm1(s * t) / std::expm1(s * length);
    }
    distance = std::max({distance,
                         f - static_cast<double>(i) / n,
                         static_cast<double>(i + 1) / n - f});
  }
  return distance;
}

// Of n sorted samples, all in the window.
PowerLawFit FitSorted(const double* x, int n, double low, double high) {
  PowerLawFit fit;
  if (n < 2) return fit;
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += std::log(high / x[i]);
  if (!(sum > 0.0) || !std::isfinite(sum)) return fit;
  if (low == 0.0) {
    fit.exponent = n / sum - 1.0;
    fit.error = (1.0 + fit.exponent) / std::sqrt(static_cast<double>(n));
  } else {
    const double length = std::log(high / low);
    const double mean = 1.0 - sum / n / length;  // of t = ln(x / low) / L
    // The mean grows with v; beyond |v| = 700 the samples are all at one end.
    double below = -700.0, above = 700.0;
    if (!(mean > MeanOfExponential(below) && mean < MeanOfExponential(above))) {
      return fit;
    }
    for (int step = 0; step < 200; ++step) {
      const double middle = 0.5 * (below + above);
      if (!(middle > below && middle < above)) break;
      (MeanOfExponential(middle) < mean ? below : above) = middle;
    }
    const double v = 0.5 * (below + above);
    fit.exponent = v / length - 1.0;
    fit.error = 1.0 / (length * std::sqrt(n * VarianceOfExponential(v)));
  }
  fit.n = n;
  fit.low = low;
  fit.high = high;
  fit.distance = KolmogorovDistance(x, n, low, high, fit.exponent);
  return fit;
}

// Sorted, and only those in the window.
std::vector<double> Within(std::vector<double> samples,
                           double low,
                           double high) {
  samples.erase(std::remove_if(samples.begin(),
                               samples.end(),
                               [low, high](double x) {
                                 return !(x > 0.0 && x >= low && x <= high);
                               }),
                samples.end());
  std::sort(samples.begin(), samples.end());
  return samples;
}

}  // namespace

bool CollectSamples(const Packing& packing,
                    const std::vector<Contact>& contacts,
                    double max_gap,
                    JammingSamples* samples,
                    std::string* error) {
  *samples = JammingSamples();
  if (!(max_gap > 0.0 && std::isfinite(max_gap))) {
    *error = Format("max_gap = %g must be positive", max_gap);
    return false;
  }
  const Observables o = Measure(packing, contacts, 0.0);
  if (o.rigid_grains == 0) return true;
  const int d = packing.dimension();
  const auto rigid = [&o](int i, int j) {
    return !o.is_rattler[i] && !o.is_rattler[j];
  };
  std::vector<int> degree(packing.size(), 0);
  double mean = 0.0;
  int count = 0;
  for (const Contact& c : contacts) {
    if (!rigid(c.id.i, c.id.j)) continue;
    ++degree[c.id.i];
    ++degree[c.id.j];
    mean += c.force;
    samples->mean_overlap +=
        c.overlap / (packing.radii[c.id.i] + packing.radii[c.id.j]);
    ++count;
  }
  mean /= count;
  samples->mean_overlap /= count;
  samples->rigid_grains = o.rigid_grains;
  samples->excess_contacts = o.rigid_contacts - o.isostatic_contacts;
  samples->bucklers =
      static_cast<int>(std::count(degree.begin(), degree.end(), d + 1));
  for (const Contact& c : contacts) {
    if (!rigid(c.id.i, c.id.j)) continue;
    const bool local = degree[c.id.i] == d + 1 || degree[c.id.j] == d + 1;
    (local ? samples->localized : samples->extended).push_back(c.force / mean);
  }
  NeighborList list;
  if (!BuildNeighborList(packing.box,
                         packing.positions,
                         packing.radii,
                         2.0 * max_gap * packing.radii.maxCoeff(),
                         &list,
                         error)) {
    return false;
  }
  for (int p = 0; p < list.num_pairs(); ++p) {
    const int i = list.i[p], j = list.j[p];
    if (!rigid(i, j)) continue;
    const double h = Gap(packing, i, j, list.image[p]) /
                     (packing.radii[i] + packing.radii[j]);
    if (h > 0.0 && h <= max_gap) samples->gaps.push_back(h);
  }
  return true;
}

PowerLawFit FitPowerLaw(const std::vector<double>& samples,
                        double low,
                        double high) {
  if (!(low >= 0.0 && high > low && std::isfinite(high))) return {};
  const std::vector<double> x = Within(samples, low, high);
  return FitSorted(x.data(), static_cast<int>(x.size()), low, high);
}

PowerLawFit ScanPowerLaw(std::vector<double> samples,
                         double low,
                         double most,
                         int least) {
  if (!(low >= 0.0 && most > low && std::isfinite(most))) return {};
  const std::vector<double> x = Within(std::move(samples), low, most);
  const int n = static_cast<int>(x.size());
  if (n <= least) return FitSorted(x.data(), n, low, most);
  constexpr int kWindows = 60;
  PowerLawFit best;
  int last = 0;
  for (int w = 0; w < kWindows; ++w) {
    const int m = static_cast<int>(
        std::lround(least * std::pow(static_cast<double>(n) / least,
                                     w / (kWindows - 1.0))));
    if (m == last) continue;
    last = m;
    // The window ends half way to the next sample: ending at one, it would
    // count a sample that it was chosen by.
    const double high = m < n ? std::sqrt(x[m - 1] * x[m]) : most;
    const PowerLawFit fit = FitSorted(x.data(), m, low, high);
    if (fit.n > 0 && (best.n == 0 || fit.distance < best.distance)) best = fit;
  }
  return best;
}

LineFit FitLine(const std::vector<double>& x,
                const std::vector<double>& y,
                const std::vector<double>& error) {
  LineFit fit;
  const std::size_t n = x.size();
  if (y.size() != n || error.size() != n) return fit;
  double sum = 0.0, sum_x = 0.0, sum_y = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!(error[i] > 0.0) || !std::isfinite(error[i])) return fit;
    const double w = 1.0 / (error[i] * error[i]);
    sum += w;
    sum_x += w * x[i];
    sum_y += w * y[i];
  }
  const double mean_x = sum_x / sum, mean_y = sum_y / sum;
  double xx = 0.0, xy = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double w = 1.0 / (error[i] * error[i]);
    xx += w * (x[i] - mean_x) * (x[i] - mean_x);
    xy += w * (x[i] - mean_x) * (y[i] - mean_y);
  }
  if (n < 2 || *std::max_element(x.begin(), x.end()) ==
                   *std::min_element(x.begin(), x.end())) {
    return fit;
  }
  fit.b = xy / xx;
  fit.a = mean_y - fit.b * mean_x;
  fit.b_error = std::sqrt(1.0 / xx);
  fit.a_error = std::sqrt(1.0 / sum + mean_x * mean_x / xx);
  for (std::size_t i = 0; i < n; ++i) {
    const double r = (y[i] - fit.a - fit.b * x[i]) / error[i];
    fit.chi2 += r * r;
  }
  fit.n = static_cast<int>(n);
  return fit;
}

}  // namespace granopt
