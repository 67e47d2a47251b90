// The diagonal blocks of the Hessian, one a point.
//
// Deviations: eigenvalues of a block are replaced by their magnitudes and
// bounded below, since a block may be indefinite or (for a point that nothing
// touches) zero, on which a diagonal scaling breaks.

#include <algorithm>
#include <string>
#include <vector>

#include "Eigen/Eigenvalues"
#include "solvers/preconditioner.h"
#include "solvers/registry.h"
#include "solvers/second_order.h"

namespace granopt {
namespace {

class BlockJacobi : public Preconditioner {
 public:
  explicit BlockJacobi(Parameters* parameters)
      : floor_(parameters->Double(
            "floor",
            0.1,
            1e-6,
            1e6,
            "least eigenvalue of a block, in units of the stiffness scale")),
        every_(parameters->Int(
            "every", 20, 1, "iterations between two evaluations of H")) {}

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const SecondOrderFunction*>(&function) != nullptr) {
      return true;
    }
    *error =
        "preconditioner block_jacobi needs a function with second derivatives";
    return false;
  }

  bool Update(const Iterate& at,
              const double* step,
              Monitor* monitor) override {
    if (step != nullptr && ++steps_ < every_) return false;
    steps_ = 0;
    const auto* function =
        dynamic_cast<const SecondOrderFunction*>(monitor->function());
    const Monitor::LinearTimer timer(monitor);
    n_ = monitor->n();
    size_ = function->BlockSize();
    const bool has_scale = at.scales.gradient > 0.0 && at.scales.length > 0.0;
    const double stiffness =
        has_scale ? at.scales.gradient / at.scales.length : 1.0;
    blocks_.assign(n_ / size_, stiffness * Block::Identity(size_, size_));
    inverses_.assign(n_ / size_, Block::Identity(size_, size_) / stiffness);
    if (!has_scale || !function->EvaluateHessian(at.x, &hessian_)) {
      ++num_fallbacks_;
      return true;
    }
    ++monitor->counters().hessians;
    const double least = floor_ * stiffness;
    for (int b = 0; b < n_ / size_; ++b) {
      Block h = Block::Zero(size_, size_);
      for (int c = 0; c < size_; ++c) {
        for (SparseMatrix::InnerIterator it(hessian_, size_ * b + c);
             it && it.row() < size_ * (b + 1);
             ++it) {
          h(it.row() - size_ * b, c) = it.value();
        }
      }
      const Eigen::SelfAdjointEigenSolver<Block> eigen(h);  // lower triangle
      const Eigen::VectorXd values =
          eigen.eigenvalues().cwiseAbs().cwiseMax(least);
      const Block& v = eigen.eigenvectors();
      blocks_[b] = v * values.asDiagonal() * v.transpose();
      inverses_[b] = v * values.cwiseInverse().asDiagonal() * v.transpose();
    }
    return true;
  }

  void Solve(const double* r, double* z, Monitor* monitor) override {
    const Monitor::LinearTimer timer(monitor);
    Apply(inverses_, r, z);
    ++monitor->counters().solves;
  }
  void Multiply(const double* v, double* pv) const override {
    Apply(blocks_, v, pv);
  }

 private:
  using Block = Eigen::MatrixXd;

  void Apply(const std::vector<Block>& matrices,
             const double* in,
             double* out) const {
    for (std::size_t b = 0; b < matrices.size(); ++b) {
      for (int r = 0; r < size_; ++r) {
        double sum = 0.0;
        for (int c = 0; c < size_; ++c) {
          sum += matrices[b](r, c) * in[size_ * b + c];
        }
        out[size_ * b + r] = sum;
      }
    }
  }

  const double floor_;
  const int every_;
  int steps_ = 0;
  int n_ = 0;
  int size_ = 1;
  SparseMatrix hessian_;
  std::vector<Block> blocks_, inverses_;
};

}  // namespace

REGISTER_PRECONDITIONER(block_jacobi,
                        BlockJacobi,
                        "diagonal blocks of the second derivatives",
                        "Saad, Iterative Methods for Sparse Linear Systems, "
                        "2nd ed. (2003), 4.1.1");

}  // namespace granopt
