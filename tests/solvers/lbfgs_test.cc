// What a preconditioner is: a change of variables, (17) and (18). A method with
// P = C C^T on f takes the steps of the method without on F(y) = f(C^-T y).

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Dense"
#include "gtest/gtest.h"
#include "solvers/preconditioner.h"
#include "solvers/registry.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kSize = 30;

// C of P = C C^T: lower triangular, of condition 10 or so, and so large
// that P is stiffer than any second derivative below.
MatrixXd Factor() {
  MatrixXd c = MatrixXd::Zero(kSize, kSize);
  for (int i = 0; i < kSize; ++i) {
    c(i, i) = std::pow(10.0, 0.3 * std::sin(7.0 * i));
    for (int j = std::max(0, i - 3); j < i; ++j) {
      c(i, j) = 0.3 * std::cos(3.0 * i + j);
    }
  }
  return 10.0 * c;
}

// P = C C^T for good, or made anew every third step: four times as much, or
// back to a quarter.
class FixedMatrix : public Preconditioner {
 public:
  explicit FixedMatrix(Parameters* parameters)
      : c_(Factor()),
        renewed_(parameters->Bool("renewed", false, "every third step")) {}

  bool Supports(const FirstOrderFunction& function,
                std::string* /*error*/) const override {
    return function.NumParameters() == kSize;
  }
  bool Update(const Iterate& /*at*/,
              const double* step,
              Monitor* /*monitor*/) override {
    if (step == nullptr) return true;
    if (!renewed_ || ++steps_ % 3 != 0) return false;
    scale_ = 5.0 - scale_;
    return true;
  }
  void Solve(const double* r, double* z, Monitor* monitor) override {
    const auto c = c_.triangularView<Eigen::Lower>();
    Eigen::Map<VectorXd> result(z, kSize);
    result = c.solve(Eigen::Map<const VectorXd>(r, kSize));
    result = c.transpose().solve(VectorXd(result)) / scale_;
    ++monitor->counters().solves;
  }
  void Multiply(const double* v, double* pv) const override {
    Eigen::Map<VectorXd>(pv, kSize) =
        scale_ * (c_ * (c_.transpose() * Eigen::Map<const VectorXd>(v, kSize)));
  }

 private:
  const MatrixXd c_;
  const bool renewed_;
  int steps_ = 0;
  double scale_ = 1.0;
};

const bool registered =
    (internal::RegisterPreconditioner(
         "fixed",
         "a matrix that is known",
         "2026",
         [](Parameters* parameters) -> std::unique_ptr<Preconditioner> {
           return std::make_unique<FixedMatrix>(parameters);
         }),
     true);

// sum of (x_i - s_i)^4 / 4 on top of a quadratic of condition 100.
class Coupled : public FirstOrderFunction {
 public:
  explicit Coupled(double quartic)
      : quartic_(quartic), quadratic_(kSize, 1e2) {}
  int NumParameters() const override { return kSize; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    quadratic_.EvaluateWithScales(x, cost, gradient, scales);
    for (int i = 0; i < kSize; ++i) {
      const double t = x[i] - quadratic_.solution()[i];
      *cost += quartic_ * 0.25 * t * t * t * t;
      if (gradient != nullptr) gradient[i] += quartic_ * t * t * t;
    }
    return true;
  }

 private:
  const double quartic_;
  const Quadratic quadratic_;
};

// F(y) = f(C^-T y) with gradient C^-1 g. A step of one length for a gradient of
// one scale is 1, as it is with a preconditioner.
class ChangeOfVariables : public FirstOrderFunction {
 public:
  explicit ChangeOfVariables(const FirstOrderFunction* f)
      : f_(f), c_(Factor()) {}
  int NumParameters() const override { return kSize; }
  VectorXd ToX(const double* y) const {
    return c_.transpose().triangularView<Eigen::Upper>().solve(
        Eigen::Map<const VectorXd>(y, kSize));
  }
  VectorXd ToY(const double* x) const {
    return c_.transpose() * Eigen::Map<const VectorXd>(x, kSize);
  }
  bool EvaluateWithScales(const double* y,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const VectorXd x = ToX(y);
    VectorXd g(kSize);
    if (!f_->EvaluateWithScales(x.data(), cost, g.data(), nullptr)) {
      return false;
    }
    if (gradient != nullptr) {
      Eigen::Map<VectorXd>(gradient, kSize) =
          c_.triangularView<Eigen::Lower>().solve(g);
    }
    if (scales != nullptr) {
      scales->gradient = 1.0;
      scales->length = 1.0;
    }
    return true;
  }

 private:
  const FirstOrderFunction* f_;
  const MatrixXd c_;
};

struct Path {
  std::vector<VectorXd> x;
  std::vector<double> cost;
  Counters counters;
};

Path Follow(const std::string& spec,
            FirstOrderFunction* f,
            const VectorXd& start,
            int iterations) {
  Path path;
  SolveOptions options;
  options.relative_tolerance = 0.0;
  options.absolute_tolerance = 1e-300;
  options.max_iterations = iterations;
  options.callback = [&](const IterationState& state) {
    path.x.push_back(Eigen::Map<const VectorXd>(state.x, kSize));
    path.cost.push_back(state.cost);
    return true;
  };
  const Result run = Minimize(
      spec, f, std::vector<double>(start.begin(), start.end()), options);
  path.counters = run.summary.counters;
  return path;
}

// The first iteration at which the cost is below a part of the first.
int IterationsTo(const Path& path, double part) {
  for (std::size_t k = 0; k < path.cost.size(); ++k) {
    if (path.cost[k] <= part * path.cost[0]) return static_cast<int>(k);
  }
  return -1;
}

struct Identity {
  const char* spec;
  // Steps over which rounding has not yet grown, and by how much it has.
  int steps;
  double tolerance;
};

class ChangesVariables : public testing::TestWithParam<Identity> {};

INSTANTIATE_TEST_SUITE_P(
    Methods,
    ChangesVariables,
    testing::Values(Identity{"lbfgs", 20, 1e-9},
                    Identity{"lbfgs:memory=1", 20, 1e-9},
                    Identity{"lbfgs:memory=20", 20, 1e-9},
                    Identity{"ncg:beta=fr", 20, 1e-9},
                    Identity{"ncg:beta=pr", 20, 1e-9},
                    Identity{"ncg:beta=hs", 20, 1e-9},
                    Identity{"ncg:beta=hz", 20, 1e-9},
                    Identity{"fire", 60, 1e-9},
                    Identity{"fire:delay=3", 60, 1e-9},
                    Identity{"heavy_ball", 60, 1e-9},
                    Identity{"heavy_ball:momentum=0.5", 60, 1e-9}),
    [](const testing::TestParamInfo<Identity>& info) {
      return TestName({info.param.spec, info.index});
    });

TEST_P(ChangesVariables, AsTheIdentitySays) {
  const std::string spec = GetParam().spec;
  const std::string preconditioned =
      spec + (Contains(spec, ":") ? "," : ":") + "preconditioner=fixed";
  for (const double quartic : {0.0, 1.0}) {
    Coupled f(quartic);
    ChangeOfVariables changed(&f);
    const VectorXd x0 = VectorXd::Constant(kSize, 0.25);
    const VectorXd y0 = changed.ToY(x0.data());
    const int most = 400;
    const Path in_x = Follow(preconditioned, &f, x0, most);
    const Path in_y = Follow(spec, &changed, y0, most);
    ASSERT_GT(in_x.x.size(), static_cast<std::size_t>(GetParam().steps));
    ASSERT_GT(in_y.x.size(), static_cast<std::size_t>(GetParam().steps));
    for (int k = 0; k <= GetParam().steps; ++k) {
      const VectorXd y = changed.ToY(in_x.x[k].data());
      const double size = (y0 - changed.ToY(in_x.x.back().data())).norm();
      EXPECT_LE((y - in_y.x[k]).norm(), GetParam().tolerance * size) << k;
    }
    // Later, rounding has its say.
    for (const double part : {1e-1, 1e-3, 1e-9}) {
      const int a = IterationsTo(in_x, part);
      const int b = IterationsTo(in_y, part);
      EXPECT_LE(std::abs(a - b), a <= GetParam().steps ? 0 : 2 + a / 5)
          << part << ": " << a << ", " << b;
      EXPECT_TRUE(part < 0.1 || a > 0) << part;
    }
    EXPECT_GT(in_x.counters.solves, 0);
    EXPECT_EQ(in_y.counters.solves, 0);
  }
}

// L-BFGS keeps its pairs when P changes, with w = P^-1 y of the new one. Times
// a power of two, which gamma makes up for, it takes the same steps.
TEST(Lbfgs, PairsSurviveANewPreconditioner) {
  Coupled f(1.0);
  const VectorXd x0 = VectorXd::Constant(kSize, 0.25);
  const Path once = Follow("lbfgs:preconditioner=fixed", &f, x0, 25);
  const Path often = Follow("lbfgs:preconditioner=fixed,renewed=1", &f, x0, 25);
  ASSERT_EQ(once.x.size(), often.x.size());
  for (std::size_t k = 0; k < 25; ++k) {
    EXPECT_LE((once.x[k] - often.x[k]).norm(), 1e-10) << k;
  }
  EXPECT_GT(often.counters.solves, once.counters.solves);
}

// One solve an iteration, whatever the memory, (15).
TEST(Lbfgs, OneSolveAnIteration) {
  Coupled f(1.0);
  const VectorXd x0 = VectorXd::Constant(kSize, 0.25);
  const Path path = Follow("lbfgs:preconditioner=fixed,memory=7", &f, x0, 25);
  EXPECT_EQ(path.counters.iterations, 25);
  EXPECT_EQ(path.counters.solves, 25);
}

// scaling=paper takes P as it is, gamma its scale from the last pair; where P
// is the Hessian itself both take Newton's step, and end at once.
TEST(Lbfgs, ScalingOfThePreconditioner) {
  Coupled f(1.0);
  const VectorXd x0 = VectorXd::Constant(kSize, 0.25);
  const Path gamma = Follow("lbfgs:preconditioner=fixed", &f, x0, 25);
  const Path paper =
      Follow("lbfgs:preconditioner=fixed,scaling=paper", &f, x0, 25);
  EXPECT_EQ(gamma.cost[1], paper.cost[1]);
  EXPECT_NE(gamma.cost[2], paper.cost[2]);
}

// ---- directions -------------------------------------------------------------

// The iterates and gradients of a run without a preconditioner.
struct Steps {
  std::vector<VectorXd> x, g;
};

Steps Record(const std::string& spec, FirstOrderFunction* f, int iterations) {
  Steps steps;
  SolveOptions options;
  options.absolute_tolerance = 1e-300;
  options.max_iterations = iterations;
  options.callback = [&](const IterationState& state) {
    const int n = state.num_parameters;
    steps.x.push_back(Eigen::Map<const VectorXd>(state.x, n));
    steps.g.push_back(Eigen::Map<const VectorXd>(state.gradient, n));
    return true;
  };
  Minimize(spec, f, std::vector<double>(f->NumParameters(), 0.25), options);
  return steps;
}

void ExpectParallel(const VectorXd& step, const VectorXd& d, double tolerance) {
  EXPECT_GT(step.dot(d), 0.0);
  EXPECT_LE((step.normalized() - d.normalized()).norm(), tolerance);
}

// The matrix of the last m pairs by the update formula, Nocedal, Wright, 2nd
// ed., (7.16), from gamma 1.
TEST(Lbfgs, DirectionsAreThoseOfTheUpdateFormula) {
  for (const int memory : {1, 2, 3, 7}) {
    Coupled f(1.0);
    const Steps steps =
        Record("lbfgs:memory=" + std::to_string(memory), &f, 25);
    ASSERT_EQ(steps.x.size(), 26u);
    for (int k = 0; k < 25; ++k) {
      SCOPED_TRACE(k);
      MatrixXd h = MatrixXd::Identity(kSize, kSize);
      for (int i = std::max(0, k - memory); i < k; ++i) {
        const VectorXd s = steps.x[i + 1] - steps.x[i];
        const VectorXd y = steps.g[i + 1] - steps.g[i];
        if (i == std::max(0, k - memory)) {
          const VectorXd last_s = steps.x[k] - steps.x[k - 1];
          const VectorXd last_y = steps.g[k] - steps.g[k - 1];
          h *= last_s.dot(last_y) / last_y.squaredNorm();
        }
        const double rho = 1.0 / y.dot(s);
        const MatrixXd v =
            MatrixXd::Identity(kSize, kSize) - rho * y * s.transpose();
        h = v.transpose() * h * v + rho * s * s.transpose();
      }
      ExpectParallel(steps.x[k + 1] - steps.x[k], -h * steps.g[k], 1e-8);
    }
  }
}

TEST(Ncg, DirectionsAreThoseOfTheFormulas) {
  for (const std::string beta : {"fr", "pr", "hs", "hz"}) {
    SCOPED_TRACE(beta);
    Coupled f(1.0);
    const Steps steps = Record("ncg:beta=" + beta, &f, 30);
    ASSERT_EQ(steps.x.size(), 31u);
    VectorXd d = -steps.g[0];
    int truncated = 0;
    for (int k = 0; k < 30; ++k) {
      SCOPED_TRACE(k);
      ExpectParallel(steps.x[k + 1] - steps.x[k], d, 1e-8);
      const VectorXd& g = steps.g[k + 1];
      const VectorXd y = g - steps.g[k];
      double b = 0.0;
      if (beta == "fr") {
        b = g.squaredNorm() / steps.g[k].squaredNorm();
      } else if (beta == "pr") {
        b = std::max(0.0, g.dot(y) / steps.g[k].squaredNorm());
      } else if (beta == "hs") {
        b = std::max(0.0, g.dot(y) / d.dot(y));
      } else {
        const double dy = d.dot(y);
        b = (y - 2.0 * y.squaredNorm() / dy * d).dot(g) / dy;
        const double least = 0.4 * steps.g[k].dot(d) / d.squaredNorm();
        if (b < least) ++truncated;
        b = std::max(b, least);
      }
      d = -g + b * d;
      if (!(d.dot(g) < 0.0)) d = -g;
    }
    EXPECT_LE(truncated, 5);
  }
}

// Where a function is so bent that beta turns negative, + methods start afresh
// and hz keeps a part of what it had.
TEST(Ncg, NegativeBetasAreBounded) {
  for (const std::string beta : {"pr", "hs", "hz"}) {
    SCOPED_TRACE(beta);
    Rosenbrock f;
    const Result run =
        Minimize("ncg:beta=" + beta, &f, kRosenbrockStart, Tolerance(1e-9));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED);
    EXPECT_LE(run.summary.counters.iterations, 200);
  }
}

TEST(HeavyBall, StepsAreThoseOfTheFormula) {
  Quadratic f(kSize, 1e2);
  Scales scales;
  double cost;
  const std::vector<double> zero(kSize, 0.0);
  f.EvaluateWithScales(zero.data(), &cost, nullptr, &scales);
  const double h = 0.25 * (scales.length / scales.gradient);
  const Steps steps = Record("heavy_ball:momentum=0.9", &f, 200);
  VectorXd move = VectorXd::Zero(kSize);
  int restarts = 0;
  for (int k = 0; k < 200; ++k) {
    SCOPED_TRACE(k);
    if (steps.g[k].dot(move) > 0.0) {
      move.setZero();
      ++restarts;
    }
    const VectorXd x = steps.x[k] - h * steps.g[k] + 0.9 * move;
    EXPECT_LE((steps.x[k + 1] - x).norm(), 1e-14);
    move = steps.x[k + 1] - steps.x[k];
  }
  EXPECT_GT(restarts, 0);
}

// fire as the head of its file says, one line a line.
TEST(Fire, StepsAreThoseOfTheFormulas) {
  for (const int delay : {20, 2}) {
    Coupled f(0.01);
    Scales scales;
    double cost;
    const std::vector<double> zero(kSize, 0.0);
    f.EvaluateWithScales(zero.data(), &cost, nullptr, &scales);
    const double kappa = scales.gradient / scales.length;
    const Steps steps = Record("fire:delay=" + std::to_string(delay), &f, 300);
    ASSERT_EQ(steps.x.size(), 301u);
    const double h_max = 0.65;
    double h = 0.1 * h_max, a = 0.25;
    int downhill = 0, uphill = 0, bounded = 0;
    VectorXd v = VectorXd::Zero(kSize);
    for (int k = 0; k < 300; ++k) {
      SCOPED_TRACE(k);
      const VectorXd& g = steps.g[k];
      VectorXd x = steps.x[k];
      if (g.dot(v) < 0.0) {
        if (++downhill > delay) {
          h = std::min(1.1 * h, h_max);
          a *= 0.99;
        }
      } else {
        downhill = 0;
        ++uphill;
        h = std::max(0.5 * h, 0.002 * h_max);
        a = 0.25;
        x -= 0.5 * h * v;
        v.setZero();
      }
      const VectorXd pushed = v - h / kappa * g;
      double b = a * kappa * pushed.norm() / g.norm();
      const double most = 2.0 * (2.0 - a) / (7.0 * h) - h;
      if (b > most) ++bounded;
      b = std::min(b, std::max(0.0, most));
      v = (1.0 - a) * pushed - b / kappa * g;
      x += h * v;
      EXPECT_LE((steps.x[k + 1] - x).norm(), 1e-12);
      v = (steps.x[k + 1] - x) / h + v;
    }
    EXPECT_GT(uphill, 2);
    EXPECT_GT(bounded, 2);
  }
}

// ---- the end of what doubles can tell ---------------------------------------

// Variables of 1e8: the minimum lies between two of them, and a step toward it
// is rounded away. A function without scales, so that nothing else ends the
// run.
class BetweenTwoNumbers : public FirstOrderFunction {
 public:
  int NumParameters() const override { return 1; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* /*scales*/) const override {
    const double d = (x[0] - 1e8) - 2e-9;
    *cost = 0.5 * d * d;
    if (gradient != nullptr) *gradient = d;
    return true;
  }
};

TEST(LineSearchMethods, StepThatIsRoundedAwayEndsTheRun) {
  for (const char* spec :
       {"lbfgs", "ncg:beta=pr", "ncg:beta=hs", "ncg:beta=hz"}) {
    BetweenTwoNumbers f;
    SolveOptions options;
    options.max_evaluations = 2000;
    const Result run = Minimize(spec, &f, {1e8 + 3.0}, options);
    EXPECT_EQ(run.summary.reason, StopReason::NO_PROGRESS)
        << run.summary.BriefReport();
    EXPECT_NEAR(run.x[0], 1e8, 2e-8);
  }
}

// ---- quadratics -------------------------------------------------------------

int IterationsOn(const std::string& spec, int n, double condition) {
  Quadratic quadratic(n, condition);
  const Result run =
      Minimize(spec, &quadratic, std::vector<double>(n, 0.0), Tolerance(1e-10));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  return static_cast<int>(run.summary.counters.iterations);
}

// In n steps with exact line searches; these are not exact.
TEST(Lbfgs, EndsOnAQuadraticWithFullMemory) {
  EXPECT_LE(IterationsOn("lbfgs:memory=50", 1, 100), 1);
  EXPECT_LE(IterationsOn("lbfgs:memory=50", 2, 100), 8);
  EXPECT_LE(IterationsOn("lbfgs:memory=50", 20, 100), 60);
  EXPECT_GT(IterationsOn("lbfgs:memory=1", 20, 100), 70);
}

TEST(Ncg, EndsOnAQuadraticInAboutNSteps) {
  for (const char* beta : {"fr", "pr", "hs", "hz"}) {
    const std::string spec = std::string("ncg:beta=") + beta;
    EXPECT_LE(IterationsOn(spec, 1, 100), 1) << beta;
    EXPECT_LE(IterationsOn(spec, 2, 100), 8) << beta;
    EXPECT_LE(IterationsOn(spec, 5, 100), 8) << beta;
    EXPECT_LE(IterationsOn(spec, 10, 100), 16) << beta;
  }
}

}  // namespace
}  // namespace granopt
