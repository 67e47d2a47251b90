#include "solvers/linear_solver.h"

#include <cmath>
#include <vector>

#include "solvers/sparse_cholesky.h"
namespace granopt {
namespace {
class Direct : public LinearSolver {
 public:
  bool Factorize(const SparseMatrix& lower,
                 std::int64_t v,
                 double shift) override {
    ++factorizations_;
    double largest = 0;
    for (int j = 0; j < lower.outerSize(); ++j)
      for (SparseMatrix::InnerIterator it(lower, j); it; ++it)
        if (it.row() == j) largest = std::max(largest, it.value() + shift);
    scale_ = largest > 0 ? std::exp2(-std::floor(std::log2(largest))) : 1;
    SparseMatrix a = lower * scale_;
    return c_.Factorize(a, v, shift * scale_);
  }
  void Solve(const double* b, double* x, int columns) override {
    ++solves_;
    const int n = n_ = n_;
    (void)n;
    SolveN(b, x, columns);
  }
  void SolveN(const double* b, double* x, int columns) {
    const int n = c_.size();
    std::vector<double> t(n), u(n);
    for (int c = 0; c < columns; ++c) {
      for (int i = 0; i < n; ++i) t[i] = b[columns * i + c];
      c_.Solve(t.data(), u.data());
      for (int i = 0; i < n; ++i) x[columns * i + c] = u[i] * scale_;
    }
  }
  int n_ = 0;
  double scale_ = 1;
  SparseCholesky c_;
};
}  // namespace
std::unique_ptr<LinearSolver> MakeLinearSolver(Parameters*) {
  return std::make_unique<Direct>();
}
}  // namespace granopt
