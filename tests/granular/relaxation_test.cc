#include "granular/relaxation.h"

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "granular/packing_generator.h"
#include "granular/quad_residual.h"
#include "granular/spatial_order.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

std::unique_ptr<Solver> DefaultSolver() {
  return MakeSolver("ceres_lbfgs:scaled=1,differences=1,restarts=10");
}

// Displaced by a little, a packing finds back to the state that an independent
// program found, and to forces that quadruple precision calls balanced: also at
// p = 1e-8, where plain coordinates end at 1e-6 mean forces.
TEST(Relaxation, FindsBackToIndependentStatesExactly) {
  struct Case {
    const char* file;
    double alpha, overlaps;
  };
  for (const Case& c : {Case{"n256_phi0.8438_a2_relaxed.xyz", 2.0, 0.3},
                        Case{"n256_phi0.8438_a2.5_relaxed.xyz", 2.5, 0.1},
                        Case{"n1024_a2_p1e-04.xyz", 2.0, 0.1},
                        Case{"n1024_a2_p1e-08.xyz", 2.0, 0.1}}) {
    SCOPED_TRACE(c.file);
    const Packing state = ReadData(c.file);
    ContactEnergyOptions options;
    options.alpha = c.alpha;
    std::string error;
    QuadResidual before;
    ASSERT_TRUE(EvaluateQuad(state, options, nullptr, &before, &error));
    const double overlap = std::pow(before.mean_force, 1.0 / (c.alpha - 1.0));
    Packing start = state;
    start.Perturb(c.overlaps * overlap, 7);
    SolveOptions solve;
    solve.relative_tolerance = 1e-12;
    Relaxation result;
    ASSERT_TRUE(Relax(start, options, *DefaultSolver(), solve, &result, &error))
        << error;
    EXPECT_EQ(result.summary.reason, StopReason::CONVERGED)
        << result.summary.BriefReport();
    QuadResidual after;
    ASSERT_TRUE(EvaluateQuad(result.packing, options, nullptr, &after, &error));
    EXPECT_LE(after.max_gradient, 1.01e-12 * after.mean_force);
    EXPECT_NEAR(after.energy, before.energy, 1e-6 * before.energy);
    EXPECT_NEAR(result.observables.energy, after.energy, 1e-13 * after.energy);
    // The packing is in its cell, and images are those of the wrapped grains.
    for (const Contact& contact : result.contacts) {
      SmallVector r = result.packing.positions.col(contact.id.i) -
                      result.packing.positions.col(contact.id.j);
      for (int k = 0; k < 2; ++k) {
        r += result.packing.box.edges().col(k) * contact.id.image[k];
      }
      EXPECT_LT((r - contact.distance * contact.normal).norm(), 1e-14);
    }
    EXPECT_GE(result.packing.positions.minCoeff(), 0.0);
    EXPECT_LE(result.packing.positions.maxCoeff(), 1.0);
  }
}

// Below jamming the energy goes to zero, and the summary says so.
TEST(Relaxation, DilutePackingVanishes) {
  GeneratorOptions generator;
  generator.particles = 64;
  generator.packing_fraction = 0.5;
  for (const int dimension : {2, 3}) {
    generator.dimension = dimension;
    Packing start;
    std::string error;
    ASSERT_TRUE(GeneratePacking(generator, &start, &error));
    Relaxation result;
    ASSERT_TRUE(
        Relax(start, {}, *DefaultSolver(), SolveOptions(), &result, &error));
    EXPECT_EQ(result.summary.reason, StopReason::VANISHED)
        << result.summary.BriefReport();
    EXPECT_LT(result.observables.pressure, 1e-12);
    // At its end already: nothing to do.
    ASSERT_TRUE(Relax(
        result.packing, {}, *DefaultSolver(), SolveOptions(), &result, &error));
    EXPECT_EQ(result.summary.reason, StopReason::VANISHED);
    EXPECT_EQ(result.summary.counters.iterations, 0);
  }
}

// One, two and three grains, free, touching or with rattlers.
TEST(Relaxation, FewGrains) {
  for (const int n : {1, 2, 3}) {
    for (const double phi : {0.3, 0.7, 1.1}) {
      GeneratorOptions generator;
      generator.particles = n;
      generator.packing_fraction = phi;
      Packing start;
      std::string error;
      ASSERT_TRUE(GeneratePacking(generator, &start, &error));
      Relaxation result;
      ASSERT_TRUE(
          Relax(start, {}, *DefaultSolver(), SolveOptions(), &result, &error));
      EXPECT_TRUE(result.summary.Succeeded())
          << n << " " << phi << ": " << result.summary.BriefReport();
      const Observables& o = result.observables;
      if (result.summary.reason == StopReason::VANISHED) {
        EXPECT_LE(o.mean_overlap, 1e-12 * start.MeanRadius());
      } else {
        EXPECT_LE(o.max_residual, 1.01e-10 * o.mean_force);
        EXPECT_GT(o.energy, 0.0);
      }
    }
  }
}

// A first step of exactly one period of the cell leaves the energy as it was:
// two points of equal cost that are not near each other.
TEST(Relaxation, AStepOfOnePeriodIsNoDecrease) {
  Packing packing;
  packing.box = Box::Cube(2, 1.0);
  packing.positions.resize(2, 2);
  packing.positions << 0.5, 0.52, 0.5, 0.5;
  packing.radii.setConstant(2, 0.3);
  for (const double alpha : {2.0, 2.5}) {
    ContactEnergyOptions options;
    options.alpha = alpha;
    Relaxation result;
    std::string error;
    ASSERT_TRUE(Relax(
        packing, options, *DefaultSolver(), SolveOptions(), &result, &error));
    EXPECT_TRUE(result.summary.Succeeded()) << result.summary.BriefReport();
    // They end half a cell apart, touching on both sides.
    EXPECT_NEAR(
        result.observables.energy, 2.0 * std::pow(0.1, alpha) / alpha, 1e-9);
  }
}

// Grains whose neighbours are anywhere in memory are put in order for the run:
// the run of a generated packing, which is in order, bit by bit, and each grain
// keeps its name.
TEST(Relaxation, ScatteredGrainsTakeTheRunOfThoseInOrderAndKeepTheirNames) {
  for (const int d : {2, 3}) {
    GeneratorOptions generate;
    generate.dimension = d;
    generate.particles = 17000;
    generate.packing_fraction = d == 2 ? 0.86 : 0.66;
    generate.polydispersity = 0.1;
    Packing start;
    std::string error;
    ASSERT_TRUE(GeneratePacking(generate, &start, &error)) << error;
    start.stiffness = Eigen::VectorXd::LinSpaced(start.size(), 1.0, 2.0);
    for (int i = 0; i < start.size(); ++i) {
      for (int k = 0; k < d; ++k) {
        start.SetPosition(i, k, start.Position(i, k) + 1e-20 * (i % 7));
      }
    }
    // name[k] is what grain k is called in the other file.
    std::vector<int> name(start.size());
    for (int k = 0; k < start.size(); ++k) {
      name[k] = static_cast<int>(7919LL * k % start.size());
    }
    const Packing scattered = Restored(start, name);
    ASSERT_FALSE(IsScattered(start));
    ASSERT_TRUE(IsScattered(scattered));
    EXPECT_EQ(Reordered(scattered, name).positions, start.positions);
    EXPECT_EQ(SpatialOrder(scattered), name);

    ContactEnergyOptions options;
    SolveOptions solve;
    solve.max_evaluations = 40;
    const std::unique_ptr<Solver> solver = MakeSolver("fire");
    Relaxation expected, result;
    ASSERT_TRUE(Relax(start, options, *solver, solve, &expected, &error));
    ASSERT_TRUE(Relax(scattered, options, *solver, solve, &result, &error));
    EXPECT_EQ(result.summary.cost, expected.summary.cost);
    for (int k = 0; k < start.size(); ++k) {
      for (int c = 0; c < d; ++c) {
        const DoubleDouble a = result.packing.Position(name[k], c);
        const DoubleDouble b = expected.packing.Position(k, c);
        ASSERT_TRUE(a.hi == b.hi && a.lo == b.lo) << k;
      }
      ASSERT_EQ(result.packing.radii[name[k]], start.radii[k]);
      ASSERT_EQ(result.packing.stiffness[name[k]], start.stiffness[k]);
      ASSERT_EQ(result.packing.species[name[k]], start.species[k]);
    }
    // The contacts are those of the packing returned, names, images and all.
    const auto energy = ContactEnergy::Create(result.packing, options, &error);
    ASSERT_NE(energy, nullptr) << error;
    const std::vector<double> zero(energy->NumParameters(), 0.0);
    const std::vector<Contact> contacts = energy->Contacts(zero.data());
    ASSERT_EQ(contacts.size(), result.contacts.size());
    for (std::size_t c = 0; c < contacts.size(); ++c) {
      ASSERT_TRUE(contacts[c].id == result.contacts[c].id) << c;
      EXPECT_NEAR(
          (contacts[c].normal - result.contacts[c].normal).norm(), 0.0, 1e-12);
    }
  }
}

// Energies times 2^a and lengths times 2^b: the whole run, not just an
// evaluation, finds the scaled packing to the accuracy asked for.
TEST(Relaxation, ResultDoesNotDependOnUnits) {
  Packing start = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  start.Perturb(1e-5, 3);
  const Packing scaled = WithLengths(20, start);
  ContactEnergyOptions options, scaled_options;
  scaled_options.stiffness = std::ldexp(1.0, -60);
  SolveOptions solve;
  solve.relative_tolerance = 1e-12;
  Relaxation a, b;
  std::string error;
  ASSERT_TRUE(Relax(start, options, *DefaultSolver(), solve, &a, &error));
  ASSERT_TRUE(
      Relax(scaled, scaled_options, *DefaultSolver(), solve, &b, &error));
  EXPECT_TRUE(a.summary.Succeeded());
  EXPECT_TRUE(b.summary.Succeeded());
  EXPECT_NEAR(b.observables.pressure,
              std::ldexp(a.observables.pressure, -60),
              1e-10 * std::ldexp(a.observables.pressure, -60));
  EXPECT_EQ(a.observables.rigid_contacts, b.observables.rigid_contacts);
}

}  // namespace
}  // namespace granopt
