#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "granular/flow/flow.h"
#include "granular/flow/incremental_potential.h"
#include "granular/flow/start.h"
#include "granular/flow/stepper.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

struct Flow {
  std::unique_ptr<FlowScene> scene;
  FlowState state;
};

Flow Make(const FlowSceneOptions& options,
          FlowState state,
          double step = 0.01) {
  Flow flow;
  std::string error;
  flow.scene = FlowScene::Create(options, &error);
  EXPECT_NE(flow.scene, nullptr) << error;
  flow.state = std::move(state);
  EXPECT_TRUE(flow.scene->Begin(step, &flow.state, &error)) << error;
  return flow;
}

NearFieldOptions Attraction(double alpha1, double alpha2) {
  NearFieldOptions options;
  options.law = RadialLaw::Powers(alpha1, 1.0, alpha2, 2.0);
  return options;
}

// Case 1 ... 4 of the paper's simulations.
Flow PaperFlow(int number,
               std::uint64_t seed,
               Domain::Kind domain = Domain::Kind::REENTRY,
               int particles = 100) {
  constexpr double kStrength[] = {0.0, 0.1, 0.25, 0.5};
  FlowStart start;
  start.particles = particles;
  start.seed = seed;
  FlowSceneOptions options;
  options.domain.kind = domain;
  start.period = options.domain.period();
  FlowState state;
  std::string error;
  EXPECT_TRUE(MakeStart(start, &options.grains, &state, &error)) << error;
  const double strength = kStrength[number - 1];
  if (number > 1) options.near_field = Attraction(strength, 0.5 * strength);
  ImpactOptions impact;
  impact.friction = {0.2, 0.1};
  options.impact = impact;
  return Make(options, state, 0.001);
}

void Go(Flow* flow, double end, Stepper* stepper) {
  std::string error;
  ASSERT_TRUE(
      RunFlow(*flow->scene, end, stepper, nullptr, &flow->state, &error))
      << error;
}

StepperOptions Fixed(double step, double tolerance = 1e-13) {
  StepperOptions options;
  options.step = options.first_step = step;
  options.tolerance = tolerance;
  options.desired_iterations = 200;
  options.is_adaptive = false;
  return options;
}

std::unique_ptr<Stepper> Minimizing(const StepperOptions& options,
                                    const std::string& solver) {
  std::string error;
  return CreateMinimizingStepper(options, CreateSolver(solver, &error));
}

// Two grains of mass 1 at distance d along x.
FlowSceneOptions TwoGrains(double distance, FlowState* state) {
  FlowSceneOptions options;
  options.grains.mass = {1.0, 1.0};
  options.grains.radius = {0.05, 0.05};
  state->x.assign(24, 0.0);
  state->v.assign(24, 0.0);
  state->x[0] = -0.5 * distance;
  state->x[1] = 0.5 * distance;
  return options;
}

// ------------------------------------------------------------ collisions

// A step that begins in contact: each stepper gives the analytic velocities.
TEST(FlowSteppers, CollideTwoGrains) {
  for (const double e : {0.0, 0.5, 1.0}) {
    for (const double slide : {0.01, 2.0}) {
      for (const int method : {0, 1, 2}) {
        FlowState state;
        FlowSceneOptions options = TwoGrains(0.0999999, &state);
        state.v[0] = 1.0, state.v[1] = -1.0;
        state.v[8] = slide, state.v[9] = -slide;
        ImpactOptions impact;
        impact.restitution = e;
        impact.friction = {0.2, 0.1};
        options.impact = impact;
        // Begin() refuses what overlaps.
        options.grains.radius = {0.0499, 0.0499};
        Flow flow = Make(options, state);
        FlowSceneOptions touching = options;
        touching.grains.radius = {0.05, 0.05};
        std::string error;
        flow.scene = FlowScene::Create(touching, &error);
        const auto stepper = method == 0   ? CreateImplicitStepper(Fixed(0.001))
                             : method == 1 ? CreateVerletStepper(Fixed(0.001))
                                           : Minimizing(Fixed(0.001), "lbfgs");
        StepReport report;
        ASSERT_TRUE(
            stepper->Step(*flow.scene, 1.0, &flow.state, &report, &error))
            << error;
        const double after =
            slide <= 0.2 * (1.0 + e) ? 0.0 : slide - 0.1 * (1.0 + e);
        EXPECT_NEAR(flow.state.v[0], -e, 1e-14);
        EXPECT_NEAR(flow.state.v[1], e, 1e-14);
        EXPECT_NEAR(flow.state.v[8], after, 1e-14);
        EXPECT_NEAR(flow.state.v[9], -after, 1e-14);
      }
    }
  }
}

// With near field: (3.14) for the impact, the near field for the whole step.
TEST(FlowSteppers, CollideInANearField) {
  FlowState state;
  FlowSceneOptions options = TwoGrains(0.0999999, &state);
  state.v[0] = 1.0, state.v[1] = -0.5;
  ImpactOptions impact;
  impact.restitution = 0.6;
  impact.duration = 0.01;
  options.impact = impact;
  options.near_field = Attraction(0.5, 0.25);
  options.grains.radius = {0.0499, 0.0499};
  Flow flow = Make(options, state);
  options.grains.radius = {0.05, 0.05};
  std::string error;
  flow.scene = FlowScene::Create(options, &error);
  const double dt = 1e-3;
  const auto stepper = CreateImplicitStepper(Fixed(dt));
  StepReport report;
  ASSERT_TRUE(stepper->Step(*flow.scene, 1.0, &flow.state, &report, &error))
      << error;
  // The end of backward Euler, solved by itself: both grains share one unknown,
  // their distance.
  double d = 0.0999999, vi = 1.0, vj = -0.5;
  for (int k = 0; k < 100; ++k) {
    const double f = 0.5 / d - 0.25 / (d * d);  // attraction of the pair
    const double p =
        NormalImpulse(0.6, 0.5, 1.5, 2.0 * f * impact.duration * dt);
    vi = 1.0 - p + dt * f;
    vj = -0.5 + p - dt * f;
    d = 0.0999999 + dt * (vj - vi);
  }
  EXPECT_NEAR(flow.state.v[0], vi, 1e-13);
  EXPECT_NEAR(flow.state.v[1], vj, 1e-13);
}

// ------------------------------------------------------------ invariants

TEST(FlowInvariants, JacobiKeepsMomentumGaussSeidelToItsTolerance) {
  const auto drift = [](StepperOptions::Sweep sweep, double tolerance) {
    Flow flow = PaperFlow(4, 1);
    StepperOptions options;
    options.sweep = sweep;
    options.tolerance = tolerance;
    const auto stepper = CreateImplicitStepper(options);
    Go(&flow, 1.0, stepper.get());
    double p[3], largest = 0.0, total = 0.0;
    flow.scene->Momentum(flow.state.v.data(), p);
    for (int k = 0; k < 3; ++k) {
      largest =
          std::max(largest, std::fabs(p[k] - flow.state.momentum_start[k]));
      total += flow.state.momentum_start[k] * flow.state.momentum_start[k];
    }
    // (6.10)
    if (sweep == StepperOptions::Sweep::JACOBI) {
      EXPECT_LE(flow.state.worst_balance, 1e-15);
    }
    return largest / std::sqrt(total);
  };
  EXPECT_LE(drift(StepperOptions::Sweep::JACOBI, 1e-8), 1e-14);
  const double loose = drift(StepperOptions::Sweep::GAUSS_SEIDEL, 1e-4);
  const double middle = drift(StepperOptions::Sweep::GAUSS_SEIDEL, 1e-8);
  const double tight = drift(StepperOptions::Sweep::GAUSS_SEIDEL, 1e-12);
  EXPECT_LE(loose, 1e-3);
  EXPECT_GE(loose, 1e-7);
  EXPECT_LE(middle, 1e-6);
  EXPECT_LE(tight, 1e-11);
  EXPECT_LT(middle, loose);
  EXPECT_LT(tight, middle);
}

TEST(FlowInvariants, LedgerClosesForEveryStepper) {
  for (const int method : {0, 1, 2, 3}) {
    for (const Domain::Kind domain : {Domain::Kind::OPEN,
                                      Domain::Kind::REENTRY,
                                      Domain::Kind::NEAREST_IMAGE,
                                      Domain::Kind::WALLS}) {
      Flow flow = PaperFlow(3, 2, domain);
      FlowSceneOptions options = flow.scene->options();
      options.external = ExternalForce();
      options.external->constant[2] = -1.0;
      options.external->amplitude[0] = 0.5;
      options.external->frequency = 20.0;
      options.damping = 0.3;
      flow = Make(options, flow.state, 0.001);
      StepperOptions stepping;
      if (method == 3) stepping.sweep = StepperOptions::Sweep::GROUPS;
      const auto stepper = method == 1   ? CreateVerletStepper(stepping)
                           : method == 2 ? Minimizing(stepping, "lbfgs")
                                         : CreateImplicitStepper(stepping);
      Go(&flow, 0.3, stepper.get());
      const double kinetic = flow.scene->Kinetic(flow.state.v.data()).total();
      EXPECT_LE(std::fabs(flow.scene->Closure(flow.state, kinetic)),
                1e-13 * kinetic)
          << method << " " << DomainName(domain);
      // Momentum: what external forces, damping and walls gave.
      double p[3];
      flow.scene->Momentum(flow.state.v.data(), p);
      const MomentumLedger& m = flow.state.momentum;
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(p[k],
                    flow.state.momentum_start[k] + m.external[k] +
                        m.damping[k] + m.fixed[k],
                    (method == 3 ? 1e-6 : 1e-12) * flow.scene->total_mass())
            << method << " " << DomainName(domain) << k;
      }
      // Energy put in by the boundary: only where jumps have no images.
      if (domain != Domain::Kind::REENTRY) {
        EXPECT_EQ(flow.state.energy.boundary, 0.0);
      } else {
        EXPECT_NE(flow.state.energy.boundary, 0.0);
      }
      EXPECT_LE(flow.state.energy.impact, 0.0);
      EXPECT_LE(flow.state.energy.friction, 0.0);
      EXPECT_LT(flow.state.energy.damping, 0.0);
    }
  }
}

// Pinned grains take momentum from fields and impacts: all of it is booked.
TEST(FlowInvariants, MomentumOfPinnedGrainsIsBooked) {
  for (const int method : {0, 1, 2}) {
    Flow flow = PaperFlow(3, 2);
    FlowSceneOptions options = flow.scene->options();
    options.grains.is_pinned.assign(options.grains.size(), 0);
    for (int i = 0; i < options.grains.size(); i += 2) {
      options.grains.is_pinned[i] = 1;
    }
    flow = Make(options, flow.state, 0.001);
    const auto stepper = method == 0   ? CreateImplicitStepper({})
                         : method == 1 ? CreateVerletStepper({})
                                       : Minimizing({}, "lbfgs");
    const std::vector<double> x = flow.state.x;
    Go(&flow, 0.3, stepper.get());
    EXPECT_GT(flow.state.impulses, 10);
    double p[3], given = 0.0;
    flow.scene->Momentum(flow.state.v.data(), p);
    for (int k = 0; k < 3; ++k) {
      const double fixed = flow.state.momentum.fixed[k];
      given += std::fabs(fixed);
      EXPECT_NEAR(p[k],
                  flow.state.momentum_start[k] + fixed,
                  1e-12 * flow.scene->total_mass())
          << method << " " << k;
    }
    EXPECT_GT(given, 1e-2 * flow.scene->total_mass());
    EXPECT_EQ(flow.state.x[0], x[0]);
  }
}

// Nothing that moves: a step of each stepper changes the time alone.
TEST(FlowSteppers, PinnedGrainsStayWhereTheyAre) {
  for (const int method : {0, 1, 2}) {
    Flow flow = PaperFlow(3, 2);
    FlowSceneOptions options = flow.scene->options();
    options.grains.is_pinned.assign(options.grains.size(), 1);
    flow = Make(options, flow.state, 0.001);
    const std::vector<double> x = flow.state.x;
    const auto stepper = method == 0   ? CreateImplicitStepper({})
                         : method == 1 ? CreateVerletStepper({})
                                       : Minimizing({}, "lbfgs");
    Go(&flow, 0.05, stepper.get());
    EXPECT_EQ(flow.state.x, x) << method;
    EXPECT_NEAR(flow.state.time, 0.05, 1e-12);
  }
}

// What the integrator does to the energy falls with Dt: backward Euler first,
// Verlet second order.
TEST(FlowInvariants, NumericalLossFallsWithTheStep) {
  const auto loss = [](bool verlet, double step) {
    Flow flow = PaperFlow(2, 3);
    StepperOptions options;
    options.step = step;
    options.first_step = step;
    const auto stepper =
        verlet ? CreateVerletStepper(options) : CreateImplicitStepper(options);
    Go(&flow, 0.5, stepper.get());
    return std::fabs(flow.scene->Numerical(
               flow.state, flow.scene->Potential(flow.state.x.data()))) /
           flow.state.kinetic_start;
  };
  const double euler = loss(false, 0.002);
  EXPECT_NEAR(euler / loss(false, 0.0005), 4.0, 0.8);
  const double verlet = loss(true, 0.002);
  EXPECT_LT(verlet, 0.02 * euler);
  EXPECT_LT(loss(true, 0.0005), 0.25 * verlet);
}

// (4.6): e^2 - 1 <= (T(t + dt) - T(t)) / T(t) <= 0 without near field and
// friction, in each step.
TEST(FlowInvariants, EnergyBoundWithoutNearField) {
  Flow flow = PaperFlow(1, 4);
  FlowSceneOptions options = flow.scene->options();
  options.impact->friction = {};
  flow = Make(options, flow.state, 0.001);
  const auto stepper = CreateVerletStepper(Fixed(0.002));
  double before = flow.state.kinetic_start;
  std::string error;
  const double e = options.impact->restitution;
  RunFlow(
      *flow.scene,
      1.0,
      stepper.get(),
      [&](const FlowState& state, const StepReport&) {
        const double now = flow.scene->Kinetic(state.v.data()).total();
        EXPECT_LE(now, before * (1.0 + 1e-14));
        EXPECT_GE(now - before, (e * e - 1.0) * before);
        before = now;
        return true;
      },
      &flow.state,
      &error);
  EXPECT_GT(flow.state.impulses, 20);
}

// ------------------------------------------------------------ oscillators

// Time of the k-th passage through the equilibrium, by interpolation.
double Period(Flow* flow, Stepper* stepper, double centre, double end) {
  std::vector<double> passages;
  double t = 0.0, last = flow->state.x[1] - flow->state.x[0] - centre;
  std::string error;
  EXPECT_TRUE(RunFlow(
      *flow->scene,
      end,
      stepper,
      [&](const FlowState& state, const StepReport&) {
        const double now = state.x[1] - state.x[0] - centre;
        if (last < 0.0 && now >= 0.0) {
          passages.push_back(t + (state.time - t) * last / (last - now));
        }
        last = now;
        t = state.time;
        return true;
      },
      &flow->state,
      &error))
      << error;
  EXPECT_GE(passages.size(), 3u);
  return (passages.back() - passages.front()) / (passages.size() - 1);
}

// (7.11): omega*^2 = (beta2 alpha2 r*^(-beta2 - 1) - beta1 alpha1 r*^(-beta1 -
// 1)) / m about a fixed point; two free equal grains are sqrt 2 as fast.
TEST(FlowOscillator, FrequencyAboutTheEquilibrium) {
  const double alpha1 = 0.5, alpha2 = 0.25, d = 0.5;
  const double stiffness = 2.0 * alpha2 / (d * d * d) - alpha1 / (d * d);
  for (const bool pinned : {true, false}) {
    const double omega = std::sqrt(stiffness * (pinned ? 1.0 : 2.0));
    double error_before = 0.0;
    for (const double step : {4e-2, 2e-2, 1e-2}) {
      FlowState state;
      FlowSceneOptions options = TwoGrains(d, &state);
      if (pinned) options.grains.is_pinned = {1, 0};
      options.near_field = Attraction(alpha1, alpha2);
      state.x[1] -= 1e-5;
      Flow flow = Make(options, state, step);
      const auto stepper = CreateVerletStepper(Fixed(step));
      const double period =
          Period(&flow, stepper.get(), d, 12.0 * 2.0 * kPi / omega);
      const double ratio = 2.0 * kPi / period / omega;
      // Second order in Dt: (omega Dt)^2 / 24 fast.
      EXPECT_NEAR(ratio, 1.0, 0.1 * omega * omega * step * step);
      if (error_before > 0.0) {
        EXPECT_NEAR(error_before / (ratio - 1.0), 4.0, 0.2);
      }
      error_before = ratio - 1.0;
    }
  }
}

// Backward Euler damps: amplitude exp(-omega^2 Dt t / 2).
TEST(FlowOscillator, BackwardEulerLosesAmplitude) {
  const double alpha1 = 0.5, alpha2 = 0.25, d = 0.5;
  const double omega = std::sqrt(2.0 * alpha2 / (d * d * d) - alpha1 / (d * d));
  const double dt = 0.005, end = 10.0 * 2.0 * kPi / omega;
  FlowState state;
  FlowSceneOptions options = TwoGrains(d, &state);
  options.grains.is_pinned = {1, 0};
  options.near_field = Attraction(alpha1, alpha2);
  state.x[1] += 1e-5;
  Flow flow = Make(options, state, dt);
  const auto stepper = CreateImplicitStepper(Fixed(dt));
  Go(&flow, end, stepper.get());
  const double q = flow.state.x[1] - flow.state.x[0] - d;
  const double amplitude =
      std::sqrt(q * q + std::pow(flow.state.v[1] / omega, 2));
  const double rate = -std::log(amplitude / 1e-5) / end;
  EXPECT_NEAR(rate / (0.5 * omega * omega * dt), 1.0, 0.01);
}

// (7.6), (7.7): steady amplitude R = (f0 / k) / sqrt((1 - W^2)^2 + (2 zeta
// W)^2), W = Omega / omega.
TEST(FlowOscillator, ForcedResonance) {
  const double alpha1 = 0.5, alpha2 = 0.25, d = 0.5;
  const double omega = std::sqrt(2.0 * alpha2 / (d * d * d) - alpha1 / (d * d));
  const double zeta = 0.1, f0 = 1e-6;
  for (const double W : {0.5, 1.0, 1.7}) {
    FlowState state;
    FlowSceneOptions options = TwoGrains(d, &state);
    options.grains.is_pinned = {1, 0};
    options.near_field = Attraction(alpha1, alpha2);
    options.damping = 2.0 * zeta * omega;
    ExternalForce force;
    force.amplitude[0] = f0;
    force.frequency = W * omega;
    options.external = force;
    Flow flow = Make(options, state, 0.01);
    const auto stepper = CreateVerletStepper(Fixed(0.01));
    double largest = 0.0;
    const double end = 30.0 * 2.0 * kPi / omega;
    std::string error;
    RunFlow(
        *flow.scene,
        end,
        stepper.get(),
        [&](const FlowState& now, const StepReport&) {
          if (now.time > end - 2.0 * 2.0 * kPi / (W * omega)) {
            largest = std::max(largest, std::fabs(now.x[1] - now.x[0] - d));
          }
          return true;
        },
        &flow.state,
        &error);
    const double R =
        f0 / (omega * omega) /
        std::sqrt(std::pow(1.0 - W * W, 2) + std::pow(2.0 * zeta * W, 2));
    EXPECT_NEAR(largest / R, 1.0, 2e-3) << W;
  }
}

// ------------------------------------------------------------ orders, sweeps

// Backward Euler is of first, Verlet of second order where nothing collides.
TEST(FlowSteppers, OrderInTheStep) {
  const auto end = [](int method, double dt) {
    Flow flow = PaperFlow(3, 5, Domain::Kind::OPEN, 20);
    FlowSceneOptions options = flow.scene->options();
    options.impact.reset();
    flow = Make(options, flow.state, dt);
    const auto stepper = method == 0   ? CreateImplicitStepper(Fixed(dt))
                         : method == 1 ? CreateVerletStepper(Fixed(dt))
                                       : Minimizing(Fixed(dt, 1e-11), "newton");
    Go(&flow, 0.08, stepper.get());
    return flow.state.x;
  };
  const auto distance = [](const std::vector<double>& a,
                           const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t e = 0; e < a.size(); ++e) {
      sum += (a[e] - b[e]) * (a[e] - b[e]);
    }
    return std::sqrt(sum);
  };
  const auto exact = end(1, 1e-5);
  for (const int method : {0, 1, 2}) {
    const double coarse = distance(end(method, 2e-3), exact);
    const double fine = distance(end(method, 1e-3), exact);
    EXPECT_NEAR(std::log2(coarse / fine), method == 1 ? 2.0 : 1.0, 0.15)
        << method;
  }
}

// Iterations to 1e-12 from the start of case 4, and the order p = 2 of the
// contraction constant (6.7).
TEST(FlowSteppers, ContractionIsOfSecondOrder) {
  const auto iterations = [](StepperOptions::Sweep sweep, double dt) {
    Flow flow = PaperFlow(4, 1);
    StepperOptions options = Fixed(dt, 1e-12);
    options.sweep = sweep;
    const auto stepper = CreateImplicitStepper(options);
    StepReport report;
    std::string error;
    EXPECT_TRUE(stepper->Step(*flow.scene, 1.0, &flow.state, &report, &error))
        << error;
    return report.iterations;
  };
  using Sweep = StepperOptions::Sweep;
  // As an independent program counts: Jacobi 12, 8, 6, Gauss-Seidel 10, 7, 6.
  EXPECT_NEAR(iterations(Sweep::JACOBI, 0.01), 12, 1);
  EXPECT_NEAR(iterations(Sweep::JACOBI, 0.005), 8, 1);
  EXPECT_NEAR(iterations(Sweep::JACOBI, 0.0025), 6, 1);
  EXPECT_NEAR(iterations(Sweep::GAUSS_SEIDEL, 0.01), 10, 1);
  EXPECT_NEAR(iterations(Sweep::GAUSS_SEIDEL, 0.005), 7, 1);
  EXPECT_NEAR(iterations(Sweep::GAUSS_SEIDEL, 0.0025), 6, 1);
  int last = 1000;
  for (const double dt : {0.01, 0.005, 0.0025}) {
    const int jacobi = iterations(Sweep::JACOBI, dt);
    const int groups = iterations(Sweep::GROUPS, dt);
    const int seidel = iterations(Sweep::GAUSS_SEIDEL, dt);
    EXPECT_LE(jacobi, last);
    EXPECT_LE(seidel, jacobi);
    EXPECT_LE(groups, jacobi);
    last = jacobi;
  }
  // eta from the last changes of a step: eta(Dt) / eta(Dt / 2) = 4.
  const auto eta = [](double dt) {
    double change[2];
    for (int more = 0; more < 2; ++more) {
      Flow flow = PaperFlow(3, 2);
      FlowSceneOptions options = flow.scene->options();
      options.impact.reset();
      flow = Make(options, flow.state, dt);
      StepperOptions stepping = Fixed(dt, 1e-300);
      stepping.desired_iterations = 5 + more;
      const auto stepper = CreateImplicitStepper(stepping);
      StepReport report;
      std::string error;
      EXPECT_FALSE(
          stepper->Step(*flow.scene, 1.0, &flow.state, &report, &error));
      change[more] = report.rejections[0].ratio;
    }
    return change[1] / change[0];
  };
  EXPECT_NEAR(std::log2(eta(0.008) / eta(0.004)), 2.0, 0.3);
}

TEST(FlowSteppers, MinimizationIsTheFixedPoint) {
  for (const char* solver : {"lbfgs", "newton", "ncg"}) {
    Flow fixed = PaperFlow(4, 6), minimized = PaperFlow(4, 6);
    const auto a = CreateImplicitStepper(Fixed(0.004, 1e-12));
    const auto b = Minimizing(Fixed(0.004, 1e-12), solver);
    Go(&fixed, 0.1, a.get());
    Go(&minimized, 0.1, b.get());
    EXPECT_GT(fixed.state.impulses, 0);
    double largest = 0.0;
    for (std::size_t e = 0; e < fixed.state.x.size(); ++e) {
      largest =
          std::max(largest, std::fabs(fixed.state.x[e] - minimized.state.x[e]));
    }
    EXPECT_LE(largest, 1e-9) << solver;
  }
}

// The gradient of Phi is that of its value, the Hessian that of its gradient,
// and a product with it is one.
TEST(IncrementalPotential, DerivativesAreThoseOfFiniteDifferences) {
  for (const Domain::Kind domain :
       {Domain::Kind::OPEN, Domain::Kind::NEAREST_IMAGE}) {
    for (const int what : {0, 1, 2}) {  // field, soft contacts, both
      FlowStart start;
      start.particles = 12;
      start.length_ratio = 0.5;
      start.attempts = 0;  // overlaps
      start.seed = 3;
      FlowSceneOptions options;
      options.domain.kind = domain;
      FlowState state;
      std::string error;
      ASSERT_TRUE(MakeStart(start, &options.grains, &state, &error)) << error;
      options.grains.is_pinned.assign(12, 0);
      options.grains.is_pinned[4] = 1;
      options.damping = 3.0;
      options.external = ExternalForce();
      options.external->constant[1] = -9.0;
      if (what != 1) options.near_field = Attraction(0.5, 0.25);
      if (what != 0) {
        options.soft_contact = SoftContactOptions();
        options.soft_contact->stiffness = 1e4;
        options.soft_contact->alpha = 2.5;
      }
      const Flow flow = Make(options, state);
      const IncrementalPotential phi(
          *flow.scene, flow.state, 0.01, flow.state.v);
      const int m = phi.NumParameters();
      ASSERT_EQ(m, 33);
      std::vector<double> s(m), v(m), gradient(m), up(m), down(m), hv(m);
      for (int k = 0; k < m; ++k) {
        s[k] = 0.01 * std::sin(1.0 + k);
        v[k] = std::cos(2.0 * k);
      }
      double value, above, below;
      ASSERT_TRUE(
          phi.EvaluateWithScales(s.data(), &value, gradient.data(), nullptr));
      SparseMatrix hessian;
      ASSERT_TRUE(phi.EvaluateHessian(s.data(), &hessian));
      ASSERT_TRUE(phi.HessianTimes(s.data(), v.data(), hv.data()));
      const Eigen::MatrixXd whole =
          Eigen::MatrixXd(hessian).selfadjointView<Eigen::Lower>();
      const double h = 1e-6, size = whole.cwiseAbs().maxCoeff();
      double largest = 0.0;
      for (const double g : gradient) {
        largest = std::max(largest, std::fabs(g));
      }
      for (int c = 0; c < m; ++c) {
        std::vector<double> shifted = s;
        shifted[c] = s[c] + h;
        phi.EvaluateWithScales(shifted.data(), &above, up.data(), nullptr);
        shifted[c] = s[c] - h;
        phi.EvaluateWithScales(shifted.data(), &below, down.data(), nullptr);
        EXPECT_NEAR((above - below) / (2.0 * h), gradient[c], 1e-5 * largest);
        for (int r = 0; r < m; ++r) {
          EXPECT_NEAR((up[r] - down[r]) / (2.0 * h), whole(r, c), 1e-6 * size)
              << DomainName(domain) << " " << what << " " << r << " " << c;
        }
      }
      const Eigen::VectorXd product =
          whole * Eigen::Map<const Eigen::VectorXd>(v.data(), m);
      for (int k = 0; k < m; ++k) {
        EXPECT_NEAR(hv[k], product[k], 1e-13 * size * m);
      }
    }
  }
}

TEST(FlowSteppers, LongStepsAreNotConvex) {
  const Flow flow = PaperFlow(4, 1);
  EXPECT_TRUE(HasConvexStep(*flow.scene, flow.state, 0.01));
  EXPECT_FALSE(HasConvexStep(*flow.scene, flow.state, 0.2));
}

TEST(FlowSteppers, RelaxationHelpsWhereStepsAreLong) {
  const auto iterations = [](double relaxation, double dt) {
    Flow flow = PaperFlow(4, 1);
    StepperOptions options = Fixed(dt, 1e-12);
    options.relaxation = relaxation;
    options.desired_iterations = 1000;
    const auto stepper = CreateImplicitStepper(options);
    StepReport report;
    std::string error;
    stepper->Step(*flow.scene, 1.0, &flow.state, &report, &error);
    return report.iterations;
  };
  EXPECT_LT(iterations(1.0, 0.01), iterations(0.7, 0.01));
  EXPECT_GT(iterations(1.0, 0.03), 1.3 * iterations(0.8, 0.03));
}

// ------------------------------------------------------------ the same bits

TEST(FlowSteppers, AStateIsAllThereIsToGoOnFrom) {
  for (const int method : {0, 1, 2}) {
    const auto make = [&] {
      return method == 0   ? CreateImplicitStepper({})
             : method == 1 ? CreateVerletStepper({})
                           : Minimizing({}, "lbfgs");
    };
    Flow whole = PaperFlow(4, 7);
    const auto one = make();
    std::vector<FlowState> states;
    std::string error;
    ASSERT_TRUE(RunFlow(
        *whole.scene,
        0.4,
        one.get(),
        [&](const FlowState& state, const StepReport&) {
          states.push_back(state);
          return true;
        },
        &whole.state,
        &error))
        << error;
    // From a step in the middle on, by a stepper that knows nothing.
    Flow rest = PaperFlow(4, 7);
    rest.state = states[states.size() / 2];
    const auto other = make();
    ASSERT_TRUE(
        RunFlow(*rest.scene, 0.4, other.get(), nullptr, &rest.state, &error));
    EXPECT_EQ(rest.state.x, whole.state.x) << method;
    EXPECT_EQ(rest.state.v, whole.state.v) << method;
    EXPECT_EQ(rest.state.energy.impact, whole.state.energy.impact);
    EXPECT_EQ(rest.state.energy.boundary, whole.state.energy.boundary);
    EXPECT_EQ(rest.state.steps, whole.state.steps);
    EXPECT_EQ(rest.state.sweeps, whole.state.sweeps) << method;
  }
}

TEST(FlowSteppers, GroupsInThreadsChangeNoBit) {
  std::vector<double> x[2];
  for (const int threads : {1, 2}) {
    if (!SetNumThreads(threads)) GTEST_SKIP() << "built without OpenMP";
    Flow flow = PaperFlow(4, 8);
    StepperOptions options;
    options.sweep = StepperOptions::Sweep::GROUPS;
    const auto stepper = CreateImplicitStepper(options);
    Go(&flow, 0.1, stepper.get());
    x[threads - 1] = flow.state.x;
  }
  SetNumThreads(1);
  EXPECT_EQ(x[0], x[1]);
}

// ------------------------------------------------------------ the paper

// A few seeds of the table of figures 5 and 6: T(1) of the four strengths and
// the relative fraction, in the bands of an independent program (mean of 20
// seeds, spread .01, .02, .03, .06 and .015 a seed).
TEST(FlowPaper, EnergiesOfFigures5And6) {
  const double kinetic[] = {0.592, 0.774, 1.069, 1.395};
  const double spread[] = {0.008, 0.024, 0.030, 0.058};
  const double fraction[] = {0.138, 0.341, 0.523, 0.634};
  constexpr int kSeeds = 8;
  for (int number = 1; number <= 4; ++number) {
    double t = 0.0, f = 0.0;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      Flow flow = PaperFlow(number, seed);
      const auto stepper = CreateImplicitStepper({});
      Go(&flow, 1.0, stepper.get());
      const KineticEnergy k = flow.scene->Kinetic(flow.state.v.data());
      t += k.total() / flow.scene->total_mass() / kSeeds;
      f += k.relative / k.total() / kSeeds;
    }
    // Four errors of both means.
    EXPECT_NEAR(t, kinetic[number - 1], 4.0 * 0.42 * spread[number - 1])
        << number;
    EXPECT_NEAR(f, fraction[number - 1], 0.03) << number;
  }
}

// A step cut short by the end of a run says nothing about the next.
TEST(FlowSteppers, ShortLastStepsAreNoMeasure) {
  for (const int method : {0, 1}) {
    Flow flow = PaperFlow(4, 1);
    const auto stepper =
        method == 0 ? CreateImplicitStepper({}) : Minimizing({}, "lbfgs");
    Go(&flow, 0.1, stepper.get());
    const double wanted = flow.state.step;
    Go(&flow, flow.state.time + 1e-3 * wanted, stepper.get());
    EXPECT_GE(flow.state.step, wanted) << method;
  }
}

// The safety factor spares most rejections.
TEST(FlowPaper, SafetyFactorSparesRejections) {
  const auto rejected = [](double safety) {
    Flow flow = PaperFlow(4, 1);
    StepperOptions options;
    options.safety = safety;
    const auto stepper = CreateImplicitStepper(options);
    Go(&flow, 1.0, stepper.get());
    return flow.state.rejected;
  };
  EXPECT_LT(3 * rejected(0.9), rejected(1.0));
}

}  // namespace
}  // namespace granopt
