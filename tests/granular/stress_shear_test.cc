// Stress-controlled simple shear.

#include "granular/stress_shear.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

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

// Where a run of ShearByStress() stood after each step, and how it ended.
struct Path {
  std::vector<StressShearState> states;
  std::vector<bool> found;
  StressShearState end;
  Relaxation last;
};

StressShearOptions YieldOptions() {
  StressShearOptions options;
  options.solve.relative_tolerance = 1e-8;
  options.solve.max_evaluations = 5000;
  return options;
}

Path Sheared(const StressPath& path) {
  Path run;
  run.end.shear.packing = RandomPacking(2, 48, 0.92, 3);
  std::string error;
  EXPECT_TRUE(ShearByStress(
      path,
      YieldOptions(),
      *MakeSolver("lbfgs"),
      [&](const StressShearState& state, const Relaxation* found) {
        run.states.push_back(state);
        run.found.push_back(found != nullptr);
        if (found != nullptr) {
          EXPECT_EQ(found->packing.positions, state.shear.packing.positions);
        }
        return true;
      },
      &run.end,
      &run.last,
      &error))
      << error;
  return run;
}

TEST(StressShear, APathThatHoldsEndsAtItsStress) {
  const Path run = Sheared({-1e-4, 3, 6});
  ASSERT_EQ(run.states.size(), 4u);
  for (int k = 0; k <= 3; ++k) {
    EXPECT_TRUE(run.found[k]);
    EXPECT_EQ(run.states[k].shear.step, k);
    EXPECT_EQ(run.states[k].reached, -1e-4 * k / 3);
    EXPECT_NEAR(
        run.states[k].shear.stress(0, 1), -run.states[k].reached, 1e-10);
  }
  EXPECT_EQ(run.states[0].shear.strain, 0.0);
  EXPECT_LT(run.end.shear.strain, 0.0);
  EXPECT_EQ(run.end.halvings, 0);
}

// Between two stresses 2^-halvings of a step apart; and whoever goes on from
// where the run stood at any time ends where it did, its last state included.
TEST(StressShear, TheYieldStressIsHalvedForAndARunGoesOnToTheSameBits) {
  const StressPath path = {0.2, 4, 3};
  const Path run = Sheared(path);
  EXPECT_EQ(run.end.halvings, path.halvings + 1);
  EXPECT_NEAR(run.end.refused - run.end.reached, 0.05 / 8, 1e-15);
  EXPECT_LT(run.end.reached, 0.5 * run.last.observables.pressure);
  EXPECT_FALSE(run.end.why.empty());
  // The first refusal and three halvings of the step before it.
  const auto first = std::find(run.found.begin(), run.found.end(), false);
  EXPECT_EQ(run.found.end() - first, 1 + path.halvings);
  for (const StressShearState& state : run.states) {
    StressShearState end = state;
    Relaxation last;
    std::string error;
    ASSERT_TRUE(ShearByStress(path,
                              YieldOptions(),
                              *MakeSolver("lbfgs"),
                              nullptr,
                              &end,
                              &last,
                              &error))
        << error;
    EXPECT_EQ(end.reached, run.end.reached);
    EXPECT_EQ(end.refused, run.end.refused);
    EXPECT_EQ(end.why, run.end.why);
    EXPECT_EQ(end.shear.counters.evaluations,
              run.end.shear.counters.evaluations);
    EXPECT_EQ(last.packing.positions, run.last.packing.positions);
    EXPECT_EQ(last.observables.energy, run.last.observables.energy);
    EXPECT_EQ(last.summary.counters.evaluations,
              run.last.summary.counters.evaluations);
    EXPECT_EQ(last.summary.message, run.last.summary.message);
    EXPECT_EQ(last.list_builds, run.last.list_builds);
  }
}

TEST(StressShear, WhatCannotBeShearedIsALine) {
  StressShearState state;
  Relaxation last;
  std::string error;
  const auto shear = [&](const StressPath& path, double phi) {
    state = StressShearState();
    state.shear.packing = RandomPacking(2, 48, phi, 3);
    error.clear();
    return ShearByStress(
        path,
        YieldOptions(),
        *MakeSolver("lbfgs"),
        [](const StressShearState&, const Relaxation*) { return false; },
        &state,
        &last,
        &error);
  };
  EXPECT_FALSE(shear({std::nan(""), 3, 6}, 0.92));
  EXPECT_FALSE(error.empty());
  EXPECT_FALSE(shear({1e-4, 0, 6}, 0.92));
  EXPECT_FALSE(error.empty());
  EXPECT_FALSE(shear({1e-4, 3, 6}, 0.92));
  EXPECT_EQ(error, "stopped by the caller");
  EXPECT_EQ(state.shear.step, 0);
}

}  // namespace
}  // namespace granopt
