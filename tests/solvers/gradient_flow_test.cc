#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Core"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

std::unique_ptr<Solver> Flow(const std::string& options = "") {
  std::string error;
  return CreateSolver("gradient_flow" + options, &error);
}

#define SKIP_WITHOUT_SUNDIALS() \
  if (!IsRegistered("gradient_flow")) GTEST_SKIP() << "built without SUNDIALS"

// (u^2 - 1)^2 / 4 + 5 v^2 in u = x, v = y - x / 2 - 3 x^2 / 10: two wells in a
// curved valley. Minima -1 and 1, saddle 0 in x.
class TwoWells : public OfTwoVariables {
 public:
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    if (!(std::abs(x[0]) < 1e3 && std::abs(x[1]) < 1e6)) return false;
    const double u = x[0];
    const double w = u * u - 1.0;
    const double v = V(x);
    *cost = 0.25 * w * w + 5.0 * v * v;
    if (gradient != nullptr) {
      gradient[0] = w * u + 10.0 * v * Vx(x);
      gradient[1] = 10.0 * v;
    }
    if (scales != nullptr) {
      scales->gradient = 1.0;
      scales->length = 1.0;
    }
    return true;
  }

 protected:
  Eigen::Matrix2d Hessian(const double* x) const override {
    const double vx = Vx(x);
    Eigen::Matrix2d h;
    h << 3.0 * x[0] * x[0] - 1.0 + 10.0 * (vx * vx - 0.6 * V(x)), 10.0 * vx,
        10.0 * vx, 10.0;
    return h;
  }

 private:
  static double V(const double* x) {
    return x[1] - 0.5 * x[0] - 0.3 * x[0] * x[0];
  }
  static double Vx(const double* x) { return -0.5 - 0.6 * x[0]; }
};

// Where the exact flow from (x, y) ends, by the classical Runge-Kutta method
// with tiny steps: the sign of x.
double ExactWell(double x, double y) {
  const TwoWells wells;
  const auto rate = [&wells](const Eigen::Vector2d& z) {
    double cost;
    Eigen::Vector2d gradient;
    wells.EvaluateWithScales(z.data(), &cost, gradient.data(), nullptr);
    return Eigen::Vector2d(-gradient);
  };
  Eigen::Vector2d z(x, y);
  const double h = 1e-3;
  for (int step = 0; step < 30000; ++step) {
    const Eigen::Vector2d k1 = rate(z);
    const Eigen::Vector2d k2 = rate(z + 0.5 * h * k1);
    const Eigen::Vector2d k3 = rate(z + 0.5 * h * k2);
    const Eigen::Vector2d k4 = rate(z + h * k3);
    z += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  EXPECT_NEAR(std::abs(z[0]), 1.0, 1e-3);
  return std::copysign(1.0, z[0]);
}

TEST(GradientFlow, SolvesQuadraticsToRounding) {
  SKIP_WITHOUT_SUNDIALS();
  for (const int n : {1, 2, 30}) {
    for (const double condition : {10.0, 1e4}) {
      Quadratic f(n, condition);
      std::vector<double> x(n, 0.0);
      const Summary summary =
          Flow(":rtol=1e-4")->Minimize(&f, Tolerance(1e-12), x.data());
      EXPECT_EQ(summary.reason, StopReason::CONVERGED)
          << n << " " << summary.BriefReport();
      EXPECT_GT(summary.counters.linear_iterations, 0);
    }
  }
}

TEST(GradientFlow, UsesSecondDerivatives) {
  SKIP_WITHOUT_SUNDIALS();
  for (const char* options :
       {":rtol=1e-4", ":rtol=1e-4,ordering=rcm", ":rtol=1e-4,linear=pcg"}) {
    Chain f(400, 4e3);
    std::vector<double> x(400, 0.0);
    const Summary summary =
        Flow(options)->Minimize(&f, Tolerance(1e-12), x.data());
    EXPECT_EQ(summary.reason, StopReason::CONVERGED) << summary.BriefReport();
    EXPECT_GT(summary.counters.hessians, 0);
    EXPECT_GT(summary.counters.factorizations, 0);
    EXPECT_GT(summary.counters.solves, 0);
    EXPECT_LT(summary.counters.evaluations, 2000) << summary.BriefReport();
  }
}

TEST(GradientFlow, EndsInTheBasinItStartsIn) {
  SKIP_WITHOUT_SUNDIALS();
  TwoWells wells;
  Wrapper first_order(&wells);
  int right = 0, starts = 0;
  for (int i = -3; i <= 3; ++i) {
    for (const double y : {-2.0, -0.3, 1.0, 2.5}) {
      const double x0 = 0.21 * i + 0.013;
      const double expected = ExactWell(x0, y);
      for (FirstOrderFunction* f :
           {static_cast<FirstOrderFunction*>(&wells),
            static_cast<FirstOrderFunction*>(&first_order)}) {
        double x[2] = {x0, y};
        const Summary summary = Flow()->Minimize(f, Tolerance(1e-12), x);
        EXPECT_EQ(summary.reason, StopReason::CONVERGED)
            << summary.BriefReport();
        EXPECT_NEAR(x[0], expected, 1e-11) << x0 << " " << y;
      }
      right += expected > 0;
      ++starts;
    }
  }
  // Both wells, and not just by the sign of the start.
  EXPECT_GT(right, 4);
  EXPECT_LT(right, starts - 4);
}

TEST(GradientFlow, EnergyDecreasesAtEachStep) {
  SKIP_WITHOUT_SUNDIALS();
  Rosenbrock rosenbrock;
  Chain chain(200, 4e2);
  TwoWells wells;
  for (FirstOrderFunction* f : {static_cast<FirstOrderFunction*>(&rosenbrock),
                                static_cast<FirstOrderFunction*>(&chain),
                                static_cast<FirstOrderFunction*>(&wells)}) {
    std::vector<double> x(f->NumParameters(), 0.1);
    x[0] = -1.2;
    SolveOptions options = Tolerance(1e-11);
    double last = std::numeric_limits<double>::infinity(), first = 0.0;
    options.callback = [&](const IterationState& state) {
      if (state.counters.iterations == 0) first = state.cost;
      EXPECT_LE(state.cost, last + 1e-9 * first);
      last = state.cost;
      return true;
    };
    const Summary summary = Flow()->Minimize(f, options, x.data());
    EXPECT_EQ(summary.reason, StopReason::CONVERGED) << summary.BriefReport();
  }
}

TEST(GradientFlow, TakesTheSameStepsInOtherUnits) {
  SKIP_WITHOUT_SUNDIALS();
  Quadratic f(12, 100.0);
  std::vector<double> x(12, 0.0);
  const auto solver = Flow(":rtol=1e-4");
  const Summary summary = solver->Minimize(&f, Tolerance(1e-10), x.data());
  for (const auto& [a, b] : {std::pair{7, -3}, {-41, 12}, {1, 1}}) {
    InOtherUnits other(&f, a, b);
    std::vector<double> y(12, 0.0);
    const Summary s = solver->Minimize(&other, Tolerance(1e-10), y.data());
    EXPECT_EQ(s.counters.iterations, summary.counters.iterations);
    for (int i = 0; i < 12; ++i) EXPECT_EQ(y[i], x[i] * std::exp2(-b));
  }
}

TEST(GradientFlow, KeepsItsBudgets) {
  SKIP_WITHOUT_SUNDIALS();
  TwoWells wells;
  const auto run = [&wells](const SolveOptions& options) {
    double x[2] = {0.1, 2.0};
    return Flow()->Minimize(&wells, options, x);
  };
  for (const int budget : {1, 2, 3, 20}) {
    SolveOptions options = Tolerance(1e-12);
    options.max_evaluations = budget;
    const Summary summary = run(options);
    EXPECT_EQ(summary.reason, StopReason::MAX_EVALUATIONS);
    EXPECT_LE(summary.counters.evaluations, budget + 1);
  }
  SolveOptions options = Tolerance(1e-12);
  options.max_iterations = 7;
  Summary summary = run(options);
  EXPECT_EQ(summary.reason, StopReason::MAX_ITERATIONS);
  EXPECT_EQ(summary.counters.iterations, 7);

  options = Tolerance(1e-12);
  options.max_seconds = 0.0;
  EXPECT_EQ(run(options).reason, StopReason::MAX_SECONDS);

  options = Tolerance(1e-12);
  options.callback = [](const IterationState& state) {
    return state.counters.iterations < 4;
  };
  summary = run(options);
  EXPECT_EQ(summary.reason, StopReason::CALLBACK);
  EXPECT_EQ(summary.counters.iterations, 4);
}

TEST(GradientFlow, SurvivesWhatCannotBeEvaluated) {
  SKIP_WITHOUT_SUNDIALS();
  Quadratic f(5, 10.0);
  // From some evaluation on.
  for (const int first : {1, 2, 30}) {
    Spy spy(&f, [&](int evaluation, double* cost, double*) {
      if (evaluation >= first) *cost = kNan;
      return true;
    });
    std::vector<double> x(5, 0.0);
    const Summary summary = Flow()->Minimize(&spy, Tolerance(1e-12), x.data());
    EXPECT_EQ(summary.reason, StopReason::EVALUATION_FAILED) << first;
    EXPECT_TRUE(Contains(summary.message, "nan"));
    for (const double value : x) EXPECT_TRUE(std::isfinite(value));
    EXPECT_LT(spy.evaluations(), first + 100);
  }
  // At one trial point: a shorter step does.
  Spy spy(&f, [](int evaluation, double*, double* gradient) {
    if (evaluation == 4 && gradient != nullptr) {
      gradient[2] = std::numeric_limits<double>::infinity();
    }
    return evaluation != 9;
  });
  std::vector<double> x(5, 0.0);
  const Summary summary = Flow()->Minimize(&spy, Tolerance(1e-12), x.data());
  EXPECT_TRUE(summary.Succeeded() ||
              summary.reason == StopReason::EVALUATION_FAILED)
      << summary.BriefReport();
}

TEST(GradientFlow, EndsWhereItIsAtRest) {
  SKIP_WITHOUT_SUNDIALS();
  // The saddle, exactly.
  TwoWells wells;
  double saddle[2] = {0.0, 0.0};
  Summary summary = Flow()->Minimize(&wells, Tolerance(1e-12), saddle);
  EXPECT_EQ(summary.reason, StopReason::CONVERGED);
  EXPECT_EQ(summary.counters.iterations, 0);
  // Cost zero.
  Rosenbrock f;
  double minimum[2] = {1.0, 1.0};
  summary = Flow()->Minimize(&f, Tolerance(0.0), minimum);
  EXPECT_EQ(summary.reason, StopReason::VANISHED);
  EXPECT_EQ(summary.counters.iterations, 0);
  // Next to the saddle, whose curvature is negative.
  double near[2] = {1e-9, 0.0};
  summary = Flow()->Minimize(&wells, Tolerance(1e-12), near);
  EXPECT_EQ(summary.reason, StopReason::CONVERGED) << summary.BriefReport();
  EXPECT_NEAR(near[0], 1.0, 1e-11);
}

TEST(GradientFlow, RebasesWhereRoundingLimits) {
  SKIP_WITHOUT_SUNDIALS();
  Quadratic f(6, 10.0);
  Offset movable(&f, 1e7, true);
  std::vector<double> x(6, 1e7);
  Summary summary = Flow()->Minimize(&movable, Tolerance(1e-13), x.data());
  EXPECT_EQ(summary.reason, StopReason::CONVERGED) << summary.BriefReport();
  EXPECT_GT(summary.counters.rebases, 0);
  // Where it cannot, the run ends all the same.
  Offset fixed(&f, 1e7);
  x.assign(6, 1e7);
  summary = Flow()->Minimize(&fixed, Tolerance(1e-13), x.data());
  EXPECT_TRUE(summary.Succeeded() || summary.reason == StopReason::NO_PROGRESS)
      << summary.BriefReport();
  EXPECT_LT(summary.max_gradient, 1e-6 * summary.scales.gradient);
}

}  // namespace
}  // namespace granopt
