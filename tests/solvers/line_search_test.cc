// The line search on curves of one variable: written down, and recorded from
// packings with all of their roundoff (tests/data/line_search).

#include "solvers/line_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// phi and phi' at a step; a value that is not finite stands for a point where
// the function is not defined.
struct Sample {
  double value = 0.0;
  double slope = 0.0;
};
using Curve = std::function<Sample(double step)>;

struct Search {
  LineSearchResult result;
  LinePoint start;
  std::vector<LinePoint> trials;  // every one, with NaN where not finite
};

LineSearchOptions Curvature(double curvature) {
  LineSearchOptions options;
  options.curvature = curvature;
  return options;
}

// Runs the search and checks all that is promised of any run.
Search Find(const Curve& phi,
            double first_step,
            const LineSearchOptions& options = {},
            int stop_after = std::numeric_limits<int>::max()) {
  Search search;
  const Sample at_zero = phi(0.0);
  search.start = {0.0, at_zero.value, at_zero.slope};
  EXPECT_LT(at_zero.slope, 0.0);
  const auto evaluate = [&](double step, LinePoint* p) {
    if (static_cast<int>(search.trials.size()) == stop_after) {
      return LineEvaluation::STOP;
    }
    EXPECT_GT(step, 0.0);
    EXPECT_TRUE(std::isfinite(step));
    const Sample sample = phi(step);
    search.trials.push_back({step, sample.value, sample.slope});
    if (!std::isfinite(sample.value)) return LineEvaluation::NOT_FINITE;
    *p = search.trials.back();
    return LineEvaluation::OK;
  };
  search.result = SearchLine(evaluate, search.start, first_step, options);

  const LineSearchResult& result = search.result;
  const LinePoint& p = result.point;
  EXPECT_LE(static_cast<int>(search.trials.size()), options.max_trials);
  // The point is one that was evaluated, or the start.
  const LinePoint* found = p.step == 0.0 ? &search.start : nullptr;
  for (const LinePoint& trial : search.trials) {
    if (trial.step == p.step) found = &trial;
  }
  EXPECT_NE(found, nullptr);
  if (found != nullptr) {
    EXPECT_EQ(p.value, found->value);
    EXPECT_EQ(p.slope, found->slope);
  }
  if (result.is_last) {
    EXPECT_FALSE(search.trials.empty());
    EXPECT_EQ(p.step, search.trials.back().step);
  }
  const double slope = search.start.slope;
  const bool decreases = LineChange(search.start, p) <=
                         options.sufficient_decrease * p.step * slope;
  switch (result.end) {
    case LineSearchEnd::WOLFE:
      EXPECT_TRUE(decreases);
      EXPECT_LE(std::abs(p.slope), options.curvature * std::abs(slope));
      EXPECT_TRUE(result.is_last);
      EXPECT_GT(p.step, 0.0);
      break;
    case LineSearchEnd::DECREASE:
      EXPECT_TRUE(decreases);
      EXPECT_GT(p.step, 0.0);
      break;
    case LineSearchEnd::NO_STEP:
      EXPECT_EQ(p.step, 0.0);
      EXPECT_FALSE(result.is_last);
      break;
    case LineSearchEnd::STOPPED:
      EXPECT_FALSE(search.trials.size() > static_cast<std::size_t>(stop_after));
      EXPECT_TRUE(p.step == 0.0 || decreases);
      break;
  }
  return search;
}

// ---- curves -----------------------------------------------------------------

// (a - 1)^2 / 2.
Sample Parabola(double a) { return {0.5 * (a - 1.0) * (a - 1.0), a - 1.0}; }

// (a - 1)^4 / 4: flat at the minimum, steep far away.
Sample Quartic(double a) {
  const double b = a - 1.0;
  return {0.25 * b * b * b * b, b * b * b};
}

// Minima at a = pi (2 k + 1): -sin along the way to each.
Sample Cosine(double a) { return {std::cos(a + 0.1), -std::sin(a + 0.1)}; }

// Springs of one side, as contacts along a line: kinks of phi'' at each
// -offset / rate, a minimum where opening and closing ones balance.
Sample Springs(double a) {
  const double offset[] = {1.0, 0.7, 0.2, -0.3, -0.9, -1.1, -4.0};
  const double rate[] = {-0.5, -0.6, 0.1, 0.4, 1.0, 1.3, 8.0};
  const double stiffness[] = {1.0, 2.0, 0.5, 1.0, 0.7, 3.0, 5.0};
  Sample sum;
  for (int c = 0; c < 7; ++c) {
    const double overlap = std::max(0.0, offset[c] + rate[c] * a);
    sum.value += 0.5 * stiffness[c] * overlap * overlap;
    sum.slope += stiffness[c] * overlap * rate[c];
  }
  return sum;
}

// |a - 1| rounded off over a part `width` of the way: almost a kink of phi.
Sample Corner(double a) {
  const double width = 1e-3;
  const double b = (a - 1.0) / width;
  const double root = std::sqrt(1.0 + b * b);
  return {width * (root - 1.0), b / root};
}

// A barrier at a = 1 that is not defined beyond.
Sample Barrier(double a) {
  if (!(a < 1.0)) return {kInfinity, 0.0};
  return {-a - 0.1 * std::log1p(-a), -1.0 + 0.1 / (1.0 - a)};
}

// More and more slowly downhill for ever.
Sample Endless(double a) {
  const double scale = 1e6;
  return {std::exp(-a / scale), -std::exp(-a / scale) / scale};
}

// The test function (4.1) of More & Thuente, ACM Trans. Math. Softw. 20 (1994)
// 286, beta = 2, and their (4.2), beta = 0.004.
Sample MoreThuente1(double a) {
  const double b = a * a + 2.0;
  return {-a / b, (a * a - 2.0) / (b * b)};
}
Sample MoreThuente2(double a) {
  const double b = a + 0.004;
  return {std::pow(b, 5) - 2.0 * std::pow(b, 4),
          5.0 * std::pow(b, 4) - 8.0 * std::pow(b, 3)};
}

struct NamedCurve {
  const char* name;
  Curve phi;
};

// All of them have a point of the Wolfe conditions for any 0 < c1 < c2 < 1.
std::vector<NamedCurve> Curves() {
  return {{"parabola", Parabola},
          {"quartic", Quartic},
          {"cosine", Cosine},
          {"springs", Springs},
          {"corner", Corner},
          {"barrier", Barrier},
          {"endless", Endless},
          {"more_thuente_1", MoreThuente1},
          {"more_thuente_2", MoreThuente2}};
}

const double kFirstSteps[] = {1e-8, 1e-3, 0.3, 0.99, 1.0, 3.0, 10.0, 1e4, 1e8};

// ---- LineChange -------------------------------------------------------------

TEST(LineChange, IsTheDifferenceWhereItHasDigits) {
  const LinePoint start = {0.0, 1.0, -1.0};
  EXPECT_EQ(LineChange(start, {2.0, 0.75, 5.0}), -0.25);
  EXPECT_EQ(LineChange(start, {2.0, 1.5, 5.0}), 0.5);
  EXPECT_EQ(LineChange(start, {1.0, 1.0 + 0x1p-26, 5.0}), 0x1p-26);
  EXPECT_EQ(LineChange({0.0, -8.0, -1.0}, {1.0, -9.0, 5.0}), -1.0);
  // A function that is zero at the start has lost nothing.
  EXPECT_EQ(LineChange({0.0, 0.0, -1.0}, {1.0, -1e-300, 5.0}), -1e-300);
  EXPECT_EQ(LineChange({0.0, 0.0, -1.0}, {1.0, 0.0, 5.0}), 0.0);
}

TEST(LineChange, IsTheTrapezoidWhereTheDifferenceIsLost) {
  const double slope = -0x1p-40;
  const LinePoint start = {0.0, 1.0, slope};
  for (const double value : {1.0, 1.0 + 0x1p-52, 1.0 - 0x1p-53}) {
    EXPECT_EQ(LineChange(start, {2.0, value, 0.5 * slope}), 1.5 * slope);
    EXPECT_EQ(LineChange(start, {2.0, value, -slope}), 0.0);
  }
  // From one trial to another: the steps' difference counts.
  EXPECT_EQ(LineChange({3.0, 1.0, slope}, {5.0, 1.0, slope}), 2.0 * slope);
  EXPECT_EQ(LineChange({5.0, 1.0, slope}, {3.0, 1.0, slope}), -2.0 * slope);
  // Of the value's size, whatever its sign.
  EXPECT_EQ(LineChange({0.0, -1.0, slope}, {2.0, -1.0, slope}), 2.0 * slope);
}

// A value equal to that at the start, but far away: by slopes alone it would be
// a decrease of any size.
TEST(LineChange, EqualValuesFarApartAreNoDecrease) {
  EXPECT_EQ(LineChange({0.0, 1.0, -1.0}, {6.28, 1.0, -1.0}), 0.0);
  EXPECT_EQ(LineChange({0.0, 1.0, -1e-7}, {1.0, 1.0 + 1e-16, -1e-7}), 0.0);
}

TEST(LineChange, IsExactForAParabolaAtAnySize) {
  for (const double size : {1.0, 1e-6, 1e-12, 1e-18}) {
    const auto point = [&](double a) {
      return LinePoint{
          a, 1.0 + size * 0.5 * (a - 1.0) * (a - 1.0), size * (a - 1.0)};
    };
    const double change = LineChange(point(0.0), point(0.75));
    EXPECT_NEAR(change, size * 0.5 * (0.0625 - 1.0), 1e-7 * size);
  }
}

// The same between points that are not on a line.
TEST(CostAnchor, ChangesAsALineDoes) {
  const double slope = -0x1p-40;
  const CostAnchor anchor = {{1.0, 2.0}, {slope, 0.0}, 1.0, 0.0};
  const double x[] = {3.0, 1.0}, g[] = {0.5 * slope, slope};
  EXPECT_EQ(anchor.Change(x, 0.75, g), -0.25);
  EXPECT_EQ(anchor.Change(x, 1.0, g), (1.5 - 0.5) * slope);
  const double far[] = {1e9, 2.0};
  EXPECT_EQ(anchor.Change(far, 1.0, g), 0.0);
}

// ---- the conditions ---------------------------------------------------------

TEST(LineSearch, FindsAWolfePointOfEveryCurveFromEveryStep) {
  for (const NamedCurve& curve : Curves()) {
    for (const double first : kFirstSteps) {
      for (const double curvature : {0.9, 0.1, 0.01}) {
        SCOPED_TRACE(curve.name);
        SCOPED_TRACE(first);
        SCOPED_TRACE(curvature);
        const Search search = Find(curve.phi, first, Curvature(curvature));
        EXPECT_EQ(search.result.end, LineSearchEnd::WOLFE);
        EXPECT_LE(search.trials.size(), first == 1e8 ? 40u : 32u);
      }
    }
  }
}

// A parabola takes one secant, from either side.
TEST(LineSearch, ParabolaTakesOneSecant) {
  for (const double first : {0.11, 0.5, 0.64, 3.0, 15.0}) {
    const Search search = Find(Parabola, first, Curvature(0.001));
    EXPECT_EQ(search.trials.size(), 2u) << first;
    EXPECT_NEAR(search.result.point.step, 1.0, 1e-15);
  }
  // The first step is kept where it will do.
  EXPECT_EQ(Find(Parabola, 0.3).trials.size(), 1u);
  EXPECT_EQ(Find(Parabola, 1.0, Curvature(0.001)).trials.size(), 1u);
  EXPECT_EQ(Find(Parabola, 1.85).trials.size(), 1u);
}

// Kinks cost secants, not more than bisection would: 20 trials find the minimum
// to 1e-5 of the first interval, here where one spring is 100 times as stiff.
TEST(LineSearch, SpringsTakeNoMoreThanBisection) {
  for (const double first : {0.2, 0.5, 1.0, 2.0, 4.0}) {
    EXPECT_LE(Find(Springs, first, Curvature(0.1)).trials.size(), 20u) << first;
  }
}

// Steps that are too short are multiplied by 10, too long ones divided by up to
// 20: about one trial a decade.
TEST(LineSearch, OneTrialADecade) {
  EXPECT_LE(Find(Quartic, 1e-8).trials.size(), 12u);
  EXPECT_LE(Find(Quartic, 1e8).trials.size(), 40u);
  EXPECT_LE(Find(Parabola, 1e-8).trials.size(), 10u);
  EXPECT_LE(Find(Parabola, 1e8).trials.size(), 10u);
}

// Of several minima one that lies lower than the start.
TEST(LineSearch, SeveralMinima) {
  for (double first = 0.1; first < 40.0; first *= 1.07) {
    const Search search = Find(Cosine, first, Curvature(0.1));
    EXPECT_EQ(search.result.end, LineSearchEnd::WOLFE);
    EXPECT_LT(search.result.point.value, 0.0) << first;
  }
}

// A first step of a whole period finds the value and the slope of the start.
TEST(LineSearch, OnePeriodIsNoStep) {
  const double period = 2.0;
  const Curve phi = [&](double a) {
    // Exactly periodic.
    const double b = std::fmod(a + 0.25, period) - 1.0;
    return Sample{0.5 * b * b, b};
  };
  const Search search = Find(phi, period);
  EXPECT_EQ(search.trials[0].value, search.start.value);
  EXPECT_EQ(search.trials[0].slope, search.start.slope);
  EXPECT_EQ(search.result.end, LineSearchEnd::WOLFE);
  EXPECT_LT(search.result.point.value, search.start.value);
}

// Where the function is not defined beyond a step, the search comes back; with
// a slope that goes on to the edge it ends with what it has.
TEST(LineSearch, NotDefinedBeyond) {
  for (const double edge : {1e-3, 0.2, 0.6}) {
    for (const double first : {0.5 * edge, 1.0, 1e8}) {
      const Curve phi = [&](double a) {
        return a < edge ? Parabola(a) : Sample{kInfinity, 0.0};
      };
      const Search search = Find(phi, first, Curvature(0.1));
      EXPECT_EQ(search.result.end, LineSearchEnd::DECREASE);
      EXPECT_GT(search.result.point.step, 0.9 * edge) << edge << " " << first;
      EXPECT_LT(search.result.point.step, edge);
    }
  }
}

TEST(LineSearch, NotDefinedAnywhere) {
  const Curve phi = [](double a) {
    return a == 0.0 ? Sample{1.0, -1.0} : Sample{kInfinity, 0.0};
  };
  const Search search = Find(phi, 1.0);
  EXPECT_EQ(search.result.end, LineSearchEnd::NO_STEP);
}

// Downhill for ever at one slope: ends far out with decrease, without overflow.
TEST(LineSearch, Unbounded) {
  const Curve phi = [](double a) { return Sample{-a, -1.0}; };
  Search search = Find(phi, 1.0);
  EXPECT_EQ(search.result.end, LineSearchEnd::DECREASE);
  EXPECT_EQ(search.trials.size(), 40u);
  EXPECT_TRUE(search.result.is_last);
  search = Find(phi, 1e290);
  EXPECT_EQ(search.result.end, LineSearchEnd::DECREASE);
  EXPECT_TRUE(search.result.is_last);
}

// A slope that the values do not bear out: uphill whatever it says.
TEST(LineSearch, UphillInSpiteOfItsSlope) {
  const Curve phi = [](double a) { return Sample{1.0 + a, -1.0}; };
  // Only where the values agree to half their digits can it pass for downhill.
  EXPECT_LE(Find(phi, 1.0).result.point.step, 1e-8);
}

TEST(LineSearch, BudgetOfTrials) {
  LineSearchOptions options = Curvature(1e-3);
  for (int budget = 1; budget <= 8; ++budget) {
    options.max_trials = budget;
    const Search search = Find(Quartic, 1e-4, options);
    EXPECT_EQ(search.trials.size(), static_cast<std::size_t>(budget));
    EXPECT_EQ(search.result.end, LineSearchEnd::DECREASE);
  }
  options.max_trials = 2;
  EXPECT_EQ(Find(Parabola, 1e8, options).result.end, LineSearchEnd::NO_STEP);
}

// ---- stops ------------------------------------------------------------------

TEST(LineSearch, StopsWhenAsked) {
  for (int after = 0; after <= 6; ++after) {
    const Search search = Find(Quartic, 1e-6, Curvature(0.1), after);
    EXPECT_EQ(search.result.end, LineSearchEnd::STOPPED);
    EXPECT_EQ(search.trials.size(), static_cast<std::size_t>(after));
    // The last that was lower.
    EXPECT_EQ(search.result.point.step,
              after == 0 ? 0.0 : search.trials.back().step);
  }
  const Search search = Find(Parabola, 1e8, {}, 2);
  EXPECT_EQ(search.result.end, LineSearchEnd::STOPPED);
  EXPECT_EQ(search.result.point.step, 0.0);
}

// ---- roundoff ---------------------------------------------------------------

// A number in [-1, 1] that depends on the bits of `a`.
double Noise(double a) {
  std::uint64_t bits;
  static_assert(sizeof(bits) == sizeof(a));
  std::memcpy(&bits, &a, sizeof(a));
  bits *= 0x9e3779b97f4a7c15u;
  bits ^= bits >> 29;
  bits *= 0xbf58476d1ce4e5b9u;
  bits ^= bits >> 32;
  return static_cast<double>(bits >> 11) * 0x1p-52 - 1.0;
}

// E = 1e-30 with noise of 1e-15 of it, and a decrease of 1e-20 of it: only
// slopes can tell.
TEST(LineSearch, DecidesBySlopesBelowTheNoiseOfTheValue) {
  for (const NamedCurve& curve : Curves()) {
    for (const double first : {1e-3, 0.3, 1.0, 3.0, 10.0}) {
      for (const double salt : {0.1, 0.2, 0.3}) {
        SCOPED_TRACE(curve.name);
        SCOPED_TRACE(first);
        const Curve phi = [&](double a) {
          const Sample s = curve.phi(a);
          return Sample{
              1e-30 * (1.0 + 1e-15 * Noise(a + salt)) + 1e-50 * s.value,
              1e-50 * s.slope};
        };
        const Search search = Find(phi, first, Curvature(0.1));
        EXPECT_EQ(search.result.end, LineSearchEnd::WOLFE);
        EXPECT_LE(std::abs(search.result.point.slope),
                  0.1 * std::abs(search.start.slope));
        EXPECT_LE(search.trials.size(), 25u);
      }
    }
  }
}

// Slopes that are wrong by a part of the first one.
TEST(LineSearch, NoisySlopes) {
  for (const double noise : {1e-3, 1e-2, 5e-2}) {
    for (const NamedCurve& curve : Curves()) {
      for (const double first : {1e-3, 0.3, 1.0, 3.0, 10.0}) {
        SCOPED_TRACE(curve.name);
        SCOPED_TRACE(first);
        const double slope0 = std::abs(curve.phi(0.0).slope);
        const Curve phi = [&](double a) {
          Sample s = curve.phi(a);
          if (a != 0.0) s.slope += noise * slope0 * Noise(a);
          return s;
        };
        const Search search = Find(phi, first, Curvature(0.1));
        EXPECT_EQ(search.result.end, LineSearchEnd::WOLFE);
        EXPECT_LE(search.trials.size(), 25u);
      }
    }
  }
}

// Nothing but noise in value and slope: ends, and soon.
TEST(LineSearch, NothingButNoise) {
  for (int salt = 0; salt < 200; ++salt) {
    const Curve phi = [&](double a) {
      if (a == 0.0) return Sample{1.0, -1e-16};
      return Sample{1.0 + 1e-16 * Noise(a + salt),
                    1e-16 * Noise(a + 1000.0 + salt)};
    };
    const Search search = Find(phi, 1.0, Curvature(0.1));
    EXPECT_NE(search.result.end, LineSearchEnd::STOPPED);
  }
}

// ---- units ------------------------------------------------------------------

void ExpectSameInOtherUnits(const Curve& phi,
                            double first,
                            const LineSearchOptions& options) {
  const Search plain = Find(phi, first, options);
  for (const int a : {0, 7, -13, 200, -301}) {
    for (const int b : {0, 3, -5, 100, -151}) {
      const double energy = std::ldexp(1.0, a);
      const double length = std::ldexp(1.0, b);
      const Search other = Find(
          [&](double step) {
            const Sample s = phi(step / length);
            return Sample{s.value * energy, s.slope * (energy / length)};
          },
          first * length,
          options);
      ASSERT_EQ(other.result.end, plain.result.end);
      ASSERT_EQ(other.result.is_last, plain.result.is_last);
      ASSERT_EQ(other.result.point.step, plain.result.point.step * length);
      ASSERT_EQ(other.trials.size(), plain.trials.size());
      for (std::size_t t = 0; t < plain.trials.size(); ++t) {
        ASSERT_EQ(other.trials[t].step, plain.trials[t].step * length);
      }
    }
  }
}

TEST(LineSearch, TrialsAreTheSameInOtherUnits) {
  for (const NamedCurve& curve : Curves()) {
    for (const double first : kFirstSteps) {
      SCOPED_TRACE(curve.name);
      SCOPED_TRACE(first);
      ExpectSameInOtherUnits(curve.phi, first, Curvature(0.9));
      ExpectSameInOtherUnits(curve.phi, first, Curvature(0.01));
      // Where digits of the value are lost.
      const Curve lost = [&](double a) {
        const Sample s = curve.phi(a);
        return Sample{1e10 + s.value, s.slope};
      };
      ExpectSameInOtherUnits(lost, first, Curvature(0.1));
    }
  }
}

// ---- recorded curves --------------------------------------------------------

// Between samples: values by Hermite's cubic, slopes by straight lines.
// Beyond the last sample, that of its parabola.
struct Recording {
  std::vector<LinePoint> points;

  Sample operator()(double a) const {
    if (a >= points.back().step) {
      const LinePoint& p = points.back();
      const LinePoint& q = points[points.size() - 2];
      const double t = a - p.step;
      const double bend = (p.slope - q.slope) / (p.step - q.step);
      return {p.value + t * (p.slope + 0.5 * t * bend), p.slope + t * bend};
    }
    const auto above = std::upper_bound(
        points.begin(), points.end(), a, [](double x, const LinePoint& p) {
          return x < p.step;
        });
    const LinePoint& q = *above;
    const LinePoint& p = *(above - 1);
    const double h = q.step - p.step;
    const double t = (a - p.step) / h;
    const double u = 1.0 - t;
    // Differences from the nearer end, which the values' noise then leaves
    // as it was recorded.
    return {p.value + t * t * (3.0 - 2.0 * t) * (q.value - p.value) +
                h * t * u * (u * p.slope - t * q.slope),
            p.slope + t * (q.slope - p.slope)};
  }
};

Recording ReadRecording(const std::string& name) {
  std::ifstream file(GRANOPT_TEST_DATA "/line_search/" + name);
  EXPECT_TRUE(file.is_open()) << name;
  Recording recording;
  std::string line;
  while (std::getline(file, line)) {
    LinePoint p;
    if (std::sscanf(line.c_str(), "%lg,%lg,%lg", &p.step, &p.value, &p.slope) ==
        3) {
      recording.points.push_back(p);
    }
  }
  EXPECT_GT(recording.points.size(), 20u);
  return recording;
}

const char* const kRecordings[] = {"n1024_p1e-08_reference.csv",
                                   "n1024_p1e-08_rounded.csv",
                                   "n1024_p1e-08_late_reference.csv",
                                   "n1024_p1e-08_late_rounded.csv",
                                   "n256_sheared_reference.csv",
                                   "n256_sheared_rounded.csv"};

TEST(LineSearch, RecordedCurves) {
  for (const char* name : kRecordings) {
    const Recording phi = ReadRecording(name);
    for (const double first : {1e-8, 0.01, 0.3, 1.0, 2.5, 30.0, 1e8}) {
      for (const double curvature : {0.9, 0.1}) {
        SCOPED_TRACE(name);
        SCOPED_TRACE(first);
        SCOPED_TRACE(curvature);
        const Search search = Find(phi, first, Curvature(curvature));
        EXPECT_EQ(search.result.end, LineSearchEnd::WOLFE);
        EXPECT_LE(search.trials.size(), 20u);
        ExpectSameInOtherUnits(phi, first, Curvature(curvature));
      }
    }
  }
}

}  // namespace
}  // namespace granopt
