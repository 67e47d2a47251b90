#include "solvers/multifrontal_cholesky.h"

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "Eigen/Dense"
#include "Eigen/SparseCholesky"
#include "gtest/gtest.h"

namespace granopt {
namespace {

// The lower triangle of a random matrix of b x b blocks, n of them a row, with
// about `degree` neighbours each, made positive definite by its diagonal.
SparseMatrix Random(int n, int b, double degree, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<double> sum(static_cast<std::size_t>(n) * b, 1.0);
  const int pairs = static_cast<int>(0.5 * degree * n);
  std::vector<std::vector<bool>> used(n, std::vector<bool>(n, false));
  for (int p = 0; p < pairs; ++p) {
    int i = static_cast<int>(generator() % n);
    // Mostly near ones, as in space.
    int j = p % 10 == 0 ? static_cast<int>(generator() % n)
                        : (i + 1 + static_cast<int>(generator() % 4)) % n;
    if (i == j) continue;
    if (i < j) std::swap(i, j);
    if (used[i][j]) continue;
    used[i][j] = true;
    for (int r = 0; r < b; ++r) {
      for (int c = 0; c < b; ++c) {
        const double value = uniform(generator);
        entries.emplace_back(i * b + r, j * b + c, value);
        sum[i * b + r] += std::abs(value);
        sum[j * b + c] += std::abs(value);
      }
    }
  }
  for (int i = 0; i < n; ++i) {
    for (int r = 0; r < b; ++r) {
      for (int c = 0; c <= r; ++c) {
        const double value = r == c ? sum[i * b + r] + b : uniform(generator);
        entries.emplace_back(i * b + r, i * b + c, value);
      }
    }
  }
  SparseMatrix lower(n * b, n * b);
  lower.setFromTriplets(entries.begin(), entries.end());
  return lower;
}

Eigen::VectorXd Wave(Eigen::Index n) {
  Eigen::VectorXd x(n);
  for (Eigen::Index i = 0; i < n; ++i) x[i] = std::sin(1.0 + 0.7 * i);
  return x;
}

std::vector<const DensePanel*> Panels() {
  std::vector<const DensePanel*> panels = {&kPortablePanel};
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    panels.push_back(&kAvx2Panel);
  }
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")) {
    panels.push_back(&kAvx512Panel);
  }
#endif
  return panels;
}

// Every kernel, block size and kind of graph against the solution and against
// another library's factor.
TEST(MultifrontalCholesky, SolvesWhatAnotherFactorSolves) {
  for (const DensePanel* panel : Panels()) {
    for (const int b : {1, 2, 3}) {
      for (const int n : {1, 2, 3, 5, 8, 40, 150}) {
        for (const double degree : {0.0, 1.0, 4.0, 12.0}) {
          SCOPED_TRACE(std::string(panel->name) + ", " + std::to_string(b) +
                       ", " + std::to_string(n) + ", " +
                       std::to_string(degree));
          const SparseMatrix lower = Random(n, b, degree, 7 * n + b);
          const Eigen::VectorXd x_true = Wave(lower.cols());
          for (const double shift : {0.0, 0.3}) {
            const Eigen::VectorXd rhs =
                lower.selfadjointView<Eigen::Lower>() * x_true + shift * x_true;
            MultifrontalCholesky cholesky;
            cholesky.set_panel(*panel);
            ASSERT_TRUE(cholesky.Analyze(lower));
            // Twice: nothing of the first may be left.
            ASSERT_TRUE(cholesky.Factorize(lower.valuePtr(), 7.0));
            ASSERT_TRUE(cholesky.Factorize(lower.valuePtr(), shift));
            Eigen::VectorXd x = rhs;
            cholesky.Solve(x.data(), x.data());
            EXPECT_LT((x - x_true).norm(), 1e-12 * x_true.norm());
            Eigen::SimplicialLLT<SparseMatrix, Eigen::Lower> other;
            other.setShift(shift);
            other.compute(lower);
            const Eigen::VectorXd y = other.solve(rhs);
            EXPECT_LT((x - y).norm(), 1e-12 * x_true.norm());
          }
        }
      }
    }
  }
}

TEST(MultifrontalCholesky, SeesBlocksAndCountsEntries) {
  for (const int b : {2, 3}) {
    const SparseMatrix lower = Random(60, b, 4.0, 3);
    MultifrontalCholesky cholesky;
    ASSERT_TRUE(cholesky.Analyze(lower));
    EXPECT_EQ(cholesky.block_size(), b);
    EXPECT_GE(cholesky.num_nonzeros(), lower.nonZeros());
    EXPECT_GE(cholesky.num_stored(), cholesky.num_nonzeros());
    EXPECT_GE(cholesky.Bytes(), 8.0 * cholesky.num_stored());
  }
  // One entry short of being full.
  SparseMatrix lower = Random(60, 2, 4.0, 3);
  lower.prune(
      [](int row, int column, double) { return !(row == 1 && column == 0); });
  MultifrontalCholesky cholesky;
  ASSERT_TRUE(cholesky.Analyze(lower));
  EXPECT_EQ(cholesky.block_size(), 1);
  // A dense matrix has no other factor than a dense one.
  Eigen::MatrixXd full = Eigen::MatrixXd::Constant(30, 30, 1.0);
  full.diagonal().array() += 30.0;
  const Eigen::MatrixXd triangle = full.triangularView<Eigen::Lower>();
  lower = triangle.sparseView();
  ASSERT_TRUE(cholesky.Analyze(lower));
  EXPECT_EQ(cholesky.num_nonzeros(), 30 * 31 / 2);
  double flops = 0.0;
  for (int k = 1; k <= 30; ++k) flops += 0.5 * k * k;
  EXPECT_DOUBLE_EQ(cholesky.flops(), flops);
}

// A pivot that is not positive, wherever it comes in the elimination.
TEST(MultifrontalCholesky, RefusesIndefiniteMatricesAndRecovers) {
  const SparseMatrix lower = Random(40, 2, 5.0, 11);
  MultifrontalCholesky cholesky;
  ASSERT_TRUE(cholesky.Analyze(lower));
  const Eigen::VectorXd x_true = Wave(lower.cols());
  const Eigen::VectorXd rhs = lower.selfadjointView<Eigen::Lower>() * x_true;
  for (int i = 0; i < lower.cols(); ++i) {
    SparseMatrix bad = lower;
    bad.coeffRef(i, i) = -1e-3;
    EXPECT_FALSE(cholesky.Factorize(bad.valuePtr(), 0.0)) << i;
    ASSERT_TRUE(cholesky.Factorize(lower.valuePtr(), 0.0)) << i;
    Eigen::VectorXd x(lower.cols());
    cholesky.Solve(rhs.data(), x.data());
    EXPECT_LT((x - x_true).norm(), 1e-12 * x_true.norm()) << i;
  }
}

// A grid, whose fronts grow to its width and whose eigenvectors are known.
TEST(MultifrontalCholesky, SolutionsOnAGridAreKnown) {
  const int m = 40;
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < m * m; ++i) {
    entries.emplace_back(i, i, 4.5);
    if (i % m != m - 1) entries.emplace_back(i + 1, i, -1.0);
    if (i + m < m * m) entries.emplace_back(i + m, i, -1.0);
  }
  SparseMatrix lower(m * m, m * m);
  lower.setFromTriplets(entries.begin(), entries.end());
  MultifrontalCholesky cholesky;
  ASSERT_TRUE(cholesky.Analyze(lower));
  ASSERT_TRUE(cholesky.Factorize(lower.valuePtr(), 0.0));
  // Eigenvectors are products of sines: A^-1 of one is it over its eigenvalue.
  const double pi = std::acos(-1.0);
  for (const int k : {1, 7, m}) {
    Eigen::VectorXd mode(m * m), x(m * m);
    for (int i = 0; i < m * m; ++i) {
      mode[i] = std::sin(pi * k * (i % m + 1) / (m + 1)) *
                std::sin(pi * 2 * (i / m + 1) / (m + 1));
    }
    const double eigenvalue =
        4.5 - 2 * std::cos(pi * k / (m + 1)) - 2 * std::cos(2 * pi / (m + 1));
    cholesky.Solve(mode.data(), x.data());
    EXPECT_LT((eigenvalue * x - mode).norm(), 1e-12 * mode.norm());
  }
}

}  // namespace
}  // namespace granopt
