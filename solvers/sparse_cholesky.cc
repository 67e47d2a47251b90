#include "solvers/sparse_cholesky.h"

#include <algorithm>
#include <cmath>

#ifdef GRANOPT_HAVE_CHOLMOD
#include <cholmod.h>
#else
#include "Eigen/SparseCholesky"
#endif

namespace granopt {

#ifdef GRANOPT_HAVE_CHOLMOD

class SparseCholesky::Backend {
 public:
  Backend() {
    cholmod_start(&common_);
    // CHOLMOD's default for small matrices is LDL^T, which accepts indefinite
    // matrices without a word; LL^T says so. Its messages would go to stdout.
    common_.final_ll = 1;
    common_.print = 0;
    common_.quick_return_if_not_posdef = 1;
    // AMD alone: trying METIS as well costs more than it gains below 10^5
    // unknowns.
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_AMD;
    common_.postorder = 1;
  }
  ~Backend() {
    cholmod_free_factor(&factor_, &common_);
    cholmod_finish(&common_);
  }
  Backend(const Backend&) = delete;
  Backend& operator=(const Backend&) = delete;

  void Analyze(const SparseMatrix& lower) {
    cholmod_free_factor(&factor_, &common_);
    cholmod_sparse view = View(lower);
    factor_ = cholmod_analyze(&view, &common_);
  }

  bool Factorize(const SparseMatrix& lower, double shift) {
    cholmod_sparse view = View(lower);
    double beta[2] = {shift, 0.0};
    cholmod_factorize_p(&view, beta, nullptr, 0, factor_, &common_);
    return common_.status == CHOLMOD_OK && factor_->minor == factor_->n;
  }

  void Solve(const double* b, double* x) {
    const std::size_t n = factor_->n;
    cholmod_dense* right =
        cholmod_allocate_dense(n, 1, n, CHOLMOD_REAL, &common_);
    std::copy(b, b + n, static_cast<double*>(right->x));
    cholmod_dense* solution =
        cholmod_solve(CHOLMOD_A, factor_, right, &common_);
    const auto* values = static_cast<const double*>(solution->x);
    std::copy(values, values + n, x);
    cholmod_free_dense(&right, &common_);
    cholmod_free_dense(&solution, &common_);
  }

  std::int64_t NumNonzeros() const {
    return static_cast<std::int64_t>(common_.lnz);
  }

 private:
  static cholmod_sparse View(const SparseMatrix& lower) {
    cholmod_sparse view = {};
    view.nrow = static_cast<std::size_t>(lower.rows());
    view.ncol = static_cast<std::size_t>(lower.cols());
    view.nzmax = static_cast<std::size_t>(lower.nonZeros());
    view.p = const_cast<int*>(lower.outerIndexPtr());
    view.i = const_cast<int*>(lower.innerIndexPtr());
    view.x = const_cast<double*>(lower.valuePtr());
    view.stype = -1;
    view.itype = CHOLMOD_INT;
    view.xtype = CHOLMOD_REAL;
    view.dtype = CHOLMOD_DOUBLE;
    view.sorted = 1;
    view.packed = 1;
    return view;
  }

  cholmod_common common_;
  cholmod_factor* factor_ = nullptr;
};

std::string SparseCholesky::Library() {
  int version[3];
  cholmod_version(version);
  return "CHOLMOD " + std::to_string(version[0]) + "." +
         std::to_string(version[1]) + "." + std::to_string(version[2]);
}

#else

class SparseCholesky::Backend {
 public:
  void Analyze(const SparseMatrix& lower) { ldlt_.analyzePattern(lower); }

  bool Factorize(const SparseMatrix& lower, double shift) {
    ldlt_.setShift(shift);
    ldlt_.factorize(lower);
    // LDL^T exists for indefinite matrices too: the signs of D decide.
    return ldlt_.info() == Eigen::Success && ldlt_.vectorD().minCoeff() > 0.0;
  }

  void Solve(const double* b, double* x) {
    const Eigen::Index n = ldlt_.rows();
    const Eigen::VectorXd solution =
        ldlt_.solve(Eigen::Map<const Eigen::VectorXd>(b, n));
    std::copy(solution.data(), solution.data() + n, x);
  }

  std::int64_t NumNonzeros() {
    return ldlt_.matrixL().nestedExpression().nonZeros() + ldlt_.rows();
  }

 private:
  Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower> ldlt_;
};

std::string SparseCholesky::Library() {
  return "Eigen " + std::to_string(EIGEN_WORLD_VERSION) + "." +
         std::to_string(EIGEN_MAJOR_VERSION) + "." +
         std::to_string(EIGEN_MINOR_VERSION) + " SimplicialLDLT";
}

#endif

SparseCholesky::SparseCholesky() : backend_(std::make_unique<Backend>()) {}
SparseCholesky::~SparseCholesky() = default;

bool SparseCholesky::Factorize(const SparseMatrix& lower,
                               std::int64_t pattern_version,
                               double shift) {
  // A NaN passes through both libraries unnoticed.
  const double* values = lower.valuePtr();
  double probe = shift - shift;
  for (Eigen::Index k = 0; k < lower.nonZeros(); ++k) {
    probe += values[k] - values[k];
  }
  if (probe != 0.0) return false;
  if (pattern_version != analyzed_version_ || size_ != lower.rows()) {
    backend_->Analyze(lower);
    analyzed_version_ = pattern_version;
    size_ = static_cast<int>(lower.rows());
    ++num_analyses_;
  }
  if (!backend_->Factorize(lower, shift)) return false;
  num_nonzeros_ = backend_->NumNonzeros();
  return true;
}

void SparseCholesky::Solve(const double* b, double* x) {
  backend_->Solve(b, x);
}

}  // namespace granopt
