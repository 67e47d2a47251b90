#include "solvers/lowest_modes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Dense"
#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

SparseMatrix Lower(int n, const std::vector<Eigen::Triplet<double>>& entries) {
  SparseMatrix a(n, n);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

// Springs between neighbours; the ends are held: eigenvalues
// 2 - 2 cos(pi k / (n + 1)), k = 1 ... n, plus `diagonal`.
SparseMatrix Chain(int n, double diagonal) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    entries.emplace_back(i, i, 2.0 + diagonal);
    if (i + 1 < n) entries.emplace_back(i + 1, i, -1.0);
  }
  return Lower(n, entries);
}
double ChainValue(int n, int k) {
  return 2.0 - 2.0 * std::cos(kPi * k / (n + 1));
}

// Closed to a ring, n > 2: 2 - 2 cos(2 pi k / n), all but two of them double.
SparseMatrix Ring(int n) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) {
    entries.emplace_back(i, i, 2.0);
    if (i + 1 < n) entries.emplace_back(i + 1, i, -1.0);
  }
  entries.emplace_back(n - 1, 0, -1.0);
  return Lower(n, entries);
}

SparseMatrix Random(int n, double diagonal, unsigned seed) {
  std::srand(seed);
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < n; ++j) {
    entries.emplace_back(j, j, diagonal + Eigen::internal::random(-1.0, 1.0));
    for (int k = 0; k < 3; ++k) {
      const int i = Eigen::internal::random(0, n - 1);
      if (i > j) entries.emplace_back(i, j, Eigen::internal::random(-1.0, 1.0));
    }
  }
  return Lower(n, entries);
}

Eigen::MatrixXd Dense(const SparseMatrix& lower) {
  return Eigen::MatrixXd(lower).selfadjointView<Eigen::Lower>();
}

LowestModes Modes(const SparseMatrix& lower,
                  int count,
                  const Eigen::MatrixXd& left_out = {}) {
  LowestModesOptions options;
  options.count = count;
  if (left_out.cols() > 0) options.left_out = left_out;
  return ComputeLowestModes(lower, options);
}

// What every result promises.
void Check(const SparseMatrix& lower, const LowestModes& modes) {
  ASSERT_TRUE(modes.converged) << modes.message;
  const Eigen::MatrixXd& v = modes.vectors;
  const Eigen::Index count = modes.values.size();
  ASSERT_EQ(v.cols(), count);
  EXPECT_LT(
      (v.transpose() * v - Eigen::MatrixXd::Identity(count, count)).norm(),
      1e-12 * count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const Eigen::VectorXd image =
        lower.selfadjointView<Eigen::Lower>() * v.col(k);
    EXPECT_LE((image - modes.values[k] * v.col(k)).norm(), 1e-10 * modes.norm);
    EXPECT_LE(modes.residuals[k], 1e-10 * modes.norm);
    if (k > 0) {
      EXPECT_GE(modes.values[k], modes.values[k - 1]);
    }
    Eigen::Index largest;
    v.col(k).cwiseAbs().maxCoeff(&largest);
    EXPECT_GT(v(largest, k), 0.0);
  }
}

TEST(LowestModes, OfAChainAreSines) {
  for (const int n : {1, 2, 3, 40, 700}) {
    SCOPED_TRACE(n);
    const SparseMatrix chain = Chain(n, 0.0);
    const int count = std::min(n, 6);
    const LowestModes modes = Modes(chain, count);
    Check(chain, modes);
    ASSERT_EQ(modes.values.size(), count);
    for (int k = 0; k < count; ++k) {
      EXPECT_NEAR(modes.values[k], ChainValue(n, k + 1), 1e-14);
      Eigen::VectorXd sine(n);
      for (int i = 0; i < n; ++i) {
        sine[i] = std::sin(kPi * (k + 1) * (i + 1) / (n + 1));
      }
      EXPECT_NEAR(
          std::abs(sine.normalized().dot(modes.vectors.col(k))), 1.0, 1e-9);
    }
  }
}

// Lower than zero, by a little and by a lot: the shift has to find the place.
TEST(LowestModes, OfIndefiniteMatrices) {
  const int n = 500;
  for (const double diagonal :
       {-1e-7, -1e-4, -0.01, -1.0, -2.0, -3.9, -100.0}) {
    SCOPED_TRACE(diagonal);
    const SparseMatrix chain = Chain(n, diagonal);
    const LowestModes modes = Modes(chain, 3);
    Check(chain, modes);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(modes.values[k],
                  ChainValue(n, k + 1) + diagonal,
                  1e-15 * modes.norm * 10);
    }
    EXPECT_GT(modes.shift, -modes.values[0]);
    // Closer than the gap to the next times some factor.
    if (diagonal < -0.001) {
      EXPECT_LT(modes.shift, 1.2 * -modes.values[0]);
    }
  }
}

TEST(LowestModes, NullVectorsAreLeftOut) {
  const int n = 300;
  const SparseMatrix ring = Ring(n);
  const LowestModes all = Modes(ring, 4);
  Check(ring, all);
  EXPECT_NEAR(all.values[0], 0.0, 1e-14);
  const Eigen::MatrixXd ones = Eigen::MatrixXd::Constant(n, 1, 3.0);
  const LowestModes rest = Modes(ring, 3, ones);
  Check(ring, rest);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(rest.values[k], all.values[k + 1], 1e-14);
    EXPECT_LT(std::abs(rest.vectors.col(k).sum()), 1e-13);
  }
  // Not only where the others are positive.
  SparseMatrix lowered = ring;
  for (int i = 0; i < n; ++i) lowered.coeffRef(i, i) -= 0.5;
  const LowestModes negative = Modes(lowered, 3, ones);
  Check(lowered, negative);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(negative.values[k], all.values[k + 1] - 0.5, 1e-14);
  }
}

// Vectors that are no eigenvectors: A restricted to their complement.
TEST(LowestModes, AnyVectorsCanBeLeftOut) {
  for (const int n : {20, 200}) {
    const SparseMatrix lower = Random(n, 6.0, 5);
    const Eigen::MatrixXd q = Eigen::MatrixXd::Random(n, 3);
    const Eigen::MatrixXd dense = Dense(lower);
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(q);
    const Eigen::MatrixXd basis =
        (qr.householderQ() * Eigen::MatrixXd::Identity(n, n)).rightCols(n - 3);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> oracle(
        basis.transpose() * dense * basis);
    const LowestModes modes = Modes(lower, 4, q);
    ASSERT_TRUE(modes.converged) << modes.message;
    for (int k = 0; k < 4; ++k) {
      EXPECT_NEAR(modes.values[k], oracle.eigenvalues()[k], 1e-12);
    }
    EXPECT_LT((q.transpose() * modes.vectors).norm(), 1e-12);
  }
}

// A single Krylov space holds one vector of each multiple eigenvalue.
TEST(LowestModes, MultipleAndClusteredEigenvaluesAreComplete) {
  const int n = 400;
  const LowestModes ring = Modes(Ring(n), 9);
  Check(Ring(n), ring);
  for (int k = 0; k < 9; ++k) {
    EXPECT_NEAR(ring.values[k],
                2.0 - 2.0 * std::cos(2.0 * kPi * ((k + 1) / 2) / n),
                1e-14);
  }
  // Six equal chains that do not touch, then nearly equal ones.
  for (const double apart : {0.0, 1e-12, 1e-6}) {
    SCOPED_TRACE(apart);
    const int copies = 6, length = 50;
    std::vector<Eigen::Triplet<double>> entries;
    std::vector<double> expected;
    for (int c = 0; c < copies; ++c) {
      for (int i = 0; i < length; ++i) {
        entries.emplace_back(c * length + i, c * length + i, 2.0 + apart * c);
        if (i > 0)
          entries.emplace_back(c * length + i, c * length + i - 1, -1.0);
      }
      for (int k = 1; k < 4; ++k) {
        expected.push_back(ChainValue(length, k) + apart * c);
      }
    }
    std::sort(expected.begin(), expected.end());
    const SparseMatrix chains = Lower(copies * length, entries);
    const LowestModes modes = Modes(chains, 10);
    Check(chains, modes);
    for (int k = 0; k < 10; ++k) {
      EXPECT_NEAR(modes.values[k], expected[k], 3e-14) << k;
    }
  }
}

// So many copies that rounding alone does not find them all.
TEST(LowestModes, HighlyMultipleEigenvaluesAreComplete) {
  struct Case {
    int length, copies, count;
  };
  for (const Case& c : {Case{20, 10, 5},
                        Case{20, 40, 20},
                        Case{200, 10, 5},
                        Case{2, 40, 20},
                        Case{2, 200, 12},
                        Case{1, 100, 7}}) {
    SCOPED_TRACE(std::to_string(c.copies) + " of " + std::to_string(c.length));
    std::vector<Eigen::Triplet<double>> entries;
    for (int i = 0; i < c.copies * c.length; ++i) {
      entries.emplace_back(i, i, 2.0);
      if (i % c.length != 0) entries.emplace_back(i, i - 1, -1.0);
    }
    const SparseMatrix chains = Lower(c.copies * c.length, entries);
    const LowestModes modes = Modes(chains, c.count);
    Check(chains, modes);
    for (int k = 0; k < c.count; ++k) {
      EXPECT_NEAR(
          modes.values[k], ChainValue(c.length, 1 + k / c.copies), 1e-13);
    }
  }
}

TEST(LowestModes, AgreeWithADenseMethod) {
  for (const int n : {1, 2, 5, 48, 49, 60, 150}) {
    for (const double diagonal : {-5.0, 0.0, 5.0}) {
      SCOPED_TRACE(std::to_string(n) + ", " + std::to_string(diagonal));
      const SparseMatrix lower = Random(n, diagonal, n);
      const Eigen::MatrixXd dense = Dense(lower);
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> oracle(dense);
      for (const int count : {1, 2, 7, n}) {
        const LowestModes modes = Modes(lower, count);
        Check(lower, modes);
        ASSERT_EQ(modes.values.size(), std::min(count, n));
        for (int k = 0; k < modes.values.size(); ++k) {
          EXPECT_NEAR(
              modes.values[k], oracle.eigenvalues()[k], 1e-13 * modes.norm);
        }
      }
    }
  }
}

TEST(LowestModes, OtherUnitsGiveTheScaledResult) {
  const SparseMatrix lower = Random(200, 0.0, 8);
  const LowestModes modes = Modes(lower, 3);
  for (const int a : {-200, -7, 1, 300}) {
    SparseMatrix scaled = lower;
    scaled.coeffs() *= std::ldexp(1.0, a);
    const LowestModes same = Modes(scaled, 3);
    EXPECT_EQ(same.values, std::ldexp(1.0, a) * modes.values);
    EXPECT_EQ(same.residuals, std::ldexp(1.0, a) * modes.residuals);
    EXPECT_EQ(same.vectors, modes.vectors);
  }
}

TEST(LowestModes, ZeroAndNothing) {
  for (const int n : {1, 30, 100}) {
    const LowestModes modes = Modes(SparseMatrix(n, n), 2);
    Check(SparseMatrix(n, n), modes);
    EXPECT_EQ(modes.values.cwiseAbs().maxCoeff(), 0.0);
  }
  EXPECT_TRUE(Modes(SparseMatrix(0, 0), 1).converged);
  EXPECT_TRUE(Modes(Chain(5, 0.0), 0).converged);
  // All of the space is left out.
  const LowestModes none = Modes(Chain(1, 0.0), 1, Eigen::MatrixXd::Ones(1, 1));
  EXPECT_TRUE(none.converged);
  EXPECT_EQ(none.values.size(), 0);
}

TEST(LowestModes, SaysWhyItFailed) {
  SparseMatrix bad = Chain(100, 0.0);
  bad.valuePtr()[7] = std::numeric_limits<double>::quiet_NaN();
  const LowestModes modes = Modes(bad, 1);
  EXPECT_FALSE(modes.converged);
  EXPECT_EQ(modes.message, "the matrix is not finite");
  LowestModesOptions options;
  options.count = 5;
  options.max_restarts = 0;
  const LowestModes stopped = ComputeLowestModes(Random(400, 0.0, 1), options);
  EXPECT_FALSE(stopped.converged);
  EXPECT_NE(stopped.message.find("after 0 restarts"), std::string::npos)
      << stopped.message;
}

}  // namespace
}  // namespace granopt
