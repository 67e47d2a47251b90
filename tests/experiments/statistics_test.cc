#include "experiments/statistics.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Statistics, QuantilesAreLinearBetweenValuesAndKnowInfinity) {
  Quantiles q = QuantilesOf({4.0, 1.0, 2.0, 3.0, 5.0, 6.0});
  EXPECT_DOUBLE_EQ(q.low, 2.0);
  EXPECT_DOUBLE_EQ(q.median, 3.5);
  EXPECT_DOUBLE_EQ(q.high, 5.0);
  q = QuantilesOf({3.0, 1.0, 2.0});
  EXPECT_DOUBLE_EQ(q.low, 1.4);
  EXPECT_DOUBLE_EQ(q.median, 2.0);
  EXPECT_DOUBLE_EQ(q.high, 2.6);
  // One failure of three: the median is known, the upper end is not.
  q = QuantilesOf({kInfinity, 1.0, 2.0});
  EXPECT_DOUBLE_EQ(q.median, 2.0);
  EXPECT_TRUE(std::isinf(q.high));
  q = QuantilesOf({kInfinity, kInfinity, 2.0});
  EXPECT_TRUE(std::isinf(q.median));
  EXPECT_TRUE(std::isnan(QuantilesOf({}).median));
}

TEST(Statistics, MedianAndWorstKnowInfinity) {
  MedianWorst value = MedianAndWorst({4.0, 1.0, 3.0});
  EXPECT_EQ(value.median, 3.0);
  EXPECT_EQ(value.worst, 4.0);
  value = MedianAndWorst({1.0, kInfinity, 3.0});
  EXPECT_EQ(value.median, 3.0);
  EXPECT_TRUE(std::isinf(value.worst));
  value = MedianAndWorst({1.0, kInfinity});
  EXPECT_TRUE(std::isinf(value.median));
  EXPECT_TRUE(std::isnan(MedianAndWorst({}).worst));
}

// Its ends solve (p - k/n)^2 = z^2 p (1 - p) / n.
TEST(Statistics, WilsonsInterval) {
  const double z2 = 1.959963984540054 * 1.959963984540054;
  for (const int n : {1, 7, 30, 1000}) {
    for (const int k : {0, 1, n / 2, n}) {
      const Interval interval = Wilson(k, n);
      EXPECT_LE(0.0, interval.low);
      EXPECT_LE(interval.low, static_cast<double>(k) / n);
      EXPECT_LE(static_cast<double>(k) / n, interval.high);
      EXPECT_LE(interval.high, 1.0);
      for (const double p : {interval.low, interval.high}) {
        const double off = p - static_cast<double>(k) / n;
        EXPECT_NEAR(off * off, z2 * p * (1.0 - p) / n, 1e-12) << k << " " << n;
      }
    }
  }
  EXPECT_EQ(Wilson(0, 10).low, 0.0);
  EXPECT_NEAR(Wilson(0, 10).high, z2 / (10.0 + z2), 1e-15);
  EXPECT_EQ(Wilson(10, 10).high, 1.0);
  EXPECT_EQ(Wilson(0, 0).low, 0.0);
  EXPECT_EQ(Wilson(0, 0).high, 1.0);
}

}  // namespace
}  // namespace granopt
