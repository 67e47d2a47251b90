#include "solvers/linear_solver.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Dense"
#include "Eigen/SparseCholesky"
#include "gtest/gtest.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

bool mpi_was_started = false;

}  // namespace
}  // namespace granopt

// Asked by LeakSanitizer: Open MPI keeps what it has allocated.
extern "C" int __lsan_is_turned_off() { return granopt::mpi_was_started; }

namespace granopt {
namespace {

using Options = std::map<std::string, std::string>;

// Null where this build is without the package.
std::unique_ptr<LinearSolver> Make(Options options) {
  options.emplace("linear_tolerance", "1e-13");
  Parameters parameters(std::move(options));
  std::unique_ptr<LinearSolver> solver = MakeLinearSolver(&parameters);
  return parameters.Error().empty() ? std::move(solver) : nullptr;
}

struct Variant {
  std::string name;
  Options options;
  bool direct, bitwise;
};

std::vector<Variant> Variants() {
  std::vector<Variant> variants;
  for (const Variant& variant : std::vector<Variant>{
           {"amd", {}, true, true},
           {"metis", {{"ordering", "metis"}}, true, true},
           {"rcm", {{"ordering", "rcm"}}, true, true},
           {"pcg", {{"linear", "pcg"}}, false, true},
           {"amg", {{"linear", "amg"}}, false, false},
       }) {
    if (Make(variant.options) == nullptr) continue;
    if (variant.name == "amg") mpi_was_started = true;
    variants.push_back(variant);
  }
  return variants;
}

// Numbers in (-1, 1) that do not depend on a library.
class Random {
 public:
  double operator()() {
    state_ = state_ * 6364136223846793005u + 1442695040888963407u;
    return static_cast<double>(state_ >> 11) * std::exp2(-52) - 1.0;
  }

 private:
  unsigned long long state_ = 1;
};

Eigen::VectorXd RandomVector(Eigen::Index n) {
  Random random;
  Eigen::VectorXd v(n);
  for (double& entry : v) entry = random();
  return v;
}

// Lower triangle of the Laplacian of a grid of m x m points plus `diagonal`.
SparseMatrix Grid(int m, double diagonal) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) {
      const int here = i * m + j;
      entries.emplace_back(here, here, diagonal);
      for (const int other :
           {j + 1 < m ? here + 1 : -1, i + 1 < m ? here + m : -1}) {
        if (other < 0) continue;
        entries.emplace_back(here, here, 1.0);
        entries.emplace_back(other, other, 1.0);
        entries.emplace_back(other, here, -1.0);
      }
    }
  }
  SparseMatrix a(m * m, m * m);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

// Lower triangle of B^T B + 1, B random with three entries a row.
SparseMatrix RandomMatrix(int n) {
  Random random;
  std::vector<Eigen::Triplet<double>> entries;
  for (int row = 0; row < 2 * n; ++row) {
    for (int k = 0; k < 3; ++k) {
      const int column =
          std::min(n - 1, static_cast<int>(0.5 * (random() + 1.0) * n));
      entries.emplace_back(row, column, random());
    }
  }
  SparseMatrix b(2 * n, n), identity(n, n);
  b.setFromTriplets(entries.begin(), entries.end());
  identity.setIdentity();
  const SparseMatrix a = SparseMatrix(b.transpose()) * b + identity;
  return a.triangularView<Eigen::Lower>();
}

TEST(LinearSolver, AgreesWithDenseAlgebra) {
  const SparseMatrix lower = RandomMatrix(120);
  const Eigen::VectorXd b = RandomVector(120);
  for (const double shift : {0.0, 0.3}) {
    Eigen::MatrixXd dense =
        Eigen::MatrixXd(lower).selfadjointView<Eigen::Lower>();
    dense.diagonal().array() += shift;
    const Eigen::VectorXd expected = dense.llt().solve(b);
    for (const Variant& variant : Variants()) {
      const auto solver = Make(variant.options);
      ASSERT_TRUE(solver->Factorize(lower, 1, shift)) << variant.name;
      Eigen::VectorXd x(120);
      solver->Solve(b.data(), x.data(), 1);
      EXPECT_LT((x - expected).norm(), 1e-11 * expected.norm()) << variant.name;
    }
  }
}

TEST(LinearSolver, AgreesOnAGraphLaplacianAndDoesColumnsAtOnce) {
  const int n = 64 * 64;
  const SparseMatrix lower = Grid(64, 0.1);
  const Eigen::SimplicialLDLT<SparseMatrix> reference(lower);
  const Eigen::VectorXd b = RandomVector(3 * n);
  for (const Variant& variant : Variants()) {
    const auto solver = Make(variant.options);
    ASSERT_TRUE(solver->Factorize(lower, 1, 0.0)) << variant.name;
    for (const int columns : {1, 2, 3, 2}) {
      const Eigen::VectorXd right = b.head(columns * n);
      Eigen::VectorXd x(columns * n);
      solver->Solve(right.data(), x.data(), columns);
      for (int c = 0; c < columns; ++c) {
        const Eigen::Map<const Eigen::VectorXd, 0, Eigen::InnerStride<>> b_c(
            right.data() + c, n, Eigen::InnerStride<>(columns)),
            x_c(x.data() + c, n, Eigen::InnerStride<>(columns));
        const Eigen::VectorXd expected = reference.solve(b_c);
        EXPECT_LT((x_c - expected).norm(), 1e-11 * expected.norm())
            << variant.name << " " << c;
      }
    }
    EXPECT_EQ(solver->solves(), 8) << variant.name;
    EXPECT_EQ(solver->iterations() > 0, !variant.direct) << variant.name;
  }
}

TEST(LinearSolver, TakesTheSameBitsInOtherUnits) {
  const SparseMatrix lower = Grid(40, 0.1);
  const int n = 1600;
  const Eigen::VectorXd b = RandomVector(2 * n);
  for (const Variant& variant : Variants()) {
    if (!variant.bitwise) continue;
    for (const double shift : {0.0, 0.37}) {
      const auto solver = Make(variant.options);
      ASSERT_TRUE(solver->Factorize(lower, 1, shift));
      Eigen::VectorXd x(2 * n);
      solver->Solve(b.data(), x.data(), 2);
      for (const auto& [a, c] :
           {std::pair{7, -5}, {-12, 3}, {1, 1}, {-301, 600}, {0, -900}}) {
        const SparseMatrix scaled = std::exp2(a) * lower;
        const Eigen::VectorXd scaled_b = std::exp2(c) * b;
        const auto other = Make(variant.options);
        ASSERT_TRUE(other->Factorize(scaled, 1, std::exp2(a) * shift));
        Eigen::VectorXd y(2 * n);
        other->Solve(scaled_b.data(), y.data(), 2);
        EXPECT_TRUE(y == std::exp2(c - a) * x) << variant.name << " " << a;
        EXPECT_EQ(other->iterations(), solver->iterations());
        // The same object again.
        other->Solve(scaled_b.data(), y.data(), 2);
        EXPECT_TRUE(y == std::exp2(c - a) * x) << variant.name << " " << a;
      }
    }
  }
}

TEST(LinearSolver, MatricesThatCannotBeSolvedAreOrdinary) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Variant& variant : Variants()) {
    const auto solver = Make(variant.options);
    Eigen::VectorXd b = RandomVector(100), x(100);

    SparseMatrix bad = Grid(10, 0.1);
    bad.valuePtr()[1] = nan;  // off the diagonal
    EXPECT_FALSE(solver->Factorize(bad, 1, 0.0)) << variant.name;
    EXPECT_FALSE(solver->Factorize(Grid(10, 0.1), 1, nan)) << variant.name;
    EXPECT_FALSE(solver->Factorize(Grid(10, -5.0), 1, 0.0)) << variant.name;

    // Indefinite, which its diagonal does not show.
    const SparseMatrix indefinite = Grid(10, -0.5);
    const bool accepted = solver->Factorize(indefinite, 1, 0.0);
    EXPECT_NE(accepted, variant.direct) << variant.name;
    if (accepted) {
      solver->Solve(b.data(), x.data(), 1);
      EXPECT_GT(b.dot(x), 0.0) << variant.name;
    }
    // Singular; a shift makes it definite.
    EXPECT_TRUE(solver->Factorize(Grid(10, 0.0), 1, 1e-3)) << variant.name;
    solver->Solve(b.data(), x.data(), 1);
    Eigen::VectorXd residual =
        Grid(10, 0.0).selfadjointView<Eigen::Lower>() * x + 1e-3 * x - b;
    EXPECT_LT(residual.norm(), 1e-11 * b.norm()) << variant.name;
    // Zero, with and without entries.
    SparseMatrix zero(100, 100);
    EXPECT_FALSE(solver->Factorize(zero, 2, 0.0)) << variant.name;
    EXPECT_TRUE(solver->Factorize(zero, 2, 2.0)) << variant.name;
    solver->Solve(b.data(), x.data(), 1);
    EXPECT_LT((2.0 * x - b).norm(), 1e-15) << variant.name;
    EXPECT_TRUE(solver->Factorize(0.0 * Grid(10, 0.1), 3, 2.0));
    // b = 0.
    b.setZero();
    solver->Solve(b.data(), x.data(), 1);
    EXPECT_EQ(x.norm(), 0.0) << variant.name;
    // One unknown, and none.
    SparseMatrix one(1, 1);
    one.insert(0, 0) = 4.0;
    one.makeCompressed();
    ASSERT_TRUE(solver->Factorize(one, 4, 0.0)) << variant.name;
    b[0] = 3.0;
    solver->Solve(b.data(), x.data(), 1);
    EXPECT_NEAR(x[0], 0.75, 1e-15) << variant.name;
    ASSERT_TRUE(solver->Factorize(SparseMatrix(0, 0), 5, 0.0)) << variant.name;
    solver->Solve(b.data(), x.data(), 2);
  }
}

TEST(LinearSolver, KeepsTheAnalysisOfAPattern) {
  for (const Variant& variant : Variants()) {
    if (variant.name == "amg") continue;  // none can be kept
    const auto solver = Make(variant.options);
    for (const double diagonal : {0.1, 0.2, 0.3}) {
      ASSERT_TRUE(solver->Factorize(Grid(60, diagonal), 1, 0.0));
    }
    EXPECT_EQ(solver->analyses(), 1) << variant.name;
    EXPECT_EQ(solver->factorizations(), 3) << variant.name;
    ASSERT_TRUE(solver->Factorize(Grid(60, 0.1), 2, 0.0));
    EXPECT_EQ(solver->analyses(), 2) << variant.name;
    ASSERT_TRUE(solver->Factorize(Grid(50, 0.1), 2, 0.0));
    EXPECT_EQ(solver->analyses(), 3) << variant.name;
    const Eigen::VectorXd b = RandomVector(2500);
    Eigen::VectorXd x(2500);
    solver->Solve(b.data(), x.data(), 1);
    const Eigen::VectorXd residual =
        Grid(50, 0.1).selfadjointView<Eigen::Lower>() * x - b;
    EXPECT_LT(residual.norm(), 1e-11 * b.norm()) << variant.name;
  }
}

TEST(LinearSolver, SaysWhatABuildIsWithout) {
  const auto error = [](Options options) {
    Parameters parameters(std::move(options));
    MakeLinearSolver(&parameters);
    return parameters.Error();
  };
  EXPECT_EQ(error({}), "");
  EXPECT_EQ(error({{"linear", "pcg"}}), "");
  const std::string amg = error({{"linear", "amg"}});
  if (!amg.empty()) {
    EXPECT_EQ(amg,
              "option linear=amg needs hypre, which this build is without");
  }
  const std::string metis = error({{"ordering", "metis"}});
  if (!SparseCholesky::Has(Ordering::METIS)) {
    EXPECT_EQ(metis,
              "option ordering=metis needs CHOLMOD, which this build is "
              "without");
  } else {
    EXPECT_EQ(metis, "");
  }
  EXPECT_NE(error({{"linear", "lu"}}), "");
  EXPECT_NE(error({{"linear_tolerance", "2"}}), "");
}

}  // namespace
}  // namespace granopt
