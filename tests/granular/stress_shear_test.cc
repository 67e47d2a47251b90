// Stress-controlled simple shear.

#include "granular/stress_shear.h"

#include <cmath>
#include <memory>
#include <string>

#include "granular/linear_response.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

QuasistaticShearState Relaxed(int d, const StressShearOptions& options) {
  QuasistaticShearState state;
  state.packing = RandomPacking(d, d == 2 ? 128 : 96, d == 2 ? 0.92 : 0.75, 3);
  state.step = -1;
  Relaxation last;
  bool found = false;
  std::string error;
  EXPECT_TRUE(StepToShearStress(
      0.0, options, *MakeSolver("newton"), &state, &last, &found, &error))
      << error;
  EXPECT_TRUE(found) << last.summary.message;
  EXPECT_EQ(state.step, 0);
  EXPECT_LE(std::abs(state.stress(0, 1)), 1e-10 * last.observables.pressure);
  state.strain = 0.0;
  return state;
}

// gamma = tau / G with the modulus of linear response, and back.
TEST(StressShear, SmallStressesMeasureTheShearModulus) {
  for (const int d : {2, 3}) {
    StressShearOptions options;
    options.solve.relative_tolerance = 1e-12;
    QuasistaticShearState state = Relaxed(d, options);
    const Packing start = state.packing;
    const ElasticResponse response =
        ComputeElasticResponse(start, ContactEnergyOptions());
    ASSERT_TRUE(response.found);
    const double tau = 1e-7 * state.stress(0, 0);
    Relaxation last;
    bool found = false;
    std::string error;
    const auto solver = MakeSolver("newton");
    ASSERT_TRUE(StepToShearStress(
        tau, options, *solver, &state, &last, &found, &error));
    ASSERT_TRUE(found) << last.summary.message;
    EXPECT_NEAR(-state.stress(0, 1), tau, 1e-6 * tau);
    // That of (13) is dsigma/dgamma at the box's own volume.
    EXPECT_NEAR(state.strain * response.shear / tau, 1.0, 1e-3) << d;
    EXPECT_EQ(state.packing.box.Volume(), start.box.Volume());
    ASSERT_TRUE(StepToShearStress(
        0.0, options, *solver, &state, &last, &found, &error));
    ASSERT_TRUE(found);
    EXPECT_LE(std::abs(state.strain), 1e-5 * tau / response.shear);
  }
}

TEST(StressShear, ThePressureStays) {
  StressShearOptions options;
  options.pressure = 1e-2;
  options.solve.relative_tolerance = 1e-11;
  QuasistaticShearState state = Relaxed(2, options);
  Relaxation last;
  bool found = false;
  std::string error;
  for (int k = 1; k <= 3; ++k) {
    ASSERT_TRUE(StepToShearStress(k * 1e-4,
                                  options,
                                  *MakeSolver("newton"),
                                  &state,
                                  &last,
                                  &found,
                                  &error));
    ASSERT_TRUE(found) << last.summary.message;
    EXPECT_NEAR(last.observables.pressure, 1e-2, 1e-9);
    EXPECT_NEAR(-last.observables.stress(0, 1), k * 1e-4, 1e-9);
  }
  EXPECT_GT(state.strain, 0.0);
  EXPECT_EQ(state.step, 3);
}

// No packing of frictionless discs bears a shear stress above its pressure.
TEST(StressShear, ItYields) {
  StressShearOptions options;
  options.solve.relative_tolerance = 1e-10;
  options.solve.max_evaluations = 20000;
  QuasistaticShearState state = Relaxed(2, options);
  const QuasistaticShearState before = state;
  Relaxation last;
  bool found = true;
  std::string error;
  ASSERT_TRUE(StepToShearStress(2.0 * state.stress(0, 0),
                                options,
                                *MakeSolver("lbfgs"),
                                &state,
                                &last,
                                &found,
                                &error));
  EXPECT_FALSE(found);
  EXPECT_FALSE(last.summary.Succeeded());
  EXPECT_EQ(state.packing.positions, before.packing.positions);
  EXPECT_EQ(state.strain, before.strain);
  EXPECT_GT(state.counters.evaluations, before.counters.evaluations);
  EXPECT_FALSE(StepToShearStress(std::nan(""),
                                 options,
                                 *MakeSolver("lbfgs"),
                                 &state,
                                 &last,
                                 &found,
                                 &error));
}

}  // namespace
}  // namespace granopt
