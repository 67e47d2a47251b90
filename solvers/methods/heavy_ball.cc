// Gradient descent with momentum: the example of a method in one file.
//
//   x_{k+1} = x_k - h z_k + beta (x_k - x_{k-1}),   z = P^-1 g
//
// with h = step Scales::length / Scales::gradient, or h = step with a
// preconditioner. Where the momentum points uphill, g.(x_k - x_{k-1}) > 0, it
// is dropped.
//
// Deviations: Polyak's optimal h and beta need the extreme eigenvalues of the
// Hessian; here the momentum is an option and the restart (O'Donoghue, Candes,
// Found. Comput. Math. 15 (2015) 715) makes up for a wrong one. A step
// that met a stiffness beyond stability, h lambda > 2, or led where the
// function is not finite is taken back, and h lowered for good.

#include <algorithm>
#include <cmath>
#include <memory>

#include "Eigen/Core"
#include "solvers/monitor.h"
#include "solvers/preconditioner.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

using Eigen::VectorXd;

class HeavyBall : public Solver {
 public:
  explicit HeavyBall(Parameters* parameters)
      : preconditioner_(parameters),
        momentum_(parameters->Double("momentum", 0.99, 0.0, 1.0, "beta")),
        step_(parameters->Double(
            "step", 0.25, 1e-12, 1e6, "h, over the stiffness scale")) {}

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
    VectorXd x_new(n), g(n), z(n), move = VectorXd::Zero(n);
    VectorXd g_before = VectorXd::Zero(n), z_before = g_before;
    double cost, cost_before = 0.0;
    Scales scales, scales_before;
    double shrink = 1.0;
    if (!monitor.Begin(*this, x.data(), &cost, g.data(), &scales)) {
      return monitor.Finish(x_out);
    }
    bool is_start = true;
    while (!monitor.BudgetSpent()) {
      double h = shrink * step_;
      if (preconditioner != nullptr) {
        const bool is_new =
            preconditioner->Update({x.data(), cost, g.data(), scales},
                                   is_start ? nullptr : move.data(),
                                   &monitor);
        if (monitor.BudgetSpent()) break;
        preconditioner->Solve(g.data(), z.data(), &monitor);
        // Differences of z are by one P.
        if (is_new && !is_start) {
          preconditioner->Solve(g_before.data(), z_before.data(), &monitor);
        }
      } else {
        z = g;
        h *= monitor.StepUnit();
      }
      if (g.dot(move) > 0.0 && !is_start) {
        // A Rayleigh quotient of P^-1 H, which roundoff only increases.
        const VectorXd dg = g - g_before;
        const double bend = dg.dot(move);
        const bool unstable =
            bend > 0.0 && monitor.max_gradient() > 100.0 * monitor.Roundoff() &&
            h * dg.dot(z - z_before) > 2.0 * bend;
        if (unstable) {
          shrink *= 0.7;
          x -= move;
          g = g_before;
          cost = cost_before;
          scales = scales_before;
        }
        move.setZero();
        is_start = unstable;
        if (unstable) continue;
      }
      is_start = false;
      g_before = g;
      z_before = z;
      x_new = x - h * z + momentum_ * move;
      double new_cost;
      Scales new_scales;
      if (!monitor.Evaluate(x_new.data(), &new_cost, g.data(), &new_scales)) {
        g = g_before;
        shrink *= 0.5;
        move.setZero();
        is_start = true;
        if (shrink < 1e-6) {
          monitor.FailEvaluation();
          break;
        }
        continue;
      }
      move = x_new - x;
      x.swap(x_new);
      cost_before = cost;
      scales_before = scales;
      cost = new_cost;
      scales = new_scales;
      if (monitor.Accept(x.data(), cost, g.data(), scales)) break;
      monitor.Recenter(x.data());
      if (monitor.WantsRebase(std::min(1.0, shrink * step_)) &&
          monitor.Rebase(x.data()) &&
          !monitor.Evaluate(x.data(), &cost, g.data(), &scales)) {
        monitor.FailEvaluation();
        break;
      }
    }
    return monitor.Finish(x_out);
  }

 private:
  const PreconditionerChoice preconditioner_;
  const double momentum_;
  const double step_;
};

}  // namespace

REGISTER_SOLVER(heavy_ball,
                HeavyBall,
                "gradient descent with momentum and restarts",
                "Polyak, USSR Comput. Math. Math. Phys. 4 (1964) 1");

}  // namespace granopt
