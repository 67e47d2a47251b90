#include "solvers/lowest_modes.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <vector>

#include "Eigen/Cholesky"
#include "Eigen/Eigenvalues"
#include "Eigen/QR"
#include "Spectra/SymEigsSolver.h"
#include "solvers/format.h"
#include "solvers/normalize.h"
#include "solvers/random.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Up to this size, or if most pairs are wanted, a dense method is faster and
// has no way to fail.
constexpr Index kDenseSize = 48;

// The first shift and by how much it grows, in units of |A|.
constexpr double kFirstShift = 1e-10;
constexpr double kShiftGrowth = 16.0;

// Of Ritz values of the inverse, relative: for the rough run that refines the
// shift and for the others. A step of inverse iteration follows the latter.
constexpr double kRoughTolerance = 1e-3;
constexpr double kRitzTolerance = 1e-10;

// A vector found later counts as new if its value is lower than the last one
// wanted by more than this part of |A|.
constexpr double kSameValue = 1e-13;

// Where few eigenvalues are distinct, rounding decides all directions but a
// few, and Spectra's small eigenproblem may fail to converge: it throws.
// Another start and size help.
constexpr int kAttempts = 4;

// Orthonormal columns that span those of m.
MatrixXd Orthonormal(const MatrixXd& m) {
  if (m.cols() == 0) return MatrixXd(m.rows(), 0);
  const Eigen::HouseholderQR<MatrixXd> qr(m);
  return qr.householderQ() * MatrixXd::Identity(m.rows(), m.cols());
}

void Orient(MatrixXd* vectors) {
  for (Index c = 0; c < vectors->cols(); ++c) {
    Index largest = 0;
    vectors->col(c).cwiseAbs().maxCoeff(&largest);
    if ((*vectors)(largest, c) < 0.0) vectors->col(c) = -vectors->col(c);
  }
}

// The matrix, normalized, and what is left out.
class Problem {
 public:
  Problem(const SparseMatrix& lower, const MatrixXd& left_out)
      : matrix_(lower), q_(Orthonormal(left_out)) {
    VectorXd sums = VectorXd::Zero(lower.rows());
    for (Index j = 0; j < lower.outerSize(); ++j) {
      for (SparseMatrix::InnerIterator it(lower, j); it; ++it) {
        sums[it.row()] += std::abs(it.value());
        if (it.row() != j) sums[j] += std::abs(it.value());
      }
    }
    // A sum keeps a NaN that a maximum may lose.
    finite_ = std::isfinite(sums.sum());
    norm_ = sums.size() > 0 ? sums.maxCoeff() : 0.0;
    unit_ = NormalizingPower(norm_);
    if (finite_) matrix_.coeffs() *= unit_;
  }

  bool finite() const { return finite_; }
  Index size() const { return matrix_.rows(); }
  Index dimensions() const { return size() - q_.cols(); }
  double norm() const { return norm_; }
  double unit() const { return unit_; }
  const SparseMatrix& matrix() const { return matrix_; }
  const MatrixXd& q() const { return q_; }

  MatrixXd Project(MatrixXd v) const {
    if (q_.cols() > 0) v -= q_ * (q_.transpose() * v);
    return v;
  }
  MatrixXd Times(const MatrixXd& v) const {
    return Project(matrix_.selfadjointView<Eigen::Lower>() * v);
  }

 private:
  SparseMatrix matrix_;
  const MatrixXd q_;
  bool finite_ = true;
  double norm_ = 0.0;
  double unit_ = 1.0;
};

// The inverse of A + shift 1 in the complement of Q and of vectors found.
class Inverse {
 public:
  using Scalar = double;  // Spectra asks for it

  explicit Inverse(const Problem& problem)
      : problem_(problem),
        found_(problem.size(), 0),
        t_(problem.size()),
        z_(problem.size()) {}

  bool Factorize(double shift) {
    ++factorizations_;
    shift_ = shift;
    if (!cholesky_.Factorize(problem_.matrix(), 1, shift)) return false;
    const MatrixXd& q = problem_.q();
    kq_.resize(q.rows(), q.cols());
    for (Index c = 0; c < q.cols(); ++c) {
      cholesky_.Solve(q.col(c).data(), kq_.col(c).data());
      ++solves_;
    }
    if (q.cols() > 0) qkq_.compute(q.transpose() * kq_);
    return true;
  }

  void LeaveOut(const MatrixXd& found) { found_ = found; }

  Index rows() const { return problem_.size(); }
  Index cols() const { return problem_.size(); }
  void perform_op(const double* x, double* y) const {
    const Index n = rows();
    t_ = problem_.Project(Eigen::Map<const VectorXd>(x, n));
    if (found_.cols() > 0) t_ -= found_ * (found_.transpose() * t_);
    cholesky_.Solve(t_.data(), z_.data());
    ++solves_;
    if (kq_.cols() > 0) {
      z_ -= kq_ * qkq_.solve(problem_.q().transpose() * z_);
      z_ = problem_.Project(z_);
    }
    if (found_.cols() > 0) z_ -= found_ * (found_.transpose() * z_);
    Eigen::Map<VectorXd>(y, n) = z_;
  }

  double shift() const { return shift_; }
  std::int64_t factorizations() const { return factorizations_; }
  std::int64_t solves() const { return solves_; }

 private:
  const Problem& problem_;
  MatrixXd found_;
  mutable SparseCholesky cholesky_;
  MatrixXd kq_;
  Eigen::LDLT<MatrixXd> qkq_;
  double shift_ = 0.0;
  mutable VectorXd t_, z_;
  std::int64_t factorizations_ = 0;
  mutable std::int64_t solves_ = 0;
};

// Eigenvectors of the `count` largest eigenvalues of the inverse; `values` are
// those of A. Fewer, with a line in `message`, if it did not converge.
bool RunLanczos(const Problem& problem,
                Inverse* inverse,
                Index count,
                int max_restarts,
                double tolerance,
                Index dimensions,
                VectorXd* values,
                MatrixXd* vectors,
                std::string* message) {
  const Index n = problem.size();
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Index columns =
        std::min(dimensions, std::max(2 * count + 1, count + 20) + 7 * attempt);
    UniformRandom random(1 + attempt);
    VectorXd start(n);
    for (double& entry : start) entry = 2.0 * random() - 1.0;
    start = problem.Project(start);
    try {
      Spectra::SymEigsSolver<Inverse> lanczos(*inverse, count, columns);
      lanczos.init(start.data());
      lanczos.compute(Spectra::SortRule::LargestAlge, max_restarts, tolerance);
      *values = lanczos.eigenvalues().cwiseInverse().array() - inverse->shift();
      *vectors = lanczos.eigenvectors();
      if (lanczos.info() == Spectra::CompInfo::Successful) return true;
      *message = Format("%d of %d eigenpairs after %d restarts",
                        static_cast<int>(values->size()),
                        static_cast<int>(count),
                        max_restarts);
      return false;
    } catch (const std::exception& e) {
      values->resize(0);
      vectors->resize(n, 0);
      *message = std::string("Lanczos failed: ") + e.what();
    }
  }
  return false;
}

// The lowest `count` pairs within the span of `basis`.
void RayleighRitz(const Problem& problem,
                  const MatrixXd& basis,
                  Index count,
                  VectorXd* values,
                  MatrixXd* vectors) {
  const MatrixXd v = Orthonormal(problem.Project(basis));
  MatrixXd small = v.transpose() * problem.Times(v);
  small = (0.5 * (small + small.transpose())).eval();
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(small);
  count = std::min(count, v.cols());
  *values = solver.eigenvalues().head(count);
  *vectors = v * solver.eigenvectors().leftCols(count);
}

// A step of inverse iteration takes what is left of high eigenvectors out.
MatrixXd Polished(const Inverse& inverse, const MatrixXd& vectors) {
  MatrixXd result(vectors.rows(), vectors.cols());
  for (Index c = 0; c < vectors.cols(); ++c) {
    inverse.perform_op(vectors.col(c).data(), result.col(c).data());
  }
  // Alike in size: all of them count in what spans their space.
  for (Index c = 0; c < vectors.cols(); ++c) result.col(c).normalize();
  return result;
}

bool FindSparse(const Problem& problem,
                const LowestModesOptions& options,
                Index count,
                Inverse* inverse,
                VectorXd* values,
                MatrixXd* vectors,
                std::string* message) {
  double shift = kFirstShift * problem.norm() * problem.unit();
  if (shift == 0.0) shift = 1.0;  // A = 0
  bool indefinite = false;
  while (!inverse->Factorize(shift)) {
    indefinite = true;
    // A + |A| 1 is positive semidefinite.
    if (shift > 2.0 * kShiftGrowth) {
      *message = "no shift makes the matrix positive definite";
      return false;
    }
    shift *= kShiftGrowth;
  }
  if (indefinite) {
    std::string ignored;
    RunLanczos(problem,
               inverse,
               1,
               options.max_restarts,
               kRoughTolerance,
               problem.dimensions(),
               values,
               vectors,
               &ignored);
    if (values->size() > 0) {
      const double lowest = (*values)[0];
      const double closer = -lowest + 0.01 * (lowest + shift);
      if (closer > 0.0 && closer < shift && !inverse->Factorize(closer) &&
          !inverse->Factorize(shift)) {
        *message = "no shift makes the matrix positive definite";
        return false;
      }
    }
  }
  if (!RunLanczos(problem,
                  inverse,
                  count,
                  options.max_restarts,
                  kRitzTolerance,
                  problem.dimensions(),
                  values,
                  vectors,
                  message)) {
    return false;
  }
  RayleighRitz(problem, Polished(*inverse, *vectors), count, values, vectors);
  // Further vectors of multiple eigenvalues.
  while (count > 1) {
    const Index left = problem.dimensions() - vectors->cols();
    const Index more = std::min((count + 1) / 2, left - 1);
    if (more < 1) break;
    VectorXd new_values;
    MatrixXd new_vectors;
    inverse->LeaveOut(*vectors);
    const bool done = RunLanczos(problem,
                                 inverse,
                                 more,
                                 options.max_restarts,
                                 kRitzTolerance,
                                 left,
                                 &new_values,
                                 &new_vectors,
                                 message);
    if (done) new_vectors = Polished(*inverse, new_vectors);
    inverse->LeaveOut(MatrixXd(problem.size(), 0));
    if (!done) return false;
    const double last = (*values)[count - 1];
    RayleighRitz(problem, new_vectors, more, &new_values, &new_vectors);
    const bool complete = !(new_values[0] < last - kSameValue);
    MatrixXd both(problem.size(), vectors->cols() + more);
    both << *vectors, new_vectors;
    RayleighRitz(problem, both, count, values, vectors);
    if (complete) break;
  }
  return true;
}

}  // namespace

LowestModes ComputeLowestModes(const SparseMatrix& lower,
                               const LowestModesOptions& options) {
  LowestModes modes;
  const Problem problem(lower, options.left_out);
  modes.norm = problem.norm();
  modes.vectors.resize(problem.size(), 0);
  if (!problem.finite()) {
    modes.norm = 0.0;
    modes.message = "the matrix is not finite";
    return modes;
  }
  const Index dimensions = problem.dimensions();
  const Index count = std::min<Index>(std::max(options.count, 0), dimensions);
  if (count <= 0) {
    modes.converged = true;
    return modes;
  }
  bool found = true;
  if (problem.size() <= kDenseSize || 2 * count + 1 >= dimensions) {
    // An orthonormal basis of the complement: the last columns of a full Q.
    MatrixXd basis = MatrixXd::Identity(problem.size(), problem.size());
    if (problem.q().cols() > 0) {
      const Eigen::HouseholderQR<MatrixXd> qr(problem.q());
      basis = qr.householderQ() * basis;
    }
    RayleighRitz(problem,
                 basis.rightCols(dimensions),
                 count,
                 &modes.values,
                 &modes.vectors);
  } else {
    Inverse inverse(problem);
    found = FindSparse(problem,
                       options,
                       count,
                       &inverse,
                       &modes.values,
                       &modes.vectors,
                       &modes.message);
    modes.shift = inverse.shift() / problem.unit();
    modes.factorizations = inverse.factorizations();
    modes.solves = inverse.solves();
  }
  Orient(&modes.vectors);
  const Index pairs = modes.vectors.cols();
  modes.residuals.resize(pairs);
  const MatrixXd images = problem.Times(modes.vectors);
  for (Index c = 0; c < pairs; ++c) {
    modes.residuals[c] =
        (images.col(c) - modes.values[c] * modes.vectors.col(c)).norm();
  }
  const double bound = options.tolerance * problem.norm() * problem.unit();
  modes.converged = found && (modes.residuals.array() <= bound).all();
  if (found && !modes.converged) {
    modes.message =
        Format("residual %.1e |A| > %.1e",
               modes.residuals.maxCoeff() / bound * options.tolerance,
               options.tolerance);
  }
  modes.values /= problem.unit();
  modes.residuals /= problem.unit();
  return modes;
}

}  // namespace granopt
