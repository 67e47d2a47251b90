// granopt: methods of the form x + a d with a from the line search.

#ifndef GRANOPT_SOLVERS_LINE_SEARCH_METHOD_H_
#define GRANOPT_SOLVERS_LINE_SEARCH_METHOD_H_

#include <functional>
#include <memory>

#include "solvers/line_search.h"
#include "solvers/preconditioner.h"
#include "solvers/registry.h"
#include "solvers/solver.h"

namespace granopt {

// How a method chooses its directions. An object serves one run. Vectors have n
// entries. z = P^-1 g is the gradient itself where there is no preconditioner.
class DirectionRule {
 public:
  virtual ~DirectionRule() = default;

  // What is known of a direction when it is made: the first step to try, and
  // the slope g.d, for which d need not be read again.
  struct Outlook {
    double first_step;
    double slope;
  };
  // Writes the direction d at an iterate. If it is no descent direction the
  // rule is asked again after a Forget().
  // `unit` = Scales::length / Scales::gradient times gradient is a step of one
  // length (1 with a preconditioner, whose steps are already lengths).
  virtual Outlook Direction(const double* g,
                            const double* z,
                            double unit,
                            double* d) = 0;

  // The step from x to x_new was taken, with gradients g and g_new at its ends
  // and slopes along d before and after, d being what Direction() last wrote.
  struct Step {
    const double* x;
    const double* x_new;
    const double* g;
    const double* z;
    const double* g_new;
    const double* z_new;
    LinePoint start;
    LinePoint end;
  };
  virtual void Taken(const Step& step) = 0;

  // P has changed; `solve` applies the new P^-1.
  using Solve = std::function<void(const double* r, double* z)>;
  virtual void PreconditionerChanged(const Solve& solve) = 0;

  // Start afresh with a steepest descent.
  virtual void Forget() = 0;
};

// The loop (15): direction, line search, step; the same for every rule, with or
// without a preconditioner.
class LineSearchMethod : public Solver {
 public:
  // Reads the option `preconditioner` and those of the chosen one.
  LineSearchMethod(Parameters* parameters,
                   const LineSearchOptions& line_search);

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override;
  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override;

 protected:
  virtual std::unique_ptr<DirectionRule> MakeRule(
      int n, bool preconditioned) const = 0;

 private:
  const LineSearchOptions line_search_;
  const PreconditionerChoice preconditioner_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_LINE_SEARCH_METHOD_H_
