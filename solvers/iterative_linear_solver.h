// granopt: what the iterative linear solvers share.

#ifndef GRANOPT_SOLVERS_ITERATIVE_LINEAR_SOLVER_H_
#define GRANOPT_SOLVERS_ITERATIVE_LINEAR_SOLVER_H_

#include <memory>

#include "Eigen/Core"
#include "solvers/linear_solver.h"

namespace granopt {

// Hands matrix and right-hand sides of order one to a method that solves for
// one column at a time. An iterative method cannot know whether the matrix is
// positive definite; two things are seen, though. A diagonal entry that is not
// positive is refused. A "solution" with b.x <= 0, which no positive definite
// matrix has, or one that is not finite, is replaced by D^-1 b with the
// diagonal D, so that x is always a direction of descent for the gradient -b.
class IterativeLinearSolver : public LinearSolver {
 public:
  bool Factorize(const SparseMatrix& lower,
                 std::int64_t pattern_version,
                 double shift) final;
  void Solve(const double* b, double* x, int columns) final;

 protected:
  // Both triangles of the normalized A + shift 1; the same object for life.
  const SparseMatrix& matrix() const { return matrix_; }

  // Called after each change of the matrix, which is not empty. Returns false
  // where the matrix is found not positive definite.
  virtual bool SetUp(bool pattern_is_new) = 0;
  // *x has the right size. Counts its iterations.
  virtual void SolveColumn(const Eigen::VectorXd& b, Eigen::VectorXd* x) = 0;

 private:
  SparseMatrix lower_, matrix_;
  Eigen::VectorXd diagonal_, right_, solution_;
  double scale_ = 1.0;
  std::int64_t version_ = -1;
  Eigen::Index size_ = -1;
};

// `linear=amg`; null without hypre.
std::unique_ptr<LinearSolver> MakeBoomerAmg(double tolerance);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_ITERATIVE_LINEAR_SOLVER_H_
