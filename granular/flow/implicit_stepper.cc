#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "granular/flow/stepper.h"
#include "solvers/format.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

using Sweep = StepperOptions::Sweep;

class ImplicitStepper : public Stepper {
 public:
  explicit ImplicitStepper(const StepperOptions& options) : options_(options) {}

  double FirstStep() const override {
    return options_.is_adaptive ? std::min(options_.first_step, options_.step)
                                : options_.step;
  }

  bool Step(const FlowScene& scene,
            double limit,
            FlowState* state,
            StepReport* report,
            std::string* error) override {
    const std::size_t size = state->x.size();
    scene.Forces(state->x.data(), state->time, false, &start_);
    ++state->sweeps;
    if (scene.options().impact) {
      scene.FindContacts(state->x.data(), &pairs_);
      FreezeImpacts(pairs_,
                    *scene.options().impact,
                    scene.stride(),
                    state->v.data(),
                    &impacts_);
    }
    double wanted = options_.is_adaptive ? std::min(state->step, options_.step)
                                         : options_.step;
    const double floor = options_.floor * options_.step;
    for (int attempt = 0; attempt < options_.max_attempts; ++attempt) {
      const double dt = std::min(wanted, limit);
      x_ = state->x;
      v_.assign(size, 0.0);
      double factor;
      const Outcome outcome = Iterate(scene, dt, state, report, &factor);
      if (outcome == Outcome::CONVERGED) {
        Accept(scene, dt, factor, wanted, state, report);
        return !scene.HasCollapsed(state->x.data(), state->time, error);
      }
      ++state->rejected;
      report->rejections.push_back(
          {state->time,
           dt,
           iterations_,
           change_ / options_.tolerance,
           outcome == Outcome::NOT_FINITE ? "not finite" : "not converged"});
      if (!options_.is_adaptive) {
        *error = Format(
            "step %.3g at t = %.9g did not converge: change %.2e > "
            "%.2e after %d iterations",
            dt,
            state->time,
            change_,
            options_.tolerance,
            iterations_);
        return false;
      }
      wanted = factor * dt;
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
  enum class Outcome { CONVERGED, NOT_CONVERGED, NOT_FINITE };

  // u after impacts, given forces; impulses of impacts are those of this pass.
  void ApplyContacts(const FlowScene& scene,
                     double dt,
                     const std::vector<double>& force,
                     const FlowState& state) {
    u_ = state.v;
    work_ = {};
    if (impacts_.empty() || !scene.options().impact) return;
    work_ = ApplyImpacts(impacts_,
                         *scene.options().impact,
                         dt,
                         scene.stride(),
                         scene.inverse_mass().data(),
                         force.data(),
                         u_.data());
  }

  // The fixed point of one step from x_ = r^L; v_ and used_ are those of its
  // last iterate. `factor`: Phi.
  Outcome Iterate(const FlowScene& scene,
                  double dt,
                  FlowState* state,
                  StepReport* report,
                  double* factor) {
    const int n = scene.size(), stride = scene.stride();
    const std::vector<double>& w = scene.inverse_mass();
    const double shrink = 1.0 / (1.0 + dt * scene.options().damping);
    const double gamma = options_.relaxation;
    double first_change = 1.0;
    *factor = 0.5;
    change_ = std::numeric_limits<double>::infinity();
    for (int k = 1; k <= options_.desired_iterations; ++k) {
      iterations_ = k;
      ++report->iterations;
      // Sweeps grain by grain leave each grain's last near field in used_.
      const bool is_known = k > 1 && options_.sweep != Sweep::JACOBI &&
                            scene.near_field() != nullptr &&
                            !scene.options().soft_contact;
      if (k == 1 && !scene.options().external) {
        used_ = start_;
      } else if (!is_known) {
        scene.Forces(x_.data(), state->time + dt, false, &used_);
        ++state->sweeps;
      }
      ApplyContacts(scene, dt, used_.total, *state);
      last_ = x_;
      if (options_.sweep == Sweep::JACOBI || scene.near_field() == nullptr) {
        for (int c = 0; c < 3; ++c) {
          for (int i = 0; i < n; ++i) {
            const int e = c * stride + i;
            if (w[i] == 0.0) continue;
            v_[e] = (u_[e] + dt * used_.total[e] * w[i]) * shrink;
            x_[e] = gamma * (state->x[e] + dt * v_[e]) + (1.0 - gamma) * x_[e];
          }
        }
      } else {
        SweepGroups(scene, dt, shrink, state);
      }
      double moved = 0.0, way = 0.0;
      for (int i = 0; i < n; ++i) {
        double a = 0.0, b = 0.0;
        for (int c = 0; c < 3; ++c) {
          const int e = c * stride + i;
          a += (x_[e] - last_[e]) * (x_[e] - last_[e]);
          b += (x_[e] - state->x[e]) * (x_[e] - state->x[e]);
        }
        moved += std::sqrt(a);
        way += std::sqrt(b);
      }
      if (!std::isfinite(moved) || !std::isfinite(way)) {
        return Outcome::NOT_FINITE;
      }
      change_ = way > 0.0 ? moved / way : 0.0;
      if (k == 1) first_change = change_;
      if (change_ <= options_.tolerance) break;
    }
    *factor = options_.safety * Phi(first_change);
    return change_ <= options_.tolerance ? Outcome::CONVERGED
                                         : Outcome::NOT_CONVERGED;
  }

  // (6.8) over Dt. An iteration that changes nothing says that any step would
  // do: ten times, for one.
  double Phi(double first_change) const {
    constexpr double kMost = 10.0;
    const double p = options_.order;
    if (first_change <= options_.tolerance || change_ <= 0.0) return kMost;
    const double target = std::pow(options_.tolerance / first_change,
                                   1.0 / (p * options_.desired_iterations));
    const double reached =
        std::pow(change_ / first_change, 1.0 / (p * iterations_));
    return std::clamp(target / reached, 0.1, kMost);
  }

  // Gauss-Seidel, grain by grain; in groups, each with the other groups frozen
  // and iterated by itself until it has converged.
  void SweepGroups(const FlowScene& scene,
                   double dt,
                   double shrink,
                   FlowState* state) {
    const int n = scene.size(), stride = scene.stride();
    const int groups = options_.sweep == Sweep::GAUSS_SEIDEL
                           ? 1
                           : std::min(options_.groups, n);
    std::vector<std::vector<double>> frozen(groups);
    std::vector<int> inner(groups, 0);
    ForEach(groups, [&](int g) {
      const int first =
          static_cast<int>(static_cast<long long>(n) * g / groups);
      const int end =
          static_cast<int>(static_cast<long long>(n) * (g + 1) / groups);
      std::vector<double>& x = frozen[g];
      x = x_;
      const int most = options_.sweep == Sweep::GAUSS_SEIDEL ? 1 : kMostInner;
      for (int pass = 0; pass < most; ++pass) {
        ++inner[g];
        double moved = 0.0, way = 0.0;
        for (int i = first; i < end; ++i) {
          if (scene.inverse_mass()[i] == 0.0) continue;
          UpdateGrain(scene, i, dt, shrink, *state, &x, &moved, &way);
        }
        if (!(moved > options_.tolerance * way)) break;
      }
    });
    // Work in sweeps over all grains.
    int most = 0;
    for (const int passes : inner) most = std::max(most, passes);
    state->sweeps += most;
    for (int g = 0; g < groups; ++g) {
      const int first =
          static_cast<int>(static_cast<long long>(n) * g / groups);
      const int end =
          static_cast<int>(static_cast<long long>(n) * (g + 1) / groups);
      for (int c = 0; c < 3; ++c) {
        std::copy(frozen[g].begin() + c * stride + first,
                  frozen[g].begin() + c * stride + end,
                  x_.begin() + c * stride + first);
      }
    }
  }

  // One grain with the near field of all others where they are in x. Soft
  // contacts and external forces are those of the last sweep.
  void UpdateGrain(const FlowScene& scene,
                   int i,
                   double dt,
                   double shrink,
                   const FlowState& state,
                   std::vector<double>* x,
                   double* moved,
                   double* way) {
    const int stride = scene.stride();
    const double gamma = options_.relaxation;
    double at[3], force[3];
    for (int c = 0; c < 3; ++c) at[c] = (*x)[c * stride + i];
    scene.near_field()->ForceOn(i, x->data(), at, force, nullptr);
    double a = 0.0, b = 0.0;
    for (int c = 0; c < 3; ++c) {
      const int e = c * stride + i;
      // used_ holds what the ledger books.
      used_.total[e] += force[c] - used_.near_field[e];
      used_.near_field[e] = force[c];
      v_[e] = (u_[e] + dt * used_.total[e] * scene.inverse_mass()[i]) * shrink;
      const double next =
          gamma * (state.x[e] + dt * v_[e]) + (1.0 - gamma) * at[c];
      a += (next - at[c]) * (next - at[c]);
      b += (next - state.x[e]) * (next - state.x[e]);
      (*x)[e] = next;
    }
    *moved += std::sqrt(a);
    *way += std::sqrt(b);
  }

  void Accept(const FlowScene& scene,
              double dt,
              double factor,
              double wanted,
              FlowState* state,
              StepReport* report) {
    scene.Book(used_, dt, u_.data(), v_.data(), state);
    scene.BookDamping(v_.data(), dt, u_.data(), v_.data(), state);
    scene.BookImpacts(work_, state);
    state->worst_balance = std::max(state->worst_balance, scene.Balance(used_));
    state->fast += scene.LargestMove(v_.data(), dt) > 1.0 ? 1 : 0;
    state->x.swap(x_);
    state->v.swap(v_);
    state->time += dt;
    ++state->steps;
    // A step cut short by the end of the run says nothing about the next.
    if (options_.is_adaptive) {
      state->step =
          std::min(options_.step,
                   dt < wanted ? std::max(wanted, factor * dt) : factor * dt);
    }
    scene.ApplyBoundary(state);
    report->step = dt;
  }

  static constexpr int kMostInner = 20;

  const StepperOptions options_;
  std::vector<double> x_, v_, u_, last_;
  SmoothForces start_, used_;
  std::vector<ClosePair> pairs_;
  std::vector<Impact> impacts_;
  ImpactWork work_;
  int iterations_ = 0;
  double change_ = 0.0;
};

}  // namespace

std::unique_ptr<Stepper> CreateImplicitStepper(const StepperOptions& options) {
  return std::make_unique<ImplicitStepper>(options);
}

}  // namespace granopt
