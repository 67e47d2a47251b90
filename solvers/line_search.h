// granopt: the line search of all methods that have one.

#ifndef GRANOPT_SOLVERS_LINE_SEARCH_H_
#define GRANOPT_SOLVERS_LINE_SEARCH_H_

#include <functional>
#include <limits>
#include <vector>

namespace granopt {

// phi(a) = f(x + a d) at one a.
struct LinePoint {
  double step = 0.0;   // a
  double value = 0.0;  // phi(a)
  double slope = 0.0;  // phi'(a) = g(x + a d).d
};

struct LineSearchOptions {
  // 0 < sufficient_decrease < curvature < 1, see SearchLine().
  double sufficient_decrease = 1e-4;
  double curvature = 0.9;
  int max_trials = 40;
  // Relative error of values, Scales::epsilon.
  double epsilon = std::numeric_limits<double>::epsilon();
};

enum class LineSearchEnd {
  WOLFE,     // both conditions hold
  DECREASE,  // trials or digits ran out at a point with sufficient decrease
  NO_STEP,   // ... without one: stay at the start
  STOPPED,   // `evaluate` asked to stop; with decrease, or the start
};

struct LineSearchResult {
  LineSearchEnd end = LineSearchEnd::NO_STEP;
  LinePoint point;
  // True if `point` is the last one that was evaluated.
  bool is_last = false;
};

// What an evaluation on the line says. On entry the LinePoint is the one that
// the search would end with if it ended now (step 0: the start).
enum class LineEvaluation { OK, NOT_FINITE, STOP };
using LineFunction = std::function<LineEvaluation(double step, LinePoint*)>;

// phi(p) - phi(start), by subtraction, or where that has lost half of its
// digits (below 1e-8 of the value for doubles) by the trapezoidal rule
//   (p.step - start.step) (phi'(start) + phi'(p)) / 2,
// which needs slopes alone and is exact for a quadratic.
double LineChange(const LinePoint& start,
                  const LinePoint& p,
                  double epsilon = std::numeric_limits<double>::epsilon());

// The same between points that need not be on a line, for a library that
// decides on costs: an iterate, and what the library was told of its cost.
struct CostAnchor {
  std::vector<double> x, gradient;
  double cost = 0.0;
  double told = 0.0;

  // cost_new - cost, or (gradient + g_new).(x_new - x) / 2.
  double Change(const double* x_new,
                double cost_new,
                const double* g_new,
                double epsilon = std::numeric_limits<double>::epsilon()) const;
};

// Finds a point of the strong Wolfe conditions
//   change(a) <= c1 a phi'(0),   |phi'(a)| <= c2 |phi'(0)|
// with change() as above, c1 = sufficient_decrease and c2 = curvature (Nocedal,
// Wright, Numerical Optimization, 2nd ed., (3.7)). Where the trapezoidal rule
// decides, the first reads phi'(a) <= (2 c1 - 1) phi'(0): the approximate Wolfe
// condition of Hager & Zhang, SIAM J. Optim. 16 (2005) 170, (4.1). So steps are
// judged rightly at any size of the function and of its decrease.
//
// `start` is phi at 0 with a negative slope, `first_step` > 0. The search keeps
// an interval whose lower end has sufficient decrease and a slope too negative,
// and whose upper end lacks decrease, slopes up or is not finite; it holds a
// Wolfe point inside. Trials come from zeros of the slope (secants), which for
// the piecewise quadratic of a sum of one-sided springs is exact between
// kinks; the interval at least halves every second trial. All constants are
// pure numbers: phi in other units takes bitwise the same trials.
LineSearchResult SearchLine(const LineFunction& evaluate,
                            const LinePoint& start,
                            double first_step,
                            const LineSearchOptions& options);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_LINE_SEARCH_H_
