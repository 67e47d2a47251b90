#include "granular/quasistatic_shear.h"

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

std::unique_ptr<Solver> MakeSolver(const std::string& spec) {
  std::string error;
  std::unique_ptr<Solver> solver = CreateSolver(spec, &error);
  EXPECT_NE(solver, nullptr) << error;
  return solver;
}

QuasistaticShearOptions Options(double strain, int steps) {
  QuasistaticShearOptions options;
  options.strain = strain;
  options.steps = steps;
  options.solve.relative_tolerance = 1e-10;
  return options;
}

// 64 discs, well above jamming, relaxed.
Packing Relaxed(int dimension = 2) {
  Relaxation relaxation;
  std::string error;
  SolveOptions solve;
  solve.relative_tolerance = 1e-12;
  EXPECT_TRUE(
      Relax(RandomPacking(dimension, 64, dimension == 2 ? 0.9 : 0.72, 2),
            ContactEnergyOptions(),
            *MakeSolver("lbfgs"),
            solve,
            &relaxation,
            &error))
      << error;
  EXPECT_TRUE(relaxation.summary.Succeeded());
  EXPECT_GT(relaxation.observables.pressure, 0.0);
  return relaxation.packing;
}

struct State {
  double strain = 0.0, energy = 0.0, work = 0.0, dissipated = 0.0;
  SmallMatrix edges;
  std::int64_t evaluations = 0;
};

std::vector<State> Shear(const Packing& start,
                         const QuasistaticShearOptions& options,
                         QuasistaticShearResult* result,
                         const std::string& spec = "lbfgs") {
  std::vector<State> states;
  const auto observer = [&](const QuasistaticShearStep& step) {
    EXPECT_EQ(step.step, static_cast<int>(states.size()));
    states.push_back({step.strain,
                      step.result->observables.energy,
                      step.work,
                      step.dissipated,
                      step.result->packing.box.edges(),
                      step.result->summary.counters.evaluations});
    return true;
  };
  std::string error;
  EXPECT_TRUE(ShearQuasistatically(
      start, options, *MakeSolver(spec), observer, result, &error))
      << error;
  return states;
}

TEST(QuasistaticShear, TheStrainIsTheSumOfItsIncrements) {
  for (const int d : {2, 3}) {
    const Packing start = Relaxed(d);
    QuasistaticShearResult result;
    const std::vector<State> states = Shear(start, Options(0.02, 5), &result);
    ASSERT_EQ(states.size(), 6u);
    EXPECT_EQ(result.relaxations, 5);
    EXPECT_EQ(result.gave_up, 0);
    EXPECT_DOUBLE_EQ(result.strain, 0.02);
    std::int64_t evaluations = 0;
    for (int k = 0; k <= 5; ++k) {
      EXPECT_DOUBLE_EQ(states[k].strain, 0.02 * k / 5);
      // The cell of one shear by the strain so far; the volume stays.
      const SmallMatrix whole = PureShear(d, 0.02 * k / 5) * start.box.edges();
      EXPECT_LE((states[k].edges - whole).cwiseAbs().maxCoeff(), 1e-15 * 5);
      evaluations += states[k].evaluations;
    }
    EXPECT_EQ(evaluations, result.counters.evaluations);
    EXPECT_GT(evaluations, 5);
    EXPECT_NEAR(result.last.packing.box.Volume(), start.box.Volume(), 1e-14);
    EXPECT_DOUBLE_EQ(result.last.packing.PackingFraction(),
                     result.last.observables.packing_fraction);
  }
}

// dE = -V sigma : d(strain) along a path without rearrangements: with the mean
// of both stresses to third order in the increment, where one of them alone
// would leave the second order.
TEST(QuasistaticShear, TheWorkOfTheStressIsTheEnergy) {
  for (const int d : {2, 3}) {
    const Packing start = Relaxed(d);
    std::vector<double> changes;
    for (const double strain : {4e-6, 2e-6}) {
      QuasistaticShearResult result;
      const std::vector<State> states =
          Shear(start, Options(strain, 1), &result);
      const double change = states[1].energy - states[0].energy;
      EXPECT_NEAR(states[1].work, change, 1e-7 * std::abs(change));
      EXPECT_DOUBLE_EQ(states[1].dissipated,
                       states[0].energy + states[1].work - states[1].energy);
      changes.push_back(change);
    }
    // There is a second order to be missed.
    EXPECT_GT(std::abs(changes[0] / changes[1] - 2.0), 1e-5);
    // There and back: no energy is lost.
    QuasistaticShearResult there, back;
    const double strain = 4e-6;
    const double energy = Shear(start, Options(strain, 2), &there)[0].energy;
    const std::vector<State> states = Shear(
        there.last.packing, Options(1.0 / (1.0 + strain) - 1.0, 2), &back);
    EXPECT_NEAR(states[2].energy, energy, 1e-6 * std::abs(changes[0]));
  }
}

// Without strain nothing moves and nothing is done.
TEST(QuasistaticShear, NoStrainDoesNothing) {
  const Packing start = Relaxed();
  QuasistaticShearResult result;
  const std::vector<State> states = Shear(start, Options(0.0, 3), &result);
  ASSERT_EQ(states.size(), 4u);
  for (const State& state : states) {
    EXPECT_EQ(state.energy, states[0].energy);
    EXPECT_EQ(state.work, 0.0);
    EXPECT_EQ(state.dissipated, 0.0);
  }
  EXPECT_EQ(result.counters.iterations, 0);
  EXPECT_EQ(result.last.packing.positions, start.positions);
}

TEST(QuasistaticShear, IsDeterministicAndAddsUp) {
  const Packing start = Relaxed();
  QuasistaticShearResult a, b;
  const std::vector<State> first = Shear(start, Options(0.02, 10), &a);
  const std::vector<State> second = Shear(start, Options(0.02, 10), &b);
  for (std::size_t k = 0; k < first.size(); ++k) {
    EXPECT_EQ(first[k].energy, second[k].energy);
    EXPECT_EQ(first[k].evaluations, second[k].evaluations);
  }
  EXPECT_EQ(a.last.packing.positions, b.last.packing.positions);
  // Energy is what work has not been dissipated, over rearrangements too.
  double sum = first[0].energy;
  for (const State& state : first) sum += state.work - state.dissipated;
  EXPECT_NEAR(sum, first.back().energy, 1e-13 * first.back().energy);
}

TEST(QuasistaticShear, CountsMethodsThatGiveUpAndGoesOn) {
  QuasistaticShearOptions options = Options(0.02, 3);
  options.solve.max_evaluations = 5;
  QuasistaticShearResult result;
  Shear(Relaxed(), options, &result);
  EXPECT_EQ(result.relaxations, 3);
  EXPECT_EQ(result.gave_up, 3);
}

TEST(QuasistaticShear, RefusesBadOptionsAndStopsWhenAsked) {
  const Packing start = Relaxed();
  const std::unique_ptr<Solver> solver = MakeSolver("lbfgs");
  QuasistaticShearResult result;
  std::string error;
  const auto run = [&](const QuasistaticShearOptions& options, bool go_on) {
    error.clear();
    return ShearQuasistatically(
        start,
        options,
        *solver,
        [go_on](const QuasistaticShearStep&) { return go_on; },
        &result,
        &error);
  };
  EXPECT_FALSE(run(Options(-1.0, 1), true));
  EXPECT_NE(error.find("strain = -1"), std::string::npos) << error;
  EXPECT_FALSE(run(Options(std::nan(""), 1), true));
  EXPECT_FALSE(run(Options(0.1, 0), true));
  EXPECT_NE(error.find("steps = 0"), std::string::npos) << error;
  EXPECT_FALSE(run(Options(0.1, 1), false));
  EXPECT_EQ(error, "stopped by the caller");
  EXPECT_TRUE(run(Options(-0.01, 1), true));
}

}  // namespace
}  // namespace granopt
