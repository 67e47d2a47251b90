#include "granular/vibrations.h"

#include <algorithm>
#include <cmath>

#include "Eigen/Eigenvalues"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// The modes of a triangular lattice are plane waves: for each wave vector q of
// the cell the two eigenvalues of
//   D(q) = sum over three bonds of 2 (1 - cos q.R) ((K + f / l) n n - f / l 1).
TEST(Vibrations, OfATriangularLatticeAreItsPhonons) {
  constexpr int kSide = 5;
  const double spacing = 0.97;
  Packing packing;
  SmallMatrix edges(2, 2);
  edges << kSide, 0.5 * kSide, 0.0, kSide * std::sqrt(0.75);
  edges *= spacing;
  packing.box = Box(edges);
  packing.positions.resize(2, kSide * kSide);
  for (int i = 0; i < kSide * kSide; ++i) {
    packing.positions.col(i) =
        edges * Eigen::Vector2d(i / kSide, i % kSide) / kSide;
  }
  packing.radii.setConstant(kSide * kSide, 0.5);

  std::vector<double> expected;
  const double tension = 0.03 / spacing;
  const Eigen::Matrix2d reciprocal =
      2.0 * M_PI * Eigen::Matrix2d(edges).inverse().transpose();
  for (int a = 0; a < kSide; ++a) {
    for (int b = 0; b < kSide; ++b) {
      if (a == 0 && b == 0) continue;
      const Eigen::Vector2d q = reciprocal * Eigen::Vector2d(a, b);
      Eigen::Matrix2d dynamical = Eigen::Matrix2d::Zero();
      for (int bond = 0; bond < 3; ++bond) {
        const double angle = bond * M_PI / 3.0;
        const Eigen::Vector2d n(std::cos(angle), std::sin(angle));
        dynamical += 2.0 * (1.0 - std::cos(spacing * q.dot(n))) *
                     ((1.0 + tension) * n * n.transpose() -
                      tension * Eigen::Matrix2d::Identity());
      }
      const Eigen::Vector2d values =
          Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(dynamical)
              .eigenvalues();
      expected.push_back(std::sqrt(values[0]));
      expected.push_back(std::sqrt(values[1]));
    }
  }
  std::sort(expected.begin(), expected.end());

  const Vibrations all =
      ComputeVibrations(packing, ContactEnergyOptions(), VibrationOptions());
  ASSERT_TRUE(all.found) << all.message;
  EXPECT_TRUE(all.complete);
  EXPECT_NEAR(all.stiffness, 1.0, 1e-12);
  ASSERT_EQ(all.modes.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    EXPECT_NEAR(all.modes[k].frequency, expected[k], 1e-12);
    EXPECT_GT(all.modes[k].participation, 0.3);
  }

  // A density over all of them integrates to one.
  const DensityOfStates density =
      BinModes(all.modes, {0.0, 0.5, 1.0, 1.5, 2.0, 3.0});
  double sum = 0.0;
  for (std::size_t b = 0; b < density.density.size(); ++b) {
    sum += density.density[b] * (density.edges[b + 1] - density.edges[b]);
  }
  EXPECT_NEAR(sum, 1.0, 1e-12);

  // The lowest ones by the sparse method.
  VibrationOptions sparse;
  sparse.most_dense = 0;
  sparse.lowest = 7;
  const Vibrations few =
      ComputeVibrations(packing, ContactEnergyOptions(), sparse);
  ASSERT_TRUE(few.found) << few.message;
  EXPECT_FALSE(few.complete);
  ASSERT_EQ(few.modes.size(), 7u);
  for (int k = 0; k < 7; ++k) {
    EXPECT_NEAR(few.modes[k].frequency, expected[k], 1e-9);
  }
}

TEST(Vibrations, OfAJammedPackingBeginWithTheCertificatesMode) {
  const Packing packing = ReadData("n64_jammed.xyz");
  const Vibrations all =
      ComputeVibrations(packing, ContactEnergyOptions(), VibrationOptions());
  ASSERT_TRUE(all.found) << all.message;
  VibrationOptions sparse;
  sparse.most_dense = 0;
  sparse.lowest = 3;
  const Vibrations few =
      ComputeVibrations(packing, ContactEnergyOptions(), sparse);
  ASSERT_TRUE(few.found) << few.message;
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(few.modes[k].frequency,
                all.modes[k].frequency,
                1e-7 * all.modes[k].frequency);
    EXPECT_NEAR(few.modes[k].participation, all.modes[k].participation, 1e-5);
  }
  EXPECT_EQ(all.modes.size(), static_cast<std::size_t>(2 * all.grains - 2));
}

}  // namespace
}  // namespace granopt
