#include "experiments/scaling_laws.h"

#include <cmath>

#include "gtest/gtest.h"

namespace granopt {
namespace {

// Packings on exact power laws with a factor of their own each.
std::vector<ScalingState> Synthetic(int packings, double alpha) {
  std::vector<ScalingState> states;
  for (int s = 1; s <= packings; ++s) {
    for (const double x : {1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1}) {
      ScalingState state;
      state.particles = 1000;
      state.seed = s;
      state.alpha = alpha;
      state.asked = x;
      state.distance = x * (1.0 + 1e-3 * s);
      const double factor = 1.0 + 0.1 * s;
      state.pressure = factor * std::pow(x, alpha - 1.0);
      state.reduced = 0.5 * x;
      state.bulk = factor * std::pow(x, alpha - 2.0);
      state.shear = factor * std::pow(x, alpha - 1.5);
      state.shear_mean = state.shear;
      state.excess = factor * std::sqrt(x);
      states.push_back(state);
    }
  }
  return states;
}

TEST(ScalingLaws, FindExactExponents) {
  for (const double alpha : {2.0, 2.5}) {
    const auto states = Synthetic(5, alpha);
    for (const std::string& quantity : ScalingQuantities()) {
      const Exponent e = FitExponent(states, quantity, alpha, 1000, {});
      EXPECT_NEAR(e.value, e.paper, 1e-12) << quantity;
      EXPECT_NEAR(e.low, e.paper, 1e-12);
      EXPECT_NEAR(e.high, e.paper, 1e-12);
      // P N^2 = 5e5 x >= 10, x <= 1e-2.
      EXPECT_EQ(e.from, 1e-4);
      EXPECT_EQ(e.to, 1e-2);
      EXPECT_EQ(e.distances, 3);
      EXPECT_EQ(e.packings, 5);
      EXPECT_EQ(e.negative, 0);
    }
  }
  const Exponent g = FitExponent(Synthetic(3, 2.5), "shear", 2.5, 1000, {});
  EXPECT_EQ(g.paper, 1.0);
  EXPECT_TRUE(g.from_paper);
}

TEST(ScalingLaws, CountNegativeModuliAndKeepThem) {
  auto states = Synthetic(5, 2.0);
  // Two of five at each distance: the median is that of a smaller packing.
  for (ScalingState& state : states) {
    if (state.seed >= 4) state.shear = -state.shear;
  }
  Exponent e = FitExponent(states, "shear", 2.0, 1000, {});
  EXPECT_EQ(e.negative, 6);
  EXPECT_NEAR(e.value, 0.5, 1e-12);
  EXPECT_EQ(e.left_out, 0);
  // Three of five: no distance is left, which is said.
  for (ScalingState& state : states) {
    if (state.seed == 3) state.shear = -state.shear;
  }
  e = FitExponent(states, "shear", 2.0, 1000, {});
  EXPECT_EQ(e.left_out, 3);
  EXPECT_LT(e.distances, 2);
}

TEST(ScalingLaws, IntervalsAreTheSameEveryTimeAndWidenWithScatter) {
  auto states = Synthetic(8, 2.0);
  for (ScalingState& state : states) {
    // Exponents between 0.8 and 1.2.
    state.pressure *= std::pow(state.asked, 0.05 * (state.seed - 4.5));
  }
  const Exponent a = FitExponent(states, "pressure", 2.0, 1000, {});
  const Exponent b = FitExponent(states, "pressure", 2.0, 1000, {});
  EXPECT_EQ(a.low, b.low);
  EXPECT_EQ(a.high, b.high);
  EXPECT_LT(a.low, 0.95);
  EXPECT_GT(a.high, 1.05);
  EXPECT_LT(a.high - a.low, 0.4);
}

TEST(ScalingLaws, StatesAreReadAsTheyAreWritten) {
  auto states = Synthetic(2, 2.0);
  states[3].shear = -1.0 / 3.0;
  std::vector<ScalingState> read;
  std::string error;
  ASSERT_TRUE(ReadStates(StatesCsv(states), "states.csv", &read, &error))
      << error;
  ASSERT_EQ(read.size(), states.size());
  EXPECT_EQ(StatesCsv(read), StatesCsv(states));
  EXPECT_FALSE(ReadStates("alpha,seed\n2,x\n", "states.csv", &read, &error));
  EXPECT_NE(error.find("states.csv"), std::string::npos) << error;
  // Nothing of a file that breaks off is taken for a state.
  const std::string whole = StatesCsv(states);
  EXPECT_FALSE(ReadStates(
      whole.substr(0, whole.size() - 40), "states.csv", &read, &error));
  EXPECT_EQ(read.size(), states.size());
}

}  // namespace
}  // namespace granopt
