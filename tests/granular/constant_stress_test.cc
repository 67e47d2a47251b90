#include "granular/constant_stress.h"

#include <memory>
#include <string>

#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// Every method that can serves it, and they find a state of the stress asked
// for.
TEST(RelaxAtStress, EveryMethodReachesThePressure) {
  for (const int d : {2, 3}) {
    // A start from which they can all be asked: relaxed, at another pressure.
    Relaxation relaxed;
    std::string why;
    SolveOptions solve;
    ASSERT_TRUE(Relax(RandomPacking(d, 64, d == 2 ? 0.9 : 0.7, 2),
                      ContactEnergyOptions(),
                      *MakeSolver("lbfgs"),
                      solve,
                      &relaxed,
                      &why));
    const Packing& start = relaxed.packing;
    for (const char* spec :
         {"lbfgs", "fire", "newton", "auto", "ncg", "lbfgs|newton"}) {
      ConstantStressOptions options;
      options.solve.relative_tolerance = 1e-10;
      options.pressure = 2e-3;
      ConstantStressResult result;
      std::string error;
      ASSERT_TRUE(
          RelaxAtStress(start, options, *MakeSolver(spec), &result, &error))
          << error;
      EXPECT_TRUE(result.converged)
          << spec << ": " << result.relaxation.summary.message;
      EXPECT_EQ(result.rounds, 1);
      const Observables& o = result.relaxation.observables;
      const SmallMatrix target = options.pressure * SmallMatrix::Identity(d, d);
      EXPECT_LE((o.stress - target).cwiseAbs().maxCoeff(),
                1e-10 * options.pressure)
          << spec;
      EXPECT_LE(o.relative_residual, 1e-10);
      EXPECT_LE((result.deformation * start.box.edges() -
                 result.relaxation.packing.box.edges())
                    .cwiseAbs()
                    .maxCoeff(),
                1e-14);
    }
  }
}

// What has not touched yet is compressed until it does.
TEST(RelaxAtStress, ALooseStartIsCompressed) {
  const Packing start = RandomPacking(2, 32, 0.3, 6);
  ConstantStressOptions options;
  options.solve.relative_tolerance = 1e-9;
  options.pressure = 1e-3;
  options.strains = IsotropicStrain(2);
  ConstantStressResult result;
  std::string error;
  ASSERT_TRUE(
      RelaxAtStress(start, options, *MakeSolver("lbfgs"), &result, &error))
      << error;
  EXPECT_TRUE(result.converged) << result.relaxation.summary.message;
  EXPECT_NEAR(result.relaxation.observables.pressure, 1e-3, 1e-11);
  EXPECT_GT(result.relaxation.observables.packing_fraction, 0.8);
  // The cell is still square.
  const SmallMatrix& edges = result.relaxation.packing.box.edges();
  EXPECT_EQ(edges(0, 1), 0.0);
  EXPECT_EQ(edges(0, 0), edges(1, 1));
}

// A dead load is the Cauchy stress once the rounds have settled.
TEST(RelaxAtStress, AShearStressIsReached) {
  ConstantStressOptions options;
  options.solve.relative_tolerance = 1e-11;
  options.pressure = 5e-3;
  ConstantStressResult first, loaded;
  std::string error;
  const Packing start = RandomPacking(2, 64, 0.9, 2);
  ASSERT_TRUE(
      RelaxAtStress(start, options, *MakeSolver("newton"), &first, &error));
  options.load = SmallMatrix::Zero(2, 2);
  options.load(0, 1) = options.load(1, 0) = -1e-4;
  options.load(0, 0) = 5e-5;
  options.load(1, 1) = -5e-5;
  options.strain_tolerance = 1e-10;
  ASSERT_TRUE(RelaxAtStress(first.relaxation.packing,
                            options,
                            *MakeSolver("newton"),
                            &loaded,
                            &error));
  EXPECT_TRUE(loaded.converged);
  EXPECT_GT(loaded.rounds, 1);
  const SmallMatrix target = 5e-3 * SmallMatrix::Identity(2, 2) + options.load;
  EXPECT_LE(
      (loaded.relaxation.observables.stress - target).cwiseAbs().maxCoeff(),
      1e-9 * options.pressure);
  // It sheared in the direction of the stress: -sigma_12 > 0.
  EXPECT_GT(loaded.deformation(0, 1), 0.0);
}

}  // namespace
}  // namespace granopt
