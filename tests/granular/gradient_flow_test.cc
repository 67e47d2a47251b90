#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "test_packings.h"

namespace granopt {
namespace {

// Near jamming and far from it, forces that jump in their derivatives.
TEST(GradientFlow, RelaxesPackings) {
  std::string error;
  const std::unique_ptr<Solver> flow =
      CreateSolver("gradient_flow:rtol=1e-3", &error);
  if (flow == nullptr) GTEST_SKIP() << error;
  struct Case {
    Packing packing;
    double alpha, shear;
  };
  std::vector<Case> cases;
  cases.push_back({ReadData("n256_phi0.8438_a2_relaxed.xyz"), 2.0, 1e-4});
  cases.push_back({ReadData("n256_phi0.8438_a2.5_relaxed.xyz"), 2.5, 1e-4});
  cases.push_back({ReadData("n1024_a2_p1e-08.xyz"), 2.0, 1e-9});
  cases.push_back(
      {RandomPacking(2, 64, 0.9, 1, Matrix2(1, 0, 0, 1)), 2.0, 0.0});
  for (Case& c : cases) {
    c.packing.Deform(Matrix2(1, c.shear, 0, 1));
    ContactEnergyOptions energy_options;
    energy_options.alpha = c.alpha;
    auto energy = ContactEnergy::Create(c.packing, energy_options, &error);
    ASSERT_NE(energy, nullptr) << error;
    std::vector<double> u(energy->NumParameters(), 0.0);
    SolveOptions options;
    options.relative_tolerance = 1e-12;
    double last = std::numeric_limits<double>::infinity();
    options.callback = [&last](const IterationState& state) {
      EXPECT_LE(state.cost, last * (1.0 + 1e-3));
      last = state.cost;
      return true;
    };
    const Summary summary = flow->Minimize(energy.get(), options, u.data());
    EXPECT_EQ(summary.reason, StopReason::CONVERGED) << summary.BriefReport();
    EXPECT_LT(summary.counters.evaluations, 20000);
  }
}

}  // namespace
}  // namespace granopt
