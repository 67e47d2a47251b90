// Newton's method in a trust region, with the sparse Hessian.
//
//   min m(s) = g.s + s.(H + floor h 1) s / 2   subject to |s| <= radius,
// h the mean magnitude of the diagonal of H, and then a step along s.
// subproblem=direct: nearly exactly, by factors of H + lambda 1 (Nocedal,
// Wright, 2nd ed., 4.3); subproblem=truncated: by conjugate gradients with any
// preconditioner P, |s| in P (Steihaug), until |H s + g| <= eta |g| with
// eta = min(1/2, (max|g| / Scales::gradient)^(1/2)) (their (7.3), made
// dimensionless). hessian=gauss_newton is, for sums of one-sided terms, H
// without the curvature of the gaps: positive semidefinite.
//
// Deviations: a step that is too long does not only shrink the radius: the line
// search goes back along it until there is decrease, for an evaluation costs a
// hundredth of a factor. With a the part of s that was taken,
//   a < 1:             radius = 30 a |s|
//   a >= 1:            radius = max(radius, 4 a |s|) if the decrease was more
//                      than half of that of m, a |s| / 2 if less than a
//                      quarter.
// Functions that are smooth between kinks want the 30: on 21 problems
// 2 a |s| takes twice as many factors, 10 or 100 a |s| 1.3 times as
// many. How exact the line search is then matters little (753 to 1008 factors
// for its curvature from 0.1 to 0.9). The textbook's smaller radius and new
// subproblem (step=shrink, for comparison) take 3.6 times as many.
// |s| is accepted between zero and twice the radius, and lambda begins where
// the secular equation of the last step suggests, so that nearly all steps take
// one factor (see NearlyExactSubproblem).
//
// The floor serves null vectors of which the gradient has no part: objects that
// nothing touches, translations. It is far below the lowest eigenvalues of
// interest, and far above the rounding of a factor. Objects that too few others
// hold make H indefinite by the curvature of their gaps; it is left out there
// (unheld=dropped, see RigidHessian), where the function is such a sum.

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "Eigen/Core"
#include "solvers/diagonal.h"
#include "solvers/linear_solver.h"
#include "solvers/monitor.h"
#include "solvers/preconditioner.h"
#include "solvers/registry.h"
#include "solvers/rigidity.h"
#include "solvers/second_order.h"
#include "solvers/step_search.h"
#include "solvers/trust_region.h"
#include "solvers/unilateral.h"

namespace granopt {
namespace {

using Eigen::VectorXd;
using End = SubproblemStep::End;

// The radius after a step, see above.
constexpr double kBeyond = 30.0;
constexpr double kGrow = 4.0;
constexpr double kGood = 0.5;
constexpr double kBad = 0.25;
constexpr double kShrink = 0.5;
// After a step without any decrease.
constexpr double kRetreat = 0.25;
constexpr int kMaxRetreats = 8;
constexpr double kSufficientDecrease = 1e-4;
// Lambdas below this part of h are zero.
constexpr double kNegligible = 1e-12;
// Where H is indefinite and nothing better is known, lambda begins at this part
// of what the curvature of the gaps takes from the diagonal, or of h.
constexpr double kFirstRaise = 0.1;
constexpr double kBlindRaise = 1e-3;
// A run whose gradient is roundoff ends after so many iterations that did not
// reduce it: each costs a factor.
constexpr int kPatienceAtRoundoff = 10;
constexpr double kLargestForcing = 0.5;

class Newton : public Solver {
 public:
  explicit Newton(Parameters* parameters)
      : is_direct_(parameters->Choice("subproblem",
                                      "direct",
                                      "direct|truncated",
                                      "nearly exact by factors, or conjugate "
                                      "gradients") == 0),
        is_exact_(parameters->Choice("hessian",
                                     "exact",
                                     "exact|gauss_newton",
                                     "with the curvature of the gaps, or "
                                     "without") == 0),
        drops_unheld_(
            parameters->Choice("unheld",
                               "dropped",
                               "dropped|kept",
                               "curvature of the gaps of objects that "
                               "too few others hold") == 0),
        searches_(parameters->Choice("step",
                                     "search",
                                     "search|shrink",
                                     "after one that is too long: line search, "
                                     "or a smaller radius") == 0),
        radius_(parameters->Double("radius",
                                   10.0,
                                   1e-6,
                                   1e12,
                                   "first trust radius: root mean square "
                                   "displacement over Scales::length")),
        floor_(parameters->Double("floor",
                                  1e-11,
                                  0.0,
                                  1.0,
                                  "added to the diagonal of H, over its mean")),
        preconditioner_(parameters) {
    if (!is_direct_) return;
    if (!preconditioner_.none()) {
      parameters->Refuse(
          "subproblem", "direct", "takes no preconditioner, truncated does");
      return;
    }
    // Reads its options, so that they are known and checked.
    MakeLinearSolver(parameters);
    parameters_ = *parameters;
  }

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const SecondOrderFunction*>(&function) == nullptr) {
      *error = "newton needs a function with second derivatives";
      return false;
    }
    if (!is_exact_ &&
        dynamic_cast<const UnilateralFunction*>(&function) == nullptr) {
      *error =
          "newton:hessian=gauss_newton needs a sum of one-sided power laws";
      return false;
    }
    return preconditioner_.Supports(function, error);
  }

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override;

 private:
  friend class NewtonRun;

  const bool is_direct_;
  const bool is_exact_;
  const bool drops_unheld_;
  const bool searches_;
  const double radius_;
  const double floor_;
  const PreconditionerChoice preconditioner_;
  Parameters parameters_;  // of the linear solver
};

class NewtonRun {
 public:
  NewtonRun(const Newton& method,
            FirstOrderFunction* function,
            const SolveOptions& options)
      : method_(method),
        monitor_(function, options, method.name()),
        n_(monitor_.n()),
        second_(dynamic_cast<const SecondOrderFunction*>(function)),
        unilateral_(dynamic_cast<const UnilateralFunction*>(function)),
        search_(n_),
        g_(n_),
        s_(n_) {}

  Summary Minimize(double* x_out);

 private:
  // H and h at x_. False where the function has none.
  bool UpdateModel();
  // s_, in LinearTimer but for what the function does.
  SubproblemStep SolveSubproblem();
  SubproblemStep SolveDirect();
  SubproblemStep SolveTruncated();
  // A shift to begin with where H is indefinite.
  double FirstRaise();
  // Goes along s_; the end is in search_ if its step is not zero.
  LinePoint Step(const SubproblemStep& step);
  void UpdateRadius(double part, double norm, double ratio);

  const Newton& method_;
  Monitor monitor_;
  const int n_;
  const SecondOrderFunction* const second_;
  const UnilateralFunction* const unilateral_;
  StepSearch search_;
  VectorXd x_, g_, s_;
  double cost_ = 0.0;
  Scales scales_;

  std::unique_ptr<LinearSolver> linear_;
  std::unique_ptr<NearlyExactSubproblem> direct_;
  std::unique_ptr<Preconditioner> preconditioner_;
  RigidHessian rigid_;
  SparseMatrix hessian_, other_;
  double unit_ = 0.0;  // h
  double radius_ = 0.0;
  // What max|g| is measured in.
  double gradient_unit_ = 0.0;
};

Summary Newton::Minimize(FirstOrderFunction* function,
                         const SolveOptions& options,
                         double* x) const {
  return NewtonRun(*this, function, options).Minimize(x);
}

bool NewtonRun::UpdateModel() {
  const Monitor::LinearTimer timer(&monitor_);
  ++monitor_.counters().hessians;
  bool done;
  if (!method_.is_exact_) {
    done = unilateral_->EvaluateStiffness(x_.data(), 0.0, &hessian_);
  } else if (unilateral_ != nullptr && method_.drops_unheld_) {
    done = rigid_.Evaluate(*unilateral_, x_.data(), &hessian_);
  } else {
    done = second_->EvaluateHessian(x_.data(), &hessian_);
  }
  if (!done) return false;
  unit_ = 0.0;
  for (int j = 0; j < n_; ++j) {
    const int place = DiagonalPlace(hessian_, j);
    if (place >= 0) unit_ += std::abs(hessian_.valuePtr()[place]);
  }
  unit_ /= n_;
  // As on a plane.
  if (!(unit_ > 0.0)) unit_ = 1.0 / monitor_.StepUnit();
  return true;
}

double NewtonRun::FirstRaise() {
  if (method_.is_exact_ && unilateral_ != nullptr &&
      unilateral_->EvaluateStiffness(x_.data(), 0.0, &other_)) {
    ++monitor_.counters().hessians;
    const double taken = (other_.diagonal() - hessian_.diagonal()).maxCoeff();
    if (taken > 0.0) return kFirstRaise * taken;
  }
  return kBlindRaise * unit_;
}

SubproblemStep NewtonRun::SolveDirect() {
  const Monitor::LinearTimer timer(&monitor_);
  const std::int64_t factorizations = linear_->factorizations();
  const std::int64_t solves = linear_->solves();
  const std::int64_t iterations = linear_->iterations();
  const SubproblemStep step = direct_->Solve(
      hessian_,
      second_->PatternVersion(),
      method_.floor_ * unit_,
      unit_,
      g_,
      radius_,
      [this]() { return FirstRaise(); },
      &s_);
  Counters& counters = monitor_.counters();
  counters.factorizations += linear_->factorizations() - factorizations;
  counters.solves += linear_->solves() - solves;
  counters.linear_iterations += linear_->iterations() - iterations;
  return step;
}

SubproblemStep NewtonRun::SolveTruncated() {
  TruncatedSubproblem truncated;
  truncated.times = [this](const VectorXd& v, VectorXd* hv) {
    const Monitor::LinearTimer timer(&monitor_);
    // HessianTimes() took twice as long where that was measured.
    *hv = hessian_.selfadjointView<Eigen::Lower>() * v;
    *hv += (method_.floor_ * unit_) * v;
  };
  if (preconditioner_ != nullptr) {
    truncated.solve = [this](const VectorXd& r, VectorXd* z) {
      preconditioner_->Solve(r.data(), z->data(), &monitor_);
    };
  }
  truncated.tolerance = std::min(
      kLargestForcing, std::sqrt(monitor_.max_gradient() / gradient_unit_));
  truncated.max_iterations = 2 * static_cast<std::int64_t>(n_);
  // Where P is like H, |s| in P is the root of an energy.
  const double p_unit = preconditioner_ != nullptr ? unit_ : 1.0;
  SubproblemStep step = truncated.Solve(g_, p_unit * radius_ * radius_, &s_);
  step.norm2 /= p_unit;
  monitor_.counters().linear_iterations += step.iterations;
  return step;
}

LinePoint NewtonRun::Step(const SubproblemStep& step) {
  const LinePoint start{0.0, cost_, g_.dot(s_)};
  if (!(start.slope < 0.0)) return start;
  LineSearchOptions options;
  options.sufficient_decrease = kSufficientDecrease;
  if (method_.searches_) {
    return search_.Search(options, x_, s_, start, 1.0, &monitor_).point;
  }
  if (monitor_.BudgetSpent()) return start;
  search_.x = x_ + s_;
  if (!monitor_.Evaluate(
          search_.x.data(), &search_.cost, search_.g.data(), &search_.scales)) {
    return start;
  }
  const LinePoint end{1.0, search_.cost, search_.g.dot(s_)};
  const double change = LineChange(start, end, monitor_.scales().epsilon);
  return change <= kSufficientDecrease * step.change ? end : start;
}

void NewtonRun::UpdateRadius(double part, double norm, double ratio) {
  const double length = part * norm;
  if (part < 1.0) {
    radius_ = kBeyond * length;
  } else if (ratio > kGood) {
    radius_ = std::max(radius_, kGrow * length);
  } else if (ratio < kBad) {
    radius_ = kShrink * length;
  }
}

Summary NewtonRun::Minimize(double* x_out) {
  x_ = Eigen::Map<const VectorXd>(x_out, n_);
  if (!monitor_.Begin(method_, x_.data(), &cost_, g_.data(), &scales_)) {
    return monitor_.Finish(x_out);
  }
  monitor_.Recenter(x_.data());
  if (method_.is_direct_) {
    Parameters parameters = method_.parameters_;
    linear_ = MakeLinearSolver(&parameters);
    NearlyExactSubproblem::Options loose;
    loose.least = 0.1;
    loose.most = 2.0;
    loose.accepts_short = true;
    loose.hard = 0.8;
    loose.negligible = kNegligible;
    direct_ = std::make_unique<NearlyExactSubproblem>(loose, linear_.get());
  }
  preconditioner_ = method_.preconditioner_.Make();
  if (preconditioner_ != nullptr) {
    preconditioner_->Update(
        {x_.data(), cost_, g_.data(), scales_}, nullptr, &monitor_);
  }
  const bool has_scales = scales_.length > 0.0 && scales_.gradient > 0.0;
  // Where no length is known, that to a zero of the linear model.
  radius_ = method_.radius_ *
            (has_scales ? scales_.length * std::sqrt(static_cast<double>(n_) /
                                                     second_->BlockSize())
                        : monitor_.StepUnit() * g_.norm());
  const double first_gradient = monitor_.max_gradient();

  bool model_is_new = false;
  int retreats = 0;
  int idle = 0;  // iterations without progress at roundoff
  double least_gradient = first_gradient;
  VectorXd moved(n_);
  while (!monitor_.BudgetSpent()) {
    if (!model_is_new && !UpdateModel()) {
      monitor_.GiveUp("the function has no Hessian here");
      break;
    }
    model_is_new = true;
    gradient_unit_ = scales_.gradient > 0.0 ? scales_.gradient : first_gradient;
    const SubproblemStep step =
        method_.is_direct_ ? SolveDirect() : SolveTruncated();
    if (linear_ != nullptr && !linear_->refusal().empty()) {
      monitor_.RunOutOfMemory(linear_->refusal());
      break;
    }
    if (step.end == End::FAILED) {
      monitor_.GiveUp("no shift makes the Hessian positive definite");
      break;
    }
    const LinePoint start{0.0, cost_, g_.dot(s_)};
    const LinePoint end = Step(step);
    if (monitor_.stopped() && end.step == 0.0) break;
    const double norm = std::sqrt(step.norm2);
    // Neither is a step that rounding takes away.
    if (end.step == 0.0 || search_.x == x_) {
      if (monitor_.Refine(x_.data())) {
        if (monitor_.Evaluate(x_.data(), &cost_, g_.data(), &scales_)) continue;
        monitor_.FailEvaluation();
        break;
      }
      if (method_.searches_ && monitor_.LastEvaluationFailed()) {
        monitor_.FailEvaluation();
        break;
      }
      if (++retreats > (method_.searches_ ? kMaxRetreats : 100)) {
        if (monitor_.LastEvaluationFailed()) monitor_.FailEvaluation();
        monitor_.GiveUp("no step lowers the cost");
        break;
      }
      radius_ = kRetreat * norm;
      if (direct_ != nullptr) direct_->Suggest(s_, radius_);
      continue;
    }
    retreats = 0;
    const double bend = 2.0 * (step.change - start.slope);
    const double predicted = end.step * (start.slope + 0.5 * end.step * bend);
    const double change = LineChange(start, end, monitor_.scales().epsilon);
    UpdateRadius(end.step, norm, change / predicted);
    if (direct_ != nullptr) direct_->Suggest(s_, radius_);

    moved = search_.x - x_;
    std::swap(x_, search_.x);
    std::swap(g_, search_.g);
    cost_ = search_.cost;
    scales_ = search_.scales;
    model_is_new = false;
    if (monitor_.Accept(x_.data(), cost_, g_.data(), scales_)) break;
    idle = monitor_.max_gradient() < least_gradient ||
                   monitor_.max_gradient() > monitor_.Roundoff()
               ? 0
               : idle + 1;
    least_gradient = std::min(least_gradient, monitor_.max_gradient());
    if (idle >= kPatienceAtRoundoff) {
      monitor_.GiveUp("|g| is within its roundoff");
      break;
    }
    if (preconditioner_ != nullptr) {
      preconditioner_->Update(
          {x_.data(), cost_, g_.data(), scales_}, moved.data(), &monitor_);
    }
    monitor_.Recenter(x_.data());
    if (monitor_.WantsRebase() && monitor_.Rebase(x_.data()) &&
        !monitor_.Evaluate(x_.data(), &cost_, g_.data(), &scales_)) {
      monitor_.FailEvaluation();
      break;
    }
  }
  return monitor_.Finish(x_out);
}

}  // namespace

REGISTER_SOLVER(newton,
                Newton,
                "trust region on the sparse Hessian, nearly exact or truncated",
                "More, Sorensen, SIAM J. Sci. Stat. Comput. 4 (1983) 553; "
                "Steihaug, SIAM J. Numer. Anal. 20 (1983) 626; Conn, Gould, "
                "Toint, Trust-Region Methods (2000)");

}  // namespace granopt
