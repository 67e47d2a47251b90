// FIRE 2.0: damped dynamics that stops where it runs uphill.
//
// With z = P^-1 g, kappa = Scales::gradient / Scales::length (1 with a
// preconditioner, whose z is a length already), a velocity v that is a length
// and a time step h in units of kappa^(-1/2), after each evaluation:
//   g.v < 0 for more than `delay` steps: h = min(1.1 h, h_max), a = 0.99 a
//   g.v >= 0:  h = max(0.5 h, h_min), a = 0.25, x = x - h v / 2, v = 0
//   v = (1 - a) (v - h z / kappa) - b z / kappa,   x = x + h v,
//   b = a kappa |v - h z / kappa| / |z|   (norms in P), but see below.
// h_max = 0.65 is stable up to an eigenvalue 4 / h_max^2 = 9.5 kappa of the
// Hessian, a little more than that of a network of equal springs in the plane.
//
// Deviations from Guenole et al.: h_max follows from the function's own
// stiffness; where that changes along the way (alpha > 2) so does kappa. b is
// bounded. Where v is in slow modes, |v| / |z| is large and the mixing alone is
// a steepest descent with a step far beyond the limit of stability: fast modes
// are excited again and again and the run ends in a cycle: of three problems of
// 8192 variables that take 1300 to 1700 steps with the bound, the published
// form (mixing=published) took more than 20000 in three at delay = 5, in two at
// delay = 50. As a two-term recursion a step reads
//   x + (1 - a) (x - x_before) - h (h + b) z / kappa,
// which is stable for h (h + b) lambda < 2 (2 - a) kappa; b obeys that for
// lambda = 7 kappa. If g.v >= 0 and the last step met a stiffness above
// 4 kappa / h_max^2, or where the function is not finite, h_max is lowered for
// good: the function's own stiffness was too small.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "Eigen/Core"
#include "solvers/monitor.h"
#include "solvers/preconditioner.h"
#include "solvers/registry.h"
#include "solvers/vector_loops.h"

namespace granopt {
namespace {

using Eigen::VectorXd;

constexpr double kIncrease = 1.1;
constexpr double kDecrease = 0.5;
constexpr double kMixing = 0.25;
constexpr double kMixingDecrease = 0.99;
// h_0 = h_max / 10, h_min = 0.02 h_0.
constexpr double kFirstStep = 0.1;
constexpr double kLeastStep = 0.002;
// The largest eigenvalue that the mixing is bounded for, in units of kappa, as
// long as h_max has not been lowered.
constexpr double kStiffest = 7.0;

class Fire : public Solver {
 public:
  explicit Fire(Parameters* parameters)
      : preconditioner_(parameters),
        h_max_(parameters->Double(
            "dt_max",
            0.65,
            1e-6,
            10.0,
            "largest time step, times the root of the stiffness scale")),
        delay_(parameters->Int(
            "delay", 20, 0, "downhill steps before the time step grows")),
        is_bounded_(parameters->Choice("mixing",
                                       "bounded",
                                       "bounded|published",
                                       "of velocity and force: kept stable, or "
                                       "as in FIRE 2.0") == 0) {}

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    return preconditioner_.Supports(function, error);
  }

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x_out) const override {
    Monitor monitor(function, options, name());
    const int n = monitor.n();
    const std::unique_ptr<Preconditioner> preconditioner =
        preconditioner_.Make();
    VectorXd x = Eigen::Map<const VectorXd>(x_out, n);
    VectorXd g(n), g_before(n), v = VectorXd::Zero(n);
    const int own = preconditioner != nullptr ? n : 0;
    VectorXd z_own(own), z_before_own(own), step(own);
    double cost;
    Scales scales;
    if (!monitor.Begin(*this, x.data(), &cost, g.data(), &scales)) {
      return monitor.Finish(x_out);
    }
    if (preconditioner != nullptr) {
      preconditioner->Update(
          {x.data(), cost, g.data(), scales}, nullptr, &monitor);
    }
    monitor.Recenter(x.data());
    double h_max = h_max_;
    double h = kFirstStep * h_max;
    double mixing = kMixing;
    int downhill = 0;
    double last_h = h;
    g_before = g;

    while (!monitor.BudgetSpent()) {
      // Step of length one for a gradient of one gradient scale.
      double unit = 1.0;
      if (preconditioner != nullptr) {
        preconditioner->Solve(g.data(), z_own.data(), &monitor);
      } else {
        unit = monitor.StepUnit();
      }
      const VectorXd& z = preconditioner != nullptr ? z_own : g;
      const VectorXd& z_before =
          preconditioner != nullptr ? z_before_own : g_before;

      auto [gv, gz, vv] = Dots(n, g.data(), v.data());
      if (preconditioner != nullptr) {
        gz = Dot(n, g.data(), z.data());
        // |v|^2 in P.
        vv = preconditioner->Dot(v.data(), v.data(), n);
      }
      if (gv < 0.0) {
        if (++downhill > delay_) {
          h = std::min(kIncrease * h, h_max);
          mixing *= kMixingDecrease;
        }
      } else {
        downhill = 0;
        // The stiffness met in the last step, in units of kappa: a Rayleigh
        // quotient of P^-1 H, which roundoff only increases.
        const VectorXd dg = g - g_before;
        const double bend = last_h * dg.dot(v);
        const double met =
            bend > 0.0 ? dg.dot(z - z_before) / bend * unit : 0.0;
        if (h_max * h_max * met > 4.0 &&
            monitor.max_gradient() > 100.0 * monitor.Roundoff()) {
          h_max *= 0.8;
        }
        h = std::max(kDecrease * h, kLeastStep * h_max);
        mixing = kMixing;
        x -= 0.5 * h * v;
        v.setZero();
        gv = vv = 0.0;
      }
      // v - h unit z: its norm, and with it the mixing.
      vv = std::max(0.0, vv - 2.0 * h * unit * gv + h * h * unit * unit * gz);
      const double lowered = h_max_ / h_max;
      const double stiffest = kStiffest * (lowered * lowered);
      const double most = 2.0 * (2.0 - mixing) / (stiffest * h) - h;
      const double b =
          std::clamp(gz > 0.0 ? mixing * std::sqrt(vv / gz) / unit : 0.0,
                     0.0,
                     is_bounded_ ? std::max(0.0, most)
                                 : std::numeric_limits<double>::infinity());
      const double keep = 1.0 - mixing;
      const double push = (keep * h + b) * unit;
      Move(n, keep, push, z.data(), h, v.data(), x.data());
      std::swap(g, g_before);  // z, if it is one of them, has been used
      if (preconditioner != nullptr) std::swap(z_own, z_before_own);
      last_h = h;
      double new_cost;
      Scales new_scales;
      if (!monitor.Evaluate(x.data(), &new_cost, g.data(), &new_scales)) {
        x -= h * v;
        g = g_before;
        v.setZero();
        h_max *= kDecrease;
        h = kFirstStep * h_max;
        downhill = 0;
        mixing = kMixing;
        if (h_max < 1e-6 * h_max_) {
          monitor.FailEvaluation();
          break;
        }
        continue;
      }
      cost = new_cost;
      scales = new_scales;
      if (monitor.Accept(x.data(), cost, g.data(), scales)) break;
      if (preconditioner != nullptr) {
        step = h * v;
        // Differences of z are by one P.
        if (preconditioner->Update(
                {x.data(), cost, g.data(), scales}, step.data(), &monitor)) {
          preconditioner->Solve(g_before.data(), z_before_own.data(), &monitor);
        }
      }
      monitor.Recenter(x.data());
      if (monitor.WantsRebase() && monitor.Rebase(x.data()) &&
          !monitor.Evaluate(x.data(), &cost, g.data(), &scales)) {
        monitor.FailEvaluation();
        break;
      }
    }
    return monitor.Finish(x_out);
  }

 private:
  const PreconditionerChoice preconditioner_;
  const double h_max_;
  const int delay_;
  const bool is_bounded_;
};

}  // namespace

REGISTER_SOLVER(
    fire,
    Fire,
    "damped dynamics with an adaptive time step, FIRE 2.0 with bounded mixing",
    "Bitzek et al., Phys. Rev. Lett. 97 (2006) 170201; Guenole et "
    "al., Comput. Mater. Sci. 175 (2020) 109584");

}  // namespace granopt
