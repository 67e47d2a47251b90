#include "granular/plastic_events.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// The first event of 256 discs in pure shear in steps of 1e-4.
class FirstEvent : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    solver = MakeSolver("auto").release();
    options.mode = DeformationMode::PURE_SHEAR;
    options.solve.relative_tolerance = 1e-12;
    event = new PlasticEvent();
    QuasistaticShearOptions shear;
    shear.solve = options.solve;
    shear.strain = 0.02;
    shear.steps = 200;
    QuasistaticShearResult result;
    const auto observer = [&](const QuasistaticShearStep& step) {
      if (step.step == 0) return true;
      if (step.dissipated < 1e-4 * step.state->energy) return true;
      EXPECT_TRUE(LocateEvent(step.before->packing,
                              step.before->strain,
                              step.strain,
                              options,
                              *solver,
                              event,
                              &error))
          << error;
      step_dissipated = step.dissipated;
      from = step.before->strain;
      to = step.strain;
      return !event->found;
    };
    ShearQuasistatically(ReadData("n256_phi0.8438_a2_relaxed.xyz"),
                         shear,
                         *solver,
                         observer,
                         &result,
                         &error);
  }
  static void TearDownTestSuite() {
    delete event;
    delete solver;
  }

  static Solver* solver;
  static PlasticEventOptions options;
  static PlasticEvent* event;
  static std::string error;
  static double step_dissipated, from, to;
};
Solver* FirstEvent::solver;
PlasticEventOptions FirstEvent::options;
PlasticEvent* FirstEvent::event;
std::string FirstEvent::error;
double FirstEvent::step_dissipated, FirstEvent::from, FirstEvent::to;

TEST_F(FirstEvent, IsLocatedToItsWidth) {
  ASSERT_TRUE(event->found);
  EXPECT_GE(event->strain_before, from);
  EXPECT_LE(event->strain_after, to);
  EXPECT_LE(event->strain_after - event->strain_before, 1e-10);
  EXPECT_GT(event->strain_after, event->strain_before);
  // Both ends are minima, and the drop is what one step of 1e-4 dissipated but
  // for what happened after it.
  EXPECT_TRUE(event->before.summary.Succeeded());
  EXPECT_TRUE(event->after.summary.Succeeded());
  EXPECT_GT(event->energy_drop, 0.1 * step_dissipated);
  EXPECT_LT(event->energy_drop, 1.5 * step_dissipated);
  EXPECT_GT(event->stress_drop, 0.0);
  // The width does no work to speak of: the drop is the difference of energies.
  EXPECT_NEAR(
      event->before.observables.energy - event->after.observables.energy,
      event->energy_drop,
      1e-3 * event->energy_drop);
}

// What changed, from the two packings alone.
TEST_F(FirstEvent, ItsChangesAreThoseOfItsPackings) {
  ASSERT_TRUE(event->found);
  const Packing& before = event->before.packing;
  const Packing& after = event->after.packing;
  const Observables b = MeasureAtRest(before, 2.0);
  const Observables a = MeasureAtRest(after, 2.0);
  EXPECT_NEAR(event->pressure_drop,
              b.pressure - a.pressure,
              1e-9 * std::abs(event->pressure_drop));
  EXPECT_NEAR(
      event->stress_drop,
      (b.stress(1, 1) - b.stress(0, 0)) - (a.stress(1, 1) - a.stress(0, 0)),
      1e-9 * event->stress_drop);
  const int n = before.size();
  std::vector<bool> counts(n);
  for (int i = 0; i < n; ++i) counts[i] = !b.is_rattler[i] && !a.is_rattler[i];
  EXPECT_LT(std::count(counts.begin(), counts.end(), true), n);
  const auto pairs = [&counts](const Packing& packing) {
    std::set<std::pair<int, int>> result;
    const auto energy = MakeEnergy(packing, 2.0);
    for (const Contact& c : energy->Contacts(Zero(*energy).data())) {
      if (counts[c.id.i] && counts[c.id.j]) result.insert({c.id.i, c.id.j});
    }
    return result;
  };
  const auto missing = [](const auto& from, const auto& in) {
    return std::count_if(from.begin(), from.end(), [&in](const auto& pair) {
      return in.count(pair) == 0;
    });
  };
  const auto pairs_before = pairs(before), pairs_after = pairs(after);
  EXPECT_EQ(event->contacts_opened, missing(pairs_before, pairs_after));
  EXPECT_EQ(event->contacts_closed, missing(pairs_after, pairs_before));
  EXPECT_NE(event->contacts_opened, event->contacts_closed);

  // The width moves nothing to speak of: the cell is that before.
  Eigen::MatrixXd u = after.positions - before.positions;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (int i = 0; i < n; ++i) {
    const Eigen::VectorXd cells = before.box.inverse() * u.col(i);
    u.col(i) -= before.box.edges() * Eigen::VectorXd(cells.array().round());
    if (counts[i]) mean += u.col(i);
  }
  u.colwise() -= mean / std::count(counts.begin(), counts.end(), true);
  double square = 0.0, fourth = 0.0;
  for (int i = 0; i < n; ++i) {
    if (!counts[i]) continue;
    EXPECT_LE((u.col(i) - event->displacement.col(i)).norm(), 1e-9);
    square += u.col(i).squaredNorm();
    fourth += std::pow(u.col(i).squaredNorm(), 2);
  }
  EXPECT_GT(square, 1e-6);
  EXPECT_NEAR(event->participation,
              square * square /
                  (fourth * std::count(counts.begin(), counts.end(), true)),
              1e-4 * event->participation);
}

TEST_F(FirstEvent, TheBranchBeforeItIsReversible) {
  ASSERT_TRUE(event->found);
  EXPECT_LE(event->reversal_energy, 1e-10);
  EXPECT_LE(event->reversal_displacement, 1e-4);
  // And the event is not: back at the strain before, the packing is another.
  Packing packing = event->after.packing;
  DeformTo(options.mode, event->strain_after, from, &packing);
  Relaxation back;
  ASSERT_TRUE(
      Relax(packing, options.energy, *solver, options.solve, &back, &error));
  EXPECT_GT(std::abs(back.observables.energy - event->branch[0].energy),
            0.1 * event->energy_drop);
}

// Hooke's law: the stiffness of a contact jumps as it opens, and so does the
// Hessian. The branch ends at such a change with an eigenvalue that is finite.
TEST_F(FirstEvent, OfHookesLawTheLowestEigenvalueStaysFinite) {
  ASSERT_TRUE(event->found);
  const std::vector<BranchPoint>& branch = event->branch;
  ASSERT_GE(branch.size(), 6u);
  for (const BranchPoint& point : branch) {
    const double left = event->strain_after - point.strain;
    if (left > 1e-6) continue;
    EXPECT_NEAR(point.lowest_eigenvalue,
                branch.back().lowest_eigenvalue,
                1e-2 * branch.back().lowest_eigenvalue);
  }
  EXPECT_GT(branch.back().lowest_eigenvalue, 1e-5);
}

// Hertz' law: a saddle-node bifurcation, lambda^2 is linear in the strain left.
TEST(PlasticEvents, OfHertzLawTheLowestEigenvalueVanishesAsASquareRoot) {
  std::string error;
  const auto solver = MakeSolver("auto");
  PlasticEventOptions options;
  options.energy.alpha = 2.5;
  options.solve.relative_tolerance = 1e-12;
  QuasistaticShearOptions shear;
  shear.energy = options.energy;
  shear.solve = options.solve;
  shear.path = {8e-4, 9e-4};
  PlasticEvent event;
  QuasistaticShearResult result;
  ASSERT_TRUE(ShearQuasistatically(
      ReadData("n256_phi0.8438_a2.5_relaxed.xyz"),
      shear,
      *solver,
      [&](const QuasistaticShearStep& step) {
        return step.step < 2 || LocateEvent(step.before->packing,
                                            step.before->strain,
                                            step.strain,
                                            options,
                                            *solver,
                                            &event,
                                            &error);
      },
      &result,
      &error))
      << error;
  ASSERT_TRUE(event.found);
  std::vector<double> x, y;
  for (const BranchPoint& point : event.branch) {
    const double left = event.strain_after - point.strain;
    EXPECT_GT(point.lowest_eigenvalue, 0.0);
    if (left > 1e-7 || left < 2e-9) continue;
    x.push_back(std::log(left));
    y.push_back(std::log(point.lowest_eigenvalue));
  }
  ASSERT_GE(x.size(), 3u);
  EXPECT_NEAR((y.back() - y.front()) / (x.back() - x.front()), 0.5, 0.05);
  EXPECT_LT(event.branch.back().lowest_eigenvalue,
            0.01 * event.branch.front().lowest_eigenvalue);
}

TEST_F(FirstEvent, TheWayDownHasABarrierOfNoHeight) {
  ASSERT_TRUE(event->found);
  std::vector<double> energy;
  ASSERT_TRUE(EnergyAlong(*event, options, 101, &energy, &error)) << error;
  EXPECT_NEAR(energy.front() - energy.back(),
              event->energy_drop,
              2e-2 * event->energy_drop);
}

// A step with changes of contacts only has no event in it.
TEST(PlasticEvents, AnElasticStepHasNone) {
  std::string error;
  const auto solver = MakeSolver("auto");
  PlasticEventOptions options;
  options.follow_mode = false;
  PlasticEvent event;
  ASSERT_TRUE(LocateEvent(ReadData("n256_phi0.8438_a2_relaxed.xyz"),
                          0.0,
                          1e-6,
                          options,
                          *solver,
                          &event,
                          &error))
      << error;
  EXPECT_FALSE(event.found);
  options.width = 0.0;
  EXPECT_FALSE(LocateEvent(ReadData("n256_phi0.8438_a2_relaxed.xyz"),
                           0.0,
                           1e-6,
                           options,
                           *solver,
                           &event,
                           &error));
  EXPECT_NE(error.find("width = 0"), std::string::npos);
}

// By the shortest image of a skewed cell, without the mean over those that
// count.
TEST(PlasticEvents, DisplacementsAreThoseByTheShortestImage) {
  Packing a = RandomPacking(2, 30, 0.5, 9, SimpleShear(2, 0.8));
  Packing b = a;
  std::vector<bool> counts(30, true);
  counts[4] = counts[17] = false;
  Eigen::MatrixXd moves(2, 30);
  UniformRandom random(5);
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (int i = 0; i < 30; ++i) {
    for (int k = 0; k < 2; ++k) moves(k, i) = 0.1 * random();
    if (counts[i]) mean += moves.col(i) / 28.0;
    for (int k = 0; k < 2; ++k) {
      b.SetPosition(i,
                    k,
                    a.Position(i, k) + moves(k, i) +
                        (i % 3 - 1) * a.box.edges()(k, 0) +
                        (i % 5 - 2) * a.box.edges()(k, 1));
    }
  }
  const Eigen::MatrixXd u = DisplacementBetween(a, b, counts);
  EXPECT_LE((u - (moves.colwise() - mean)).cwiseAbs().maxCoeff(), 1e-14);
}

// The field of Eshelby's inclusion in plane shear is found by m = 2 alone.
TEST(PlasticEvents, HarmonicsTellAQuadrupole) {
  const Packing packing = RandomPacking(2, 4000, 0.8, 7);
  Eigen::MatrixXd u(2, packing.size());
  const int centre = 11;
  for (int i = 0; i < packing.size(); ++i) {
    SmallVector r = packing.positions.col(i) - packing.positions.col(centre);
    for (int k = 0; k < 2; ++k) r[k] -= std::round(r[k]);
    const double distance = std::max(r.norm(), 1e-9);
    const double theta = std::atan2(r[1], r[0]);
    u.col(i) = r * std::cos(2.0 * theta + 0.4) / (distance * distance);
  }
  const std::vector<double> a =
      RadialHarmonics(packing, u, centre, 0.1, 0.3, 5);
  for (const int m : {0, 1, 3, 4}) EXPECT_LT(a[m], 0.2 * a[2]) << m;
  // Half the mean of 1 / r over the ring.
  EXPECT_NEAR(a[2], 0.5 * (0.3 - 0.1) / (0.5 * (0.09 - 0.01)), 0.15);
}

}  // namespace
}  // namespace granopt
