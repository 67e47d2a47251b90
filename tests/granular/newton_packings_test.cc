// newton on packings: what rattlers, pre-stress and the last digits cost.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"
#include "gtest/gtest.h"
#include "solvers/rigidity.h"
#include "solvers/sparse_cholesky.h"
#include "tests/granular/test_packings.h"
#include "tests/solvers/run_method.h"

namespace granopt {
namespace {

Result Relax(const std::string& spec,
             const Packing& packing,
             double alpha,
             double tolerance) {
  const auto energy = MakeEnergy(packing, alpha);
  return Minimize(spec,
                  energy.get(),
                  std::vector<double>(energy->NumParameters(), 0.0),
                  Tolerance(tolerance));
}

// Rattlers pressed by 1e-7, a twentieth of an overlap, against a neighbour
// each, which cannot hold them.
Packing WithPressedRattlers() {
  Packing packing = ReadData("n1024_a2_p1e-04.xyz");
  const auto energy = MakeEnergy(packing, 2.0);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  Gaps gaps;
  EXPECT_TRUE(energy->EvaluateGaps(zero.data(), &gaps));
  const std::vector<bool> held = HeldObjects(gaps, packing.size(), 3);
  std::vector<bool> is_pressed(packing.size(), false);
  int pressed = 0;
  for (std::size_t c = 0; c < gaps.ids.size(); ++c) {
    const int i = gaps.ids[c].i, j = gaps.ids[c].j;
    const int k = !held[i] ? i : j;
    const auto row = static_cast<Eigen::Index>(c);
    if (held[i] == held[j] || is_pressed[k] || gaps.delta[row] > 0.0) continue;
    is_pressed[k] = true;
    ++pressed;
    for (int d = 0; d < 2; ++d) {
      packing.SetPosition(
          k,
          d,
          packing.Position(k, d) +
              (1e-7 - gaps.delta[row]) * gaps.jacobian.coeff(row, 2 * k + d));
    }
  }
  EXPECT_GT(pressed, 5);
  return packing;
}

// 39 rattlers, and translations: one factor an iteration. (At 1e-9 a contact
// opens and closes within the rounding of the last two.)
TEST(NewtonPackings, RattlersCostNoFactors) {
  for (const double strain : {3e-9, 1e-8, 1e-7}) {
    const Packing packing = Sheared("n1024_a2_p1e-04.xyz", strain);
    const Result run = Relax("newton", packing, 2.0, 1e-12);
    EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
    EXPECT_EQ(run.summary.counters.factorizations,
              run.summary.counters.iterations);
  }
  const Packing pressed = WithPressedRattlers();
  const Result dropped = Relax("newton", pressed, 2.0, 1e-9);
  EXPECT_TRUE(dropped.summary.Succeeded()) << dropped.summary.BriefReport();
  const Result kept = Relax("newton:unheld=kept", pressed, 2.0, 1e-9);
  EXPECT_GT(kept.summary.counters.factorizations,
            dropped.summary.counters.factorizations);
}

// The exact Hessian is then indefinite by far more than the floor; without the
// curvature of the gaps of the pressed it is not.
TEST(NewtonPackings, UnheldGrainsDoNotMakeTheHessianIndefinite) {
  const auto energy = MakeEnergy(WithPressedRattlers(), 2.0);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  SparseMatrix hessian;
  SparseCholesky cholesky;
  const double floor = 1e-9;  // k = 1
  ASSERT_TRUE(energy->EvaluateHessian(zero.data(), &hessian));
  EXPECT_FALSE(cholesky.Factorize(hessian, energy->PatternVersion(), floor));
  RigidHessian rigid;
  ASSERT_TRUE(rigid.Evaluate(*energy, zero.data(), &hessian));
  EXPECT_TRUE(cholesky.Factorize(hessian, energy->PatternVersion(), floor));
}

// Where every object is held, bit for bit the Hessian; the pattern is the same.
TEST(NewtonPackings, RigidHessianIsTheHessianOfHeldGrains) {
  for (const double alpha : {2.0, 2.5, 3.3}) {
    Packing packing = ReadData("n64_jammed.xyz");
    packing.ScaleRadii(1.3);
    const auto energy = MakeEnergy(packing, alpha);
    const std::vector<double> zero(energy->NumParameters(), 0.0);
    SparseMatrix exact, rigid_matrix;
    RigidHessian rigid;
    ASSERT_TRUE(energy->EvaluateHessian(zero.data(), &exact));
    ASSERT_TRUE(rigid.Evaluate(*energy, zero.data(), &rigid_matrix));
    const Eigen::VectorXd difference = exact.coeffs() - rigid_matrix.coeffs();
    EXPECT_LE(difference.cwiseAbs().maxCoeff(),
              1e-15 * exact.coeffs().cwiseAbs().maxCoeff());
  }
}

TEST(NewtonPackings, GaussNewtonNeverFailsToFactor) {
  for (const char* file : {"n64_jammed.xyz", "n64_3d_jammed.xyz"}) {
    SCOPED_TRACE(file);
    Packing packing = ReadData(file);
    packing.ScaleRadii(1.0 + 1e-4);
    packing.Perturb(1e-3, 5);
    const auto energy = MakeEnergy(packing, 2.0);
    const std::vector<double> zero(energy->NumParameters(), 0.0);
    SparseMatrix h;
    SparseCholesky cholesky;
    ASSERT_TRUE(energy->EvaluateStiffness(zero.data(), 0.0, &h));
    EXPECT_TRUE(cholesky.Factorize(h, energy->PatternVersion(), 1e-11));
    const Result run = Relax("newton:hessian=gauss_newton", packing, 2.0, 1e-9);
    EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  }
}

// Two digits of the last step are gained by every other one.
TEST(NewtonPackings, ReachesTheFloorAtAnyPressure) {
  for (const char* file : {"n1024_a2_p1e-04.xyz", "n1024_a2_p1e-08.xyz"}) {
    for (const char* spec : {"newton",
                             "newton:subproblem=truncated,preconditioner="
                             "hessian,every=5,shift=1e-6"}) {
      SCOPED_TRACE(std::string(file) + " " + spec);
      Packing packing = ReadData(file);
      packing.Perturb(1e-9 * packing.box.Length(), 1);
      const Result run = Relax(spec, packing, 2.0, 1e-14);
      EXPECT_LE(run.summary.max_gradient, 1e-14 * run.summary.scales.gradient)
          << run.summary.BriefReport();
    }
  }
}

TEST(NewtonPackings, HertzAndThreeDimensions) {
  const Result hertz = Relax(
      "newton", Sheared("n256_phi0.8438_a2.5_relaxed.xyz", 1e-4), 2.5, 1e-12);
  EXPECT_TRUE(hertz.summary.Succeeded()) << hertz.summary.BriefReport();
  EXPECT_LE(hertz.summary.counters.iterations, 40);
  Packing spheres = Sheared("n64_3d_jammed.xyz", 1e-4);
  spheres.ScaleRadii(1.001);
  const Result run = Relax("newton", spheres, 2.0, 1e-12);
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_LE(run.summary.counters.iterations, 60);
}

}  // namespace
}  // namespace granopt
