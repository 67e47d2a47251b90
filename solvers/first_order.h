// granopt: functions that methods minimize, first order.

#ifndef GRANOPT_SOLVERS_FIRST_ORDER_H_
#define GRANOPT_SOLVERS_FIRST_ORDER_H_

#include <limits>

#include "ceres/first_order_function.h"

namespace granopt {

// The function's own units at a point. Every tolerance of this project is
// relative to them, so that a problem stated in other units takes bitwise the
// same iterations.
struct Scales {
  // Mean magnitude of the terms that a gradient entry is the sum of. 0 when no
  // term is active.
  double gradient = 0.0;
  // Change of x over which such a term changes by its own size. 0 when no term
  // is active.
  double length = 0.0;
  // Dimensionless size of the function itself; once it is under a stated bound
  // the function counts as zero. Infinity for functions whose minimum is not
  // known to be zero.
  double vanishing = std::numeric_limits<double>::infinity();
  // Relative error of the function's values and of the terms of its gradient.
  double epsilon = std::numeric_limits<double>::epsilon();
  // Refine() makes that smaller, and is worth its price once
  //   max|g| < refine_below * gradient.
  // 0 where it does nothing.
  double refine_below = 0.0;
};

// A function R^n -> R with a gradient, which Ceres' GradientProblemSolver takes
// as it is and which in addition knows its own scales.
//
// Evaluate() is a pure function of the variables and of the reference that
// Recenter() last set. Workspaces are mutable members: one object must not be
// evaluated from two threads at once.
class FirstOrderFunction : public ceres::FirstOrderFunction {
 public:
  // x has NumParameters() entries and no particular alignment. `gradient` and
  // `scales` may be null. Returns false where the function is not defined
  // (a non-finite x).
  virtual bool EvaluateWithScales(const double* x,
                                  double* cost,
                                  double* gradient,
                                  Scales* scales) const = 0;

  bool Evaluate(const double* const x,
                double* cost,
                double* gradient) const final {
    return EvaluateWithScales(x, cost, gradient, nullptr);
  }

  // Called by methods between iterations with the accepted iterate. The
  // function may move the reference that its differences are taken from; the
  // variables keep their meaning, values change in the last digits only, so
  // histories and cached values stay valid. Returns true if it moved.
  virtual bool Recenter(const double* x) {
    (void)x;
    return false;
  }

  // Absorbs x into the function's origin and sets x to zero, for when
  // eps * max|x| limits the attainable tolerance. Differences of iterates and
  // of gradients stay valid, cached values do not. Returns false if the
  // function has no origin that can be moved (x is then untouched).
  virtual bool Rebase(double* x) {
    (void)x;
    return false;
  }

  // From now on values are as precise as the function can make them. Cached
  // values are not valid any more. Returns false if they have been so before.
  virtual bool Refine() { return false; }
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_FIRST_ORDER_H_
