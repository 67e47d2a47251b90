// A primal-dual interior point for sums of one-sided power laws,
//   E(x) = min over e of sum_c k_c e_c^alpha / alpha,
//          e_c - s_c = delta_c(x),  e_c >= 0,  s_c >= 0,
// whose gaps may open and close in any number within one iteration. With
// phi(e) = e^(alpha-1), B = d delta / dx and f_c = k_c phi(e_c), Newton's
// method for
//   B^T f = 0,   e - s = delta(x),   phi(e_c) s_c = mu
// eliminates e and s and leaves one system with the pattern of the Hessian,
//   (B^T W B + theta sum f_c Hess(delta_c) + Lambda) dx
//       = -B^T (f + W (delta - e + mu / phi)),
//   de = rho (B dx + delta - e + mu / phi),
//   ds = (mu - phi s - s phi' de) / phi,
// rho = phi / (phi + s phi'), W = k phi' rho: Nocedal, Wright, Numerical
// Optimization, 2nd ed., (19.12) and (16.58) for this function. mu goes down by
// the predictor and corrector of Mehrotra, SIAM J. Optim. 2 (1992) 575, and
// once closed gaps are told from open ones exact Newton steps finish.
//
// The start is warm: e and s are those of the central path at x for a length
// that is taken from a Gauss-Newton step, so that a small load begins with a
// small mu. Gaps have names, by which e and s survive new lists.
//
// It descends at the end only: on the way the cost may rise, and the minimum
// that it finds may be another one than a descent's. One above the least cost
// seen is not returned.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Core"
#include "solvers/barrier.h"
#include "solvers/diagonal.h"
#include "solvers/format.h"
#include "solvers/linear_solver.h"
#include "solvers/monitor.h"
#include "solvers/registry.h"
#include "solvers/rigidity.h"
#include "solvers/unilateral.h"

namespace granopt {
namespace {

using Eigen::VectorXd;

// Of the step to the boundary.
constexpr double kFraction = 0.995;
// Gaps take part that are open by less than this part of Gaps::margin: less
// than one, so that few of those that come near later are new to the pattern.
constexpr double kReach = 0.5;
// The start's length in units of the mean closure, and the shift of the step
// that it is taken from, in units of the mean stiffness.
constexpr double kLeastLength = 1e-4;
constexpr double kPredictorShift = 1e-6;
// Centring and corrector that are tried beside Mehrotra's own.
constexpr double kSigmas[] = {0.03, 0.1, 0.3, 0.7};
constexpr double kOmegas[] = {1.0, 0.3, 0.0};
// Added to the diagonal, in units of the mean stiffness, for what nothing
// holds.
constexpr double kFloor = 1e-9;
// Added to the diagonal of objects that too few closed gaps hold, in units of
// the largest pre-stress f |Hess(delta)|. It keeps them from flying off; more
// of it slows what they touch.
constexpr double kLooseHold = 0.03;
// A shift that was not enough: first in those units, then times this; a quarter
// of it is tried after a success.
constexpr double kFirstShift = 0.05;
constexpr double kRaiseShift = 4.0;
constexpr int kMaxRaises = 30;
// An iteration is better if its measure is less than this part of the best.
constexpr double kBetter = 0.9;
// Exact Newton steps are tried once mu^(1/alpha) is under this part of the mean
// closure and max|g| under that part of its scale; again, if they failed, once
// the first has come down by the third number.
constexpr double kFinishLength = 1e-3;
constexpr double kFinishGradient = 1e-2;
constexpr double kFinishAgain = 0.1;
constexpr int kFinishSteps = 12;

struct Settings {
  double theta;
  double start;
  int patience;
};

class Run {
 public:
  Run(const Settings& settings,
      UnilateralFunction* function,
      Monitor* monitor,
      LinearSolver* linear)
      : settings_(settings),
        function_(function),
        monitor_(monitor),
        linear_(linear),
        n_(monitor->n()),
        block_(function->BlockSize()),
        alpha_(function->Exponent()) {}

  void Minimize(const Solver& solver, const double* x0) {
    x_ = Eigen::Map<const VectorXd>(x0, n_);
    g_.resize(n_);
    if (!monitor_->Begin(solver, x_.data(), &cost_, g_.data(), &scales_)) {
      return;
    }
    if (!(scales_.length > 0.0 && scales_.gradient > 0.0)) {
      monitor_->GiveUp("the function states no scales to start with");
      return;
    }
    stiffness_scale_ = scales_.gradient / scales_.length;
    closure_scale_ = scales_.length * (alpha_ - 1.0);
    if (Start()) FollowPath();
  }

 private:
  int num_gaps() const { return static_cast<int>(gaps_.ids.size()); }
  bool IsMember(int c) const { return e_[c] > 0.0; }

  bool IsNear(int c) const { return gaps_.delta[c] > -kReach * gaps_.margin; }

  // e and s of the central path at x. False if the run ends here.
  bool Start() {
    if (!UpdateGaps()) return false;
    const double change = PredictedChange();
    if (monitor_->stopped()) return false;
    const double length = std::clamp(settings_.start * change,
                                     kLeastLength * closure_scale_,
                                     closure_scale_);
    e_ = VectorXd::Zero(num_gaps());
    s_ = VectorXd::Zero(num_gaps());
    Join(length);
    return true;
  }

  // Root mean square of the change of the closed gaps in a step of Gauss and
  // Newton. (In an open one the step may be anything, along what is loose.)
  double PredictedChange() {
    const Monitor::LinearTimer timer(monitor_);
    if (!function_->EvaluateStiffness(x_.data(), 0.0, &matrix_)) {
      return closure_scale_;
    }
    ++monitor_->counters().hessians;
    if (!Factorize(kPredictorShift * stiffness_scale_)) return closure_scale_;
    Solve(-g_, &dx_);
    const VectorXd change = gaps_.jacobian * dx_;
    double sum = 0.0;
    int count = 0;
    for (int c = 0; c < num_gaps(); ++c) {
      if (!(gaps_.delta[c] > 0.0)) continue;
      sum += change[c] * change[c];
      ++count;
    }
    return count > 0 ? std::sqrt(sum / count) : 0.0;
  }

  bool Factorize(double shift) {
    ++monitor_->counters().factorizations;
    const bool done =
        linear_->Factorize(matrix_, function_->PatternVersion(), shift);
    if (!linear_->refusal().empty()) {
      monitor_->RunOutOfMemory(linear_->refusal());
    }
    return done;
  }

  void Solve(const VectorXd& right, VectorXd* solution) {
    solution->resize(n_);
    const std::int64_t before = linear_->iterations();
    linear_->Solve(right.data(), solution->data(), 1);
    ++monitor_->counters().solves;
    monitor_->counters().linear_iterations += linear_->iterations() - before;
  }

  // The gaps at x, with e and s of those known before.
  bool UpdateGaps() {
    std::swap(ids_, gaps_.ids);
    if (!function_->EvaluateGaps(x_.data(), &gaps_)) {
      monitor_->FailEvaluation();
      return false;
    }
    if (e_.size() == 0 || ids_ == gaps_.ids) return true;
    VectorXd e = VectorXd::Zero(num_gaps());
    VectorXd s = VectorXd::Zero(num_gaps());
    std::size_t from = 0;
    for (int c = 0; c < num_gaps(); ++c) {
      while (from < ids_.size() && ids_[from] < gaps_.ids[c]) ++from;
      if (from == ids_.size()) break;
      if (ids_[from] == gaps_.ids[c]) {
        e[c] = e_[from];
        s[c] = s_[from];
      }
    }
    e_ = e;
    s_ = s;
    return true;
  }

  // Gaps that have come near take their place on the central path.
  void Join(double length) {
    for (int c = 0; c < num_gaps(); ++c) {
      if (IsMember(c) || !IsNear(c)) continue;
      CentralClosures(*function_, 1, &gaps_.delta[c], length, &e_[c], &s_[c]);
    }
  }

  // Writes the matrix of e and s. Objects that too few closed gaps hold get no
  // pre-stress, which would make the matrix indefinite for nothing, and are
  // held where they are.
  bool Assemble() {
    const int m = num_gaps();
    first_ = second_ = rho_ = VectorXd::Zero(m);
    degree_.assign(n_ / block_, 0);
    for (int c = 0; c < m; ++c) {
      const GapId& id = gaps_.ids[c];
      if (!(e_[c] > s_[c]) || id.i == id.j) continue;
      ++degree_[id.i];
      ++degree_[id.j];
    }
    prestress_ = 0.0;
    for (int c = 0; c < m; ++c) {
      if (!IsMember(c)) continue;
      const double k = gaps_.stiffness[c];
      rho_[c] = phi_[c] / (phi_[c] + s_[c] * dphi_[c]);
      first_[c] = k * dphi_[c] * rho_[c];
      prestress_ = std::max(prestress_, k * phi_[c] * gaps_.curvature[c]);
    }
    for (int c = 0; c < m; ++c) {
      if (!IsMember(c)) continue;
      if (!IsLoose(gaps_.ids[c].i) && !IsLoose(gaps_.ids[c].j)) {
        second_[c] = settings_.theta * (gaps_.stiffness[c] * phi_[c]);
      }
    }
    if (!function_->EvaluateWeightedHessian(
            x_.data(), first_.data(), second_.data(), &matrix_)) {
      return false;
    }
    ++monitor_->counters().hessians;
    for (int i = 0; i < static_cast<int>(degree_.size()); ++i) {
      if (!IsLoose(i)) continue;
      for (int k = 0; k < block_; ++k) {
        // Where there is none, nothing moves the object.
        const int place = DiagonalPlace(matrix_, i * block_ + k);
        if (place >= 0) matrix_.valuePtr()[place] += kLooseHold * prestress_;
      }
    }
    return true;
  }

  bool IsLoose(int object) const { return degree_[object] <= block_; }

  // Factors the matrix, shifted until that is possible.
  bool FactorizeShifted() {
    for (int raise = 0; raise < kMaxRaises; ++raise) {
      if (Factorize(std::max(shift_, kFloor * stiffness_scale_))) {
        shift_ *= 0.25;
        return true;
      }
      shift_ = std::max(kRaiseShift * shift_, kFirstShift * prestress_);
      if (monitor_->BudgetSpent()) return false;
    }
    return false;
  }

  // A step, or a part of one: of x, e and s.
  struct Direction {
    VectorXd dx, de, ds;
  };

  // The part of the step that is due to the targets of phi(e) s, and with
  // `complete` to what is there without.
  void Solve(const VectorXd& target, bool complete, Direction* d) {
    const int m = num_gaps();
    VectorXd weight(m);
    for (int c = 0; c < m; ++c) {
      if (!IsMember(c)) {
        weight[c] = 0.0;
        continue;
      }
      weight[c] = first_[c] * (target[c] / phi_[c]);
      if (complete) {
        weight[c] +=
            gaps_.stiffness[c] * phi_[c] + first_[c] * (gaps_.delta[c] - e_[c]);
      }
    }
    const VectorXd right = -(gaps_.jacobian.transpose() * weight);
    Solve(right, &d->dx);
    const VectorXd change = gaps_.jacobian * d->dx;
    d->de = VectorXd::Zero(m);
    d->ds = VectorXd::Zero(m);
    for (int c = 0; c < m; ++c) {
      if (!IsMember(c)) continue;
      double de = change[c] + target[c] / phi_[c];
      double ds = target[c];
      if (complete) {
        de += gaps_.delta[c] - e_[c];
        ds -= phi_[c] * s_[c];
      }
      d->de[c] = rho_[c] * de;
      d->ds[c] = (ds - s_[c] * dphi_[c] * d->de[c]) / phi_[c];
    }
  }

  double StepToBoundary(const VectorXd& de, const VectorXd& ds) const {
    double t = 1.0;
    for (int c = 0; c < num_gaps(); ++c) {
      if (!IsMember(c)) continue;
      if (t * de[c] < -kFraction * e_[c]) t = -kFraction * e_[c] / de[c];
      if (t * ds[c] < -kFraction * s_[c]) t = -kFraction * s_[c] / ds[c];
    }
    return t;
  }

  double MeanComplementarity(const VectorXd& e, const VectorXd& s) const {
    const int m = num_gaps();
    VectorXd phi(m), dphi(m);
    function_->EvaluateLaw(m, e.data(), phi.data(), dphi.data());
    double sum = 0.0;
    int count = 0;
    for (int c = 0; c < m; ++c) {
      if (!IsMember(c)) continue;
      sum += phi[c] * s[c];
      ++count;
    }
    return count > 0 ? sum / count : 0.0;
  }

  // Predictor, centring and corrector, each from the same factor; how much of
  // the last two is decided by what they promise.
  void ChooseStep(double mu) {
    const int m = num_gaps();
    Direction predictor, centre, corrector;
    Solve(VectorXd::Zero(m), true, &predictor);
    Solve(VectorXd::Constant(m, mu), false, &centre);
    const double t = StepToBoundary(predictor.de, predictor.ds);
    const double ratio =
        MeanComplementarity(e_ + t * predictor.de, s_ + t * predictor.ds) / mu;
    const double mehrotra = std::clamp(ratio * ratio * ratio, 1e-6, 1.0);
    VectorXd target(m);
    for (int c = 0; c < m; ++c) {
      target[c] = -predictor.de[c] * dphi_[c] * predictor.ds[c];
    }
    Solve(target, false, &corrector);
    double best = 2.0;
    double best_sigma = 0.0, best_omega = 0.0;
    VectorXd de, ds;
    const auto consider = [&](double sigma) {
      for (const double omega : kOmegas) {
        de = predictor.de + sigma * centre.de + omega * corrector.de;
        ds = predictor.ds + sigma * centre.ds + omega * corrector.ds;
        const double step = StepToBoundary(de, ds);
        const double promise =
            std::max(1.0 - step,
                     MeanComplementarity(e_ + step * de, s_ + step * ds) / mu);
        if (!(promise < best)) continue;
        best = promise;
        best_sigma = sigma;
        best_omega = omega;
        t_ = step;
      }
    };
    consider(mehrotra);
    for (const double sigma : kSigmas) {
      if (sigma > mehrotra) consider(sigma);
    }
    dx_ = predictor.dx + best_sigma * centre.dx + best_omega * corrector.dx;
    de_ = predictor.de + best_sigma * centre.de + best_omega * corrector.de;
    ds_ = predictor.ds + best_sigma * centre.ds + best_omega * corrector.ds;
  }

  // From Start() until the run stops, or until nothing gets better.
  void FollowPath() {
    const double unit = ComplementarityOf(*function_, closure_scale_);
    double best = std::numeric_limits<double>::infinity();
    double finish_at = kFinishLength;
    int since = 0;
    while (!monitor_->stopped()) {
      const int m = num_gaps();
      phi_.resize(m);
      dphi_.resize(m);
      function_->EvaluateLaw(m, e_.data(), phi_.data(), dphi_.data());
      const double mu = MeanComplementarity(e_, s_);
      const double length = std::pow(mu / unit, 1.0 / alpha_);
      const double measure = std::max(length, Residual());
      // A NaN is no progress.
      if (measure < kBetter * best) {
        best = measure;
        since = 0;
      } else if (++since >= settings_.patience) {
        monitor_->GiveUp(
            Format("%d iterations in a row did not bring the residual of the "
                   "relaxed problem under %.1e",
                   since,
                   kBetter * best));
        return;
      }
      if (length < finish_at &&
          MaxNorm(g_) < kFinishGradient * scales_.gradient) {
        const auto before = monitor_->counters().iterations;
        if (Finish() || !UpdateGaps()) return;
        finish_at = kFinishAgain * length;
        if (monitor_->counters().iterations > before) {
          // What is known of e and s belongs to another x.
          e_.setZero();
          s_.setZero();
          Join(length * closure_scale_);
        }
        continue;
      }
      bool factored = false;
      {
        const Monitor::LinearTimer timer(monitor_);
        factored = Assemble() && FactorizeShifted();
        if (factored) ChooseStep(mu);
      }
      if (!factored) {
        monitor_->GiveUp("no shift makes the matrix positive definite");
        return;
      }
      if (!Take(length * closure_scale_)) return;
    }
  }

  static double MaxNorm(const VectorXd& v) { return v.cwiseAbs().maxCoeff(); }

  // The larger one of max|B^T f| and the root mean square of e - s - delta,
  // each in its unit.
  double Residual() const {
    VectorXd force = VectorXd::Zero(num_gaps());
    double sum = 0.0;
    for (int c = 0; c < num_gaps(); ++c) {
      if (!IsMember(c)) continue;
      force[c] = gaps_.stiffness[c] * phi_[c];
      const double r = e_[c] - s_[c] - gaps_.delta[c];
      sum += r * r;
    }
    const double unbalanced = MaxNorm(gaps_.jacobian.transpose() * force);
    return std::max(unbalanced / scales_.gradient,
                    std::sqrt(sum / num_gaps()) / closure_scale_);
  }

  // x + t dx and so on. False if the run ends here.
  bool Take(double length) {
    VectorXd x(n_), g(n_);
    double cost;
    Scales scales;
    for (int trial = 0;; ++trial) {
      if (monitor_->BudgetSpent()) return false;
      x = x_ + t_ * dx_;
      if (monitor_->Evaluate(x.data(), &cost, g.data(), &scales)) break;
      if (trial == 20) {
        monitor_->FailEvaluation();
        return false;
      }
      t_ *= 0.25;
    }
    e_ += t_ * de_;
    s_ += t_ * ds_;
    if (!Accept(x, g, cost, scales)) return false;
    Join(length);
    return true;
  }

  // False if the run ends here.
  bool Accept(const VectorXd& x,
              const VectorXd& g,
              double cost,
              const Scales& scales) {
    if (monitor_->IsAbove(cost) && MaxNorm(g) <= monitor_->Tolerance(scales)) {
      monitor_->GiveUp(
          Format("the minimum found, of cost %.10e, is above the least seen, "
                 "%.10e",
                 cost,
                 monitor_->least_cost()));
      return false;
    }
    x_ = x;
    g_ = g;
    cost_ = cost;
    scales_ = scales;
    if (monitor_->Accept(x_.data(), cost_, g_.data(), scales_)) return false;
    monitor_->Recenter(x_.data());
    if (monitor_->WantsRebase() && monitor_->Rebase(x_.data()) &&
        !monitor_->Evaluate(x_.data(), &cost_, g_.data(), &scales_)) {
      monitor_->FailEvaluation();
      return false;
    }
    return UpdateGaps();
  }

  // Exact Newton steps as long as they halve the gradient. True if the run ends
  // here.
  bool Finish() {
    for (int step = 0; step < kFinishSteps; ++step) {
      {
        const Monitor::LinearTimer timer(monitor_);
        if (!rigid_.Evaluate(*function_, x_.data(), &matrix_)) return false;
        ++monitor_->counters().hessians;
        if (!Factorize(0.1 * kFloor * stiffness_scale_)) return false;
        Solve(-g_, &dx_);
      }
      VectorXd g(n_);
      double cost;
      Scales scales;
      const double bound = 0.5 * MaxNorm(g_);
      bool taken = false;
      double t = 1.0;
      for (int trial = 0; trial < 3 && !taken; ++trial, t *= 0.5) {
        if (monitor_->BudgetSpent()) return true;
        const VectorXd x = x_ + t * dx_;
        if (!monitor_->Evaluate(x.data(), &cost, g.data(), &scales)) continue;
        if (!(MaxNorm(g) < bound)) continue;
        taken = true;
        if (!Accept(x, g, cost, scales)) return true;
      }
      if (!taken) return false;
    }
    return false;
  }

  const Settings settings_;
  UnilateralFunction* const function_;
  Monitor* const monitor_;
  LinearSolver* const linear_;
  const int n_;
  const int block_;
  const double alpha_;

  VectorXd x_, g_;
  double cost_ = 0.0;
  Scales scales_;
  // Of the start: units of what follows.
  double stiffness_scale_ = 0.0, closure_scale_ = 0.0;

  // The gaps at x; e = s = 0 for those that do not take part.
  Gaps gaps_;
  std::vector<GapId> ids_;
  VectorXd e_, s_, phi_, dphi_;
  // The system.
  VectorXd first_, second_, rho_;
  std::vector<int> degree_;
  SparseMatrix matrix_;
  RigidHessian rigid_;
  double shift_ = 0.0, prestress_ = 0.0;
  // The step.
  VectorXd dx_, de_, ds_;
  double t_ = 0.0;
};

class InteriorPoint : public Solver {
 public:
  explicit InteriorPoint(Parameters* parameters) : parameters_(*parameters) {
    settings_.theta = parameters->Double(
        "theta", 1.0, 0.0, 1.0, "part of the second derivatives of gaps kept");
    settings_.start = parameters->Double(
        "start",
        1.4,
        0.0,
        1e6,
        "first length, in units of the predicted change of closed gaps");
    settings_.patience = parameters->Int(
        "patience", 10, 1, "iterations without progress before it gives up");
    MakeLinearSolver(parameters);
  }

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const UnilateralFunction*>(&function) != nullptr) {
      return true;
    }
    *error = "interior_point needs a sum of one-sided power laws";
    return false;
  }

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override {
    Monitor monitor(function, options, name());
    std::string why;
    if (!Supports(*function, &why)) {
      monitor.Refuse(why);
      return monitor.Finish(x);
    }
    Parameters parameters = parameters_;
    const std::unique_ptr<LinearSolver> linear = MakeLinearSolver(&parameters);
    Run(settings_,
        dynamic_cast<UnilateralFunction*>(function),
        &monitor,
        linear.get())
        .Minimize(*this, x);
    return monitor.Finish(x);
  }

 private:
  Settings settings_;
  const Parameters parameters_;
};

}  // namespace

REGISTER_SOLVER(interior_point,
                InteriorPoint,
                "primal-dual interior point of one-sided terms, warm-started",
                "Mehrotra, SIAM J. Optim. 2 (1992) 575");

}  // namespace granopt
