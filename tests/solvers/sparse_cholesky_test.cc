#include "solvers/sparse_cholesky.h"

#include <cmath>
#include <limits>
#include <thread>
#include <vector>

#include "Eigen/Dense"
#include "gtest/gtest.h"

namespace granopt {
namespace {

// Lower triangle of the Laplacian of a chain of n, plus `diagonal` times 1.
SparseMatrix Chain(int n, double diagonal) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    entries.emplace_back(i, i, 2.0 + diagonal);
    if (i + 1 < n) entries.emplace_back(i + 1, i, -1.0);
  }
  SparseMatrix a(n, n);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

TEST(SparseCholesky, SolvesWithTheSymmetricMatrixAndItsShift) {
  const int n = 200;
  const SparseMatrix lower = Chain(n, 0.1);
  Eigen::VectorXd x_true(n);
  for (int i = 0; i < n; ++i) x_true[i] = std::sin(1.0 + i);
  for (const double shift : {0.0, 0.7}) {
    const Eigen::VectorXd b =
        lower.selfadjointView<Eigen::Lower>() * x_true + shift * x_true;
    SparseCholesky cholesky;
    ASSERT_TRUE(cholesky.Factorize(lower, 1, shift));
    Eigen::VectorXd x(n);
    cholesky.Solve(b.data(), x.data());
    EXPECT_LT((x - x_true).norm(), 1e-12 * x_true.norm());
    // In place.
    x = b;
    cholesky.Solve(x.data(), x.data());
    EXPECT_LT((x - x_true).norm(), 1e-12 * x_true.norm());
  }
}

TEST(SparseCholesky, AnalyzesOncePerPatternVersion) {
  SparseCholesky cholesky;
  ASSERT_TRUE(cholesky.Factorize(Chain(50, 0.1), 7));
  ASSERT_TRUE(cholesky.Factorize(Chain(50, 0.2), 7));
  EXPECT_EQ(cholesky.num_analyses(), 1);
  ASSERT_TRUE(cholesky.Factorize(Chain(60, 0.2), 8));
  EXPECT_EQ(cholesky.num_analyses(), 2);
  EXPECT_GE(cholesky.num_nonzeros(), 60 + 59);
}

// The bits of a solution do not say whether its analysis was made or recalled,
// and a pattern that differs in one place only is another one.
TEST(SparseCholesky, RecallsTheLastAnalysisOfTheSamePattern) {
  const auto chain_and = [](int i, int j) {
    SparseMatrix a = Chain(60, 1.0);
    a.coeffRef(i, j) = -0.3;
    a.makeCompressed();
    return a;
  };
  const SparseMatrix one = chain_and(40, 3), other = chain_and(41, 3);
  ASSERT_EQ(one.nonZeros(), other.nonZeros());
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(60, -1.0, 2.0);
  // By a new object, as each solve has one.
  const auto solve = [&b](const SparseMatrix& a, bool recalls) {
    SparseCholesky cholesky(Ordering::AMD, Factorizer::MULTIFRONTAL);
    EXPECT_TRUE(cholesky.Factorize(a, 1));
    EXPECT_EQ(cholesky.num_analyses(), 1);
    EXPECT_EQ(cholesky.num_recalled(), recalls ? 1 : 0);
    Eigen::VectorXd x(60);
    cholesky.Solve(b.data(), x.data());
    EXPECT_LT((a.selfadjointView<Eigen::Lower>() * x - b).norm(), 1e-13);
    return x;
  };
  Eigen::VectorXd first, second;
  // Threads that have solved nothing before.
  std::thread([&] { first = solve(one, false); }).join();
  std::thread([&] { second = solve(other, false); }).join();
  std::thread([&] {
    EXPECT_EQ(solve(one, false), first);
    EXPECT_EQ(solve(2.0 * one, true), 0.5 * first);
    EXPECT_EQ(solve(other, false), second);
    EXPECT_EQ(solve(other, true), second);
    SparseCholesky::ForgetAnalysis();
    EXPECT_EQ(solve(other, false), second);
    EXPECT_EQ(solve(one, false), first);
    // Neither the factor nor a refused matrix is remembered.
    SparseCholesky refuses(Ordering::AMD, Factorizer::MULTIFRONTAL);
    EXPECT_FALSE(refuses.Factorize(-one, 1));
    EXPECT_FALSE(refuses.Factorize(SparseMatrix(60, 60), 2));
    EXPECT_EQ(solve(one, false), first);
  }).join();
}

TEST(SparseCholesky, RefusesIndefiniteAndNotFiniteMatricesAndRecovers) {
  SparseCholesky cholesky;
  // The chain's least eigenvalue is 2 - 2 cos(pi / (n + 1)) > 0.
  EXPECT_TRUE(cholesky.Factorize(Chain(30, 0.0), 1));
  EXPECT_FALSE(cholesky.Factorize(Chain(30, -0.5), 1));
  EXPECT_TRUE(cholesky.Factorize(Chain(30, -0.5), 1, 0.6));
  SparseMatrix bad = Chain(30, 0.1);
  bad.valuePtr()[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(cholesky.Factorize(bad, 1));
  ASSERT_TRUE(cholesky.Factorize(Chain(30, 0.1), 1));
  std::vector<double> b(30, 1.0), x(30);
  cholesky.Solve(b.data(), x.data());
  EXPECT_TRUE(std::isfinite(x[15]));
}

// Nested dissection pays on large grids, a band never does.
TEST(SparseCholesky, OrderingsDifferInFill) {
  const int m = 60;
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) {
      entries.emplace_back(i * m + j, i * m + j, 4.1);
      if (j + 1 < m) entries.emplace_back(i * m + j + 1, i * m + j, -1.0);
      if (i + 1 < m) entries.emplace_back(i * m + j + m, i * m + j, -1.0);
    }
  }
  SparseMatrix a(m * m, m * m);
  a.setFromTriplets(entries.begin(), entries.end());
  const auto fill = [&a](Ordering ordering) {
    SparseCholesky cholesky(ordering);
    EXPECT_TRUE(cholesky.Factorize(a, 1));
    return cholesky.num_nonzeros();
  };
  const std::int64_t amd = fill(Ordering::AMD);
  const std::int64_t rcm = fill(Ordering::RCM);
  // Levels from a corner are diagonals of at most m points.
  EXPECT_LT(rcm, static_cast<std::int64_t>(m) * m * m);
  EXPECT_GT(rcm, 3 * amd / 2);
  if (SparseCholesky::Has(Ordering::METIS)) {
    const std::int64_t metis = fill(Ordering::METIS);
    EXPECT_NE(metis, amd);
    EXPECT_GT(rcm, 3 * metis / 2);
  }
}

TEST(SparseCholesky, SolvesColumnsInPlace) {
  const int n = 90;
  const SparseMatrix lower = Chain(n, 0.3);
  SparseCholesky cholesky;
  ASSERT_TRUE(cholesky.Factorize(lower, 1));
  std::vector<double> b(2 * n), one(n), x(2 * n);
  for (int i = 0; i < 2 * n; ++i) b[i] = std::cos(2.0 * i);
  x = b;
  cholesky.Solve(x.data(), x.data(), 2);
  for (int c = 0; c < 2; ++c) {
    for (int i = 0; i < n; ++i) one[i] = b[2 * i + c];
    cholesky.Solve(one.data(), one.data());
    for (int i = 0; i < n; ++i) EXPECT_NEAR(x[2 * i + c], one[i], 1e-14);
  }
}

// A grid, whose factor fills in.
SparseMatrix Grid(int m) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < m * m; ++i) {
    entries.emplace_back(i, i, 4.1);
    if (i % m != m - 1) entries.emplace_back(i + 1, i, -1.0);
    if (i + m < m * m) entries.emplace_back(i + m, i, -1.0);
  }
  SparseMatrix a(m * m, m * m);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

// Known before the factor is made: by columns exactly, by blocks (the larger
// one) with their padding.
TEST(SparseCholesky, StatesItsMemoryAndKeepsToIt) {
  for (const int m : {3, 10, 80}) {
    SCOPED_TRACE(m);
    SparseCholesky cholesky;
    cholesky.set_memory_limit(1.0);
    EXPECT_FALSE(cholesky.Factorize(Grid(m), 1));
    EXPECT_TRUE(cholesky.ExceedsMemory());
    EXPECT_EQ(cholesky.num_nonzeros(), 0);
    const double stated = cholesky.Bytes();
    cholesky.set_memory_limit(stated);
    ASSERT_TRUE(cholesky.Factorize(Grid(m), 1));
    EXPECT_FALSE(cholesky.ExceedsMemory());
    EXPECT_EQ(cholesky.num_analyses(), 1);
    const double entries = static_cast<double>(cholesky.num_nonzeros());
    EXPECT_GE(stated, 12.0 * entries);
    EXPECT_LE(stated, 40.0 * entries);
  }
}

TEST(SparseCholesky, NamesItsLibrary) {
  EXPECT_FALSE(SparseCholesky::Library().empty());
}

}  // namespace
}  // namespace granopt
