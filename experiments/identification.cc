#include "experiments/identification.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "Eigen/Eigenvalues"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The finalizer of splitmix64 (Steele, Lea, Flood, OOPSLA 2014).
std::uint64_t Mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

}  // namespace

bool ReadTarget(const std::string& path,
                double duration,
                const MisfitWeights& weights,
                EnergyCurve* target,
                std::string* error) {
  std::string text;
  if (!ReadFile(path, &text, error)) return false;
  CsvReader csv(text, path);
  if (!csv.Begin(error)) return false;
  struct Column {
    const char* name;
    double weight;
    std::vector<double>* to;
    const char* error_name;
    std::vector<double>* error_to;
  };
  const Column columns[] = {
      {"T", weights.total, &target->total, "T_error", &target->total_error},
      {"T_b", weights.bulk, &target->bulk, "T_b_error", &target->bulk_error},
      {"T_r",
       weights.relative,
       &target->relative,
       "T_r_error",
       &target->relative_error}};
  bool has_errors = false;
  for (const Column& column : columns) {
    has_errors = has_errors || csv.Has(column.error_name);
  }
  for (const Column& column : columns) {
    if (has_errors && column.weight > 0.0 && !csv.Has(column.error_name)) {
      return Fail(Format("%s:1: no column %s: errors are given of all energies "
                         "with a weight, or of none",
                         path.c_str(),
                         column.error_name),
                  error);
    }
  }
  while (csv.Row() && csv.error().empty()) {
    double time = 0.0;
    csv.Read("time", &time);
    if (!csv.error().empty()) break;
    if (!std::isfinite(time)) {
      csv.Complain("time is not finite");
    } else if (target->time.empty() && time != 0.0) {
      csv.Complain(Format("the first time is %g, expected 0", time));
    } else if (!target->time.empty() && !(time > target->time.back())) {
      csv.Complain(Format("time %g does not exceed the one before, %g",
                          time,
                          target->time.back()));
    }
    target->time.push_back(time);
    for (const Column& column : columns) {
      double value = 0.0;
      if (column.weight > 0.0 || csv.Has(column.name)) {
        csv.Read(column.name, &value);
        if (csv.error().empty() && !(std::isfinite(value) && value >= 0.0)) {
          csv.Complain(Format("%s = %g is no energy", column.name, value));
        }
      }
      column.to->push_back(value);
      if (!csv.Has(column.error_name)) continue;
      double deviation = 0.0;
      csv.Read(column.error_name, &deviation);
      if (csv.error().empty() &&
          !(std::isfinite(deviation) && deviation > 0.0)) {
        csv.Complain(
            Format("%s = %g must be positive", column.error_name, deviation));
      }
      column.error_to->push_back(deviation);
    }
  }
  if (!csv.error().empty()) return Fail(csv.error(), error);
  if (target->time.size() < 2) {
    return Fail(path + ": a target has at least two rows", error);
  }
  if (target->time.back() < duration * (1.0 - 1e-12)) {
    return Fail(Format("%s: ends at time %g, before --duration=%g",
                       path.c_str(),
                       target->time.back(),
                       duration),
                error);
  }
  const std::vector<double> zero(target->time.size(), 0.0);
  for (const Column& column : columns) {
    if (column.weight > 0.0 &&
        !(IntegrateDifference(
              target->time, *column.to, target->time, zero, duration) > 0.0)) {
      return Fail(Format("%s: column %s is 0 everywhere: nothing to divide by "
                         "(its weight may be 0)",
                         path.c_str(),
                         column.name),
                  error);
    }
  }
  return true;
}

std::string FormatCurve(const EnergyCurve& curve) {
  const struct {
    const char* name;
    const std::vector<double>* values;
  } errors[] = {{"T_error", &curve.total_error},
                {"T_b_error", &curve.bulk_error},
                {"T_r_error", &curve.relative_error}};
  std::string text = "time,T,T_b,T_r";
  for (const auto& column : errors) {
    if (!column.values->empty()) text += std::string(",") + column.name;
  }
  text += "\n";
  for (std::size_t k = 0; k < curve.time.size(); ++k) {
    text += Format("%.17g,%.17g,%.17g,%.17g",
                   curve.time[k],
                   curve.total[k],
                   curve.bulk[k],
                   curve.relative[k]);
    for (const auto& column : errors) {
      if (!column.values->empty()) text += "," + Number((*column.values)[k]);
    }
    text += "\n";
  }
  return text;
}

bool IsSettled(const EnsembleRule& rule, const std::vector<double>& values) {
  if (values.empty()) return false;
  if (!std::isfinite(values.back())) return true;
  const int n = static_cast<int>(values.size());
  if (n >= rule.most) return true;
  if (n < std::max(2, rule.least)) return false;
  double sum = 0.0;
  for (int k = 0; k + 1 < n; ++k) sum += values[k];
  const double before = sum / (n - 1), now = (sum + values[n - 1]) / n;
  return std::fabs(now - before) <= rule.tolerance * std::fabs(now);
}

std::uint64_t StartSeed(std::uint64_t seed,
                        const EnsembleRule& rule,
                        std::int64_t index,
                        int run) {
  const std::uint64_t stream = Mix(Mix(seed) + rule.stream);
  const std::uint64_t string =
      rule.is_common ? 0 : 1 + static_cast<std::uint64_t>(index);
  return Mix(Mix(stream + string) + static_cast<std::uint64_t>(run));
}

double Ensemble::mean() const {
  for (const double v : values) {
    if (!std::isfinite(v)) return kInfinity;
  }
  return values.empty() ? kInfinity : MeanAndDeviation(values).mean;
}

double Ensemble::error() const {
  if (values.size() < 2) return 0.0;
  return std::isfinite(mean()) ? MeanAndDeviation(values).standard_error
                               : kInfinity;
}

void PairedDifference(const std::vector<double>& a,
                      const std::vector<double>& b,
                      double* mean,
                      double* error) {
  Ensemble difference;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    difference.values.push_back(a[k] - b[k]);
  }
  *mean = difference.mean();
  *error = difference.error();
}

bool ParseSearched(const std::string& text,
                   std::vector<SearchedFlag>* flags,
                   std::string* error) {
  std::size_t at = 0;
  while (at <= text.size()) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string item = text.substr(at, end - at);
    const std::size_t first = item.find(':');
    const std::size_t second =
        first == std::string::npos ? first : item.find(':', first + 1);
    SearchedFlag flag;
    if (second == std::string::npos || first == 0 ||
        !ParseDouble(item.substr(first + 1, second - first - 1), &flag.low) ||
        !ParseDouble(item.substr(second + 1), &flag.high)) {
      return Fail("'" + item + "' is not name:low:high", error);
    }
    flag.name = item.substr(0, first);
    if (!std::isfinite(flag.low) || !std::isfinite(flag.high) ||
        !(flag.low < flag.high)) {
      return Fail("'" + item + "': bounds must be finite and low < high",
                  error);
    }
    for (const SearchedFlag& other : *flags) {
      if (other.name == flag.name) {
        return Fail("'" + flag.name + "' is given twice", error);
      }
    }
    flags->push_back(flag);
    at = end + 1;
  }
  return true;
}

Valley DescribeValley(const std::vector<std::vector<double>>& strings,
                      const std::vector<SearchedFlag>& flags) {
  const int n = static_cast<int>(flags.size());
  const int count = static_cast<int>(strings.size());
  Valley valley;
  Eigen::MatrixXd unit(count, n);
  for (int k = 0; k < n; ++k) {
    double low = kInfinity, high = -kInfinity;
    for (int s = 0; s < count; ++s) {
      low = std::min(low, strings[s][k]);
      high = std::max(high, strings[s][k]);
      unit(s, k) =
          (strings[s][k] - flags[k].low) / (flags[k].high - flags[k].low);
    }
    valley.low.push_back(low);
    valley.high.push_back(high);
  }
  if (count < n + 2) return valley;
  const Eigen::MatrixXd centred = unit.rowwise() - unit.colwise().mean();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
      centred.transpose() * centred / (count - 1.0));
  for (int k = 0; k < n; ++k) {
    valley.deviation.push_back(
        std::sqrt(std::max(0.0, eigen.eigenvalues()[k])));
    std::vector<double> axis(n);
    // Its largest entry is positive.
    int largest;
    eigen.eigenvectors().col(k).cwiseAbs().maxCoeff(&largest);
    const double sign = eigen.eigenvectors()(largest, k) < 0.0 ? -1.0 : 1.0;
    for (int c = 0; c < n; ++c) axis[c] = sign * eigen.eigenvectors()(c, k);
    valley.axis.push_back(axis);
  }
  return valley;
}

}  // namespace granopt
