#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>

#include "Eigen/Core"
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

double Env(const char* name, double value) {
  const char* text = std::getenv(name);
  return text == nullptr ? value : std::atof(text);
}

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
        preconditioner_(parameters) {}

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const SecondOrderFunction*>(&function) == nullptr) {
      *error = "newton needs a function with second derivatives";
      return false;
    }
    if (!is_exact_ &&
        dynamic_cast<const UnilateralFunction*>(&function) == nullptr) {
      *error = "hessian=gauss_newton needs a sum of one-sided terms";
      return false;
    }
    return preconditioner_.Supports(function, error);
  }

  Summary Minimize(FirstOrderFunction* f,
                   const SolveOptions& options,
                   double* x_out) const override {
    Monitor monitor(f, options, name());
    const int n = monitor.n();
    VectorXd x = Eigen::Map<const VectorXd>(x_out, n);
    VectorXd g(n), s(n), taken(n);
    double cost = 0.0;
    Scales scales;
    if (!monitor.Begin(*this, x.data(), &cost, g.data(), &scales)) {
      return monitor.Finish(x_out);
    }
    const auto* second = dynamic_cast<const SecondOrderFunction*>(f);
    const auto* unilateral = dynamic_cast<const UnilateralFunction*>(f);
    const double blocks = std::max(1, n / second->BlockSize());
    Parameters parameters;
    const std::unique_ptr<LinearSolver> linear = MakeLinearSolver(&parameters);
    NearlyExactSubproblem::Options sub_options;
    sub_options.least = Env("NW_LEAST", 0.0);
    sub_options.most = Env("NW_MOST", 2.0);
    sub_options.negligible = Env("NW_NEG", 1e-12);
    NearlyExactSubproblem direct(sub_options, linear.get());
    const std::unique_ptr<Preconditioner> preconditioner =
        preconditioner_.Make();
    monitor.Recenter(x.data());
    if (preconditioner != nullptr) {
      preconditioner->Update(
          {x.data(), cost, g.data(), scales}, nullptr, &monitor);
    }
    StepSearch search(n);
    LineSearchOptions line;
    line.curvature = Env("NW_C2", 0.9);
    const bool searches = Env("NW_SEARCH", 1) != 0;
    const double floor_part = Env("NW_FLOOR", 1e-11);
    const bool deflates = Env("NW_DEFL", 1) != 0;
    const double grow = Env("NW_GROW", 4.0), shrink = Env("NW_SHRINK", 2.0);
    const bool debug = Env("NW_DEBUG", 0) != 0;
    const double r0 = Env("NW_R0", 10.0);

    double radius = r0 * std::sqrt(blocks) *
                    (scales.length > 0.0 ? scales.length
                                         : monitor.StepUnit() * g.norm());
    RigidHessian rigid;
    SparseMatrix hessian;
    bool is_new = true;
    int short_of = 0;
    double unit = 0.0;
    while (!monitor.BudgetSpent()) {
      if (is_new) {
        const Monitor::LinearTimer timer(&monitor);
        bool done;
        if (!is_exact_) {
          done = unilateral->EvaluateStiffness(x.data(), 0.0, &hessian);
        } else if (unilateral != nullptr && deflates) {
          done = rigid.Evaluate(*unilateral, x.data(), &hessian);
        } else {
          done = second->EvaluateHessian(x.data(), &hessian);
        }
        if (!done) {
          monitor.GiveUp("no Hessian");
          break;
        }
        ++monitor.counters().hessians;
        unit = 0.0;
        for (int j = 0; j < n; ++j) {
          unit += std::abs(hessian.coeff(j, j));
        }
        unit /= n;
        is_new = false;
      }
      const double floor = floor_part * unit;
      SubproblemStep step;
      const std::int64_t factors = linear->factorizations();
      const std::int64_t fails = direct.failures();
      if (is_direct_) {
        const Monitor::LinearTimer timer(&monitor);
        const std::int64_t solves = linear->solves();
        step = direct.Solve(
            hessian,
            second->PatternVersion(),
            floor,
            unit,
            g,
            radius,
            [&]() {
              if (!is_exact_ || unilateral == nullptr) return 1e-3 * unit;
              const VectorXd before = hessian.diagonal();
              SparseMatrix h0;
              unilateral->EvaluateStiffness(x.data(), 0.0, &h0);
              ++monitor.counters().hessians;
              const VectorXd after = h0.diagonal();
              return Env("NW_RAISE", 0.1) * (after - before).maxCoeff();
            },
            &s);
        monitor.counters().factorizations += linear->factorizations() - factors;
        monitor.counters().solves += linear->solves() - solves;
      } else {
        TruncatedSubproblem truncated;
        truncated.times = [&](const VectorXd& v, VectorXd* hv) {
          const Monitor::LinearTimer timer(&monitor);
          if (Env("NW_TIMES", 0) != 0) {
            second->HessianTimes(x.data(), v.data(), hv->data());
          } else {
            hv->noalias() = hessian.selfadjointView<Eigen::Lower>() * v;
          }
        };
        if (preconditioner != nullptr) {
          truncated.solve = [&](const VectorXd& r, VectorXd* z) {
            preconditioner->Solve(r.data(), z->data(), &monitor);
          };
        }
        truncated.tolerance = std::min(
            0.5, std::sqrt(monitor.max_gradient() / scales.gradient));
        truncated.max_iterations = 2 * n;
        step = truncated.Solve(g, radius * radius, &s);
        monitor.counters().linear_iterations += step.iterations;
      }
      if (step.end == SubproblemStep::End::FAILED) {
        monitor.GiveUp("no factor");
        break;
      }
      const LinePoint start{0.0, cost, g.dot(s)};
      LinePoint end = start;
      const double norm = std::sqrt(step.norm2);
      if (start.slope < 0.0) {
        if (searches) {
          end = search.Search(line, x, s, start, 1.0, &monitor).point;
        } else {
          search.x = x + s;
          if (monitor.Evaluate(search.x.data(),
                               &search.cost,
                               search.g.data(),
                               &search.scales)) {
            LinePoint p{1.0, search.cost, search.g.dot(s)};
            if (LineChange(start, p) <= 1e-4 * step.change) end = p;
          }
        }
      }
      const double bend = 2.0 * (step.change - start.slope);
      const double predicted =
          end.step * (start.slope + 0.5 * end.step * bend);
      const double ratio = LineChange(start, end) / predicted;
      if (debug) {
        std::fprintf(
            stderr,
            "it %lld E %.6e g/f %.2e  len %.1e radius %.2e |s| %.2e lam/unit "
            "%.2e end %d fac %lld fail %lld cg %lld  a %.3g ratio %.2g ev "
            "%lld\n",
            (long long)monitor.counters().iterations,
            cost,
            monitor.max_gradient() / scales.gradient,
            scales.length,
            radius / std::sqrt(blocks),
            norm / std::sqrt(blocks),
            step.lambda / unit,
            (int)step.end,
            (long long)(linear->factorizations() - factors),
            (long long)(direct.failures() - fails),
            (long long)step.iterations,
            end.step,
            ratio,
            (long long)monitor.counters().evaluations);
      }
      if (monitor.stopped() && end.step == 0.0) break;
      if (end.step == 0.0 || search.x == x) {
        if (monitor.LastEvaluationFailed()) {
          monitor.FailEvaluation();
          break;
        }
        if (++short_of > 20) {
          monitor.GiveUp("no step lowers the cost");
          break;
        }
        radius = 0.25 * norm;
        direct.Suggest(radius);
        continue;
      }
      short_of = 0;
      const double length = end.step * norm;
      if (end.step < 1.0) {
        radius = shrink * length;
      } else if (ratio > 0.5) {
        radius = std::max(radius, grow * length);
      } else if (ratio < 0.25) {
        radius = 0.5 * length;
      }
      taken = search.x - x;
      std::swap(x, search.x);
      std::swap(g, search.g);
      cost = search.cost;
      scales = search.scales;
      is_new = true;
      if (monitor.Accept(x.data(), cost, g.data(), scales)) break;
      direct.Suggest(radius);
      if (preconditioner != nullptr) {
        preconditioner->Update(
            {x.data(), cost, g.data(), scales}, taken.data(), &monitor);
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
  const bool is_direct_;
  const bool is_exact_;
  const PreconditionerChoice preconditioner_;
};

}  // namespace

REGISTER_SOLVER(newton, Newton, "trust region", "x");

}  // namespace granopt
