#include "granular/contact_changes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Dense"
#include "granular/force_network.h"
#include "gtest/gtest.h"
#include "solvers/condition.h"
#include "solvers/monitor.h"
#include "solvers/preconditioner.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Discs of radius 0.1 at these x, in a cell of edge 2.
Packing Row(const std::vector<double>& x) {
  Packing packing;
  packing.box = Box(2.0 * SmallMatrix::Identity(2, 2));
  const auto n = static_cast<int>(x.size());
  packing.positions.setConstant(2, n, 0.5);
  packing.radii.setConstant(n, 0.1);
  for (int i = 0; i < n; ++i) packing.positions(0, i) = x[i];
  return packing;
}

TEST(ContactChanges, ComparesSetsOfPairs) {
  const ContactPairs before = {{0, 1}, {0, 1}, {1, 2}, {3, 4}};
  const ContactPairs after = {{0, 1}, {0, 2}, {1, 2}};
  const ContactChange change = Compare(before, after);
  EXPECT_EQ(change.opened, 2);  // an image of 0-1, and 3-4
  EXPECT_EQ(change.closed, 1);
  EXPECT_EQ(Compare(after, after).total(), 0);
}

// 0 and 1 touch, 2 is apart, 3 overlaps 4 through the face of the cell.
TEST(ContactChanges, OnAWayByHand) {
  const Packing packing = Row({0.4, 0.59, 0.85, 0.05, 1.9});
  const std::vector<bool> all(5, true);
  WayChanges changes;
  std::string error;
  std::vector<double> moves(10, 0.0);
  ASSERT_TRUE(ChangesOnTheWay(packing, moves.data(), all, &changes, &error));
  EXPECT_EQ(changes.total(), 0);
  EXPECT_EQ(changes.first, std::numeric_limits<double>::infinity());
  // 1 goes to the right: leaves 0 at 0.01 / 0.08, meets 2 at 0.06 / 0.08.
  moves[2] = 0.08;
  ASSERT_TRUE(ChangesOnTheWay(packing, moves.data(), all, &changes, &error));
  EXPECT_EQ(changes.opened, 1);
  EXPECT_EQ(changes.closed, 1);
  EXPECT_NEAR(changes.first, 0.125, 1e-12);
  // 3 and 4, centres 0.15 apart, part by 0.05.
  moves[6] = 0.04;
  moves[8] = -0.06;
  ASSERT_TRUE(ChangesOnTheWay(packing, moves.data(), all, &changes, &error));
  EXPECT_EQ(changes.opened, 2);
  // Grains that do not count have no contacts.
  ASSERT_TRUE(ChangesOnTheWay(packing,
                              moves.data(),
                              {true, false, true, true, true},
                              &changes,
                              &error));
  EXPECT_EQ(changes.total(), 1);
  EXPECT_NEAR(changes.first, 0.5, 1e-12);
  // 2 passes above 1 and touches it for a while.
  Packing above = Row({0.4, 0.75});
  above.positions(1, 1) = 0.69;
  moves.assign(4, 0.0);
  moves[2] = -0.095;
  ASSERT_TRUE(
      ChangesOnTheWay(above, moves.data(), {true, true}, &changes, &error));
  EXPECT_EQ(changes.total(), 0);
  above.positions(0, 1) = 0.45;
  above.positions(1, 1) = 0.5 + 0.199;
  ASSERT_TRUE(
      ChangesOnTheWay(above, moves.data(), {true, true}, &changes, &error));
  // Until |x| = (0.04 - 0.199^2)^(1/2) and from the other side again.
  const double x = std::sqrt(0.04 - 0.199 * 0.199);
  EXPECT_EQ(changes.closed, 1);
  EXPECT_EQ(changes.opened, 1);
  EXPECT_NEAR(changes.first, (0.05 - x) / 0.095, 1e-9);
  moves[2] = 0.3;
  EXPECT_FALSE(
      ChangesOnTheWay(above, moves.data(), {true, true}, &changes, &error));
  EXPECT_FALSE(error.empty());
}

class Jammed : public testing::Test {
 protected:
  void SetUp() override { Load("n64_jammed.xyz"); }
  void Load(const std::string& name) {
    packing_ = ReadData(name);
    energy_ = MakeEnergy(packing_, 2.0);
    zero_.assign(energy_->NumParameters(), 0.0);
    contacts_ = energy_->Contacts(zero_.data());
    double cost = 0.0;
    gradient_.resize(zero_.size());
    energy_->EvaluateWithScales(
        zero_.data(), &cost, gradient_.data(), &scales_);
    const Observables o = Measure(packing_, contacts_, cost);
    counts_ = CountingGrains(o, contacts_);
    VectorXd among;
    ASSERT_TRUE(
        EvaluateAmong(*energy_, zero_.data(), counts_, &among, &hessian_));
    EXPECT_LT(among.lpNorm<Eigen::Infinity>(), 1e-4 * o.mean_force);
    blind_ = BlindMotions(2, counts_);
  }
  MatrixXd Matrix(const std::string& spec) {
    std::string error;
    const auto made = CreatePreconditioner(spec, &error);
    EXPECT_NE(made, nullptr) << error;
    Monitor monitor(energy_.get(), SolveOptions(), spec);
    made->Update(
        {zero_.data(), 0.0, gradient_.data(), scales_}, nullptr, &monitor);
    EXPECT_EQ(made->num_fallbacks(), 0);
    const auto n = static_cast<int>(zero_.size());
    MatrixXd p(n, n);
    for (int c = 0; c < n; ++c) {
      const VectorXd unit = VectorXd::Unit(n, c);
      made->Multiply(unit.data(), p.col(c).data());
    }
    return p;
  }

  Packing packing_;
  std::unique_ptr<ContactEnergy> energy_;
  std::vector<double> zero_, gradient_;
  std::vector<Contact> contacts_;
  std::vector<bool> counts_;
  Scales scales_;
  SparseMatrix hessian_;
  MatrixXd blind_;
};

TEST_F(Jammed, BlindMotionsHaveNoStiffness) {
  const MatrixXd images = hessian_.selfadjointView<Eigen::Lower>() * blind_;
  EXPECT_LT(images.cwiseAbs().maxCoeff(),
            1e-13 * hessian_.coeffs().abs().maxCoeff());
}

// The eigenvalues of P^-1 H, by a dense and nonsymmetric method, without as
// many zeros as there are blind motions.
TEST_F(Jammed, ConditionOfEachPreconditionerIsThatOfADenseMethod) {
  const MatrixXd h = MatrixXd(hessian_).selfadjointView<Eigen::Lower>();
  for (const char* spec : {"laplacian",
                           "contact",
                           "contact:shift=1e-6",
                           "barrier:length=1",
                           "hessian",
                           "block_jacobi"}) {
    SCOPED_TRACE(spec);
    const MatrixXd p = Matrix(spec);
    VectorXd values = (p.ldlt().solve(h)).eigenvalues().real();
    std::sort(values.data(), values.data() + values.size());
    SparseMatrix lower = p.sparseView(1.0, 0.0);
    lower = SparseMatrix(lower.triangularView<Eigen::Lower>());
    const Condition c =
        ComputeCondition(hessian_, lower, blind_, ConditionOptions());
    ASSERT_TRUE(c.found) << c.message;
    const double highest = values[values.size() - 1];
    const double lowest = values[blind_.cols()];
    EXPECT_NEAR(c.highest, highest, 2e-4 * highest);
    EXPECT_NEAR(c.lowest, lowest, 1e-3 * lowest);
    EXPECT_EQ(c.negative, 0);
    EXPECT_EQ(c.below, (values.array() < 0.5).count() - blind_.cols());
    EXPECT_EQ(c.above, (values.array() > 2.0).count());
  }
}

TEST_F(Jammed, TheHessianIsItsOwnPerfectPreconditioner) {
  const MatrixXd p = Matrix("hessian:shift=1e-9");
  SparseMatrix lower = p.sparseView(1.0, 0.0);
  lower = SparseMatrix(lower.triangularView<Eigen::Lower>());
  const Condition c =
      ComputeCondition(hessian_, lower, blind_, ConditionOptions());
  ASSERT_TRUE(c.found) << c.message;
  EXPECT_NEAR(c.Number(), 1.0, 1e-3);
}

// Without changes of contacts, linear response ends within O(strain^2) of the
// new minimum: Newton's step from there has nothing left to do.
TEST_F(Jammed, LinearResponseIsNewtonsStepOfASmallStrain) {
  Load("n256_phi0.8438_a2_relaxed.xyz");
  const double strain = 1e-9;
  SmallMatrix gradient = SimpleShear(2, strain);
  gradient -= SmallMatrix::Identity(2, 2);
  NewtonStep response, newton;
  std::string error;
  ASSERT_TRUE(ComputeLinearResponse(
      *energy_, zero_.data(), counts_, gradient, &response, &error));
  EXPECT_EQ(response.shift, 0.0);
  // What a residual is left does not count.
  NewtonStep rest;
  ASSERT_TRUE(
      ComputeNewtonStep(*energy_, zero_.data(), counts_, &rest, &error));
  Packing deformed = packing_;
  deformed.Deform(SimpleShear(2, strain));
  const auto energy = MakeEnergy(deformed, 2.0);
  ASSERT_TRUE(
      ComputeNewtonStep(*energy, zero_.data(), counts_, &newton, &error));
  ASSERT_EQ(PairsInTouch(energy->Contacts(zero_.data()), counts_),
            PairsInTouch(contacts_, counts_));
  double worst = 0.0, size = 0.0;
  for (std::size_t k = 0; k < zero_.size(); ++k) {
    worst = std::max(worst,
                     std::abs(newton.displacement[k] - rest.displacement[k] -
                              response.displacement[k]));
    size = std::max(size, std::abs(response.displacement[k]));
  }
  EXPECT_GT(size, 1e-12);
  EXPECT_LT(worst, 1e-3 * size);
}

}  // namespace
}  // namespace granopt
