// conformance_test.cc on packings: what every registered method must do near
// jamming and far from it, with rattlers and without contacts.

#include <cstdio>
#include <string>
#include <vector>

#include "granular/quad_residual.h"
#include "gtest/gtest.h"
#include "tests/granular/conformance.h"

namespace granopt {
namespace {

INSTANTIATE_TEST_SUITE_P(Methods,
                         Conformance,
                         testing::ValuesIn(MethodSpecs(true)),
                         TestName);

TEST_P(Conformance, Packings) {
  for (const double alpha : {2.0, 2.5}) {
    SCOPED_TRACE(alpha);
    Packing packing =
        ReadData(alpha == 2.0 ? "n256_phi0.8438_a2_relaxed.xyz"
                              : "n256_phi0.8438_a2.5_relaxed.xyz");
    packing.Deform(SimpleShear(2, 1e-4));
    const auto energy = MakeEnergy(packing, alpha);
    if (!Supports(spec(), *energy)) return;
    const std::vector<double> start(energy->NumParameters(), 0.0);
    const Result run =
        Minimize(spec(), energy.get(), start, Tolerance(traits().tolerance));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    ExpectSound(*energy, start, run);
  }
}

// Next to jamming, with rattlers.
TEST_P(Conformance, PackingsWithRattlers) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(1.0 + 1e-5);
  packing.Perturb(1e-6, 3);
  const auto energy = MakeEnergy(packing, 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(energy->NumParameters(), 0.0);
  const Result run =
      Minimize(spec(), energy.get(), start, Tolerance(traits().tolerance));
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  ExpectSound(*energy, start, run);
}

// A thousand mean overlaps away from a packing at jamming: the reference is
// moved along, and forces balance as quadruple precision sees them.
TEST_P(Conformance, FarFromTheReferenceNearJamming) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.Perturb(1e-6, 3);
  const auto energy = MakeEnergy(packing, 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(energy->NumParameters(), 0.0);
  const Result run = Minimize(spec(), energy.get(), start, Tolerance(1e-11));
  ExpectSound(*energy, start, run);
  EXPECT_GT(run.summary.counters.recenters, 0);
  if (traits().foreign || Creeps()) return;
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  if (run.summary.reason != StopReason::CONVERGED) return;
  QuadResidual judged;
  std::string error;
  ASSERT_TRUE(EvaluateQuad(
      energy->Configuration(run.x.data()), {}, nullptr, &judged, &error));
  EXPECT_LE(judged.Relative(), 1.2e-11);
}

TEST_P(Conformance, RandomStart) {
  if (Creeps()) return;
  const auto energy = MakeEnergy(RandomPacking(2, 64, 0.9, 11), 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(energy->NumParameters(), 0.0);
  const Result run =
      Minimize(spec(), energy.get(), start, Tolerance(traits().tolerance));
  ExpectSound(*energy, start, run);
  if (traits().small_loads_only) {
    // It must know, and leave the best that it has seen.
    EXPECT_TRUE(run.summary.Succeeded() ||
                run.summary.reason == StopReason::NO_PROGRESS);
    EXPECT_LE(run.summary.counters.factorizations, 60);
    return;
  }
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
}

TEST_P(Conformance, NoContactsAtTheStartHasVanished) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(0.99);
  const auto energy = MakeEnergy(packing, 2.0);
  if (!Supports(spec(), *energy)) return;
  std::vector<double> start = RandomVector(energy->NumParameters(), 1e-9, 4);
  const Result run = Minimize(spec(), energy.get(), start);
  EXPECT_EQ(run.summary.reason, StopReason::VANISHED);
  EXPECT_EQ(run.summary.message, "cost = 0 exactly after 0 iterations");
  EXPECT_TRUE(SameBits(run.x, start));
  EXPECT_EQ(run.summary.counters.evaluations, 1);
}

// Below jamming the energy goes to zero.
TEST_P(Conformance, DilutePackingVanishes) {
  const auto energy = MakeEnergy(RandomPacking(2, 64, 0.5, 5), 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(energy->NumParameters(), 0.0);
  const Result run = Minimize(spec(), energy.get(), start, Tolerance(1e-10));
  EXPECT_EQ(run.summary.reason, StopReason::VANISHED)
      << run.summary.BriefReport();
  ExpectSound(*energy, start, run);
}

TEST_P(Conformance, OneGrain) {
  for (const double radius : {0.3, 0.6}) {
    Eigen::MatrixXd positions(2, 1);
    positions << 0.25, 0.5;
    const Packing packing = MakePacking(Box::Cube(2, 1.0), positions, {radius});
    const auto energy = MakeEnergy(packing, 2.0);
    if (!Supports(spec(), *energy)) return;
    const std::vector<double> start = {0.0, 0.0};
    const Result run = Minimize(spec(), energy.get(), start);
    EXPECT_EQ(run.summary.reason,
              radius == 0.3 ? StopReason::VANISHED : StopReason::CONVERGED)
        << run.summary.BriefReport();
    EXPECT_TRUE(SameBits(run.x, start));
    ExpectSound(*energy, start, run);
  }
}

// Two grains in line with their own images: forces cancel exactly where a small
// step aside would lower the energy.
TEST_P(Conformance, SaddleIsLeftAlone) {
  Eigen::MatrixXd positions(2, 2);
  positions << 0.25, 0.75, 0.5, 0.5;
  const Packing packing = MakePacking(Box::Cube(2, 1.0), positions, {0.3, 0.3});
  const auto energy = MakeEnergy(packing, 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(4, 0.0);
  const Result run = Minimize(spec(), energy.get(), start);
  EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  EXPECT_EQ(run.summary.max_gradient, 0.0);
  EXPECT_GT(run.summary.cost, 0.0);
  EXPECT_EQ(run.summary.counters.evaluations, 1);
  EXPECT_TRUE(SameBits(run.x, start));
  ExpectSound(*energy, start, run);
}

// Beside it: away it goes.
TEST_P(Conformance, SaddleIsLeft) {
  Eigen::MatrixXd positions(2, 2);
  positions << 0.25, 0.75, 0.5, 0.501;
  const Packing packing = MakePacking(Box::Cube(2, 1.0), positions, {0.3, 0.3});
  const auto energy = MakeEnergy(packing, 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(4, 0.0);
  const Result run = Minimize(spec(), energy.get(), start, Tolerance(1e-10));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  ExpectSound(*energy, start, run);
  EXPECT_LT(run.summary.cost, 0.5 * run.summary.initial_cost);
}

// Asked for more than there is, a method ends by itself, soon after it has got
// all there is.
TEST_P(Conformance, ToleranceZeroEndsByItself) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(1.0 + 1e-4);
  packing.Perturb(1e-5, 3);
  const auto energy = MakeEnergy(packing, 2.0);
  if (!Supports(spec(), *energy)) return;
  const std::vector<double> start(energy->NumParameters(), 0.0);
  SolveOptions options;
  options.relative_tolerance = 0.0;
  options.max_evaluations = 30000;
  const Result run = Minimize(spec(), energy.get(), start, options);
  ExpectSound(*energy, start, run);
  if (traits().foreign) return;
  EXPECT_LE(run.summary.max_gradient, 1e-12 * run.summary.scales.gradient)
      << run.summary.BriefReport();
  if (run.summary.Succeeded()) return;  // exactly zero
  EXPECT_EQ(run.summary.reason, StopReason::NO_PROGRESS)
      << run.summary.BriefReport();
}

// ---- the last digits --------------------------------------------------------

// Near jamming, to 1e-12 mean forces as quadruple precision sees the packing
// that was written.
TEST(Methods, BalanceForcesNearJammingAsTheJudgeSees) {
  for (const char* spec :
       {"lbfgs", "fire", "newton", "newton:subproblem=truncated"}) {
    SCOPED_TRACE(spec);
    Packing packing = ReadData("n1024_a2_p1e-08.xyz");
    packing.Perturb(1e-9 * packing.box.Length(), 1);
    const auto energy = MakeEnergy(packing, 2.0);
    const Result run =
        Minimize(spec,
                 energy.get(),
                 std::vector<double>(energy->NumParameters(), 0.0),
                 Tolerance(5e-13));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    const std::string path = testing::TempDir() + "granopt_conformance_" +
                             std::string(spec, 4) + ".xyz";
    std::string error;
    ASSERT_TRUE(WritePacking(path, energy->Configuration(run.x.data()), &error))
        << error;
    Packing back;
    ASSERT_TRUE(ReadPacking(path, &back, &error)) << error;
    std::remove(path.c_str());
    QuadResidual judged;
    ASSERT_TRUE(EvaluateQuad(back, {}, nullptr, &judged, &error)) << error;
    EXPECT_LE(judged.Relative(), 1e-12);
    EXPECT_GT(judged.contacts, 1900);
  }
}

}  // namespace
}  // namespace granopt
