#include "solvers/condition.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <vector>

#include "Eigen/Cholesky"
#include "Eigen/LU"
#include "Eigen/SparseCholesky"
#include "Spectra/SymGEigsShiftSolver.h"
#include "Spectra/SymGEigsSolver.h"
#include "solvers/normalize.h"
#include "solvers/random.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The first shift, in units of the highest eigenvalue, and by how much it
// grows.
constexpr double kFirstShift = 1e-11;
constexpr double kShiftGrowth = 16.0;
constexpr int kMaxShifts = 16;

// Of the Ritz values, relative.
constexpr double kRitzTolerance = 1e-6;

// Up to this part of the highest eigenvalue a value counts as zero.
constexpr double kZero = 1e-12;
// Negative ones are counted from this part of the lowest one on: those nearer
// to zero may be roundoff.
constexpr double kClearly = 1e-3;

// See lowest_modes.cc: another start and size help where Spectra throws.
constexpr int kAttempts = 2;
constexpr Index kColumns = 60;

SparseMatrix Combined(const SparseMatrix& a, double s, const SparseMatrix& p) {
  SparseMatrix sum = a + s * p;
  sum.makeCompressed();
  return sum;
}

// The lower triangle of B^T M B.
SparseMatrix Congruent(const SparseMatrix& lower, const SparseMatrix& b) {
  const SparseMatrix full = lower.selfadjointView<Eigen::Lower>();
  const SparseMatrix product = full * b;
  const SparseMatrix transposed = b.transpose();
  const SparseMatrix all = transposed * product;
  SparseMatrix result = all.triangularView<Eigen::Lower>();
  result.makeCompressed();
  return result;
}

// A and P in a basis of unit vectors, as many as are independent of the null
// space, and the null space itself, which comes last: A is then zero there
// without the rounding errors that it would be mistaken for eigenvalues by
// where P is small on it.
void ChangeBasis(const MatrixXd& null_space, SparseMatrix* a, SparseMatrix* p) {
  const Index n = a->rows();
  const Index q = null_space.cols();
  std::vector<bool> replaced(n, false);
  if (q > 0) {
    const Eigen::FullPivLU<MatrixXd> lu(null_space);
    for (Index k = 0; k < q; ++k) {
      // permutationP() maps rows to their place.
      for (Index i = 0; i < n; ++i) {
        if (lu.permutationP().indices()[i] == k) replaced[i] = true;
      }
    }
  }
  std::vector<Eigen::Triplet<double>> units;
  int column = 0;
  for (Index i = 0; i < n; ++i) {
    if (!replaced[i]) units.emplace_back(static_cast<int>(i), column++, 1.0);
  }
  SparseMatrix basis(n, n);
  basis.setFromTriplets(units.begin(), units.end());
  *a = Congruent(*a, basis);
  for (Index k = 0; k < q; ++k) {
    for (Index i = 0; i < n; ++i) {
      if (null_space(i, k) != 0.0) {
        units.emplace_back(static_cast<int>(i),
                           column + static_cast<int>(k),
                           null_space(i, k));
      }
    }
  }
  basis.setFromTriplets(units.begin(), units.end());
  *p = Congruent(*p, basis);
}

// P, its factor, and what is left out.
class Metric {
 public:
  using Scalar = double;  // Spectra asks for it

  Metric(const SparseMatrix& p, const MatrixXd& null_space)
      : p_(p), null_(null_space) {
    if (null_.cols() > 0) {
      p_null_ = p_.selfadjointView<Eigen::Lower>() * null_;
      null_p_null_.compute(null_.transpose() * p_null_);
    }
  }
  bool Factorize() { return cholesky_.Factorize(p_, 1); }

  Index rows() const { return p_.rows(); }
  Index cols() const { return p_.rows(); }
  void perform_op(const double* x, double* y) const {
    Eigen::Map<VectorXd>(y, rows()) = p_.selfadjointView<Eigen::Lower>() *
                                      Eigen::Map<const VectorXd>(x, rows());
  }
  void solve(const double* x, double* y) const {
    cholesky_.Solve(x, y);
    Project(y);
  }
  Index nulls() const { return null_.cols(); }
  // P-orthogonally to the null space.
  void Project(double* x) const {
    if (null_.cols() == 0) return;
    Eigen::Map<VectorXd> v(x, rows());
    v -= null_ * null_p_null_.solve(p_null_.transpose() * v);
  }

 private:
  const SparseMatrix& p_;
  const MatrixXd& null_;
  mutable SparseCholesky cholesky_;
  MatrixXd p_null_;
  Eigen::LDLT<MatrixXd> null_p_null_;
};

class Product {
 public:
  using Scalar = double;
  explicit Product(const SparseMatrix& a) : a_(a) {}
  Index rows() const { return a_.rows(); }
  Index cols() const { return a_.rows(); }
  void perform_op(const double* x, double* y) const {
    Eigen::Map<VectorXd>(y, rows()) = a_.selfadjointView<Eigen::Lower>() *
                                      Eigen::Map<const VectorXd>(x, rows());
  }

 private:
  const SparseMatrix& a_;
};

// (A + s P)^-1, P-orthogonally to the null space.
class Inverse {
 public:
  using Scalar = double;
  Inverse(const SparseMatrix& a, const SparseMatrix& p, const Metric& metric)
      : a_(a), p_(p), metric_(metric) {}
  bool Factorize(double s) {
    return cholesky_.Factorize(Combined(a_, s, p_), 1);
  }
  Index rows() const { return a_.rows(); }
  Index cols() const { return a_.rows(); }
  void set_shift(double /*sigma*/) {}  // Factorize() did
  void perform_op(const double* x, double* y) const {
    // Of a vector that is P x with x P-orthogonal to the null space, these are
    // zero but for rounding, which the shift would blow up.
    right_ = Eigen::Map<const VectorXd>(x, rows());
    right_.tail(metric_.nulls()).setZero();
    cholesky_.Solve(right_.data(), y);
    metric_.Project(y);
  }

 private:
  const SparseMatrix& a_;
  const SparseMatrix& p_;
  const Metric& metric_;
  mutable SparseCholesky cholesky_;
  mutable VectorXd right_;
};

// The extreme value of a Spectra solver that `make` makes for a number of
// columns.
template <typename Make>
bool RunLanczos(const Metric& metric,
                Index dimensions,
                int max_restarts,
                Make make,
                double* value) {
  const Index n = metric.rows();
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Index columns = std::min(dimensions, kColumns + 11 * attempt);
    UniformRandom random(1 + attempt);
    VectorXd start(n);
    for (double& entry : start) entry = 2.0 * random() - 1.0;
    metric.Project(start.data());
    try {
      auto lanczos = make(columns);
      lanczos.init(start.data());
      lanczos.compute(
          Spectra::SortRule::LargestAlge, max_restarts, kRitzTolerance);
      if (lanczos.info() == Spectra::CompInfo::Successful) {
        *value = lanczos.eigenvalues()[0];
        return std::isfinite(*value);
      }
    } catch (const std::exception&) {
      // Another start, or bisection.
    }
  }
  return false;
}

// Negative pivots of A - x P: as many eigenvalues are below x. Without
// pivoting for size, which an indefinite matrix may ask for; only a pivot near
// zero would do harm, and that is seen. -1 then.
class Inertia {
 public:
  Inertia(const SparseMatrix& a, const SparseMatrix& p) : a_(a), p_(p) {}
  int Below(double x) {
    const SparseMatrix m = Combined(a_, -x, p_);
    if (!analyzed_) ldlt_.analyzePattern(m);
    analyzed_ = true;
    ldlt_.factorize(m);
    if (ldlt_.info() != Eigen::Success) return -1;
    const VectorXd d = ldlt_.vectorD();
    if (!d.allFinite()) return -1;
    return static_cast<int>((d.array() < 0.0).count());
  }

 private:
  const SparseMatrix& a_;
  const SparseMatrix& p_;
  Eigen::SimplicialLDLT<SparseMatrix> ldlt_;
  bool analyzed_ = false;
};

// The least x > 0 with is_above(x), up to a factor of 1 + accuracy; false if
// that is not between 1e-30 and 1e30.
template <typename Test>
bool Bisect(Test is_above, double accuracy, double* x) {
  double low = 1.0, high = 1.0;
  while (!is_above(high)) {
    low = high;
    high *= 32.0;
    if (high > 1e30) return false;
  }
  while (low == high || is_above(low)) {
    high = low;
    low /= 32.0;
    if (low < 1e-30) return false;
  }
  while (high > low * (1.0 + accuracy)) {
    const double middle = std::sqrt(low * high);
    (is_above(middle) ? high : low) = middle;
  }
  *x = std::sqrt(low * high);
  return true;
}

}  // namespace

double Condition::Number() const {
  return found && lowest > kZero * highest
             ? highest / lowest
             : std::numeric_limits<double>::infinity();
}

Condition ComputeCondition(const SparseMatrix& a_given,
                           const SparseMatrix& p_given,
                           const MatrixXd& null_space,
                           const ConditionOptions& options) {
  Condition result;
  const auto failed = [&result](const std::string& why) {
    result.message = why;
    return result;
  };
  const Index n = a_given.rows();
  const auto q = static_cast<int>(null_space.cols());
  result.dimensions = static_cast<int>(n) - q;
  if (result.dimensions < 3) return failed("too few dimensions");
  // Spectra's thresholds are absolute.
  const double a_unit = NormalizingPower(a_given, 0.0);
  const double p_unit = NormalizingPower(p_given, 0.0);
  SparseMatrix a = a_unit * a_given;
  SparseMatrix p = p_unit * p_given;
  const double unit = p_unit / a_unit;
  ChangeBasis(null_space, &a, &p);
  MatrixXd last = MatrixXd::Zero(n, q);
  last.bottomRows(q).setIdentity();

  Inertia inertia(a, p);
  // Eigenvalues of the complement below x: without the zeros left out.
  const auto below = [&](double x) {
    const int count = inertia.Below(x);
    return count < 0 || x < 0.0 ? count : count - q;
  };
  const int all = result.dimensions;

  Metric metric(p, last);
  if (!metric.Factorize()) return failed("P is not positive definite");
  double highest = 0.0;
  {
    Product product(a);
    using Solver = Spectra::
        SymGEigsSolver<Product, Metric, Spectra::GEigsMode::RegularInverse>;
    const bool found = RunLanczos(
        metric,
        all,
        options.max_restarts,
        [&](Index columns) { return Solver(product, metric, 1, columns); },
        &highest);
    const double width = options.accuracy * highest;
    if (!found || !(highest > 0.0) || below(highest + width) != all ||
        below(highest - width) >= all) {
      const auto is_above = [&](double x) { return below(x) == all; };
      if (!Bisect(is_above, options.accuracy, &highest)) {
        return failed("the highest eigenvalue was not found");
      }
    }
  }
  const double zero = kZero * highest;
  Inverse inverse(a, p, metric);
  double s = kFirstShift * highest;
  int tries = 0;
  while (!inverse.Factorize(s)) {
    if (++tries > kMaxShifts) return failed("no shift is enough");
    s *= kShiftGrowth;
  }
  double lowest = 0.0;
  {
    using Solver = Spectra::
        SymGEigsShiftSolver<Inverse, Metric, Spectra::GEigsMode::ShiftInvert>;
    const bool found = RunLanczos(
        metric,
        all,
        options.max_restarts,
        [&](Index columns) { return Solver(inverse, metric, 1, columns, -s); },
        &lowest);
    const double width = options.accuracy * std::abs(lowest);
    if (!found || width == 0.0 || below(lowest - width) != 0 ||
        below(lowest + width) < 1) {
      const bool negative = below(-zero) > 0;
      const auto is_above = [&](double x) {
        return negative ? below(-x) == 0 : below(x) > 0;
      };
      if (below(zero) > 0 && !negative) {
        lowest = 0.0;
      } else if (!Bisect(is_above, options.accuracy, &lowest)) {
        return failed("the lowest eigenvalue was not found");
      } else if (negative) {
        lowest = -lowest;
      }
    }
  }
  const double clearly = std::max(zero, kClearly * std::abs(lowest));
  result.negative = lowest < -zero ? below(-clearly) : 0;
  result.below = below(options.low / unit);
  const int not_above = below(options.high / unit);
  if (result.negative < 0 || result.below < 0 || not_above < 0) {
    return failed("eigenvalues could not be counted");
  }
  result.above = result.dimensions - not_above;
  result.lowest = lowest * unit;
  result.highest = highest * unit;
  result.found = true;
  return result;
}

}  // namespace granopt
