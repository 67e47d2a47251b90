#include "experiments/minima.h"

#include <vector>

#include "gtest/gtest.h"

namespace granopt {
namespace {

TEST(MinimaTest, RigidDistanceLeavesOutTranslationsAndRattlers) {
  const std::vector<bool> first = {false, false, true, false};
  const std::vector<bool> second = {false, false, false, true};
  const std::vector<double> zero(8, 0.0);
  EXPECT_EQ(RigidDistance({1, 2, 1, 2, 9, 9, 9, 9}, first, zero, second), 0.0);
  EXPECT_EQ(RigidDistance({1, 2, 1.5, 2, 9, 9, 9, 9}, first, zero, second),
            0.25);
  EXPECT_EQ(RigidDistance({}, {}, {}, {}), 0.0);
}

TEST(MinimaTest, ReservedLettersAreNotGivenAgain) {
  Minima minima;
  const std::vector<bool> rigid = {false};
  EXPECT_EQ(minima.Tag(1.0, 0.0, 1.0, 1e-3, {0, 0}, rigid), "A");
  minima.Reserve(3);
  EXPECT_EQ(minima.Tag(1.0, 0.0, 1.0, 1e-3, {0, 0}, rigid), "A");
  EXPECT_EQ(minima.Tag(2.0, 0.0, 1.0, 1e-3, {0, 0}, rigid), "D");
}

TEST(MinimaTest, MinimaAreToldApartByEnergyAndDisplacement) {
  Minima minima;
  const std::vector<bool> rigid = {false, false, true};
  const auto tag = [&](double energy,
                       const std::vector<double>& u,
                       double residual = 1e-10,
                       double vanishing = 1e-3) {
    return minima.Tag(energy, residual, vanishing, 1e-3, u, rigid);
  };
  EXPECT_EQ(tag(1.0, {0, 0, 0, 0, 0, 0}), "A");
  // A translation, and a rattler anywhere.
  EXPECT_EQ(tag(1.0 + 1e-8, {.1, .2, .1, .2, 5, 5}), "A");
  // Elsewhere at the same energy; the same place cannot be at another one.
  EXPECT_EQ(tag(1.0, {1e-2, 0, 0, 0, 0, 0}), "B");
  EXPECT_EQ(tag(1.1, {0, 0, 0, 0, 0, 0}), "C");
  EXPECT_EQ(tag(1.0, {0, 0, 0, 0, 0, 0}), "A");
  EXPECT_EQ(tag(1.0, {0, 0, 0, 0, 0, 0}, 1e-2), "-");
  EXPECT_EQ(tag(0.0, {0, 0, 0, 0, 0, 0}, 0.0), "0");
  EXPECT_EQ(tag(1e-30, {0, 0, 0, 0, 0, 0}, 1.0, 1e-13), "0");
}

}  // namespace
}  // namespace granopt
