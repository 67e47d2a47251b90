#include "solvers/line_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace granopt {
namespace {

// Without an upper end a trial goes on by a factor between these.
constexpr double kMinExpansion = 1.5;
constexpr double kMaxExpansion = 10.0;
// Trials stay this part of the interval away from its ends.
constexpr double kMargin = 0.05;
// Of an interval that says nothing about the function, this part is next.
constexpr double kBackOff = 0.1;
// The interval is resolved when it is shorter than this part of its upper end.
constexpr double kResolution = 1e-14;

// after - before, or rule() where that has lost half of its digits: below 1e-8
// of `before` for doubles, and as the square root of `epsilon`.
template <typename Rule>
double Difference(double before,
                  double after,
                  double epsilon,
                  const Rule& rule) {
  const double change = after - before;
  const double lost =
      1e-8 * std::sqrt(epsilon / std::numeric_limits<double>::epsilon()) *
      std::abs(before);
  if (std::abs(change) > lost) return change;
  // A rule that is not small itself: the values agree, but not because the
  // points are near.
  const double by_rule = rule();
  return std::abs(by_rule) <= 2.0 * lost ? by_rule : change;
}

}  // namespace

double LineChange(const LinePoint& start, const LinePoint& p, double epsilon) {
  return Difference(start.value, p.value, epsilon, [&]() {
    return 0.5 * (p.step - start.step) * (start.slope + p.slope);
  });
}

double CostAnchor::Change(const double* x_new,
                          double cost_new,
                          const double* g_new,
                          double epsilon) const {
  return Difference(cost, cost_new, epsilon, [&]() {
    double rule = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      rule += 0.5 * (gradient[i] + g_new[i]) * (x_new[i] - x[i]);
    }
    return rule;
  });
}

LineSearchResult SearchLine(const LineFunction& evaluate,
                            const LinePoint& start,
                            double first_step,
                            const LineSearchOptions& options) {
  LineSearchResult result;
  result.point = start;
  LinePoint low = start;     // the lower end
  LinePoint before = start;  // the lower end before that
  LinePoint high;            // the upper end, if has_high
  bool has_high = false;
  bool high_is_finite = false;
  double last_step = 0.0;     // of the trials so far
  double width_before = 0.0;  // of the interval two trials ago
  double width = 0.0;         // of the interval one trial ago
  double step = first_step;

  for (int trial = 0; trial < options.max_trials; ++trial) {
    LinePoint p = result.point;
    const LineEvaluation outcome = evaluate(step, &p);
    if (outcome == LineEvaluation::STOP) {
      result.end = LineSearchEnd::STOPPED;
      result.is_last =
          result.point.step > 0.0 && result.point.step == last_step;
      return result;
    }
    last_step = step;
    if (outcome == LineEvaluation::NOT_FINITE) {
      high = LinePoint{step, 0.0, 0.0};
      has_high = true;
      high_is_finite = false;
    } else {
      const bool decreases = LineChange(start, p, options.epsilon) <=
                             options.sufficient_decrease * step * start.slope;
      if (decreases &&
          std::abs(p.slope) <= options.curvature * std::abs(start.slope)) {
        result.end = LineSearchEnd::WOLFE;
        result.point = p;
        result.is_last = true;
        return result;
      }
      if (!decreases || p.slope > 0.0) {
        high = p;
        has_high = true;
        high_is_finite = true;
        // A point that slopes up and still has decrease is worth keeping: if
        // the search ends early it is the better end.
        if (decreases && LineChange(low, p, options.epsilon) < 0.0)
          result.point = p;
      } else {
        before = low;
        low = p;
        result.point = p;
      }
    }

    if (!has_high) {
      // The zero of the slope by the secant through the last two points.
      const double bend = low.slope - before.slope;
      const double span = low.step - before.step;
      double next = kMaxExpansion * low.step;
      if (bend > 0.0) next = low.step - low.slope * (span / bend);
      step =
          std::clamp(next, kMinExpansion * low.step, kMaxExpansion * low.step);
      if (!std::isfinite(step)) break;
      continue;
    }
    const double now = high.step - low.step;
    if (!(now > kResolution * high.step)) break;
    double part = 0.5;
    if (!high_is_finite) {
      part = kBackOff;
    } else if (width_before > 0.0 && now > 0.5 * width_before) {
      // From the start the size of a good step is not known: decades at once.
      part = low.step > 0.0 ? 0.5 : kBackOff;
    } else if (high.slope > 0.0) {
      part = low.slope / (low.slope - high.slope);
    } else {
      // The value is too high though the slope is not: the minimum of the
      // parabola through both values and the lower slope.
      const double excess =
          LineChange(low, high, options.epsilon) - low.slope * now;
      part = excess > 0.0 ? -0.5 * low.slope * now / excess : 0.5;
    }
    step = low.step + std::clamp(part, kMargin, 1.0 - kMargin) * now;
    width_before = width;
    width = now;
  }
  result.end = result.point.step > 0.0 ? LineSearchEnd::DECREASE
                                       : LineSearchEnd::NO_STEP;
  result.is_last = result.point.step > 0.0 && result.point.step == last_step;
  return result;
}

}  // namespace granopt
