// granopt: methods in turn.

#ifndef GRANOPT_SOLVERS_SOLVER_SEQUENCE_H_
#define GRANOPT_SOLVERS_SOLVER_SEQUENCE_H_

#include <memory>
#include <string>
#include <vector>

#include "solvers/solver.h"

namespace granopt {

// Of a run in several parts: the budgets that `done` leaves, and a callback
// that sees the whole run. `done` must outlive what is returned.
SolveOptions Remaining(const SolveOptions& options, const Summary& done);
// Work and trace of both, the end of the second.
Summary Joined(Summary first, Summary second);

// "a|b|c": each method starts from the best point of those before it, until one
// succeeds or a budget is spent; one that cannot serve the function is passed
// over. Work is added up, and the message names the method that ended the run.
class SolverSequence : public Solver {
 public:
  explicit SolverSequence(std::vector<std::unique_ptr<Solver>> solvers)
      : solvers_(std::move(solvers)) {}

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override;
  // If any of them does.
  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override;

 private:
  const std::vector<std::unique_ptr<Solver>> solvers_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SOLVER_SEQUENCE_H_
