#include "granular/quasistatic_shear.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "Eigen/LU"
#include "granular/constant_stress.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

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

// ---- modes of deformation

// exp(ln F) = F, increments compose, and the conjugate stress is the derivative
// of the work.
TEST(DeformationModes, IncrementsAreGroupsOfOneParameter) {
  for (const int d : {2, 3}) {
    for (const DeformationMode mode : {DeformationMode::PURE_SHEAR,
                                       DeformationMode::SIMPLE_SHEAR,
                                       DeformationMode::BULK}) {
      const SmallMatrix one = DeformationIncrement(mode, d, 0.0, 0.07);
      const SmallMatrix two = DeformationIncrement(mode, d, 0.07, -0.11);
      const SmallMatrix both = DeformationIncrement(mode, d, 0.0, -0.11);
      EXPECT_LE((two * one - both).cwiseAbs().maxCoeff(), 4 * kEps);
      EXPECT_NEAR(both.determinant(),
                  mode == DeformationMode::BULK ? 1.0 - 0.11 : 1.0,
                  4 * kEps);
      const SmallMatrix log = StrainIncrement(mode, d, 0.0, -0.11);
      SmallMatrix sum = SmallMatrix::Identity(d, d);
      SmallMatrix term = sum;
      for (int k = 1; k < 20; ++k) {
        term = (term * log / k).eval();
        sum += term;
      }
      EXPECT_LE((sum - both).cwiseAbs().maxCoeff(), 4 * kEps);
      SmallMatrix stress(d, d);
      for (int r = 0; r < d; ++r) {
        for (int c = 0; c < d; ++c) stress(r, c) = 1.0 + r * c + 0.3 * (r + c);
      }
      const double h = 1e-7;
      const double work =
          -stress.cwiseProduct(StrainIncrement(mode, d, 0.0, h)).sum() / h;
      EXPECT_NEAR(ConjugateStress(mode, stress), work, 1e-6);
    }
  }
}

// The same contacts with the same forces, whichever cell the lattice is given
// by; images n become T^-1 n.
TEST(LeesEdwards, FoldingKeepsEveryContactAndForce) {
  struct Case {
    Packing packing;
    double strain;
  };
  std::vector<Case> cases = {{ReadData("n1024_a2_p1e-08.xyz"), 0.6},
                             {ReadData("n1024_a2_p1e-08.xyz"), -7.3},
                             {ReadData("n1024_a2_p1e-04.xyz"), 1000.25},
                             {ReadData("n1024_a2_p1e-08.xyz"), 1000.25},
                             {RandomPacking(3, 64, 0.75, 5), 0.8}};
  for (Case& c : cases) {
    Packing skewed = c.packing;
    const int d = skewed.dimension();
    skewed.Deform(SimpleShear(d, c.strain));
    skewed.box = skewed.box.Rounded();
    Packing folded = skewed;
    Eigen::Matrix3i transform;
    ASSERT_TRUE(folded.Fold(&transform));
    // The edges are those integer combinations exactly.
    for (int k = 0; k < d; ++k) {
      for (int r = 0; r < d; ++r) {
        Quad edge = 0;
        for (int m = 0; m < d; ++m) {
          edge += Quad(skewed.box.edges()(r, m)) * transform(m, k);
        }
        EXPECT_EQ(static_cast<double>(edge - Quad(folded.box.edges()(r, k))),
                  0.0);
      }
    }
    const auto energy = MakeEnergy(skewed, 2.0);
    const auto energy_folded = MakeEnergy(folded, 2.0);
    const std::vector<double> zero(energy->NumParameters(), 0.0);
    const auto contacts = energy->Contacts(zero.data());
    const auto contacts_folded = energy_folded->Contacts(zero.data());
    ASSERT_GT(contacts.size(), 100u);
    ASSERT_EQ(contacts.size(), contacts_folded.size());
    const Observables o = Measure(skewed, contacts, 0.0);
    const Observables o_folded = Measure(folded, contacts_folded, 0.0);
    // By grains; the few pairs with several images by force.
    const auto key = [](const Contact& contact) {
      return std::make_tuple(contact.id.i, contact.id.j, contact.force);
    };
    auto a = contacts, b = contacts_folded;
    const auto less = [&key](const Contact& x, const Contact& y) {
      return key(x) < key(y);
    };
    std::sort(a.begin(), a.end(), less);
    std::sort(b.begin(), b.end(), less);
    double worst = 0.0;
    for (std::size_t k = 0; k < a.size(); ++k) {
      ASSERT_EQ(a[k].id.i, b[k].id.i);
      ASSERT_EQ(a[k].id.j, b[k].id.j);
      worst = std::max(
          worst, (a[k].force * a[k].normal - b[k].force * b[k].normal).norm());
    }
    EXPECT_LE(worst, 1e-14 * o.mean_force) << c.strain;
    EXPECT_LE((o.stress - o_folded.stress).cwiseAbs().maxCoeff(),
              1e-13 * o.pressure);
    EXPECT_EQ(o.rigid_contacts, o_folded.rigid_contacts);
    // Nothing is left to fold.
    EXPECT_FALSE(folded.Fold(&transform));
  }
}

// A strain of 1 is a vector of the lattice: the packing is what it was, and the
// forces of a jammed one are those of the start to the last digits.
TEST(LeesEdwards, AStrainOfOneIsNoStrain) {
  Packing packing = ReadData("n1024_a2_p1e-08.xyz");
  const auto force = [](const Packing& p) {
    const auto energy = MakeEnergy(p, 2.0);
    const std::vector<double> zero(energy->NumParameters(), 0.0);
    return Measure(p, energy->Contacts(zero.data()), 0.0);
  };
  const Observables before = force(packing);
  // x + gamma y with gamma = 1 cannot be undone by images unless y is one, so
  // shear there and back through many folded cells.
  double strain = 0.0;
  for (const double next : {0.75, 1.5, 3.0, 1.5, 0.75, 0.0}) {
    DeformTo(DeformationMode::SIMPLE_SHEAR, strain, next, &packing);
    strain = next;
    EXPECT_LE(
        std::abs(packing.box.edges().col(0).dot(packing.box.edges().col(1))),
        0.5000001 * packing.box.edges().col(0).squaredNorm());
  }
  const Observables after = force(packing);
  EXPECT_EQ(before.contacts, after.contacts);
  EXPECT_NEAR(before.mean_force, after.mean_force, 1e-13 * before.mean_force);
  EXPECT_NEAR(
      before.max_residual, after.max_residual, 1e-13 * before.mean_force);
}

// Every mode does the work that the energy gains, and undoes it on the way
// back.
TEST(QuasistaticShear, EveryModeIsReversibleWhereNothingRearranges) {
  for (const int d : {2, 3}) {
    const Packing start = Relaxed(d);
    for (const DeformationMode mode : {DeformationMode::PURE_SHEAR,
                                       DeformationMode::SIMPLE_SHEAR,
                                       DeformationMode::BULK}) {
      QuasistaticShearOptions options = Options(0.0, 1);
      options.mode = mode;
      options.solve.relative_tolerance = 1e-12;
      options.path = {2e-6, 4e-6, 2e-6, 0.0};
      QuasistaticShearResult result;
      const std::vector<State> states = Shear(start, options, &result);
      ASSERT_EQ(states.size(), 5u);
      double change = 0.0;
      for (int k = 1; k < 5; ++k) {
        change = std::max(change, std::abs(states[k].work));
        EXPECT_LE(std::abs(states[k].dissipated), 1e-6 * change)
            << DeformationModeName(mode) << k;
      }
      EXPECT_NEAR(states[4].energy, states[0].energy, 1e-6 * change);
      EXPECT_LE((states[4].edges - start.box.edges()).cwiseAbs().maxCoeff(),
                4 * kEps);
    }
  }
}

// Across the fold of the cell nothing happens: stress and energy go on.
TEST(LeesEdwards, AFlowGoesOnAcrossTheFold) {
  QuasistaticShearOptions options = Options(0.0, 1);
  options.mode = DeformationMode::SIMPLE_SHEAR;
  Packing start = Relaxed();
  DeformTo(options.mode, 0.0, 0.4999, &start);
  options.path = {5e-5, 9.9e-5, 1.01e-4, 1.5e-4};
  options.solve.relative_tolerance = 1e-11;
  QuasistaticShearResult result;
  Relaxation relaxed;
  std::string error;
  ASSERT_TRUE(Relax(start,
                    options.energy,
                    *MakeSolver("lbfgs"),
                    options.solve,
                    &relaxed,
                    &error));
  const std::vector<State> states = Shear(relaxed.packing, options, &result);
  ASSERT_EQ(states.size(), 5u);
  EXPECT_GT(states[2].edges(0, 1), 0.0);
  EXPECT_LT(states[3].edges(0, 1), 0.0);
  EXPECT_LE(std::abs(states[3].dissipated), 1e-5 * std::abs(states[3].work));
}

// At constant pressure the volume gives way: p stays, and the work of shear and
// of the pressure is the energy.
TEST(QuasistaticShear, AtConstantPressureTheVolumeGivesWay) {
  for (const int d : {2, 3}) {
    ConstantStressOptions stress;
    stress.pressure = 5e-3;
    stress.strains = IsotropicStrain(d);
    stress.solve.relative_tolerance = 1e-12;
    ConstantStressResult start;
    std::string error;
    const auto solver = MakeSolver("newton");
    ASSERT_TRUE(RelaxAtStress(Relaxed(d), stress, *solver, &start, &error));
    for (const DeformationMode mode :
         {DeformationMode::PURE_SHEAR, DeformationMode::SIMPLE_SHEAR}) {
      QuasistaticShearOptions options = Options(0.0, 1);
      options.mode = mode;
      options.pressure = stress.pressure;
      options.path = {2e-6, 4e-6};
      options.solve.relative_tolerance = 1e-12;
      QuasistaticShearResult result;
      double volume = start.relaxation.packing.box.Volume();
      double most = 0.0;
      ASSERT_TRUE(ShearQuasistatically(
          start.relaxation.packing,
          options,
          *solver,
          [&](const QuasistaticShearStep& step) {
            EXPECT_NEAR(step.result->observables.pressure,
                        options.pressure,
                        1e-10 * options.pressure);
            if (step.step == 0) return true;
            EXPECT_NE(step.state->packing.box.Volume(), volume);
            most = std::max(most, std::abs(step.work));
            EXPECT_LE(std::abs(step.dissipated), 1e-5 * most);
            return true;
          },
          &result,
          &error))
          << error;
      EXPECT_EQ(result.gave_up, 0);
    }
  }
  QuasistaticShearOptions options = Options(0.1, 1);
  options.pressure = -1.0;
  QuasistaticShearResult result;
  std::string error;
  const Packing start = Relaxed();
  EXPECT_FALSE(ShearQuasistatically(
      start, options, *MakeSolver("lbfgs"), nullptr, &result, &error));
  EXPECT_NE(error.find("pressure = -1"), std::string::npos);
}

// From any state that an observer was shown, bitwise.
TEST(QuasistaticShear, ARunThatGoesOnEndsWhereTheWholeOneDoes) {
  const Packing start = Relaxed();
  QuasistaticShearOptions options = Options(0.5, 1);
  options.mode = DeformationMode::SIMPLE_SHEAR;
  options.path = {0.2, 0.4, 0.6, 0.3};
  QuasistaticShearResult whole;
  QuasistaticShearState kept;
  std::string error;
  const auto observer = [&](const QuasistaticShearStep& step) {
    if (step.step == 2) kept = *step.state;
    return true;
  };
  ASSERT_TRUE(ShearQuasistatically(
      start, options, *MakeSolver("lbfgs"), observer, &whole, &error));
  QuasistaticShearResult rest;
  int seen = 0;
  ASSERT_TRUE(ContinueShear(
      options,
      *MakeSolver("lbfgs"),
      [&seen](const QuasistaticShearStep& step) {
        EXPECT_EQ(step.step, 3 + seen++);
        return true;
      },
      &kept,
      &rest,
      &error));
  EXPECT_EQ(seen, 2);
  EXPECT_EQ(rest.last.packing.positions, whole.last.packing.positions);
  EXPECT_EQ(rest.last.packing.positions_low, whole.last.packing.positions_low);
  EXPECT_EQ(rest.last.observables.energy, whole.last.observables.energy);
  EXPECT_EQ(rest.counters.evaluations, whole.counters.evaluations);
  EXPECT_EQ(rest.relaxations, 4);
}

}  // namespace
}  // namespace granopt
