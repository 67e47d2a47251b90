// granopt: preconditioners that are sparse matrices.

#ifndef GRANOPT_SOLVERS_MATRIX_PRECONDITIONER_H_
#define GRANOPT_SOLVERS_MATRIX_PRECONDITIONER_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "solvers/linear_solver.h"
#include "solvers/preconditioner.h"

namespace granopt {

// P = scale (A + shift 1) (x) 1_columns with a sparse symmetric A: variable
// columns * i + c belongs to row i of A. Keeps A factored; derived classes make
// A and say when it is stale.
class MatrixPreconditioner : public Preconditioner {
 public:
  bool Update(const Iterate& at, const double* step, Monitor* monitor) final;
  void Solve(const double* r, double* z, Monitor* monitor) final;
  void Multiply(const double* v, double* pv) const final;

 protected:
  // Reads the options of the linear solver.
  explicit MatrixPreconditioner(Parameters* parameters);

  struct Matrix {
    SparseMatrix lower;  // lower triangle of A, see EvaluateHessian()
    std::int64_t pattern_version = 0;
    double shift = 0.0;
    double scale = 1.0;
    int columns = 1;
  };

  // How far the iterate has come since P was made.
  struct Age {
    std::int64_t steps = 0;
    double moved = 0.0;  // largest displacement of a block of variables
  };

  // Makes `matrix` at an iterate; storage and pattern may be kept from last
  // time. If A + shift 1 turns out not to be positive definite the shift is
  // raised. False where there is nothing to make it from.
  virtual bool Assemble(const Iterate& at,
                        Monitor* monitor,
                        Matrix* matrix) = 0;
  virtual bool IsStale(const Iterate& at, const Age& age) const = 0;

 private:
  bool Make(const Iterate& at, Monitor* monitor);

  const std::unique_ptr<LinearSolver> linear_;
  Matrix matrix_;
  bool is_factored_ = false;
  double identity_ = 1.0;  // P = identity_ 1 if not factored
  std::vector<double> displacement_;
  Age age_;
  mutable Eigen::VectorXd scratch_;
};

// P = A + shift kappa 1 with an A in the units of second derivatives, kappa =
// Scales::gradient / Scales::length, made anew every so many iterations.
class StiffnessPreconditioner : public MatrixPreconditioner {
 protected:
  using MatrixPreconditioner::MatrixPreconditioner;
  // Reads the options `shift` and `every`, which follow a class' own.
  void ReadPolicy(Parameters* parameters, double shift, double least_shift);

  // Writes A, with the pattern of PatternVersion(). False where it cannot.
  virtual bool EvaluateMatrix(const SecondOrderFunction& function,
                              const Iterate& at,
                              SparseMatrix* lower) = 0;

 private:
  bool Assemble(const Iterate& at, Monitor* monitor, Matrix* matrix) final;
  bool IsStale(const Iterate& at, const Age& age) const final;

  double shift_ = 0.0;
  int every_ = 0;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_MATRIX_PRECONDITIONER_H_
