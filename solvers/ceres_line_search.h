// granopt: Ceres' GradientProblemSolver behind the Solver interface.

#ifndef GRANOPT_SOLVERS_CERES_LINE_SEARCH_H_
#define GRANOPT_SOLVERS_CERES_LINE_SEARCH_H_

#include "ceres/gradient_problem_solver.h"
#include "solvers/registry.h"
#include "solvers/solver.h"

namespace granopt {

// Runs Ceres with our stopping test, our counts and our best point. Shared by
// the methods ceres_lbfgs and ceres_ncg.
//
// As is (scaled = false) Ceres keeps its defaults; only tolerances and the
// limit of iterations are opened, so that none of its absolute tests ends the
// run before ours does.
//
// scaled = true hands Ceres the function  C f(L y)  of  y = x / L  with powers
// of two C and L (both exact), chosen so that Ceres' absolute constants become
// harmless: L is about Scales::length, so the first step min(1, 1/|g|) moves no
// variable by more than the length over which the gradient changes; C makes the
// gradient at the requested tolerance of order one, which keeps g.d above the
// restart threshold 1e-12 of its NCG and s.y above the 1e-14 under which its
// L-BFGS stops learning. Both are chosen again, with a restart, when the
// function has shrunk by 2^10 since. It also turns on L-BFGS' eigenvalue
// scaling.
//
// differences = true hands Ceres the cost relative to the start of the run, and
// replaces a change of the cost that is lost in roundoff (below 1e-8 of the
// cost) by the trapezoidal rule (g_a + g_b).(x_b - x_a) / 2 from the last
// accepted iterate a. Ceres' sufficient decrease then still decides correctly
// where it would otherwise end the run at |g| ~ sqrt(eps f lambda): it becomes
// the approximate Wolfe condition of Hager & Zhang, SIAM J. Optim. 16 (2005)
// 170. Restarts (option `restarts`) begin again at cost zero, which resolves
// smaller and smaller changes.
//
// Ceres keeps its own copy of x between iterations: the reference of the
// function is moved from the iteration callback (FirstOrderFunction::Recenter),
// and a rebase stops and restarts Ceres, which is counted.
class CeresLineSearch : public Solver {
 public:
  // Reads the options that both methods share: scaled, differences, restarts.
  explicit CeresLineSearch(Parameters* parameters);

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override;

 protected:
  ceres::GradientProblemSolver::Options& ceres_options() {
    return ceres_options_;
  }

 private:
  ceres::GradientProblemSolver::Options ceres_options_;
  bool scaled_;
  bool differences_;
  int restarts_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_CERES_LINE_SEARCH_H_
