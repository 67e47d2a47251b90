#include <algorithm>
#include <cmath>
#include <vector>

#include "Eigen/Cholesky"
#include "granular/flow/incremental_potential.h"
#include "granular/flow/stepper.h"
#include "solvers/format.h"

namespace granopt {
namespace {

class MinimizingStepper : public Stepper {
 public:
  MinimizingStepper(const StepperOptions& options,
                    std::unique_ptr<Solver> solver)
      : options_(options), solver_(std::move(solver)) {}

  double FirstStep() const override { return options_.step; }

  bool Step(const FlowScene& scene,
            double limit,
            FlowState* state,
            StepReport* report,
            std::string* error) override {
    const int stride = scene.stride();
    const auto& impact = scene.options().impact;
    impacts_.clear();
    if (impact) {
      scene.FindContacts(state->x.data(), &pairs_);
      FreezeImpacts(pairs_, *impact, stride, state->v.data(), &impacts_);
    }
    double wanted = options_.is_adaptive ? std::min(state->step, options_.step)
                                         : options_.step;
    const double floor = options_.floor * options_.step;
    for (int attempt = 0; attempt < options_.max_attempts; ++attempt) {
      const double dt = std::min(wanted, limit);
      Summary summary;
      double change;
      if (Solve(scene, dt, state, report, &summary, &change)) {
        Accept(scene, dt, state, report);
        if (scene.HasCollapsed(state->x.data(), state->time, error)) {
          return false;
        }
        // As slowly back as it was taken fast.
        if (options_.is_adaptive) {
          state->step = std::min(options_.step, 1.5 * wanted);
        }
        return true;
      }
      ++state->rejected;
      report->rejections.push_back(
          {state->time,
           dt,
           static_cast<int>(summary.counters.iterations),
           summary.Succeeded()
               ? change / options_.tolerance
               : summary.max_gradient / std::max(summary.tolerance, 1e-300),
           summary.Succeeded() ? "impacts not converged"
                               : StopReasonName(summary.reason)});
      if (!options_.is_adaptive) {
        *error = Format("step %.3g at t = %.9g: %s: %s",
                        dt,
                        state->time,
                        solver_->name().c_str(),
                        summary.message.c_str());
        return false;
      }
      wanted = 0.5 * dt;
      if (wanted < floor) break;
    }
    double ratio;
    const std::string closest = scene.DescribeClosest(state->x.data(), &ratio);
    *error = Format("%s at t = %.9g: Dt would fall below %.1e of its limit; %s",
                    ratio < kCollapsedDistance ? "collapse" : "step floor",
                    state->time,
                    options_.floor,
                    closest.c_str());
    return false;
  }

 private:
  bool Solve(const FlowScene& scene,
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
    std::vector<double> s, previous;
    for (int pass = 0; pass < options_.desired_iterations; ++pass) {
      ++report->iterations;
      u_ = state->v;
      work_ = {};
      if (!impacts_.empty()) {
        work_ = ApplyImpacts(impacts_,
                             *scene.options().impact,
                             dt,
                             stride,
                             w.data(),
                             used_.total.data(),
                             u_.data());
      }
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

  void Accept(const FlowScene& scene,
              double dt,
              FlowState* state,
              StepReport* report) {
    const int n = scene.size(), stride = scene.stride();
    const double shrink = 1.0 / (1.0 + dt * scene.options().damping);
    v_.assign(state->v.size(), 0.0);
    for (int k = 0; k < 3; ++k) {
      for (int i = 0; i < n; ++i) {
        const int e = k * stride + i;
        v_[e] =
            (u_[e] + dt * used_.total[e] * scene.inverse_mass()[i]) * shrink;
        if (scene.inverse_mass()[i] == 0.0) v_[e] = 0.0;
      }
    }
    scene.Book(used_, dt, u_.data(), v_.data(), state);
    scene.BookDamping(v_.data(), dt, u_.data(), v_.data(), state);
    scene.BookImpacts(work_, state);
    state->worst_balance = std::max(state->worst_balance, scene.Balance(used_));
    state->fast += scene.LargestMove(v_.data(), dt) > 1.0 ? 1 : 0;
    state->x.swap(x_);
    state->v.swap(v_);
    state->time += dt;
    ++state->steps;
    scene.ApplyBoundary(state);
    report->step = dt;
  }

  const StepperOptions options_;
  const std::unique_ptr<Solver> solver_;
  std::vector<double> x_, v_, u_;
  SmoothForces used_;
  std::vector<ClosePair> pairs_;
  std::vector<Impact> impacts_;
  ImpactWork work_;
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
