// Methods of other libraries on a packing; those that were not found when this
// was configured are skipped.

#include <memory>
#include <string>

#include "granular/packing_generator.h"
#include "granular/quad_residual.h"
#include "granular/relaxation.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class Competitors : public testing::TestWithParam<const char*> {};

INSTANTIATE_TEST_SUITE_P(All,
                         Competitors,
                         testing::Values("nlopt_lbfgs",
                                         "liblbfgs",
                                         "tao_lmvm",
                                         "tao_nls",
                                         "tao_bntr",
                                         "ceres_nlls"),
                         [](const auto& info) {
                           return std::string(info.param);
                         });

// Where every step must lower the cost, the roundoff of the cost ends a run at
// about sqrt(eps * contacts) mean forces, here 1e-8 to 1e-7 by chance.
TEST_P(Competitors, ScaledTheyRelaxAPacking) {
  constexpr double kTolerance = 1e-6;
  const std::string name = GetParam();
  bool registered = false;
  for (const SolverInfo& info : ListSolvers()) {
    registered = registered || info.name == name;
  }
  if (!registered) GTEST_SKIP() << "built without it";
  GeneratorOptions generator;
  generator.particles = 128;
  generator.packing_fraction = 0.9;
  Packing start;
  std::string error;
  ASSERT_TRUE(GeneratePacking(generator, &start, &error)) << error;
  const auto solver = CreateSolver(name + ":scaled=1", &error);
  ASSERT_NE(solver, nullptr) << error;
  SolveOptions options;
  options.relative_tolerance = kTolerance;
  options.max_iterations = 100000;
  for (const double alpha : {2.0, 2.5}) {
    ContactEnergyOptions energy;
    energy.alpha = alpha;
    Relaxation result;
    ASSERT_TRUE(Relax(start, energy, *solver, options, &result, &error))
        << error;
    EXPECT_EQ(result.summary.reason, StopReason::CONVERGED)
        << result.summary.BriefReport();
    QuadResidual judge;
    ASSERT_TRUE(EvaluateQuad(result.packing, energy, nullptr, &judge, &error));
    EXPECT_LE(judge.max_gradient, 1.01 * kTolerance * judge.mean_force);
    EXPECT_GT(result.observables.rigid_grains, 100);
  }
}

}  // namespace
}  // namespace granopt
