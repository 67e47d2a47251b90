#include "granular/walls.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

ContactEnergyOptions Masked(int n) {
  ContactEnergyOptions options;
  options.fixed.assign(n, false);
  for (int i = 0; i < n; i += 3) options.fixed[i] = true;
  return options;
}

// ---- fixed grains

// The energy of the pairs with a free grain, its gradient with respect to free
// coordinates, and second derivatives, gaps and products that agree with that.
TEST(FixedGrains, AreConstantsOfTheEnergy) {
  for (const int d : {2, 3}) {
    const Packing packing = RandomPacking(d, 60, d == 2 ? 1.0 : 0.8, 4);
    const ContactEnergyOptions options = Masked(packing.size());
    const auto masked = MakeEnergy(packing, options);
    const auto plain = MakeEnergy(packing, 2.0);
    const int n = masked->NumParameters();
    const Evaluation a = Evaluate(*masked), b = Evaluate(*plain);
    double between = 0.0;
    int removed = 0;
    const std::vector<double> zero(n, 0.0);
    for (const Contact& c : plain->Contacts(zero.data())) {
      if (options.fixed[c.id.i] && options.fixed[c.id.j]) {
        between += 0.5 * c.overlap * c.overlap;
        ++removed;
      }
    }
    ASSERT_GT(removed, 0);
    EXPECT_EQ(masked->Contacts(zero.data()).size() + removed,
              plain->Contacts(zero.data()).size());
    EXPECT_NEAR(a.energy, b.energy - between, 1e-13 * b.energy);
    for (int v = 0; v < n; ++v) {
      if (options.fixed[v / d]) {
        EXPECT_EQ(a.gradient[v], 0.0);
      } else {
        EXPECT_EQ(a.gradient[v], b.gradient[v]);
      }
    }
    SparseMatrix sparse, sparse_plain;
    ASSERT_TRUE(masked->EvaluateHessian(zero.data(), &sparse));
    ASSERT_TRUE(plain->EvaluateHessian(zero.data(), &sparse_plain));
    const Eigen::MatrixXd h(sparse), h_plain(sparse_plain);
    for (int c = 0; c < n; ++c) {
      for (int r = c; r < n; ++r) {
        if (!options.fixed[r / d] && !options.fixed[c / d]) {
          EXPECT_EQ(h(r, c), h_plain(r, c));
        } else if (r != c) {
          EXPECT_EQ(h(r, c), 0.0);
        } else {
          EXPECT_GT(h(r, c), 0.0);
        }
      }
    }
    const std::vector<double> v = RandomVector(n, 1.0, 3);
    std::vector<double> hv(n);
    ASSERT_TRUE(masked->HessianTimes(zero.data(), v.data(), hv.data()));
    Eigen::MatrixXd full = h;
    full.triangularView<Eigen::StrictlyUpper>() = h.transpose();
    const Eigen::VectorXd expected =
        full * Eigen::Map<const Eigen::VectorXd>(v.data(), n);
    for (int k = 0; k < n; ++k) EXPECT_NEAR(hv[k], expected[k], 1e-12);
    // What stands for fixed grains has the unit of the others.
    ContactEnergyOptions stiff = options;
    stiff.stiffness = 4.0;
    SparseMatrix sparse_stiff;
    const auto four = MakeEnergy(packing, stiff);
    ASSERT_TRUE(four->EvaluateHessian(zero.data(), &sparse_stiff));
    EXPECT_EQ((sparse_stiff - 4.0 * sparse).norm(), 0.0);
    // sum f grad(delta) is minus the gradient of the energy.
    Gaps gaps;
    ASSERT_TRUE(masked->EvaluateGaps(zero.data(), &gaps));
    const Eigen::VectorXd force = gaps.delta.cwiseMax(0.0);
    const Eigen::VectorXd from_gaps = gaps.jacobian.transpose() * force;
    for (int k = 0; k < n; ++k) EXPECT_NEAR(from_gaps[k], a.gradient[k], 1e-14);
  }
}

// They are where they were, to the bit, and the others are in balance.
TEST(FixedGrains, StayWhereTheyAreWithEveryMethod) {
  const Packing packing = RandomPacking(2, 64, 0.95, 4);
  const ContactEnergyOptions options = Masked(packing.size());
  SolveOptions solve;
  solve.relative_tolerance = 1e-9;
  Relaxation near;
  std::string error;
  ASSERT_TRUE(
      Relax(packing, options, *MakeSolver("auto"), solve, &near, &error));
  for (const char* spec :
       {"auto", "lbfgs", "fire", "newton", "interior_point", "ncg"}) {
    Relaxation result;
    // An interior point begins near a minimum.
    Packing start = packing;
    if (std::string(spec) == "interior_point") {
      start = near.packing;
      for (int i = 1; i < packing.size(); i += 3) {
        start.SetPosition(i, 0, start.Position(i, 0) + 1e-5);
      }
    }
    ASSERT_TRUE(
        Relax(start, options, *MakeSolver(spec), solve, &result, &error))
        << error;
    EXPECT_TRUE(result.summary.Succeeded())
        << spec << ": " << result.summary.message;
    EXPECT_LE(result.observables.relative_residual, 1e-9) << spec;
    for (int i = 0; i < packing.size(); i += 3) {
      for (int k = 0; k < 2; ++k) {
        const double moved =
            (result.packing.Position(i, k) - packing.Position(i, k)).Value();
        EXPECT_EQ(moved - std::round(moved), 0.0) << spec;
      }
    }
  }
}

TEST(FixedGrains, AMaskOfAnotherLengthIsRefused) {
  std::string error;
  ContactEnergyOptions options = Masked(10);
  EXPECT_EQ(
      ContactEnergy::Create(RandomPacking(2, 11, 0.5, 1), options, &error),
      nullptr);
  EXPECT_NE(error.find("another length"), std::string::npos);
}

// What is known of a grain stays with it where Relax() has put the packing in
// another order: here a lattice with small grains in vacancies, shuffled.
TEST(FixedGrains, AndRattlersKeepTheirNamesInAnotherOrder) {
  Packing packing = BravaisLattice(HexagonalCell(0.99), {132, 132}, 0.5);
  const int n = packing.size();
  UniformRandom random(4);
  for (int i = n - 1; i > 0; --i) {
    packing.positions.col(i).swap(
        packing.positions.col(static_cast<int>(random() * (i + 1))));
  }
  for (int i = 0; i < n; i += 97) packing.radii[i] = 0.05;
  ContactEnergyOptions options;
  options.fixed.assign(n, false);
  for (int i = 5; i < n; i += 2000) options.fixed[i] = true;
  SolveOptions solve;
  solve.relative_tolerance = 1e-2;
  std::string error;
  const auto solver = CreateSolver("lbfgs", &error);
  Relaxation result;
  ASSERT_TRUE(Relax(packing, options, *solver, solve, &result, &error))
      << error;
  ASSERT_TRUE(result.summary.Succeeded());
  ASSERT_GT(result.observables.rattlers, n / 97 - 5);
  for (int i = 0; i < n; ++i) {
    if (i % 97 == 0 && !options.fixed[i]) {
      EXPECT_TRUE(result.observables.is_rattler[i]) << i;
    }
    if (options.fixed[i]) {
      const Eigen::VectorXd cells =
          packing.box.inverse() *
          (result.packing.positions.col(i) - packing.positions.col(i));
      EXPECT_LE((cells.array() - cells.array().round()).abs().maxCoeff(), 1e-14)
          << i;
      EXPECT_FALSE(result.observables.is_rattler[i]) << i;
    }
  }
}

// ---- walls

Packing Relaxed(int d) {
  Relaxation relaxation;
  std::string error;
  SolveOptions solve;
  solve.relative_tolerance = 1e-12;
  EXPECT_TRUE(
      Relax(RandomPacking(d, d == 2 ? 256 : 400, d == 2 ? 0.9 : 0.72, 2),
            ContactEnergyOptions(),
            *MakeSolver("auto"),
            solve,
            &relaxation,
            &error));
  return relaxation.packing;
}

// Cut from a relaxed packing it stays relaxed: nothing to do, and the walls
// bear the stress of the packing.
TEST(Walls, RoughOnesKeepARelaxedPacking) {
  for (const int d : {2, 3}) {
    Packing packing = Relaxed(d);
    const double thickness = 2.05 * packing.radii.maxCoeff();
    Walls walls;
    std::string error;
    ASSERT_TRUE(MakeRoughWalls(thickness, &packing, &walls, &error)) << error;
    WallShearOptions options;
    options.solve.relative_tolerance = 1e-10;
    QuasistaticShearState state;
    state.step = -1;
    state.packing = packing;
    Relaxation last_state;
    double normal = 0.0, imbalance = 1.0;
    ASSERT_TRUE(ShearBetweenWalls(
        walls,
        options,
        *MakeSolver("auto"),
        [&](const WallShearStep& step) {
          normal = step.normal_stress;
          imbalance = step.imbalance;
          return true;
        },
        &state,
        &last_state,
        &error))
        << error;
    EXPECT_EQ(last_state.summary.counters.iterations, 0);
    EXPECT_LE(imbalance, 1e-9);
    // sum over contacts of l_2 f = sum over wall grains of x_2 F.
    double virial[3] = {}, of_walls[3] = {};
    for (const Contact& c : last_state.contacts) {
      for (int k = 0; k < d; ++k) {
        virial[k] += c.distance * c.normal[1] * c.force * c.normal[k];
        for (const auto& [grain, sign] :
             {std::make_pair(c.id.i, 1.0), std::make_pair(c.id.j, -1.0)}) {
          if (walls.side[grain] == 0) continue;
          of_walls[k] += sign * c.force * c.normal[k] *
                         last_state.packing.positions(1, grain);
        }
      }
    }
    const SmallMatrix measured =
        last_state.observables.stress * walls.Volume();  // (10)
    for (int k = 0; k < d; ++k) {
      EXPECT_NEAR(virial[k], of_walls[k], 1e-9 * virial[1]) << k;
      EXPECT_NEAR(virial[k], measured(1, k), 1e-12 * virial[1]) << k;
    }
    EXPECT_GT(normal, 0.0);
    const SmallMatrix stress =
        last_state.observables.stress;  // of the cut packing
    EXPECT_NEAR(normal / stress(1, 1), 1.0, 0.5);
  }
}

// The power of the wall is the energy, and the way back undoes it.
TEST(Walls, WorkIsEnergyWhereNothingRearranges) {
  for (const bool rough : {true, false}) {
    Packing packing = Relaxed(2);
    Walls walls;
    std::string error;
    ASSERT_TRUE(
        rough ? MakeRoughWalls(
                    2.05 * packing.radii.maxCoeff(), &packing, &walls, &error)
              : MakeFlatWalls(0.5, &packing, &walls, &error))
        << error;
    WallShearOptions options;
    options.solve.relative_tolerance = 1e-12;
    options.path = {1e-6, 2e-6, 1e-6, 0.0};
    QuasistaticShearState state;
    state.step = -1;
    state.packing = packing;
    Relaxation last_state;
    double first = 0.0, most = 0.0, last = 0.0;
    std::vector<double> shear;
    ASSERT_TRUE(ShearBetweenWalls(
        walls,
        options,
        *MakeSolver("auto"),
        [&](const WallShearStep& step) {
          if (step.step == 0) first = step.result->observables.energy;
          last = step.result->observables.energy;
          most = std::max(most, std::abs(step.work));
          shear.push_back(step.shear_stress);
          EXPECT_LE(step.imbalance, 1e-9);
          if (step.step > 0) {
            EXPECT_LE(std::abs(step.dissipated), 2e-4 * most) << step.step;
          }
          return true;
        },
        &state,
        &last_state,
        &error))
        << error;
    EXPECT_EQ(state.gave_up, 0);
    EXPECT_NEAR(last, first, 2e-4 * most) << rough;
    EXPECT_GT(shear[2], shear[0]) << rough;  // it resists
    EXPECT_NEAR(shear[4], shear[0], 1e-5 * (shear[2] - shear[0]));
  }
}

// Walls of grains are made and refused as said.
TEST(Walls, GeometryAndErrors) {
  Packing packing = RandomPacking(3, 50, 0.3, 1);
  Walls walls;
  std::string error;
  const double radius = packing.radii.minCoeff();
  ASSERT_TRUE(MakeFlatWalls(0.8, &packing, &walls, &error)) << error;
  const int row = static_cast<int>(std::ceil(1.0 / (0.8 * radius)));
  EXPECT_EQ(packing.size(), 50 + 2 * row * row);
  EXPECT_EQ(packing.species.back(), "wall");
  EXPECT_NEAR(walls.Height(), 1.0, 1e-15);
  EXPECT_NEAR(walls.area, 1.0, 1e-15);
  for (int i = 0; i < packing.size(); ++i) {
    if (walls.side[i] < 0) {
      EXPECT_NEAR(packing.positions(1, i) + radius, walls.lower, 1e-15);
    }
    if (walls.side[i] > 0) {
      EXPECT_NEAR(packing.positions(1, i) - radius, walls.upper, 1e-15);
    }
  }
  EXPECT_TRUE(packing.IsValid(&error)) << error;
  Packing thin = RandomPacking(2, 50, 0.3, 1);
  EXPECT_FALSE(MakeRoughWalls(1e-3, &thin, &walls, &error));
  EXPECT_NE(error.find("thickness 0.001"), std::string::npos) << error;
  EXPECT_FALSE(MakeFlatWalls(0.0, &thin, &walls, &error));
  const Packing untouched = thin;
  EXPECT_FALSE(MakeFlatWalls(1e-9, &thin, &walls, &error));
  EXPECT_NE(error.find("too many"), std::string::npos) << error;
  EXPECT_EQ(thin.positions, untouched.positions);
  EXPECT_EQ(thin.size(), 50);
  thin.Deform(SimpleShear(2, 0.1));
  EXPECT_FALSE(MakeRoughWalls(0.2, &thin, &walls, &error));
  EXPECT_NE(error.find("rectangular"), std::string::npos) << error;
}

}  // namespace
}  // namespace granopt
