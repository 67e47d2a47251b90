// granopt: the subproblem of trust region methods.
//
//   min m(s) = g.s + s.H s / 2   subject to |s| <= radius

#ifndef GRANOPT_SOLVERS_TRUST_REGION_H_
#define GRANOPT_SOLVERS_TRUST_REGION_H_

#include <cstdint>
#include <functional>

#include "Eigen/Core"
#include "solvers/linear_solver.h"
#include "solvers/second_order.h"

namespace granopt {

struct SubproblemStep {
  enum class End {
    INTERIOR,  // H is positive definite and its Newton step is short enough
    BOUNDARY,  // |s| is the radius, as nearly as asked for
    SHORT,     // shorter than asked for
    CURVED,    // truncated: a direction of negative curvature, followed to |s|
    FAILED,    // no factor was found
  };
  End end = End::FAILED;
  double lambda = 0.0;
  double norm2 = 0.0;   // |s|^2
  double change = 0.0;  // m(s)
  std::int64_t iterations = 0;
};

// The nearly exact solution by factors of H + lambda 1: it is the minimizer if
// and only if, for some lambda >= 0,
//   (H + lambda 1) s = -g,   lambda (radius - |s|) = 0,   H + lambda 1 >= 0
// (Nocedal, Wright, 2nd ed., Theorem 4.1). lambda is found by Newton's method
// on 1/radius - 1/|s(lambda)|, (4.44),
//   lambda += |s|^2 / (s.(H + lambda 1)^-1 s) (|s| - radius) / radius,
// within an interval whose lower end is not positive definite or has a step too
// long. In the hard case, where a shift that hardly makes the matrix positive
// definite gives a step that is too short, a multiple of the lowest
// eigenvector, found by inverse iteration, is added until |s| = radius (Conn,
// Gould, Toint, Trust-Region Methods (2000), 7.3).
//
// Deviations: the search begins at the lambda that the last step suggests (see
// Suggest()), not at zero, and ends as soon as |s| lies between `least` and
// `most` times the radius. With loose bounds most steps take one factor, above
// all with accepts_short: a lambda that was larger than necessary is then put
// right by the next step, not by another factor for this one.
class NearlyExactSubproblem {
 public:
  struct Options {
    double least = 0.9;
    double most = 1.1;
    // Ends with a step below `least` unless it is the hard case.
    bool accepts_short = false;
    // An interval for lambda as narrow as this part of its upper end will not
    // give a longer step: the hard case.
    double hard = 1e-6;
    // Below this part of `unit`, lambda is zero.
    double negligible = 1e-14;
    int max_factorizations = 60;
  };

  NearlyExactSubproblem(const Options& options, LinearSolver* linear)
      : options_(options), linear_(linear) {}

  // `floor` is added to the diagonal of H: H + floor 1 is what is minimized.
  // `unit` is a curvature typical of H, `first_raise` a shift to try where H
  // itself is indefinite and nothing better is known. The last factor is kept
  // for Suggest().
  SubproblemStep Solve(const SparseMatrix& lower,
                       std::int64_t pattern_version,
                       double floor,
                       double unit,
                       const Eigen::VectorXd& g,
                       double radius,
                       const std::function<double()>& first_raise,
                       Eigen::VectorXd* s);

  // The lambda at which the last step, `s`, would have been as long as
  // `radius`, by the formula above; where the next Solve() begins.
  void Suggest(const Eigen::VectorXd& s, double radius);

 private:
  // slope_ for the last factor and a step s that belongs to it.
  void FindSlope(const Eigen::VectorXd& s, double norm2);
  // By how much lambda is to grow for |s| = radius.
  double Growth(double radius) const {
    return slope_ * ((last_norm_ - radius) / radius);
  }

  const Options options_;
  LinearSolver* const linear_;
  double lambda_ = 0.0;       // where to begin
  double last_lambda_ = 0.0;  // of the last step
  double slope_ = 0.0;        // |s|^2 / s.(H + lambda 1)^-1 s there, 0: unknown
  double last_norm_ = 0.0;
  double barrier_ = 0.0;  // below it, shifts have failed lately
  bool is_known_ = false;
  double unit_ = 1.0;
  Eigen::VectorXd w_, z_, minus_g_;
};

// The truncated solution by conjugate gradients preconditioned by P, in the
// norm |s|_P (Steihaug, SIAM J. Numer. Anal. 20 (1983) 626; Conn, Gould, Toint,
// Algorithm 7.5.1): stops where |H s + g| in the norm of P^-1 has fallen to
// `tolerance` of |g|, at the boundary, or, where a direction has no positive
// curvature, at the boundary along it. `times` writes H p, `solve` P^-1 r
// (null: P = 1). norm2 and radius2 are in P.
struct TruncatedSubproblem {
  using Apply = std::function<void(const Eigen::VectorXd&, Eigen::VectorXd*)>;
  Apply times;
  Apply solve;
  double tolerance = 0.1;
  std::int64_t max_iterations = 0;

  SubproblemStep Solve(const Eigen::VectorXd& g,
                       double radius2,
                       Eigen::VectorXd* s) const;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_TRUST_REGION_H_
