#include "solvers/sparse_cholesky.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "solvers/multifrontal_cholesky.h"
#include "solvers/normalize.h"
#include "solvers/one_thread.h"
#include "solvers/reverse_cuthill_mckee.h"

#ifdef GRANOPT_HAVE_CHOLMOD
#include <cholmod.h>
#else
#include "Eigen/OrderingMethods"
#include "Eigen/SparseCholesky"
#endif

namespace granopt {

#ifdef GRANOPT_HAVE_CHOLMOD
class SparseCholesky::Backend {
 public:
  explicit Backend(Ordering ordering) : ordering_(ordering) {
    cholmod_start(&common_);
    // CHOLMOD's default for small matrices is LDL^T, which accepts indefinite
    // matrices without a word; LL^T says so. Its messages would go to stdout.
    common_.final_ll = 1;
    common_.print = 0;
    // Large matrices are factored by dense blocks (supernodes), but solves with
    // single columns of L take half the time of solves with blocks. Zeros that
    // the blocks are padded with are dropped, except from a band, where they
    // keep columns alike.
    common_.final_asis = 0;
    common_.final_super = 0;
    common_.final_pack = 1;
    common_.final_monotonic = 1;
    common_.final_resymbol = ordering == Ordering::RCM ? 0 : 1;
    common_.quick_return_if_not_posdef = 1;
    // One ordering: trying METIS as well costs more than it gains below 10^5
    // unknowns.
    common_.nmethods = 1;
    common_.method[0].ordering = ordering == Ordering::METIS ? CHOLMOD_METIS
                                 : ordering == Ordering::RCM ? CHOLMOD_GIVEN
                                                             : CHOLMOD_AMD;
    common_.postorder = 1;
  }
  ~Backend() {
    cholmod_free_dense(&solution_, &common_);
    cholmod_free_dense(&work_y_, &common_);
    cholmod_free_dense(&work_e_, &common_);
    cholmod_free_factor(&factor_, &common_);
    cholmod_free_factor(&symbolic_, &common_);
    cholmod_finish(&common_);
  }
  Backend(const Backend&) = delete;
  Backend& operator=(const Backend&) = delete;

  bool Analyze(const SparseMatrix& lower) {
    cholmod_free_factor(&factor_, &common_);
    cholmod_free_factor(&symbolic_, &common_);
    cholmod_sparse a = Sparse(lower, lower.valuePtr());
    std::vector<int> order;
    if (ordering_ == Ordering::RCM) order = ReverseCuthillMcKee(lower);
    symbolic_ = cholmod_analyze_p(
        &a, order.empty() ? nullptr : order.data(), nullptr, 0, &common_);
    if (symbolic_ == nullptr) return false;
    factor_ = cholmod_copy_factor(symbolic_, &common_);
    return factor_ != nullptr;
  }

  bool Factorize(const SparseMatrix& lower,
                 const double* values,
                 double shift) {
    cholmod_sparse a = Sparse(lower, values);
    double beta[2] = {shift, 0.0};
    if (symbolic_->is_super) {
      cholmod_free_factor(&factor_, &common_);
      factor_ = cholmod_copy_factor(symbolic_, &common_);
      if (factor_ == nullptr) return false;
    }
    [[maybe_unused]] const OneThread one_thread;
    cholmod_factorize_p(&a, beta, nullptr, 0, factor_, &common_);
    return common_.status == CHOLMOD_OK && factor_->minor == factor_->n;
  }

  // One column after the other. The result lives until the next call.
  const double* Solve(const double* b, int columns) {
    cholmod_dense right = {};
    right.nrow = factor_->n;
    right.ncol = static_cast<std::size_t>(columns);
    right.nzmax = right.nrow * right.ncol;
    right.d = right.nrow;
    right.x = const_cast<double*>(b);
    right.xtype = CHOLMOD_REAL;
    right.dtype = CHOLMOD_DOUBLE;
    // Keeps the solution and both work spaces from one solve to the next.
    cholmod_solve2(CHOLMOD_A,
                   factor_,
                   &right,
                   nullptr,
                   &solution_,
                   nullptr,
                   &work_y_,
                   &work_e_,
                   &common_);
    return static_cast<const double*>(solution_->x);
  }

  std::int64_t NumNonzeros() const {
    return static_cast<std::int64_t>(common_.lnz);
  }

  // Values and row numbers; before that, those of the blocks with their
  // padding, which are turned into columns while both exist.
  double Bytes() const {
    double bytes = common_.lnz * (sizeof(double) + sizeof(int));
    if (symbolic_->is_super) {
      bytes += sizeof(double) *
                   static_cast<double>(symbolic_->xsize + symbolic_->maxcsize) +
               sizeof(int) * static_cast<double>(symbolic_->ssize);
    }
    return bytes;
  }

 private:
  static cholmod_sparse Sparse(const SparseMatrix& lower,
                               const double* values) {
    cholmod_sparse a = {};
    a.nrow = static_cast<std::size_t>(lower.rows());
    a.ncol = static_cast<std::size_t>(lower.cols());
    a.nzmax = static_cast<std::size_t>(lower.nonZeros());
    a.p = const_cast<int*>(lower.outerIndexPtr());
    // Null pointers are refused, even where there is nothing to point to.
    static int no_row = 0;
    static double no_value = 0.0;
    a.i = a.nzmax == 0 ? &no_row : const_cast<int*>(lower.innerIndexPtr());
    a.x = a.nzmax == 0 ? &no_value : const_cast<double*>(values);
    a.stype = -1;
    a.itype = CHOLMOD_INT;
    a.xtype = CHOLMOD_REAL;
    a.dtype = CHOLMOD_DOUBLE;
    a.sorted = 1;
    a.packed = 1;
    return a;
  }

  const Ordering ordering_;
  cholmod_common common_;
  // A factor by blocks that has been turned into columns cannot be used again:
  // the analysis is kept as it was.
  cholmod_factor* symbolic_ = nullptr;
  cholmod_factor* factor_ = nullptr;
  cholmod_dense* solution_ = nullptr;
  cholmod_dense* work_y_ = nullptr;
  cholmod_dense* work_e_ = nullptr;
};

bool SparseCholesky::Has(Ordering) { return true; }

std::string SparseCholesky::Library() {
  int version[3];
  cholmod_version(version);
  return "CHOLMOD " + std::to_string(version[0]) + "." +
         std::to_string(version[1]) + "." + std::to_string(version[2]);
}

#else

class SparseCholesky::Backend {
 public:
  explicit Backend(Ordering ordering) : ordering_(ordering) {}

  bool Analyze(const SparseMatrix& lower) {
    // Both conventions name the inverse: order_ takes old places to new ones.
    if (ordering_ == Ordering::RCM) {
      const std::vector<int> order = ReverseCuthillMcKee(lower);
      order_.resize(lower.cols());
      for (int k = 0; k < lower.cols(); ++k) order_.indices()[order[k]] = k;
    } else {
      Permutation inverse;
      Eigen::AMDOrdering<int>()(lower.selfadjointView<Eigen::Lower>(), inverse);
      order_ = inverse.inverse();
    }
    Permute(lower);
    num_entries_ = CountEntries();
    is_analyzed_ = false;
    return true;
  }

  bool Factorize(const SparseMatrix& lower,
                 const double* values,
                 double shift) {
    Permute(Eigen::Map<const SparseMatrix>(lower.rows(),
                                           lower.cols(),
                                           lower.nonZeros(),
                                           lower.outerIndexPtr(),
                                           lower.innerIndexPtr(),
                                           values));
    // Here, since it allocates the factor.
    if (!is_analyzed_) ldlt_.analyzePattern(upper_);
    is_analyzed_ = true;
    ldlt_.setShift(shift);
    ldlt_.factorize(upper_);
    // LDL^T exists for indefinite matrices too: the signs of D decide.
    return ldlt_.info() == Eigen::Success && ldlt_.vectorD().minCoeff() > 0.0;
  }

  // One column after the other. The result lives until the next call.
  const double* Solve(const double* b, int columns) {
    const Eigen::Index n = ldlt_.rows();
    permuted_ = order_ * Eigen::Map<const Eigen::MatrixXd>(b, n, columns);
    permuted_ = ldlt_.solve(permuted_);
    solution_ = order_.transpose() * permuted_;
    return solution_.data();
  }

  double Bytes() const { return num_entries_ * (sizeof(double) + sizeof(int)); }

  std::int64_t NumNonzeros() {
    return ldlt_.matrixL().nestedExpression().nonZeros() + ldlt_.rows();
  }

 private:
  using Permutation =
      Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int>;

  // Entries of L by its rows: row k is a subtree of the elimination tree, with
  // the leaves that column k of the upper triangle names (Davis, Direct Methods
  // for Sparse Linear Systems (2006), 4.2).
  double CountEntries() const {
    const auto n = static_cast<int>(upper_.cols());
    std::vector<int> parent(n, -1), seen(n, -1);
    double count = n;
    for (int k = 0; k < n; ++k) {
      seen[k] = k;
      for (SparseMatrix::InnerIterator it(upper_, k); it; ++it) {
        for (auto i = static_cast<int>(it.row()); i < k && seen[i] != k;
             i = parent[i]) {
          if (parent[i] < 0) parent[i] = k;
          seen[i] = k;
          ++count;
        }
      }
    }
    return count;
  }

  template <typename Matrix>
  void Permute(const Matrix& lower) {
    upper_.resize(lower.rows(), lower.cols());
    upper_.selfadjointView<Eigen::Upper>() =
        lower.template selfadjointView<Eigen::Lower>().twistedBy(order_);
  }

  const Ordering ordering_;
  Permutation order_;
  SparseMatrix upper_;
  Eigen::SimplicialLDLT<SparseMatrix, Eigen::Upper, Eigen::NaturalOrdering<int>>
      ldlt_;
  Eigen::MatrixXd permuted_, solution_;
  double num_entries_ = 0.0;
  bool is_analyzed_ = false;
};

bool SparseCholesky::Has(Ordering ordering) {
  return ordering != Ordering::METIS;
}

std::string SparseCholesky::Library() {
  return "Eigen " + std::to_string(EIGEN_WORLD_VERSION) + "." +
         std::to_string(EIGEN_MAJOR_VERSION) + "." +
         std::to_string(EIGEN_MINOR_VERSION) + " SimplicialLDLT";
}

#endif

namespace {

// Above this many multiplications the large fronts decide, for which the
// library's BLAS has kernels that ours are no match for: with 3e9 of them (8000
// points in space, 3 x 3 blocks) ours takes 0.4 of the time with that ordering,
// with 5e10 (20000) 1.4 times.
constexpr double kMostFlops = 1e10;

// The last pattern that our own factor was given and what it made of it: the
// next solve of a sequence often begins with the same pattern, and an analysis
// takes the time of two factors. It is a function of the pattern alone, so that
// no result depends on what was solved before.
struct LastAnalysis {
  std::vector<int> start, row;
  MultifrontalCholesky symbolic;  // never factored

  bool IsOf(const SparseMatrix& lower) const {
    return std::equal(start.begin(),
                      start.end(),
                      lower.outerIndexPtr(),
                      lower.outerIndexPtr() + lower.cols() + 1) &&
           std::equal(row.begin(),
                      row.end(),
                      lower.innerIndexPtr(),
                      lower.innerIndexPtr() + lower.nonZeros());
  }

  bool Analyze(const SparseMatrix& lower) {
    start.clear();
    if (!symbolic.Analyze(lower)) return false;
    start.assign(lower.outerIndexPtr(),
                 lower.outerIndexPtr() + lower.cols() + 1);
    row.assign(lower.innerIndexPtr(), lower.innerIndexPtr() + lower.nonZeros());
    return true;
  }
};

LastAnalysis& LastOfThisThread() {
  thread_local LastAnalysis last;
  return last;
}

}  // namespace

SparseCholesky::SparseCholesky(Ordering ordering, Factorizer factorizer)
    : ordering_(ordering), wanted_(factorizer) {}
SparseCholesky::~SparseCholesky() = default;

void SparseCholesky::ForgetAnalysis() { LastOfThisThread() = LastAnalysis(); }

bool SparseCholesky::Analyze(const SparseMatrix& lower) {
  if (ordering_ == Ordering::AMD && wanted_ != Factorizer::LIBRARY) {
    LastAnalysis& last = LastOfThisThread();
    const bool recalls = last.IsOf(lower);
    if (recalls) ++num_recalled_;
    // Without blocks its supernodes are too small to make up for what they are
    // padded with, in solves above all.
    if ((recalls || last.Analyze(lower)) &&
        (wanted_ == Factorizer::MULTIFRONTAL ||
         (last.symbolic.block_size() > 1 &&
          last.symbolic.flops() <= kMostFlops))) {
      if (multifrontal_ == nullptr) {
        multifrontal_ = std::make_unique<MultifrontalCholesky>();
      }
      *multifrontal_ = last.symbolic;
      bytes_ = multifrontal_->Bytes();
      return true;
    }
    multifrontal_ = nullptr;
  }
  if (backend_ == nullptr) backend_ = std::make_unique<Backend>(ordering_);
  if (!backend_->Analyze(lower)) return false;
  bytes_ = backend_->Bytes();
  return true;
}

bool SparseCholesky::Factorize(const SparseMatrix& lower,
                               std::int64_t pattern_version,
                               double shift) {
  scale_ = NormalizingPower(lower, shift);
  const auto count = static_cast<std::size_t>(lower.nonZeros());
  values_.resize(count);
  shift *= scale_;
  // A NaN passes through both libraries unnoticed.
  double probe = shift - shift;
  for (std::size_t k = 0; k < count; ++k) {
    values_[k] = scale_ * lower.valuePtr()[k];
    probe += values_[k] - values_[k];
  }
  if (probe != 0.0) return false;
  if (pattern_version != analyzed_version_ || size_ != lower.rows()) {
    size_ = -1;
    bytes_ = 0.0;
    if (lower.rows() > 0 && !Analyze(lower)) return false;
    analyzed_version_ = pattern_version;
    size_ = static_cast<int>(lower.rows());
    ++num_analyses_;
  }
  num_nonzeros_ = 0;
  if (size_ == 0) return true;
  if (ExceedsMemory()) return false;
  if (multifrontal_ != nullptr) {
    if (!multifrontal_->Factorize(values_.data(), shift)) return false;
    num_nonzeros_ = multifrontal_->num_nonzeros();
    return true;
  }
  if (!backend_->Factorize(lower, values_.data(), shift)) return false;
  num_nonzeros_ = backend_->NumNonzeros();
  return true;
}

void SparseCholesky::Solve(const double* b, double* x, int columns) {
  if (size_ == 0) return;
  const auto n = static_cast<std::size_t>(size_);
  const auto stride = static_cast<std::size_t>(columns);
  if (stride > 1) {
    columns_.resize(n * stride);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t c = 0; c < stride; ++c) {
        columns_[c * n + i] = b[i * stride + c];
      }
    }
    b = columns_.data();
  }
  const double* solution = nullptr;
  if (multifrontal_ != nullptr) {
    solution_.resize(n * stride);
    for (std::size_t c = 0; c < stride; ++c) {
      multifrontal_->Solve(b + c * n, solution_.data() + c * n);
    }
    solution = solution_.data();
  } else {
    solution = backend_->Solve(b, columns);
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < stride; ++c) {
      x[i * stride + c] = scale_ * solution[c * n + i];
    }
  }
}

}  // namespace granopt
