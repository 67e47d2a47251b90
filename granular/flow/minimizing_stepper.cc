#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "granular/flow/stepper.h"
#include "solvers/format.h"
#include "solvers/second_order.h"

namespace granopt {
namespace {

// Phi of one step as a function of displacements from r^L, grain by grain, over
// the mean kinetic scale, so that values near 1 mean what they say.
class IncrementalPotential : public SecondOrderFunction {
 public:
  IncrementalPotential(const FlowScene& scene,
                       const FlowState& state,
                       double dt,
                       const std::vector<double>& u)
      : scene_(scene), state_(state), dt_(dt), u_(u), x_(state.x) {
    for (int i = 0; i < scene.size(); ++i) {
      if (scene.inverse_mass()[i] > 0.0) free_.push_back(i);
    }
    if (scene.options().external) {
      scene.options().external->At(state.time + dt, external_);
    }
  }

  int NumParameters() const override {
    return 3 * static_cast<int>(free_.size());
  }
  int BlockSize() const override { return 3; }
  std::int64_t PatternVersion() const override { return 1; }
  const SmoothForces& forces() const { return forces_; }
  double length() const { return length_; }
  void set_length(double length) { length_ = length; }

  bool EvaluateWithScales(const double* s,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const int stride = scene_.stride();
    if (!Place(s)) return false;
    scene_.Forces(x_.data(), state_.time + dt_, true, &forces_);
    const double damping = scene_.options().damping;
    double sum = 0.0, size = 0.0;
    bool is_finite = true;
    for (std::size_t f = 0; f < free_.size(); ++f) {
      const int i = free_[f];
      const double m = scene_.grains().mass[i];
      for (int k = 0; k < 3; ++k) {
        const int e = k * stride + i;
        const double d = s[3 * f + k];
        const double lag = d - dt_ * u_[e];
        sum += 0.5 * m / (dt_ * dt_) * lag * lag +
               0.5 * damping * m / dt_ * d * d - m * external_[k] * d;
        const double inertia = m / (dt_ * dt_) * lag + damping * m / dt_ * d;
        const double g = inertia - forces_.total[e];
        is_finite = is_finite && std::isfinite(g);
        size += std::fabs(inertia) + std::fabs(forces_.total[e]);
        if (gradient != nullptr) gradient[3 * f + k] = g;
      }
    }
    sum += forces_.near_field_energy + forces_.soft_contact_energy;
    *cost = sum;
    if (scales != nullptr) {
      *scales = {};
      scales->gradient = size / (2.0 * NumParameters());
      scales->length = length_;
    }
    return is_finite && std::isfinite(sum);
  }

  bool EvaluateHessian(const double* s, SparseMatrix* hessian) const override {
    if (!Place(s)) return false;
    const int m = NumParameters();
    if (hessian->rows() != m || !has_pattern_) {
      hessian->resize(m, m);
      hessian->reserve(Eigen::VectorXi::LinSpaced(m, m, 1));
      for (int c = 0; c < m; ++c) {
        for (int r = c; r < m; ++r) hessian->insert(r, c) = 0.0;
      }
      hessian->makeCompressed();
      has_pattern_ = true;
    }
    // Column c holds rows c ... m - 1.
    double* const values = hessian->valuePtr();
    const int* const start = hessian->outerIndexPtr();
    std::fill(values, values + hessian->nonZeros(), 0.0);
    const auto at = [&](int r, int c) -> double& {
      return r >= c ? values[start[c] + r - c] : values[start[r] + c - r];
    };
    const double damping = scene_.options().damping;
    for (std::size_t f = 0; f < free_.size(); ++f) {
      const double mass = scene_.grains().mass[free_[f]];
      for (int k = 0; k < 3; ++k) {
        at(3 * f + k, 3 * f + k) = mass / (dt_ * dt_) + damping * mass / dt_;
      }
    }
    std::vector<int> rank(scene_.size(), -1);
    for (std::size_t f = 0; f < free_.size(); ++f) rank[free_[f]] = f;
    double block[9];
    for (int i = 0; i < scene_.size(); ++i) {
      for (int j = i + 1; j < scene_.size(); ++j) {
        if (rank[i] < 0 && rank[j] < 0) continue;
        if (!PairBlock(i, j, block)) continue;
        for (int a = 0; a < 3; ++a) {
          for (int b = 0; b < 3; ++b) {
            const double value = block[3 * a + b];
            if (a >= b) {
              if (rank[i] >= 0) at(3 * rank[i] + a, 3 * rank[i] + b) += value;
              if (rank[j] >= 0) at(3 * rank[j] + a, 3 * rank[j] + b) += value;
            }
            if (rank[i] >= 0 && rank[j] >= 0) {
              at(3 * rank[j] + a, 3 * rank[i] + b) -= value;
            }
          }
        }
      }
    }
    return true;
  }

  bool HessianTimes(const double* s,
                    const double* v,
                    double* hv) const override {
    SparseMatrix hessian;
    has_pattern_ = false;
    if (!EvaluateHessian(s, &hessian)) return false;
    const Eigen::Map<const Eigen::VectorXd> from(v, NumParameters());
    Eigen::Map<Eigen::VectorXd> to(hv, NumParameters());
    to = hessian.selfadjointView<Eigen::Lower>() * from;
    return true;
  }

 private:
  bool Place(const double* s) const {
    const int stride = scene_.stride();
    for (std::size_t f = 0; f < free_.size(); ++f) {
      for (int k = 0; k < 3; ++k) {
        const int e = k * stride + free_[f];
        if (!std::isfinite(s[3 * f + k])) return false;
        x_[e] = state_.x[e] + s[3 * f + k];
      }
    }
    return true;
  }

  // Second derivatives of V of a pair by the position of one of the two:
  // V'' n n + V' / d (1 - n n). False if the pair has none.
  bool PairBlock(int i, int j, double* block) const {
    const int stride = scene_.stride();
    double r[3], square = 0.0;
    const double period = scene_.options().domain.period();
    for (int k = 0; k < 3; ++k) {
      r[k] = x_[k * stride + j] - x_[k * stride + i];
      if (period > 0.0) r[k] -= period * std::nearbyint(r[k] / period);
      square += r[k] * r[k];
    }
    const double d = std::sqrt(square);
    double first = 0.0, second = 0.0;
    if (const NearField* const field = scene_.near_field()) {
      const RadialValues values = EvaluateLaw(field->law(), d);
      const double weight = field->weights()[i] * field->weights()[j];
      first += weight * values.stiffness;
      second += weight * values.force_over_distance;
    }
    if (scene_.options().soft_contact) {
      const SoftContactValues values = EvaluateSoftContact(
          *scene_.options().soft_contact,
          scene_.grains().radius[i] + scene_.grains().radius[j] - d);
      first += values.stiffness;
      second -= values.force / d;
    }
    if (first == 0.0 && second == 0.0) return false;
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) {
        block[3 * a + b] =
            (first - second) * r[a] * r[b] / square + (a == b ? second : 0.0);
      }
    }
    return true;
  }

  const FlowScene& scene_;
  const FlowState& state_;
  const double dt_;
  const std::vector<double>& u_;
  std::vector<int> free_;
  double external_[3] = {};
  double length_ = 1.0;
  mutable bool has_pattern_ = false;
  mutable std::vector<double> x_;
  mutable SmoothForces forces_;
};

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
      if (m == 0) return true;
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
    state->energy.impact += work_.normal;
    state->energy.friction += work_.friction;
    state->impulses += work_.impulses;
    state->sticking += work_.sticking;
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
