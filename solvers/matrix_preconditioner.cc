#include "solvers/matrix_preconditioner.h"

#include <algorithm>
#include <cmath>

#include "Eigen/Core"
#include "solvers/diagonal.h"

namespace granopt {
namespace {

// A shift that was not enough is raised to this part of the largest diagonal
// entry, then by this factor, this often.
constexpr double kFirstShift = 1e-3;
constexpr double kRaiseShift = 4.0;
constexpr int kMaxRaises = 12;

}  // namespace

MatrixPreconditioner::MatrixPreconditioner(Parameters* parameters)
    : linear_(MakeLinearSolver(parameters)) {}

bool MatrixPreconditioner::Update(const Iterate& at,
                                  const double* step,
                                  Monitor* monitor) {
  const int n = monitor->n();
  if (step != nullptr) {
    const auto* second =
        dynamic_cast<const SecondOrderFunction*>(monitor->function());
    const int block = second == nullptr ? 1 : second->BlockSize();
    double most2 = 0.0;
    for (int i = 0; i < n; i += block) {
      double moved2 = 0.0;
      for (int k = i; k < std::min(i + block, n); ++k) {
        displacement_[k] += step[k];
        moved2 += displacement_[k] * displacement_[k];
      }
      most2 = std::max(most2, moved2);
    }
    ++age_.steps;
    age_.moved = std::sqrt(most2);
    if (!IsStale(at, age_)) return false;
  }
  displacement_.assign(n, 0.0);
  age_ = Age();
  is_factored_ = Make(at, monitor);
  if (!is_factored_) {
    ++num_fallbacks_;
    const Scales& s = at.scales;
    identity_ =
        s.gradient > 0.0 && s.length > 0.0 ? s.gradient / s.length : 1.0;
  }
  return true;
}

bool MatrixPreconditioner::Make(const Iterate& at, Monitor* monitor) {
  if (!Assemble(at, monitor, &matrix_)) return false;
  const Monitor::LinearTimer timer(monitor);
  const SparseMatrix& a = matrix_.lower;
  double largest = 0.0;
  for (int j = 0; j < a.cols(); ++j) {
    const int place = DiagonalPlace(a, j);
    if (place >= 0) largest = std::max(largest, a.valuePtr()[place]);
  }
  const std::int64_t before = linear_->factorizations();
  bool done = false;
  for (int raise = 0; raise <= kMaxRaises && !done; ++raise) {
    if (raise > 0) {
      matrix_.shift =
          std::max(kRaiseShift * matrix_.shift, kFirstShift * largest);
    }
    done = linear_->Factorize(
        matrix_.lower, matrix_.pattern_version, matrix_.shift);
    if (!linear_->refusal().empty()) {
      monitor->RunOutOfMemory(linear_->refusal());
      break;
    }
  }
  monitor->counters().factorizations += linear_->factorizations() - before;
  return done;
}

void MatrixPreconditioner::Solve(const double* r, double* z, Monitor* monitor) {
  const Monitor::LinearTimer timer(monitor);
  const int n = monitor->n();
  if (!is_factored_) {
    for (int i = 0; i < n; ++i) z[i] = r[i] / identity_;
    return;
  }
  const std::int64_t iterations = linear_->iterations();
  linear_->Solve(r, z, matrix_.columns);
  if (matrix_.scale != 1.0) {
    for (int i = 0; i < n; ++i) z[i] /= matrix_.scale;
  }
  ++monitor->counters().solves;
  monitor->counters().linear_iterations += linear_->iterations() - iterations;
}

void MatrixPreconditioner::Multiply(const double* v, double* pv) const {
  if (!is_factored_) {
    for (std::size_t i = 0; i < displacement_.size(); ++i) {
      pv[i] = identity_ * v[i];
    }
    return;
  }
  using RowMajor =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Index rows = matrix_.lower.rows();
  const int columns = matrix_.columns;
  const Eigen::Map<const RowMajor> in(v, rows, columns);
  Eigen::Map<RowMajor> out(pv, rows, columns);
  const auto a = matrix_.lower.selfadjointView<Eigen::Lower>();
  for (int c = 0; c < columns; ++c) {
    scratch_ = in.col(c);
    out.col(c) = matrix_.scale * (a * scratch_ + matrix_.shift * scratch_);
  }
}

void StiffnessPreconditioner::ReadPolicy(Parameters* parameters,
                                         double shift,
                                         double least_shift) {
  shift_ =
      parameters->Double("shift",
                         shift,
                         least_shift,
                         1e6,
                         "added to the diagonal, in units of the stiffness "
                         "scale");
  every_ =
      parameters->Int("every", 20, 1, "iterations between two factorizations");
}

bool StiffnessPreconditioner::Assemble(const Iterate& at,
                                       Monitor* monitor,
                                       Matrix* matrix) {
  const auto& function =
      dynamic_cast<const SecondOrderFunction&>(*monitor->function());
  if (!(at.scales.length > 0.0)) return false;
  const Monitor::LinearTimer timer(monitor);
  if (!EvaluateMatrix(function, at, &matrix->lower)) return false;
  ++monitor->counters().hessians;
  matrix->pattern_version = function.PatternVersion();
  matrix->shift = shift_ * (at.scales.gradient / at.scales.length);
  return true;
}

bool StiffnessPreconditioner::IsStale(const Iterate& /*at*/,
                                      const Age& age) const {
  return age.steps >= every_;
}

}  // namespace granopt
