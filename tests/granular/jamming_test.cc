#include "granular/jamming.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "granular/quad_residual.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

std::unique_ptr<Solver> DefaultSolver() {
  return MakeSolver("ceres_lbfgs:scaled=1,differences=1,restarts=10");
}

JammingOptions Options(double phi_init, double epsilon, double error_bar) {
  JammingOptions options;
  options.phi_init = phi_init;
  options.phi_increment = 5e-3;
  options.accuracy = epsilon;
  options.error_bar = error_bar;
  options.solve.relative_tolerance = 1e-8;
  options.solve.vanishing_tolerance = 1e-3 * std::min(epsilon, error_bar);
  return options;
}

// n x n hexagonal lattice of equal discs in its rectangular cell.
Packing Hexagonal(int n) {
  Packing packing;
  SmallMatrix edges = SmallMatrix::Zero(2, 2);
  edges(0, 0) = 1.0;
  edges(1, 1) = std::sqrt(3.0) / 2.0;
  packing.box = Box(edges);
  packing.positions.resize(2, n * n);
  packing.radii.setConstant(n * n, 0.4 / n);
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      packing.positions(0, row * n + column) =
          (column + 0.5 * (row % 2) + 0.25) / n;
      packing.positions(1, row * n + column) =
          (row + 0.5) * std::sqrt(3.0) / 2.0 / n;
    }
  }
  return packing;
}

// n^3 face-centred cubic cells of four spheres.
Packing Fcc(int n) {
  Packing packing;
  packing.box = Box::Cube(3, 1.0);
  packing.positions.resize(3, 4 * n * n * n);
  packing.radii.setConstant(4 * n * n * n, 0.3 / n);
  const double base[4][3] = {{0, 0, 0}, {0, .5, .5}, {.5, 0, .5}, {.5, .5, 0}};
  int at = 0;
  for (int a = 0; a < n; ++a) {
    for (int b = 0; b < n; ++b) {
      for (int c = 0; c < n; ++c) {
        for (const auto& site : base) {
          packing.positions.col(at++) =
              Eigen::Vector3d(
                  a + site[0] + .25, b + site[1] + .25, c + site[2] + .25) /
              n;
        }
      }
    }
  }
  return packing;
}

class CrystalTest : public testing::TestWithParam<double> {};

// A crystal jams where its neighbours touch, whatever the law.
TEST_P(CrystalTest, HexagonalLatticeJamsAtItsClosePacking) {
  JammingOptions options = Options(0.88, 1e-6, 1e-9);
  options.energy.alpha = GetParam();
  JammingResult result;
  std::string error;
  ASSERT_TRUE(FindJamming(
      Hexagonal(6), options, *DefaultSolver(), nullptr, &result, &error))
      << error;
  EXPECT_TRUE(result.converged);
  EXPECT_LE(result.distance, 1e-9);
  const double exact = kPi / (2.0 * std::sqrt(3.0));
  EXPECT_NEAR(result.phi_j, exact, result.distance);
  EXPECT_GT(result.phi_cr, exact);
  EXPECT_EQ(result.jammed.observables.rigid_contacts, 3 * 36);
}

// From above: the same point, without growth.
TEST_P(CrystalTest, AnOverJammedLatticeIsFollowedDownToItsClosePacking) {
  JammingOptions options = Options(0.88, 1e-6, 1e-9);
  options.energy.alpha = GetParam();
  Packing start = Hexagonal(6);
  start.SetPackingFraction(0.95);
  JammingResult result;
  std::string error;
  options.phi_init = 0.0;
  ASSERT_TRUE(
      FindJamming(start, options, *DefaultSolver(), nullptr, &result, &error))
      << error;
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.cycles, 0);
  EXPECT_EQ(result.phi_unjammed, 0.0);
  EXPECT_NEAR(result.phi_j, kPi / (2.0 * std::sqrt(3.0)), result.distance);
}

TEST_P(CrystalTest, FaceCentredCubicLatticeJamsAtItsClosePacking) {
  JammingOptions options = Options(0.72, 1e-6, 1e-9);
  options.energy.alpha = GetParam();
  JammingResult result;
  std::string error;
  ASSERT_TRUE(
      FindJamming(Fcc(2), options, *DefaultSolver(), nullptr, &result, &error))
      << error;
  EXPECT_NEAR(result.phi_j, kPi / std::sqrt(18.0), result.distance);
  EXPECT_LE(result.distance, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(Laws, CrystalTest, testing::Values(2.0, 2.5, 3.0));

TEST(Jamming, DisorderedPackingIsIsostaticAtItsJammingPoint) {
  for (const int dimension : {2, 3}) {
    GeneratorOptions generator;
    generator.dimension = dimension;
    generator.particles = dimension == 2 ? 100 : 60;
    generator.seed = 3;
    Packing start;
    std::string error;
    ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
    JammingOptions options = Options(dimension == 2 ? 0.79 : 0.57, 1e-5, 1e-9);
    JammingResult result;
    ASSERT_TRUE(
        FindJamming(start, options, *DefaultSolver(), nullptr, &result, &error))
        << error;
    EXPECT_TRUE(result.converged);
    const Observables& o = result.jammed.observables;
    // d N' - d + 1 contacts carry a positive bulk modulus; none more is left.
    EXPECT_EQ(o.rigid_contacts, o.isostatic_contacts) << dimension;
    EXPECT_GT(o.rigid_grains, 0.8 * o.grains);
    // Literature: 0.842 (2D) and 0.64-0.65 (3D) for large packings.
    EXPECT_NEAR(result.phi_j, dimension == 2 ? 0.835 : 0.635, 0.025);
    // The result is in force balance by the judge's measure too.
    QuadResidual judge;
    ASSERT_TRUE(EvaluateQuad(
        result.jammed.packing, options.energy, nullptr, &judge, &error));
    EXPECT_LE(judge.max_gradient, 2e-8 * judge.mean_force);
  }
}

// Over-compression takes the place of the bisection, and the descent goes on
// until no contact opens.
TEST(Jamming, SharpProtocolEndsWithExactlyTheIsostaticContacts) {
  for (int seed = 21; seed <= 26; ++seed) {
    SCOPED_TRACE(seed);
    const int dimension = seed <= 24 ? 2 : 3;
    GeneratorOptions generator;
    generator.dimension = dimension;
    generator.particles = dimension == 2 ? 64 : 40;
    generator.seed = static_cast<std::uint64_t>(seed);
    Packing start;
    std::string error;
    ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
    // Grown, or quenched from above.
    JammingOptions options = Options(
        dimension == 2 ? (seed % 2 == 0 ? 0.79 : 0.9) : 0.57, 1e-5, 1e-4);
    options.overcompression = 3e-3;
    options.until_isostatic = true;
    options.solve.vanishing_tolerance = 1e-9;
    JammingResult result;
    int bisections = 0;
    double highest = 0.0;
    const auto observer = [&](const JammingStep& step) {
      bisections += step.stage == JammingStage::BISECTION ? 1 : 0;
      if (step.stage == JammingStage::GROWTH) highest = step.phi;
      return true;
    };
    ASSERT_TRUE(FindJamming(
        start, options, *DefaultSolver(), observer, &result, &error))
        << error;
    EXPECT_EQ(bisections, 0);
    const Observables& o = result.jammed.observables;
    EXPECT_EQ(o.rigid_contacts, o.isostatic_contacts);
    EXPECT_LE(result.distance, 1e-4);
    if (highest > 0.0) {
      EXPECT_GE(highest - result.phi_j, 2e-3);
    }
  }
}

// A search that goes on from a copy of any of its states is the same search.
TEST(Jamming, AnySearchGoesOnFromAnyOfItsStates) {
  GeneratorOptions generator;
  generator.particles = 48;
  generator.seed = 6;
  Packing start;
  std::string error;
  ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
  JammingOptions options = Options(0.79, 1e-3, 1e-6);
  const auto solver = DefaultSolver();
  std::vector<JammingState> states;
  JammingResult whole;
  ASSERT_TRUE(FindJamming(
      start,
      options,
      *solver,
      [&](const JammingStep& step) {
        states.push_back(*step.state);
        return true;
      },
      &whole,
      &error));
  ASSERT_GE(states.size(), 8u);
  for (std::size_t k = 0; k < states.size(); k += 3) {
    SCOPED_TRACE(k);
    JammingState state = states[k];
    JammingResult rest;
    ASSERT_TRUE(
        ContinueJamming(options, *solver, nullptr, &state, &rest, &error));
    EXPECT_EQ(rest.phi_j, whole.phi_j);
    EXPECT_EQ(rest.distance, whole.distance);
    EXPECT_EQ(rest.relaxations, whole.relaxations);
    EXPECT_EQ(rest.counters.evaluations, whole.counters.evaluations);
    EXPECT_EQ(rest.jammed.packing.positions, whole.jammed.packing.positions);
    EXPECT_EQ(rest.jammed.packing.positions_low,
              whole.jammed.packing.positions_low);
    EXPECT_EQ(rest.jammed.observables.pressure,
              whole.jammed.observables.pressure);
  }
}

// Whatever the branches do on the way down, a run ends at a jamming point.
TEST(Jamming, EverySeedEndsAtItsOwnJammingPoint) {
  for (int seed = 11; seed <= 18; ++seed) {
    SCOPED_TRACE(seed);
    GeneratorOptions generator;
    generator.particles = 64;
    generator.seed = static_cast<std::uint64_t>(seed);
    Packing start;
    std::string error;
    ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
    JammingOptions options = Options(0.77, 1e-4, 1e-8);
    JammingResult result;
    ASSERT_TRUE(
        FindJamming(start, options, *DefaultSolver(), nullptr, &result, &error))
        << error;
    EXPECT_TRUE(result.converged) << result.distance;
    EXPECT_GE(result.cycles, 1);
    const Observables& o = result.jammed.observables;
    // A contact that opens within the error bar may still be there.
    EXPECT_GE(o.rigid_contacts, o.isostatic_contacts);
    EXPECT_LE(o.rigid_contacts, o.isostatic_contacts + 1);
    // p is linear in phi - phi_J: the slope p' of a branch is of order k.
    EXPECT_NEAR(o.pressure / result.distance, 0.4, 0.2);
  }
}

// As the experiment does it: `jamming --particles=96 --seed=25`.
TEST(Jamming, TheExperimentConvergesWithAuto) {
  GeneratorOptions generator;
  generator.particles = 96;
  generator.seed = 25;
  Packing start;
  std::string error;
  ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
  JammingOptions options;
  options.overcompression = 1e-3;
  options.until_isostatic = true;
  options.solve.relative_tolerance = 1e-8;
  options.solve.vanishing_tolerance = 1e-9;
  JammingResult result;
  ASSERT_TRUE(FindJamming(
      start, options, *MakeSolver("auto"), nullptr, &result, &error))
      << error;
  EXPECT_TRUE(result.converged) << result.distance;
  EXPECT_EQ(result.jammed.summary.reason, StopReason::CONVERGED)
      << result.jammed.summary.BriefReport();
  const Observables& o = result.jammed.observables;
  EXPECT_EQ(o.rigid_contacts, o.isostatic_contacts);
}

TEST(Jamming, ErrorBarIsTheDistanceToTheBranchEnd) {
  GeneratorOptions generator;
  generator.particles = 100;
  generator.seed = 5;
  Packing start;
  std::string error;
  ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
  const auto solver = DefaultSolver();
  JammingResult coarse, fine;
  // The published algorithm ends at a distance that the bar must cover; what
  // the decompression finds later lies within it.
  JammingOptions published =
      Options(0.79, 1e-4, std::numeric_limits<double>::infinity());
  published.solve.vanishing_tolerance = 1e-12;
  JammingOptions followed = published;
  followed.error_bar = 1e-9;
  ASSERT_TRUE(FindJamming(start, published, *solver, nullptr, &coarse, &error))
      << error;
  ASSERT_TRUE(FindJamming(start, followed, *solver, nullptr, &fine, &error))
      << error;
  EXPECT_TRUE(coarse.secant);
  EXPECT_LE(fine.distance, 1e-9);
  EXPECT_LT(fine.phi_cr, coarse.phi_cr);
  EXPECT_NEAR(fine.phi_j, coarse.phi_j, coarse.distance);
}

TEST(Jamming, JammedStartAndBadOptionsAreRefused) {
  Packing packing = Hexagonal(4);
  JammingOptions options =
      Options(0.95, 1e-6, std::numeric_limits<double>::infinity());
  options.solve.vanishing_tolerance = 1e-9;
  JammingResult result;
  std::string error;
  const auto solver = DefaultSolver();
  EXPECT_FALSE(
      FindJamming(packing, options, *solver, nullptr, &result, &error));
  EXPECT_NE(error.find("jammed already at phi_init = 0.95"), std::string::npos)
      << error;
  options.phi_increment = -1.0;
  EXPECT_FALSE(
      FindJamming(packing, options, *solver, nullptr, &result, &error));
  EXPECT_EQ(error, "dphi = -1 must be positive");
}

TEST(Jamming, ObserverSeesEveryRelaxationAndCanStop) {
  int seen = 0;
  JammingResult result;
  std::string error;
  const JammingOptions options = Options(0.88, 1e-3, 1e-6);
  const auto solver = DefaultSolver();
  const auto count = [&seen](const JammingStep& step) {
    EXPECT_EQ(step.relaxation, ++seen);
    EXPECT_NE(step.result, nullptr);
    return true;
  };
  ASSERT_TRUE(
      FindJamming(Hexagonal(4), options, *solver, count, &result, &error))
      << error;
  EXPECT_EQ(seen, result.relaxations);
  const auto stop = [](const JammingStep&) { return false; };
  EXPECT_FALSE(
      FindJamming(Hexagonal(4), options, *solver, stop, &result, &error));
  EXPECT_EQ(error, "stopped by the caller");
}

}  // namespace
}  // namespace granopt
