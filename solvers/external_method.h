// granopt: methods of other libraries behind the Solver interface.

#ifndef GRANOPT_SOLVERS_EXTERNAL_METHOD_H_
#define GRANOPT_SOLVERS_EXTERNAL_METHOD_H_

#include <string>
#include <vector>

#include "solvers/monitor.h"
#include "solvers/registry.h"
#include "solvers/second_order.h"
#include "solvers/solver.h"
#include "solvers/unilateral.h"

namespace granopt {

// Runs a library's method with our stopping test, our counts and our best
// point. A derived class states one run of the library, Run(); everything that
// is decided between runs is decided here: rebases, new units, restarts.
//
// As is (scaled = false) the library sees the function itself. Its tolerances
// are opened, so that it ends a run only where it cannot go on.
//
// scaled = true hands it  C f(L y)  of  y = x / L  with powers of two C and L,
// which is exact. C L^2 makes the curvature of the active terms about one,
// whatever the units of the function, and L is RelativeLengthUnit() of
// Scales::length. Both are chosen again, with a counted restart, where
// Scales::length or Scales::gradient has shrunk by 2^10 since.
class ExternalMethod : public Solver {
 public:
  // What a library gets to see: a function of y and somebody to tell of each
  // iterate.
  class Problem {
   public:
    int n() const { return monitor_->n(); }
    // Cost and gradient at y, counted. False where the library must end: a
    // budget is spent, the function failed, Accept() said so, or y is not
    // finite, which is the library's own fault. Nothing is then evaluated; what
    // the library is told is only to make it return.
    bool Evaluate(const double* y, double* cost, double* gradient);
    // Tells of an iterate that the library has accepted, which is not the
    // start. False where it must return.
    bool Accept(const double* y);

    // The function's second derivatives and gaps at y in the library's units,
    // for a method whose Supports() asks for them. Hessians are counted; gaps
    // are not, as they go with an evaluation. False as with Evaluate().
    bool EvaluateHessian(const double* y, SparseMatrix* hessian);
    bool EvaluateGaps(const double* y, Gaps* gaps);

    // What the method counts and times itself.
    Monitor* monitor() { return monitor_; }

    Problem(const Problem&) = delete;
    Problem& operator=(const Problem&) = delete;

   private:
    friend class ExternalMethod;
    enum class Interruption { NONE, STOPPED, REBASE, RESCALE, LOST };

    Problem(Monitor* monitor,
            const Scales& scales,
            double length,
            double cost,
            bool rescales,
            const double* x);
    bool Interrupt(Interruption why) {
      interruption_ = why;
      return false;
    }
    // x_ from y.
    void SetX(const double* y);
    bool Fail(const char* what);

    Monitor* monitor_;
    const double length_unit_;  // L
    const double cost_unit_;    // C
    // Under either of them the units no longer fit; 0 if they are fixed.
    const double least_length_, least_gradient_;
    Interruption interruption_ = Interruption::NONE;
    std::vector<double> x_, accepted_;
  };

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override;

 protected:
  // Reads the options that all share: scaled, restarts.
  explicit ExternalMethod(Parameters* parameters);

  // One run of the library from y; leaves its last accepted iterate there.
  // Returns, in the library's own words, why it ended; they do not matter where
  // it was told to.
  virtual std::string Run(Problem* problem, double* y) const = 0;

  // "NLopt", for messages.
  virtual const char* library() const = 0;

  // With scaled=1, the length L relative to Scales::length (before both are
  // rounded to powers of two); `tolerance` is the bound of max|g| relative to
  // Scales::gradient. At L the gradient is 1/this of the active terms' in the
  // library's units.
  virtual double RelativeLengthUnit(double tolerance) const {
    (void)tolerance;
    return 1.0;
  }

 private:
  bool scaled_;
  int restarts_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_EXTERNAL_METHOD_H_
