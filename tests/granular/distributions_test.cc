#include "granular/distributions.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/random.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// n samples of a density proportional to x^exponent on [low, high], at even
// steps of its distribution.
std::vector<double> PowerLawSamples(int n,
                                    double exponent,
                                    double low,
                                    double high) {
  const double s = 1.0 + exponent;
  const double a = low > 0.0 ? std::pow(low, s) : 0.0, b = std::pow(high, s);
  std::vector<double> x;
  for (int i = 0; i < n; ++i) {
    x.push_back(std::pow(a + (b - a) * (i + 0.5) / n, 1.0 / s));
  }
  return x;
}

JammingSamples Collect(const Packing& packing, double max_gap) {
  const auto energy = MakeEnergy(packing, 2.0);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  JammingSamples samples;
  std::string error;
  EXPECT_TRUE(CollectSamples(
      packing, energy->Contacts(zero.data()), max_gap, &samples, &error))
      << error;
  return samples;
}

std::vector<double> Sorted(std::vector<double> x) {
  std::sort(x.begin(), x.end());
  return x;
}

TEST(Distributions, FitsAreThoseOfTheClosedForm) {
  // Two samples by hand: theta = 2 / (ln 2 + ln 4) - 1.
  const PowerLawFit two = FitPowerLaw({0.5, 0.25, 7.0, -1.0, 0.0}, 0.0, 1.0);
  EXPECT_EQ(two.n, 2);
  EXPECT_NEAR(two.exponent, 2.0 / std::log(8.0) - 1.0, 1e-15);
  EXPECT_NEAR(two.error, 2.0 / std::log(8.0) / std::sqrt(2.0), 1e-15);
  // The distance: F = x^s at 0.25, of 0.5 above and 0 below, and at 0.5.
  const double s = 1.0 + two.exponent;
  const double f1 = std::pow(0.25, s), f2 = std::pow(0.5, s);
  EXPECT_NEAR(
      two.distance, std::max({f1, 0.5 - f1, f2 - 0.5, 1.0 - f2}), 1e-15);
  // Even steps of the distribution have the exponent up to 1 / n.
  for (const double exponent : {-0.9, -0.41269, 0.0, 0.17462, 0.42311, 3.0}) {
    for (const double low : {0.0, 1e-6, 1e-2}) {
      SCOPED_TRACE(testing::Message() << exponent << " from " << low);
      const PowerLawFit fit =
          FitPowerLaw(PowerLawSamples(20000, exponent, low, 0.3), low, 0.3);
      EXPECT_EQ(fit.n, 20000);
      EXPECT_NEAR(fit.exponent, exponent, 0.03 * fit.error);
      EXPECT_LT(fit.distance, 1e-3);
    }
  }
  // e = -1 is where both closed forms of the truncated law cancel.
  std::vector<double> even;
  for (int i = 0; i < 10001; ++i) even.push_back(std::pow(10.0, -4e-4 * i));
  const PowerLawFit flat = FitPowerLaw(even, 1e-4, 1.0);
  EXPECT_NEAR(flat.exponent, -1.0, 1e-9);
  // Of a uniform variable in ln x: variance 1 / 12.
  EXPECT_NEAR(
      flat.error, std::sqrt(12.0 / 10001) / std::log(1e4), 1e-3 * flat.error);
}

TEST(Distributions, ErrorsAreThoseOfRandomSamples) {
  UniformRandom random(7);
  for (const double low : {0.0, 1e-3}) {
    SCOPED_TRACE(low);
    constexpr int kRuns = 400, kSamples = 300;
    constexpr double kExponent = -0.4, kHigh = 0.1;
    const double s = 1.0 + kExponent;
    const double a = low > 0.0 ? std::pow(low, s) : 0.0;
    double sum = 0.0, squares = 0.0, stated = 0.0;
    for (int run = 0; run < kRuns; ++run) {
      std::vector<double> x;
      for (int i = 0; i < kSamples; ++i) {
        x.push_back(std::pow(a + (std::pow(kHigh, s) - a) * random(), 1.0 / s));
      }
      const PowerLawFit fit = FitPowerLaw(x, low, kHigh);
      sum += fit.exponent - kExponent;
      squares += std::pow(fit.exponent - kExponent, 2);
      stated += fit.error;
    }
    const double spread = std::sqrt(squares / kRuns);
    // The bias of order 1 / n is a part of the error; a standard deviation of
    // 400 runs is known to 4 %.
    EXPECT_LT(std::abs(sum / kRuns), 0.3 * spread);
    EXPECT_NEAR(spread / (stated / kRuns), 1.0, 0.15);
  }
}

TEST(Distributions, TheScanFindsWhereThePowerLawEnds) {
  // x^0.2 up to 0.1, and nothing like it beyond.
  std::vector<double> x = PowerLawSamples(2000, 0.2, 0.0, 0.1);
  const std::vector<double> more = PowerLawSamples(6000, 4.0, 0.1, 1.0);
  x.insert(x.end(), more.begin(), more.end());
  const PowerLawFit fit = ScanPowerLaw(x, 0.0, 1.0, 50);
  EXPECT_GT(fit.n, 500);
  EXPECT_LT(fit.high, 0.13);
  EXPECT_NEAR(fit.exponent, 0.2, 2.0 * fit.error);
  const PowerLawFit all = FitPowerLaw(x, 0.0, 1.0);
  EXPECT_GT(std::abs(all.exponent - 0.2), 5.0 * all.error);
  // Bad from below too, where the cut says so.
  std::vector<double> blurred = PowerLawSamples(2000, -0.4, 1e-3, 0.1);
  for (int i = 0; i < 300; ++i) blurred.push_back(1e-4);
  EXPECT_NEAR(ScanPowerLaw(blurred, 1e-3, 0.1, 50).exponent, -0.4, 0.05);
  // Too few to choose from.
  EXPECT_EQ(ScanPowerLaw({0.1, 0.2, 0.3}, 0.0, 1.0, 50).high, 1.0);
}

TEST(Distributions, WhatCannotBeFittedIsNot) {
  EXPECT_EQ(FitPowerLaw({}, 0.0, 1.0).n, 0);
  EXPECT_EQ(FitPowerLaw({0.5}, 0.0, 1.0).n, 0);
  EXPECT_EQ(FitPowerLaw({1.0, 1.0}, 0.0, 1.0).n, 0);
  EXPECT_EQ(FitPowerLaw({0.1, 0.1, 0.1}, 0.1, 1.0).n, 0);
  EXPECT_EQ(FitPowerLaw({0.1, 0.2}, 1.0, 0.5).n, 0);
  EXPECT_EQ(FitPowerLaw({0.1, 0.2}, -1.0, 0.5).n, 0);
  EXPECT_EQ(ScanPowerLaw({0.1, 0.2}, 1.0, 0.5, 50).n, 0);
  EXPECT_EQ(FitLine({1.0}, {1.0}, {1.0}).n, 0);
  EXPECT_EQ(FitLine({1.0, 1.0}, {1.0, 2.0}, {1.0, 1.0}).n, 0);
  EXPECT_EQ(FitLine({1.0, 2.0}, {1.0, 2.0}, {1.0, 0.0}).n, 0);
}

TEST(Distributions, LinesAreThoseOfTheClosedForm) {
  const LineFit exact = FitLine({1.0, 2.0, 4.0}, {5.0, 7.0, 11.0}, {1, 2, 3});
  EXPECT_NEAR(exact.a, 3.0, 1e-14);
  EXPECT_NEAR(exact.b, 2.0, 1e-14);
  EXPECT_NEAR(exact.chi2, 0.0, 1e-25);
  // Two points: b = dy / dx with errors added in squares; a at x = 0.
  const LineFit two = FitLine({1.0, 3.0}, {1.0, 2.0}, {0.3, 0.4});
  EXPECT_NEAR(two.b_error, 0.5 / 2.0, 1e-15);
  // a = (3 y1 - y2) / 2.
  EXPECT_NEAR(two.a, 0.5, 1e-15);
  EXPECT_NEAR(two.a_error, 0.5 * std::hypot(0.9, 0.4), 1e-15);
}

// Discs of diameter 1 + overlap on a triangular lattice of `columns` x `rows`
// sites, every one of them in a cell without shear.
Packing Lattice(int columns, int rows, double overlap) {
  const double height = std::sqrt(0.75);
  Eigen::MatrixXd positions(2, columns * rows);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      positions.col(r * columns + c) << c + 0.5 * (r % 2) + 0.1,
          r * height + 0.1;
    }
  }
  return MakePacking(Box(Matrix2(columns, 0, 0, rows * height)),
                     positions,
                     std::vector<double>(columns * rows, 0.5 + 0.5 * overlap));
}

TEST(Distributions, ALatticeHasItsContactsAndGaps) {
  const Packing lattice = Lattice(6, 6, 1e-3);
  const JammingSamples s = Collect(lattice, 0.75);
  // 3 contacts a grain, all alike; none of the grains a buckler.
  EXPECT_EQ(s.bucklers, 0);
  EXPECT_EQ(s.rigid_grains, 36);
  EXPECT_EQ(s.excess_contacts, 108 - (2 * 36 - 1));
  EXPECT_TRUE(s.localized.empty());
  ASSERT_EQ(s.extended.size(), 108u);
  for (const double f : s.extended) EXPECT_NEAR(f, 1.0, 1e-11);
  EXPECT_NEAR(s.mean_overlap, 1e-3 / 1.001, 1e-15);
  // The next neighbours, at sqrt(3).
  ASSERT_EQ(s.gaps.size(), 108u);
  for (const double h : s.gaps) {
    EXPECT_NEAR(h, std::sqrt(3.0) / 1.001 - 1.0, 1e-12);
  }
  EXPECT_TRUE(Collect(lattice, 0.7).gaps.empty());
  // A hole: six grains lose a contact, and their gaps across it (at distance 2
  // and sqrt(3)) are there as before, the missing grain's are not.
  Packing hole = Lattice(6, 6, 1e-3);
  hole.radii[14] = 0.05;
  const JammingSamples without = Collect(hole, 0.75);
  EXPECT_EQ(without.rigid_grains, 35);
  EXPECT_EQ(without.extended.size(), 102u);
  EXPECT_EQ(without.gaps.size(), 102u);
}

TEST(Distributions, BucklersAndRattlers) {
  // Honeycomb: grains with three contacts each are all bucklers. The grain in a
  // hexagon touches nothing: a rattler, of whose gaps none counts.
  Packing lattice = Lattice(6, 6, 1e-3);
  Packing honeycomb = lattice;
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) {
      // Colour 0 of the three sublattices.
      if ((c - r / 2 - r + 30) % 3 == 0) {
        honeycomb.radii[6 * r + c] = 0.45;
      }
    }
  }
  const JammingSamples s = Collect(honeycomb, 0.2);
  EXPECT_EQ(s.rigid_grains, 24);
  EXPECT_EQ(s.bucklers, 24);
  EXPECT_EQ(s.localized.size(), 36u);
  EXPECT_TRUE(s.extended.empty());
  EXPECT_TRUE(s.gaps.empty());
}

TEST(Distributions, AJammedPackingMadeElsewhere) {
  const JammingSamples s = Collect(ReadData("n1024_a2_p1e-08.xyz"), 0.3);
  EXPECT_EQ(s.rigid_grains, 976);
  EXPECT_EQ(s.excess_contacts, 1);
  EXPECT_EQ(s.localized.size() + s.extended.size(), 1952u);
  double sum = 0.0;
  for (const double f : s.localized) sum += f;
  for (const double f : s.extended) sum += f;
  EXPECT_NEAR(sum / 1952.0, 1.0, 1e-12);
  EXPECT_GT(s.bucklers, 200);
  EXPECT_GT(s.gaps.size(), 500u);
  // No gap is counted twice, none is a contact.
  EXPECT_GT(*std::min_element(s.gaps.begin(), s.gaps.end()), 0.0);
  const std::vector<double> gaps = Sorted(s.gaps);
  EXPECT_EQ(std::adjacent_find(gaps.begin(), gaps.end()), gaps.end());
}

TEST(Distributions, UnitsDoNotMatter) {
  Packing packing = ReadData("n64_jammed.xyz");
  const JammingSamples s = Collect(packing, 0.3);
  // Lengths in units of 2^5 and energies of 2^-7: the same bits.
  Packing other = WithLengths(5, packing);
  other.stiffness =
      Eigen::VectorXd::Constant(other.size(), std::ldexp(1.0, -7));
  const JammingSamples t = Collect(other, 0.3);
  EXPECT_EQ(s.localized, t.localized);
  EXPECT_EQ(s.extended, t.extended);
  EXPECT_EQ(s.gaps, t.gaps);
  EXPECT_EQ(s.mean_overlap, t.mean_overlap);
  EXPECT_EQ(s.bucklers, t.bucklers);
  // Other units too, up to rounding.
  Packing third = packing;
  third.box = Box(3.0 * packing.box.edges());
  third.positions *= 3.0;
  third.positions_low *= 3.0;
  third.radii *= 3.0;
  EXPECT_EQ(Collect(third, 0.3).gaps.size(), s.gaps.size());
}

TEST(Distributions, AnUnjammedPackingHasNoSamples) {
  const JammingSamples s = Collect(Lattice(4, 4, -0.1), 0.3);
  EXPECT_EQ(s.rigid_grains, 0);
  EXPECT_TRUE(s.localized.empty());
  EXPECT_TRUE(s.extended.empty());
  EXPECT_TRUE(s.gaps.empty());
  JammingSamples none;
  std::string error;
  EXPECT_FALSE(CollectSamples(Packing(), {}, 0.0, &none, &error));
  EXPECT_EQ(error, "max_gap = 0 must be positive");
}

}  // namespace
}  // namespace granopt
