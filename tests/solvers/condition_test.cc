#include "solvers/condition.h"

#include <cmath>
#include <limits>
#include <vector>

#include "Eigen/Dense"
#include "gtest/gtest.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

SparseMatrix Lower(const MatrixXd& m) {
  SparseMatrix lower = m.sparseView(1.0, 0.0);
  lower = SparseMatrix(lower.triangularView<Eigen::Lower>());
  lower.makeCompressed();
  return lower;
}

MatrixXd Random(int rows, int columns, unsigned seed) {
  std::srand(seed);
  return MatrixXd::Random(rows, columns);
}

// Symmetric, with these eigenvalues.
MatrixXd WithValues(const VectorXd& values, unsigned seed) {
  const Eigen::HouseholderQR<MatrixXd> qr(Random(
      static_cast<int>(values.size()), static_cast<int>(values.size()), seed));
  const MatrixXd q = qr.householderQ();
  return q * values.asDiagonal() * q.transpose();
}

// Eigenvalues of P^-1 A without the null space, by a dense method.
VectorXd Dense(const MatrixXd& a, const MatrixXd& p, const MatrixXd& null) {
  const Eigen::Index n = a.rows(), q = null.cols();
  MatrixXd basis = MatrixXd::Identity(n, n);
  if (q > 0) {
    // P-orthogonal to the null space.
    const Eigen::HouseholderQR<MatrixXd> qr(p * null);
    basis = MatrixXd(qr.householderQ()).rightCols(n - q);
  }
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> solver(
      basis.transpose() * a * basis, basis.transpose() * p * basis);
  return solver.eigenvalues();
}

void ExpectAsDense(const MatrixXd& a, const MatrixXd& p, const MatrixXd& null) {
  const VectorXd values = Dense(a, p, null);
  const Condition c =
      ComputeCondition(Lower(a), Lower(p), null, ConditionOptions());
  ASSERT_TRUE(c.found) << c.message;
  const double highest = values[values.size() - 1];
  EXPECT_EQ(c.dimensions, values.size());
  EXPECT_NEAR(c.lowest, values[0], 2e-4 * std::abs(values[0]));
  EXPECT_NEAR(c.highest, highest, 2e-4 * highest);
  EXPECT_EQ(c.below, (values.array() < 0.5).count());
  EXPECT_EQ(c.above, (values.array() > 2.0).count());
  EXPECT_EQ(c.negative, (values.array() < -1e-3 * std::abs(values[0])).count());
  if (values[0] > 0.0) {
    EXPECT_NEAR(c.Number(), highest / values[0], 4e-4 * highest / values[0]);
  } else {
    EXPECT_EQ(c.Number(), std::numeric_limits<double>::infinity());
  }
}

TEST(Condition, IsThatOfADenseMethod) {
  const int n = 80;
  const MatrixXd p =
      WithValues(VectorXd::LinSpaced(n, -4.0, 2.0).array().exp(), 1);
  const MatrixXd none(n, 0);
  ExpectAsDense(
      WithValues(VectorXd::LinSpaced(n, -9.0, 3.0).array().exp(), 2), p, none);
  // Negative ones.
  ExpectAsDense(WithValues(VectorXd::LinSpaced(n, -0.3, 2.0), 3), p, none);
  ExpectAsDense(WithValues(VectorXd::LinSpaced(n, -30.0, 2.0), 3), p, none);
}

TEST(Condition, NullVectorsAreLeftOut) {
  const int n = 90;
  const MatrixXd p =
      WithValues(VectorXd::LinSpaced(n, -4.0, 2.0).array().exp(), 4);
  for (const int q : {1, 2, 7}) {
    SCOPED_TRACE(q);
    const MatrixXd null = Random(n, q, 5);
    const Eigen::HouseholderQR<MatrixXd> qr(null);
    const MatrixXd basis = MatrixXd(qr.householderQ()).rightCols(n - q);
    const MatrixXd a =
        basis *
        WithValues(VectorXd::LinSpaced(n - q, -9.0, 1.0).array().exp(), 6) *
        basis.transpose();
    ExpectAsDense(a, p, null);
  }
}

TEST(Condition, OfAMatrixByItselfIsOne) {
  const int n = 100;
  const MatrixXd a =
      WithValues(VectorXd::LinSpaced(n, -18.0, 0.0).array().exp(), 7);
  const Condition c =
      ComputeCondition(Lower(a), Lower(a), MatrixXd(n, 0), ConditionOptions());
  ASSERT_TRUE(c.found) << c.message;
  EXPECT_NEAR(c.Number(), 1.0, 2e-4);
  EXPECT_EQ(c.below, 0);
  EXPECT_EQ(c.above, 0);
  const Condition twice = ComputeCondition(
      Lower(a), Lower(0.25 * a), MatrixXd(n, 0), ConditionOptions());
  ASSERT_TRUE(twice.found) << twice.message;
  EXPECT_NEAR(twice.lowest, 4.0, 1e-3);
  EXPECT_EQ(twice.above, n);
}

TEST(Condition, DoesNotDependOnUnits) {
  const int n = 80;
  const MatrixXd p =
      WithValues(VectorXd::LinSpaced(n, -4.0, 2.0).array().exp(), 8);
  const MatrixXd a =
      WithValues(VectorXd::LinSpaced(n, -9.0, 2.0).array().exp(), 9);
  const MatrixXd none(n, 0);
  const Condition c =
      ComputeCondition(Lower(a), Lower(p), none, ConditionOptions());
  ASSERT_TRUE(c.found) << c.message;
  for (const int power : {-200, -40, 60, 300}) {
    const double unit = std::ldexp(1.0, power);
    const Condition both = ComputeCondition(
        Lower(unit * a), Lower(unit * p), none, ConditionOptions());
    ASSERT_TRUE(both.found) << both.message;
    EXPECT_EQ(both.lowest, c.lowest);
    EXPECT_EQ(both.highest, c.highest);
    EXPECT_EQ(both.below, c.below);
    const Condition one =
        ComputeCondition(Lower(unit * a), Lower(p), none, ConditionOptions());
    ASSERT_TRUE(one.found) << one.message;
    EXPECT_EQ(one.lowest, unit * c.lowest);
    EXPECT_EQ(one.Number(), c.Number());
  }
}

TEST(Condition, RefusesWhatIsNotPositiveDefinite) {
  const int n = 20;
  const MatrixXd a = MatrixXd::Identity(n, n);
  MatrixXd p = a;
  p(3, 3) = -1.0;
  const Condition c =
      ComputeCondition(Lower(a), Lower(p), MatrixXd(n, 0), ConditionOptions());
  EXPECT_FALSE(c.found);
  EXPECT_FALSE(c.message.empty());
}

}  // namespace
}  // namespace granopt
