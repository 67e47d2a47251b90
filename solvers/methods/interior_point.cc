// A primal-dual interior point for sums of one-sided power laws,
//   E(x) = min over e of sum_c k_c e_c^alpha / alpha,
//          e_c - s_c = delta_c(x),  e_c >= 0,  s_c >= 0,
// whose contacts may open and close in any number within one iteration. With
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
// once contacts are told from gaps exact Newton steps finish.
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
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Core"
#include "solvers/barrier.h"
#include "solvers/format.h"
#include "solvers/linear_solver.h"
#include "solvers/monitor.h"
#include "solvers/registry.h"
#include "solvers/unilateral.h"

namespace granopt {
namespace {

using Eigen::VectorXd;

// Of the step to the boundary.
constexpr double kFraction = 0.995;

struct Settings {
  double theta;
  double start;
  double loose;
  double reach;
  int patience;
  int restarts;
  double polish;
  double recentre;
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
    least_cost_ = cost_;
    for (int attempt = 0; !monitor_->stopped(); ++attempt) {
      if (attempt > settings_.restarts) {
        monitor_->GiveUp(why_);
        return;
      }
      if (attempt > 0) ++monitor_->counters().restarts;
      if (!(scales_.length > 0.0 && scales_.gradient > 0.0)) {
        monitor_->GiveUp("no term is active, and none says how far to go");
        return;
      }
      stiffness_scale_ = scales_.gradient / scales_.length;
      overlap_ = scales_.length * (alpha_ - 1.0);
      if (!Start(attempt)) return;
      FollowPath();
    }
  }

 private:
  int num_gaps() const { return static_cast<int>(gaps_.ids.size()); }
  bool IsMember(int c) const { return e_[c] > 0.0; }

  // e and s of the central path at x.
  bool Start(int attempt) {
    if (!UpdateGaps()) return false;
    const int m = num_gaps();
    shift_ = 0.0;
    double length = overlap_;
    if (settings_.start > 0.0) {
      length = std::clamp(
          settings_.start * PredictedChange(), 1e-4 * overlap_, overlap_);
    }
    // What did not work is tried from closer by.
    for (int k = 0; k < attempt; ++k) length *= 0.25;
    e_.resize(m);
    s_.resize(m);
    CentralClosures(
        *function_, m, gaps_.delta.data(), length, e_.data(), s_.data());
    for (int c = 0; c < m; ++c) {
      if (gaps_.delta[c] > -settings_.reach * gaps_.margin) continue;
      e_[c] = s_[c] = 0.0;
    }
    length_ = length;
    return true;
  }

  // e and s of the central path at x, of the length that they have on average.
  void Centre() {
    const double mu = MeanComplementarity(e_, s_);
    length_ = std::pow(mu, 1.0 / alpha_);
    for (int c = 0; c < num_gaps(); ++c) {
      if (!IsMember(c)) continue;
      CentralClosures(*function_, 1, &gaps_.delta[c], length_, &e_[c], &s_[c]);
    }
  }

  // Root mean square of the change of the gaps in a step of Gauss and Newton.
  double PredictedChange() {
    const Monitor::LinearTimer timer(monitor_);
    if (!function_->EvaluateStiffness(x_.data(), 0.0, &matrix_)) {
      return overlap_;
    }
    ++monitor_->counters().hessians;
    if (!Factorize(1e-6 * stiffness_scale_)) return overlap_;
    VectorXd step(n_);
    Solve(-g_, &step);
    const VectorXd change = gaps_.jacobian * step;
    double sum = 0.0;
    int count = 0;
    for (int c = 0; c < num_gaps(); ++c) {
      if (gaps_.delta[c] > 0.0) {
        sum += change[c] * change[c];
        ++count;
      }
    }
    return count > 0 ? std::sqrt(sum / count) : 0.0;
  }

  bool Factorize(double shift) {
    ++monitor_->counters().factorizations;
    return linear_->Factorize(matrix_, function_->PatternVersion(), shift);
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

  // Gaps that have come near join on the central path.
  void Join() {
    for (int c = 0; c < num_gaps(); ++c) {
      if (IsMember(c) || gaps_.delta[c] <= -settings_.reach * gaps_.margin) {
        continue;
      }
      CentralClosures(*function_, 1, &gaps_.delta[c], length_, &e_[c], &s_[c]);
    }
  }

  // Writes the matrix of the current e and s.
  bool Assemble() {
    const int m = num_gaps();
    first_.resize(m);
    second_.resize(m);
    rho_.resize(m);
    // Objects that too few closed gaps hold.
    degree_.assign(n_ / block_, 0);
    for (int c = 0; c < m; ++c) {
      const GapId& id = gaps_.ids[c];
      if (!IsMember(c) || id.i == id.j || !(e_[c] > s_[c])) continue;
      ++degree_[id.i];
      ++degree_[id.j];
    }
    double prestress = 0.0;
    for (int c = 0; c < m; ++c) {
      first_[c] = second_[c] = rho_[c] = 0.0;
      if (!IsMember(c)) continue;
      const double k = gaps_.stiffness[c];
      rho_[c] = phi_[c] / (phi_[c] + s_[c] * dphi_[c]);
      first_[c] = k * dphi_[c] * rho_[c];
      const GapId& id = gaps_.ids[c];
      if (degree_[id.i] > block_ && degree_[id.j] > block_) {
        second_[c] = settings_.theta * k * phi_[c];
        prestress = std::max(prestress, second_[c] * gaps_.curvature[c]);
      }
    }
    prestress_ = prestress;
    if (!function_->EvaluateWeightedHessian(
            x_.data(), first_.data(), second_.data(), &matrix_)) {
      return false;
    }
    ++monitor_->counters().hessians;
    HoldLooseObjects();
    return true;
  }

  void HoldLooseObjects() {
    for (std::size_t i = 0; i < degree_.size(); ++i) {
      if (degree_[i] > block_) continue;
      for (int k = 0; k < block_; ++k) {
        const int column = static_cast<int>(i) * block_ + k;
        matrix_.valuePtr()[matrix_.outerIndexPtr()[column]] +=
            settings_.loose * prestress_;
      }
    }
  }

  // Factors the matrix, shifted until that is possible.
  bool FactorizeShifted() {
    const double floor = 1e-9 * stiffness_scale_;
    for (int trial = 0; trial < 30; ++trial) {
      if (Factorize(std::max(shift_, floor))) {
        shift_ *= 0.25;
        return true;
      }
      shift_ = std::max(4.0 * shift_, 0.05 * prestress_);
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
    double best_sigma = 0, best_omega = 0;
    VectorXd de, ds;
    for (const double sigma : {mehrotra, 0.03, 0.1, 0.3, 0.7}) {
      if (sigma < mehrotra) continue;
      for (const double omega : {1.0, 0.3, 0.0}) {
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
    }
    dx_ = predictor.dx + best_sigma * centre.dx + best_omega * corrector.dx;
    de_ = predictor.de + best_sigma * centre.de + best_omega * corrector.de;
    ds_ = predictor.ds + best_sigma * centre.ds + best_omega * corrector.ds;
    if (debug_)
      std::fprintf(stderr,
                   "    mehrotra %.2e sigma %.2e omega %.1f promise %.3f\n",
                   mehrotra,
                   best_sigma,
                   best_omega,
                   best);
  }

  // From Start() until the run stops, or until nothing gets better.
  void FollowPath() {
    double best = std::numeric_limits<double>::infinity();
    int since = 0;
    while (!monitor_->stopped()) {
      const int m = num_gaps();
      phi_.resize(m);
      dphi_.resize(m);
      function_->EvaluateLaw(m, e_.data(), phi_.data(), dphi_.data());
      const double mu = MeanComplementarity(e_, s_);
      length_ = std::pow(mu, 1.0 / alpha_);
      const double unit = ComplementarityOf(*function_, overlap_);
      // The residual of the forces, and of the definition of e and s.
      VectorXd force = gaps_.stiffness.cwiseProduct(phi_);
      double infeasible = 0.0;
      for (int c = 0; c < m; ++c) {
        if (!IsMember(c)) {
          force[c] = 0.0;
          continue;
        }
        const double r = e_[c] - s_[c] - gaps_.delta[c];
        infeasible += r * r;
      }
      infeasible = std::sqrt(infeasible / m) / overlap_;
      const VectorXd residual = gaps_.jacobian.transpose() * force;
      const double unbalanced =
          residual.cwiseAbs().maxCoeff() / scales_.gradient;
      const double central = std::pow(mu / unit, 1.0 / alpha_);
      const double measure = std::max({central, unbalanced, infeasible});
      if (debug_) {
        std::fprintf(stderr,
                     "  ip mu %.2e dual %.2e primal %.2e |g| %.2e E %.9e shift "
                     "%.1e t %.3f fact %d\n",
                     central,
                     unbalanced,
                     infeasible,
                     g_.cwiseAbs().maxCoeff() / scales_.gradient,
                     cost_,
                     shift_ / stiffness_scale_,
                     t_,
                     (int)monitor_->counters().factorizations);
      }
      if (measure < 0.9 * best) {
        best = measure;
        since = 0;
      } else if (++since >= settings_.patience) {
        why_ = Format("%d iterations in a row led nowhere", since);
        return;
      }
      if (central < settings_.polish &&
          g_.cwiseAbs().maxCoeff() < 1e-2 * scales_.gradient && Polish()) {
        return;
      }
      if (monitor_->stopped()) return;

      bool factored = false;
      {
        const Monitor::LinearTimer timer(monitor_);
        factored = Assemble() && FactorizeShifted();
        if (factored) {
          ChooseStep(mu);
        }
      }
      if (!factored) {
        if (!monitor_->stopped()) why_ = "no shift made the matrix definite";
        return;
      }
      if (!Take()) return;
    }
  }

  // x + t dx and so on; false if the run or the path ends here.
  bool Take() {
    VectorXd trial(n_), g(n_);
    double cost;
    Scales scales;
    for (int halvings = 0;; ++halvings) {
      trial = x_ + t_ * dx_;
      if (monitor_->BudgetSpent()) return false;
      if (monitor_->Evaluate(trial.data(), &cost, g.data(), &scales)) break;
      if (halvings == 20) {
        monitor_->FailEvaluation();
        return false;
      }
      t_ *= 0.25;
    }
    e_ += t_ * de_;
    s_ += t_ * ds_;
    if (!AcceptPoint(trial, g, cost, scales)) return false;
    if (!UpdateGaps()) return false;
    Join();
    if (t_ < settings_.recentre) Centre();
    return true;
  }

  // False if the run ends.
  bool AcceptPoint(const VectorXd& x,
                   const VectorXd& g,
                   double cost,
                   const Scales& scales) {
    x_ = x;
    g_ = g;
    cost_ = cost;
    scales_ = scales;
    least_cost_ = std::min(least_cost_, cost);
    if (monitor_->Accept(x_.data(), cost_, g_.data(), scales_)) return false;
    monitor_->Recenter(x_.data());
    return true;
  }

  // Exact Newton steps as long as they halve the gradient. True if the run is
  // over.
  bool Polish() {
    for (int step = 0; step < 12; ++step) {
      {
        const Monitor::LinearTimer timer(monitor_);
        if (!function_->EvaluateHessian(x_.data(), &matrix_)) return false;
        ++monitor_->counters().hessians;
        if (!Factorize(1e-10 * stiffness_scale_)) {
          if (debug_) std::fprintf(stderr, "  polish: indefinite\n");
          return false;
        }
        Solve(-g_, &dx_);
      }
      VectorXd g(n_);
      double cost;
      Scales scales;
      const double before = g_.cwiseAbs().maxCoeff();
      bool taken = false;
      double t = 1.0;
      for (int trial = 0; trial < 3 && !taken; ++trial, t *= 0.5) {
        const VectorXd x = x_ + t * dx_;
        if (monitor_->BudgetSpent()) return true;
        if (!monitor_->Evaluate(x.data(), &cost, g.data(), &scales)) continue;
        if (!(g.cwiseAbs().maxCoeff() < 0.5 * before)) continue;
        taken = true;
        if (!AcceptPoint(x, g, cost, scales)) return true;
      }
      if (debug_) {
        std::fprintf(stderr,
                     "  polish |g| %.2e taken %d\n",
                     g.cwiseAbs().maxCoeff() / scales_.gradient,
                     taken);
      }
      if (!taken) break;
      if (!UpdateGaps()) return true;
    }
    if (!UpdateGaps()) return true;
    Join();
    return false;
  }

  const Settings settings_;
  UnilateralFunction* const function_;
  Monitor* const monitor_;
  LinearSolver* const linear_;
  const int n_;
  const int block_;
  const double alpha_;
  const bool debug_ = std::getenv("GRANOPT_IP") != nullptr;

  VectorXd x_, g_;
  double cost_ = 0.0, least_cost_ = 0.0;
  Scales scales_;
  std::string why_;

  Gaps gaps_;
  std::vector<GapId> ids_;
  VectorXd e_, s_, phi_, dphi_;
  VectorXd first_, second_, rho_;
  std::vector<int> degree_;
  SparseMatrix matrix_;
  VectorXd dx_, de_, ds_;
  double stiffness_scale_ = 0.0, overlap_ = 0.0, length_ = 0.0;
  double shift_ = 0.0, prestress_ = 0.0, t_ = 0.0;
};

class InteriorPoint : public Solver {
 public:
  explicit InteriorPoint(Parameters* parameters) : parameters_(*parameters) {
    settings_.theta = parameters->Double(
        "theta", 1.0, 0.0, 1.0, "part of the pre-stress that the matrix has");
    settings_.start =
        parameters->Double("start", 1.4, 0.0, 1e6, "first length");
    settings_.loose = parameters->Double("loose", 0.03, 0.0, 1e6, "loose");
    settings_.reach = parameters->Double("reach", 1, 0.0, 1e6, "reach");
    settings_.patience = parameters->Int("patience", 8, 1, "patience");
    settings_.restarts = parameters->Int("restarts", 3, 0, "restarts");
    settings_.polish = parameters->Double("polish", 1e-3, 0, 1, "polish");
    settings_.recentre = parameters->Double("recentre", 0.1, 0, 1, "recentre");
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
