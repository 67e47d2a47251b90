#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/flow/flow.h"
#include "granular/flow/start.h"
#include "granular/flow/stepper.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

struct Start {
  FlowSceneOptions options;
  FlowState state;
};

Start RandomStart(int n, double ratio, int attempts, double period = 0.0) {
  FlowStart start;
  start.particles = n;
  start.length_ratio = ratio;
  start.attempts = attempts;
  start.period = period;
  Start made;
  std::string error;
  EXPECT_TRUE(MakeStart(start, &made.options.grains, &made.state, &error))
      << error;
  if (period > 0.0) made.options.domain.kind = Domain::Kind::NEAREST_IMAGE;
  return made;
}

int Overlaps(const Start& start) {
  ContactSearch search;
  std::vector<ClosePair> pairs;
  search.Find(start.options.grains.size(),
              start.options.grains.stride(),
              start.state.x.data(),
              start.options.grains.radius.data(),
              start.options.domain.period(),
              &pairs);
  return static_cast<int>(pairs.size());
}

TEST(FlowStart, HasThePapersNumbers) {
  const Start start = RandomStart(100, 0.25, 10000);
  const Grains& grains = start.options.grains;
  // b = 0.0539, volume fraction 0.0655 (sec. 7.1), mass rho 4 pi b^3 / 3.
  EXPECT_NEAR(grains.radius[0], 0.0539, 5e-5);
  double mass = 0.0;
  for (const double m : grains.mass) mass += m;
  EXPECT_NEAR(mass / 2000.0, 0.0654, 1e-4);
  EXPECT_EQ(Overlaps(start), 0);
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  const KineticEnergy k = scene->Kinetic(start.state.v.data());
  // The mean is exact; perturbations add their variance of 1/3.
  EXPECT_NEAR(k.bulk / mass, 0.5 * (1.0 + 0.01 + 0.01), 1e-14);
  EXPECT_NEAR(k.relative / mass, 0.5 * 1.02 / 3.0, 0.03);
}

TEST(FlowStart, DensePlacesAreFoundOrRefused) {
  EXPECT_EQ(Overlaps(RandomStart(300, 0.38, 100000, 1.0)), 0);
  FlowStart start;
  start.length_ratio = 0.55;
  Grains grains;
  FlowState state;
  std::string error;
  EXPECT_FALSE(MakeStart(start, &grains, &state, &error));
  EXPECT_EQ(error.find("placement impossible: "), 0u) << error;
}

TEST(FlowStart, OverlapsAreRefusedOrRelaxed) {
  for (const double period : {0.0, 1.0}) {
    Start start = RandomStart(200, 0.35, 0, period);
    start.options.impact = ImpactOptions();
    EXPECT_GT(Overlaps(start), 20);
    std::string error, report;
    const auto scene = FlowScene::Create(start.options, &error);
    FlowState state = start.state;
    EXPECT_FALSE(scene->Begin(0.01, &state, &error));
    EXPECT_EQ(error.find("overlapping start: "), 0u) << error;
    ASSERT_TRUE(RelaxOverlaps(start.options.grains,
                              start.options.domain,
                              *CreateSolver("lbfgs", &error),
                              &start.state,
                              &report,
                              &error))
        << error;
    EXPECT_EQ(Overlaps(start), 0);
    EXPECT_TRUE(scene->Begin(0.01, &start.state, &error)) << error;
  }
  // More than fits.
  Start start = RandomStart(200, 0.7, 0, 1.0);
  std::string error, report;
  EXPECT_FALSE(RelaxOverlaps(start.options.grains,
                             start.options.domain,
                             *CreateSolver("lbfgs", &error),
                             &start.state,
                             &report,
                             &error));
  EXPECT_NE(error.find("the grains jam"), std::string::npos) << error;
}

TEST(FlowScene, CoincidentGrainsAreNamed) {
  Start start = RandomStart(50, 0.25, 10000);
  const int stride = start.options.grains.stride();
  for (int k = 0; k < 3; ++k) {
    start.state.x[k * stride + 31] = start.state.x[k * stride + 4];
  }
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  EXPECT_FALSE(scene->Begin(0.01, &start.state, &error));
  EXPECT_EQ(error.find("coincident grains: 4 and 31"), 0u) << error;
}

TEST(FlowScene, RefusesWhatMakesNoSense) {
  const auto refused = [](const FlowSceneOptions& options,
                          const std::string& words) {
    std::string error;
    EXPECT_EQ(FlowScene::Create(options, &error), nullptr) << words;
    EXPECT_NE(error.find(words), std::string::npos) << error;
  };
  const FlowSceneOptions good = RandomStart(5, 0.25, 10000).options;
  FlowSceneOptions bad = good;
  bad.impact = ImpactOptions();
  bad.impact->restitution = 1.01;
  refused(bad, "restitution e = 1.01 must be in [0, 1]");
  bad.impact = ImpactOptions();
  bad.impact->friction = {0.1, 0.2};
  refused(bad, "mu_d = 0.2 > mu_s = 0.1");
  bad.impact = ImpactOptions();
  bad.soft_contact = SoftContactOptions();
  refused(bad, "exclude each other");
  bad = good;
  bad.grains.mass[2] = 0.0;
  refused(bad, "grain 2: mass 0");
  bad = good;
  bad.domain.kind = Domain::Kind::WALLS;
  bad.domain.side = 0.1;
  refused(bad, "smaller than four radii");
  refused({}, "at least one grain");
  bad = good;
  bad.external = ExternalForce();
  bad.external->frequency = NAN;
  refused(bad, "external force: frequency nan");
  bad.external = ExternalForce();
  bad.external->constant[2] = INFINITY;
  refused(bad, "must be finite");
}

TEST(FlowScene, WeightsAreMassAreaOrOne) {
  // Two grains of different size at distance d: alpha w_1 w_2 / d.
  const double d = 0.3, pi = 3.14159265358979323846;
  FlowSceneOptions options;
  options.grains.mass = {2.0, 5.0};
  options.grains.radius = {0.01, 0.03};
  options.near_field = NearFieldOptions();
  options.near_field->law = RadialLaw::Powers(0.7, 1.0, 0.0, 2.0);
  std::vector<double> x(24, 0.0);
  x[1] = d;
  const struct {
    FlowSceneOptions::Weight weight;
    double product;
  } cases[] = {
      {FlowSceneOptions::Weight::MASS, 10.0},
      {FlowSceneOptions::Weight::AREA, 16.0 * pi * pi * 1e-4 * 9e-4},
      {FlowSceneOptions::Weight::ONE, 1.0},
  };
  for (const auto& c : cases) {
    options.weight = c.weight;
    std::string error;
    const auto scene = FlowScene::Create(options, &error);
    ASSERT_NE(scene, nullptr) << error;
    SmoothForces forces;
    scene->Forces(x.data(), 0.0, true, &forces);
    const double pull = 0.7 * c.product / d;
    EXPECT_NEAR(forces.near_field[0], pull, 1e-13 * pull);
    EXPECT_NEAR(forces.near_field[1], -pull, 1e-13 * pull);
  }
}

TEST(FlowScene, TheClosestPairMayBeAnImage) {
  Start start = RandomStart(3, 0.1, 10000, 1.0);
  const int stride = start.options.grains.stride();
  for (int k = 1; k < 3; ++k) {
    for (int i = 0; i < 3; ++i) start.state.x[k * stride + i] = 0.0;
  }
  start.state.x[0] = -0.45, start.state.x[1] = 0.0, start.state.x[2] = 0.45;
  const double diameter = 2.0 * start.options.grains.radius[0];
  for (const bool periodic : {true, false}) {
    start.options.domain.kind =
        periodic ? Domain::Kind::NEAREST_IMAGE : Domain::Kind::REENTRY;
    std::string error;
    const auto scene = FlowScene::Create(start.options, &error);
    double ratio;
    const std::string text =
        scene->DescribeClosest(start.state.x.data(), &ratio);
    EXPECT_NEAR(ratio * diameter, periodic ? 0.1 : 0.45, 1e-12);
    EXPECT_EQ(text.find(periodic ? "grains 0 and 2" : "grains "), 0u) << text;
  }
}

TEST(FlowStart, TinyGrainsTakeNoGridOfTheirOwnSize) {
  // Cells as small as these grains would be 64 million.
  const Start start = RandomStart(1000, 1e-3, 10000);
  EXPECT_EQ(Overlaps(start), 0);
  // The places do not depend on the grid.
  const Start larger = RandomStart(1000, 0.1, 0);
  const Start smaller = RandomStart(1000, 1e-3, 0);
  EXPECT_EQ(larger.state.x, smaller.state.x);
}

// A scene without an ingredient holds no memory for it.
TEST(FlowScene, AbsentIngredientsHoldNoMemory) {
  Start start = RandomStart(50, 0.25, 10000);
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  EXPECT_EQ(scene->near_field(), nullptr);
  SmoothForces forces;
  scene->Forces(start.state.x.data(), 0.0, true, &forces);
  EXPECT_TRUE(forces.near_field.empty());
  EXPECT_TRUE(forces.soft_contact.empty());
  for (const double f : forces.total) EXPECT_EQ(f, 0.0);
  EXPECT_EQ(scene->Potential(start.state.x.data()), 0.0);
}

// Soft contacts are the energy of packings.
TEST(FlowScene, SoftContactsAreThePackingsEnergy) {
  for (const double alpha : {2.0, 2.5, 3.0}) {
    Start start = RandomStart(200, 0.45, 0, 1.0);
    SoftContactOptions soft;
    soft.alpha = alpha;
    soft.stiffness = 30.0;
    start.options.soft_contact = soft;
    std::string error;
    const auto scene = FlowScene::Create(start.options, &error);
    SmoothForces forces;
    scene->Forces(start.state.x.data(), 0.0, true, &forces);
    Packing packing;
    packing.box = Box::Cube(3, 1.0);
    packing.positions.resize(3, 200);
    packing.radii.resize(200);
    const int stride = scene->stride();
    for (int i = 0; i < 200; ++i) {
      packing.radii[i] = scene->grains().radius[i];
      for (int k = 0; k < 3; ++k) {
        packing.positions(k, i) = start.state.x[k * stride + i];
      }
    }
    ContactEnergyOptions options;
    options.alpha = alpha;
    options.stiffness = 30.0;
    const auto energy = ContactEnergy::Create(packing, options, &error);
    ASSERT_NE(energy, nullptr) << error;
    std::vector<double> u(600, 0.0), gradient(600);
    double value;
    ASSERT_TRUE(energy->Evaluate(u.data(), &value, gradient.data()));
    EXPECT_NEAR(forces.soft_contact_energy, value, 1e-13 * value);
    double scale = 0.0;
    for (const double g : gradient) scale = std::max(scale, std::fabs(g));
    for (int i = 0; i < 200; ++i) {
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(forces.soft_contact[k * stride + i],
                    -gradient[3 * i + k],
                    1e-12 * scale);
      }
    }
  }
}

// Grains that repel softly keep their energy under Verlet.
TEST(FlowScene, SoftContactsConserveEnergy) {
  Start start = RandomStart(60, 0.35, 100000, 1.0);
  SoftContactOptions soft;
  soft.stiffness = 1e4;
  soft.alpha = 2.5;
  start.options.soft_contact = soft;
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  StepperOptions options;
  options.step = 2e-4;
  const auto stepper = CreateVerletStepper(options);
  ASSERT_TRUE(scene->Begin(2e-4, &start.state, &error)) << error;
  ASSERT_TRUE(
      RunFlow(*scene, 0.5, stepper.get(), nullptr, &start.state, &error));
  const double total = scene->Kinetic(start.state.v.data()).total() +
                       scene->Potential(start.state.x.data());
  EXPECT_NE(start.state.energy.soft_contact, 0.0);
  EXPECT_NEAR(total, start.state.kinetic_start, 1e-4 * total);
}

// A jump by the paper's rule costs exactly the change of the potential; images
// make it free.
TEST(FlowDomain, JumpsAreBooked) {
  for (const Domain::Kind kind :
       {Domain::Kind::REENTRY, Domain::Kind::NEAREST_IMAGE}) {
    Start start = RandomStart(40, 0.25, 10000);
    start.options.domain.kind = kind;
    start.options.near_field = NearFieldOptions();
    start.options.near_field->law = RadialLaw::Powers(0.5, 1.0, 0.25, 2.0);
    std::string error;
    const auto scene = FlowScene::Create(start.options, &error);
    const int stride = scene->stride();
    FlowState& state = start.state;
    ASSERT_TRUE(scene->Begin(0.01, &state, &error)) << error;
    state.x[3] = 0.501, state.v[3] = 1.0;
    state.x[stride + 7] = -0.503, state.v[stride + 7] = -1.0;
    state.x[9] = 0.502, state.v[9] = -1.0;  // incoming: stays
    const double before = scene->Potential(state.x.data());
    const std::vector<double> v = state.v;
    scene->ApplyBoundary(&state);
    const double after = scene->Potential(state.x.data());
    EXPECT_EQ(state.jumps, 2);
    EXPECT_EQ(state.v, v);
    EXPECT_EQ(state.x[9], 0.502);
    if (kind == Domain::Kind::REENTRY) {
      EXPECT_EQ(state.x[3], -0.501);
      EXPECT_EQ(state.x[stride + 7], 0.503);
      EXPECT_NEAR(state.energy.boundary, after - before, 1e-13);
      EXPECT_GT(std::fabs(after - before), 1e-6);
    } else {
      EXPECT_NEAR(state.x[3], -0.499, 1e-15);
      EXPECT_EQ(state.energy.boundary, 0.0);
      EXPECT_NEAR(after, before, 1e-12 * std::fabs(before));
    }
  }
}

TEST(FlowDomain, WallsReverseWhatGoesOut) {
  Start start = RandomStart(10, 0.25, 10000);
  start.options.domain.kind = Domain::Kind::WALLS;
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  FlowState& state = start.state;
  ASSERT_TRUE(scene->Begin(0.01, &state, &error)) << error;
  state.x[2] = 0.6, state.v[2] = 2.0;
  scene->ApplyBoundary(&state);
  EXPECT_EQ(state.v[2], -2.0);
  EXPECT_EQ(state.x[2], 0.6);
  EXPECT_DOUBLE_EQ(state.momentum.fixed[0], -4.0 * scene->grains().mass[2]);
}

TEST(FlowErrors, CollapseIsNamedByEveryStepper) {
  for (const bool verlet : {true, false}) {
    Start start = RandomStart(100, 0.25, 10000);
    start.options.near_field = NearFieldOptions();
    start.options.near_field->law = RadialLaw::Powers(5.0, 1.0, 0.0, 2.0);
    std::string error;
    const auto scene = FlowScene::Create(start.options, &error);
    ASSERT_TRUE(scene->Begin(1e-3, &start.state, &error)) << error;
    StepperOptions options;
    options.step = 1e-3;
    const auto stepper =
        verlet ? CreateVerletStepper(options) : CreateImplicitStepper(options);
    EXPECT_FALSE(
        RunFlow(*scene, 1.0, stepper.get(), nullptr, &start.state, &error));
    EXPECT_EQ(error.find("collapse"), 0u) << error;
  }
}

TEST(FlowErrors, StepFloorIsNamed) {
  // Next to each other under a repulsion of very high order: no step is short
  // enough for the bound.
  Start start = RandomStart(2, 0.1, 10000);
  start.state.x[0] = 0.0;
  start.state.x[1] = 1e-6;
  for (int k = 1; k < 3; ++k)
    start.state.x[8 * k] = start.state.x[8 * k + 1] = 0;
  start.options.near_field = NearFieldOptions();
  start.options.near_field->law = RadialLaw::Powers(0.0, 1.0, 1.0, 8.0);
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  ASSERT_TRUE(scene->Begin(1e-3, &start.state, &error)) << error;
  StepperOptions options;
  const auto stepper = CreateImplicitStepper(options);
  const std::vector<double> x = start.state.x;
  EXPECT_FALSE(
      RunFlow(*scene, 1.0, stepper.get(), nullptr, &start.state, &error));
  EXPECT_EQ(error.find("collapse at t = 0: Dt would fall below 1.0e-09 of its "
                       "limit; grains 0 and 1 are at "),
            0u)
      << error;
  // The state is where it was; the log says why.
  EXPECT_EQ(start.state.x, x);
  EXPECT_GT(start.state.rejected, 5);
  // Apart from each other, and too fast for any step.
  start.state.x[1] = 1.0;
  start.state.v[0] = 1e200;
  ASSERT_TRUE(scene->Begin(1e-3, &start.state, &error)) << error;
  EXPECT_FALSE(
      RunFlow(*scene, 1.0, stepper.get(), nullptr, &start.state, &error));
  EXPECT_EQ(error.find("step floor at t = 0: "), 0u) << error;
}

TEST(FlowScene, FastGrainsAreCounted) {
  Start start = RandomStart(20, 0.25, 10000);
  for (int i = 0; i < 20; ++i) start.state.v[i] = 30.0;
  std::string error;
  const auto scene = FlowScene::Create(start.options, &error);
  ASSERT_TRUE(scene->Begin(1e-2, &start.state, &error)) << error;
  StepperOptions options;
  const auto stepper = CreateVerletStepper(options);
  ASSERT_TRUE(
      RunFlow(*scene, 0.05, stepper.get(), nullptr, &start.state, &error));
  EXPECT_EQ(start.state.fast, 5);
}

}  // namespace
}  // namespace granopt
