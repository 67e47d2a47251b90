#include "solvers/linear_solver.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "Eigen/IterativeLinearSolvers"
#include "solvers/format.h"
#include "solvers/iterative_linear_solver.h"
#include "solvers/normalize.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

constexpr double kGigabyte = 1e9;

// Half of the machine's memory, in bytes.
double DefaultMemory() {
  const double pages = static_cast<double>(sysconf(_SC_PHYS_PAGES));
  const double bytes = 0.5 * pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  return bytes > 0.0 ? bytes : std::numeric_limits<double>::infinity();
}

class Direct : public LinearSolver {
 public:
  Direct(Ordering ordering, Factorizer factorizer, double memory)
      : cholesky_(ordering, factorizer) {
    cholesky_.set_memory_limit(memory);
  }

  bool Factorize(const SparseMatrix& lower,
                 std::int64_t pattern_version,
                 double shift) override {
    ++factorizations_;
    const bool done = cholesky_.Factorize(lower, pattern_version, shift);
    analyses_ = cholesky_.num_analyses();
    refusal_.clear();
    if (cholesky_.ExceedsMemory()) {
      refusal_ =
          Format("a factor takes %.3g GB > %.3g GB (option factor_memory)",
                 cholesky_.Bytes() / kGigabyte,
                 cholesky_.memory_limit() / kGigabyte);
    }
    return done;
  }

  void Solve(const double* b, double* x, int columns) override {
    solves_ += columns;
    cholesky_.Solve(b, x, columns);
  }

 private:
  SparseCholesky cholesky_;
};

// Preconditioned by the diagonal. Eigen::IncompleteCholesky divides the
// iterations by 1.7 to 2.8, but each takes 2.7 to 3.6 times as long.
class ConjugateGradients : public IterativeLinearSolver {
 public:
  explicit ConjugateGradients(double tolerance) {
    solver_.setTolerance(tolerance);
  }

 protected:
  bool SetUp(bool pattern_is_new) override {
    if (pattern_is_new) {
      solver_.analyzePattern(matrix());
      ++analyses_;
    }
    solver_.factorize(matrix());
    return true;
  }

  void SolveColumn(const Eigen::VectorXd& b, Eigen::VectorXd* x) override {
    *x = solver_.solve(b);
    iterations_ += solver_.iterations();
  }

 private:
  // Both triangles: rows of a symmetric matrix are its columns, and a product
  // that gathers is faster than one that also scatters.
  Eigen::ConjugateGradient<SparseMatrix,
                           Eigen::Lower | Eigen::Upper,
                           Eigen::DiagonalPreconditioner<double>>
      solver_;
};

}  // namespace

bool IterativeLinearSolver::Factorize(const SparseMatrix& lower,
                                      std::int64_t pattern_version,
                                      double shift) {
  ++factorizations_;
  scale_ = NormalizingPower(lower, shift);
  lower_ = lower;
  const auto n = lower_.cols();
  for (Eigen::Index j = 0; j < n && shift != 0.0; ++j) {
    lower_.coeffRef(j, j) += shift;
  }
  lower_.makeCompressed();
  lower_.coeffs() *= scale_;
  diagonal_ = lower_.diagonal();
  // False for a NaN, too.
  if (!(diagonal_.array() > 0.0).all() || !lower_.coeffs().allFinite()) {
    return false;
  }
  matrix_ = lower_.selfadjointView<Eigen::Lower>();
  const bool pattern_is_new = pattern_version != version_ || n != size_;
  version_ = pattern_version;
  size_ = n;
  return n == 0 || SetUp(pattern_is_new);
}

void IterativeLinearSolver::Solve(const double* b, double* x, int columns) {
  const Eigen::Index n = size_;
  right_.resize(n);
  solution_.resize(n);
  solves_ += columns;
  for (int c = 0; c < columns; ++c) {
    double largest = 0.0;
    double probe = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      right_[i] = b[i * columns + c];
      largest = std::max(largest, std::abs(right_[i]));
      probe += right_[i] - right_[i];
    }
    // Squares of small numbers must not underflow.
    const double unit = NormalizingPower(largest);
    right_ *= unit;
    if (probe != 0.0 || largest == 0.0) {
      solution_ = right_;  // zero, or as undefined as b
    } else {
      SolveColumn(right_, &solution_);
      const double product = right_.dot(solution_);
      if (!(product > 0.0 && std::isfinite(product))) {
        solution_ = right_.cwiseQuotient(diagonal_);
      }
    }
    for (Eigen::Index i = 0; i < n; ++i) {
      x[i * columns + c] = solution_[i] / unit * scale_;
    }
  }
}

std::unique_ptr<LinearSolver> MakeLinearSolver(Parameters* parameters) {
  constexpr Ordering kOrderings[] = {
      Ordering::AMD, Ordering::METIS, Ordering::RCM};
  const int kind = parameters->Choice(
      "linear",
      "cholesky",
      "cholesky|pcg|amg",
      "direct, conjugate gradients, or those with algebraic multigrid");
  const Ordering ordering = kOrderings[parameters->Choice(
      "ordering", "amd", "amd|metis|rcm", "of the unknowns, for cholesky")];
  const Factorizer factorizer =
      parameters->Choice("factor",
                         "multifrontal",
                         "multifrontal|library",
                         "by our own code (amd only) or CHOLMOD's") == 0
          ? Factorizer::FASTEST
          : Factorizer::LIBRARY;
  const double tolerance =
      parameters->Double("linear_tolerance",
                         1e-8,
                         1e-15,
                         0.5,
                         "|b - A x| / |b| where pcg and amg stop");
  double memory = parameters->Double("factor_memory",
                                     0.0,
                                     0.0,
                                     1e9,
                                     "GB that a factor may take; 0: half of "
                                     "the machine's");
  memory = memory > 0.0 ? memory * kGigabyte : DefaultMemory();
  if (kind == 1) return std::make_unique<ConjugateGradients>(tolerance);
  if (kind == 2) {
    std::unique_ptr<LinearSolver> amg = MakeBoomerAmg(tolerance);
    if (amg != nullptr) return amg;
    parameters->Refuse(
        "linear", "amg", "needs hypre, which this build is without");
  }
  if (!SparseCholesky::Has(ordering)) {
    parameters->Refuse(
        "ordering", "metis", "needs CHOLMOD, which this build is without");
    return std::make_unique<Direct>(Ordering::AMD, factorizer, memory);
  }
  return std::make_unique<Direct>(ordering, factorizer, memory);
}

}  // namespace granopt
