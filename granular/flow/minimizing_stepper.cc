#include <algorithm>
#include <cmath>
#include <vector>

#include "Eigen/Cholesky"
#include "granular/flow/backward_euler.h"
#include "granular/flow/incremental_potential.h"

namespace granopt {
namespace {

class MinimizingStepper : public BackwardEuler {
 public:
  MinimizingStepper(const StepperOptions& options,
                    std::unique_ptr<Solver> solver)
      : BackwardEuler(options), solver_(std::move(solver)) {}

  double FirstStep() const override { return options_.step; }

 protected:
  bool Solve(const FlowScene& scene,
             double dt,
             FlowState* state,
             StepReport* report,
             Failure* failure) override {
    Summary summary;
    double change;
    if (Minimize(scene, dt, state, report, &summary, &change)) {
      SetVelocities(scene, dt);
      return true;
    }
    failure->iterations = static_cast<int>(summary.counters.iterations);
    failure->ratio =
        summary.Succeeded()
            ? change / options_.tolerance
            : summary.max_gradient / std::max(summary.tolerance, 1e-300);
    failure->reason = summary.Succeeded() ? "impacts not converged"
                                          : StopReasonName(summary.reason);
    failure->message = ": " + solver_->name() + ": " + summary.message;
    return false;
  }

  // As slowly back as it was taken fast.
  double NextStep(double, double wanted) const override { return 1.5 * wanted; }

 private:
  // Passes of minimization and impacts until they agree.
  bool Minimize(const FlowScene& scene,
                double dt,
                FlowState* state,
                StepReport* report,
                Summary* summary,
                double* change) {
    const int n = scene.size(), stride = scene.stride();
    const std::vector<double>& w = scene.inverse_mass();
    scene.Forces(state->x.data(), state->time + dt, false, &used_);
    ++state->sweeps;
    *change = 0.0;
    std::vector<double> s;
    for (int pass = 0; pass < options_.desired_iterations; ++pass) {
      ++report->iterations;
      ApplyContacts(scene, dt, *state);
      IncrementalPotential phi(scene, *state, dt, u_);
      const int m = phi.NumParameters();
      // Mean way of a grain in the step: the unit of what is tolerated.
      double way = 0.0, mass = 0.0;
      if (s.empty()) s.assign(m, 0.0);
      std::size_t f = 0;
      for (int i = 0; i < n; ++i) {
        if (w[i] == 0.0) continue;
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
          const int e = k * stride + i;
          const double step = dt * (u_[e] + dt * used_.total[e] * w[i]);
          if (pass == 0) s[3 * f + k] = dt * u_[e];
          square += step * step;
        }
        way += std::sqrt(square);
        mass += scene.grains().mass[i];
        ++f;
      }
      if (m == 0) {  // every grain is pinned
        x_ = state->x;
        return true;
      }
      way /= f;
      phi.set_length(way > 0.0 ? way : scene.grains().radius[0]);
      SolveOptions solve;
      // |g| Dt^2 / m <= TOL times the mean way: the error of r that the fixed
      // point is stopped at.
      solve.absolute_tolerance =
          options_.tolerance * phi.length() * (mass / f) / (dt * dt);
      solve.vanishing_tolerance = 0.0;
      solve.max_iterations = 1000;
      *summary = solver_->Minimize(&phi, solve, s.data());
      state->sweeps += summary->counters.evaluations;
      report->evaluations += summary->counters.evaluations;
      if (!summary->Succeeded()) return false;
      x_ = state->x;
      f = 0;
      for (int i = 0; i < n; ++i) {
        if (w[i] == 0.0) continue;
        for (int k = 0; k < 3; ++k) x_[k * stride + i] += s[3 * f + k];
        ++f;
      }
      scene.Forces(x_.data(), state->time + dt, false, &used_);
      ++state->sweeps;
      if (impacts_.empty()) return true;
      // Do impulses of these forces move the end by more than is tolerated?
      std::vector<double> again = state->v;
      ApplyImpacts(impacts_,
                   *scene.options().impact,
                   dt,
                   stride,
                   w.data(),
                   used_.total.data(),
                   again.data());
      double sum = 0.0;
      for (int i = 0; i < n; ++i) {
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
          const double d = dt * (again[k * stride + i] - u_[k * stride + i]);
          square += d * d;
        }
        sum += std::sqrt(square);
      }
      *change = sum / (f * phi.length());
      if (*change <= options_.tolerance) return true;
    }
    return false;
  }

  void SetVelocities(const FlowScene& scene, double dt) {
    const int n = scene.size(), stride = scene.stride();
    const double shrink = 1.0 / (1.0 + dt * scene.options().damping);
    v_.assign(u_.size(), 0.0);
    for (int k = 0; k < 3; ++k) {
      for (int i = 0; i < n; ++i) {
        const int e = k * stride + i;
        const double w = scene.inverse_mass()[i];
        if (w != 0.0) v_[e] = (u_[e] + dt * used_.total[e] * w) * shrink;
      }
    }
  }

  const std::unique_ptr<Solver> solver_;
};

}  // namespace

bool HasConvexStep(const FlowScene& scene, const FlowState& state, double dt) {
  const IncrementalPotential phi(scene, state, dt, state.v);
  const std::vector<double> still(phi.NumParameters(), 0.0);
  SparseMatrix hessian;
  if (!phi.EvaluateHessian(still.data(), &hessian)) return false;
  // Full anyway.
  const Eigen::MatrixXd dense(hessian);
  return Eigen::LLT<Eigen::MatrixXd>(dense).info() == Eigen::Success;
}

bool SolvesSteps(const Solver& solver, std::string* error) {
  FlowSceneOptions options;
  options.grains.mass = options.grains.radius = {1.0};
  FlowState state;
  state.x.assign(3 * options.grains.stride(), 0.0);
  state.v = state.x;
  const std::unique_ptr<FlowScene> scene = FlowScene::Create(options, error);
  const IncrementalPotential phi(*scene, state, 1.0, state.v);
  return solver.Supports(phi, error);
}

std::unique_ptr<Stepper> CreateMinimizingStepper(
    const StepperOptions& options, std::unique_ptr<Solver> solver) {
  return std::make_unique<MinimizingStepper>(options, std::move(solver));
}

}  // namespace granopt
