// newton, and the trust region subproblem that it solves.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Dense"
#include "gtest/gtest.h"
#include "solvers/linear_solver.h"
#include "solvers/registry.h"
#include "solvers/rigidity.h"
#include "solvers/second_order.h"
#include "solvers/sparse_cholesky.h"
#include "solvers/trust_region.h"
#include "solvers/unilateral.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// The lower triangle with every entry kept.
SparseMatrix Lower(const MatrixXd& a) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < a.cols(); ++j) {
    for (int i = j; i < a.rows(); ++i) entries.emplace_back(i, j, a(i, j));
  }
  SparseMatrix lower(a.rows(), a.cols());
  lower.setFromTriplets(entries.begin(), entries.end());
  return lower;
}

// f by formulas, dense and small, with scales if `length` > 0.
class Smooth : public SecondOrderFunction {
 public:
  explicit Smooth(int n, double length = 0.0) : n_(n), length_(length) {}
  virtual double Value(const VectorXd& x) const = 0;
  virtual VectorXd Gradient(const VectorXd& x) const = 0;
  virtual MatrixXd Hessian(const VectorXd& x) const = 0;

  int NumParameters() const override { return n_; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const VectorXd at = Eigen::Map<const VectorXd>(x, n_);
    *cost = Value(at);
    if (gradient != nullptr) {
      Eigen::Map<VectorXd>(gradient, n_) = Gradient(at);
    }
    if (scales != nullptr) {
      *scales = Scales();
      if (length_ > 0.0) {
        scales->gradient = 1.0;
        scales->length = length_;
      }
    }
    return true;
  }
  bool EvaluateHessian(const double* x, SparseMatrix* h) const override {
    *h = Lower(Hessian(Eigen::Map<const VectorXd>(x, n_)));
    return true;
  }
  std::int64_t PatternVersion() const override { return 1; }
  bool HessianTimes(const double* x,
                    const double* v,
                    double* hv) const override {
    Eigen::Map<VectorXd>(hv, n_) = Hessian(Eigen::Map<const VectorXd>(x, n_)) *
                                   Eigen::Map<const VectorXd>(v, n_);
    return true;
  }

 private:
  const int n_;
  const double length_;
};

// Symmetric with the eigenvalues given and mixed eigenvectors.
MatrixXd WithEigenvalues(const VectorXd& values) {
  const auto n = values.size();
  MatrixXd a(n, n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) a(i, j) = std::sin(1.0 + 3.0 * i + 7.0 * j * j);
  }
  const MatrixXd q = Eigen::HouseholderQR<MatrixXd>(a).householderQ();
  return q * values.asDiagonal() * q.transpose();
}

class Bowl : public Smooth {
 public:
  explicit Bowl(const VectorXd& eigenvalues)
      : Smooth(static_cast<int>(eigenvalues.size()), 100.0),
        a_(WithEigenvalues(eigenvalues)),
        center_(VectorXd::LinSpaced(eigenvalues.size(), 1.0, 2.0)) {}
  double Value(const VectorXd& x) const override {
    return 0.5 * (x - center_).dot(a_ * (x - center_));
  }
  VectorXd Gradient(const VectorXd& x) const override {
    return a_ * (x - center_);
  }
  MatrixXd Hessian(const VectorXd& /*x*/) const override { return a_; }

 private:
  const MatrixXd a_;
  const VectorXd center_;
};

// sum (x_i^2 - 1)^2 / 4 + coupling: indefinite everywhere near zero.
class Wells : public Smooth {
 public:
  explicit Wells(int n) : Smooth(n, 1.0) {}
  double Value(const VectorXd& x) const override {
    double sum = 0.0;
    for (int i = 0; i < x.size(); ++i) {
      sum += 0.25 * (x[i] * x[i] - 1.0) * (x[i] * x[i] - 1.0);
      if (i > 0) sum += 0.05 * (x[i] - x[i - 1]) * (x[i] - x[i - 1]);
    }
    return sum;
  }
  VectorXd Gradient(const VectorXd& x) const override {
    VectorXd g(x.size());
    for (int i = 0; i < x.size(); ++i) {
      g[i] = x[i] * (x[i] * x[i] - 1.0);
      if (i > 0) g[i] += 0.1 * (x[i] - x[i - 1]);
      if (i + 1 < x.size()) g[i] += 0.1 * (x[i] - x[i + 1]);
    }
    return g;
  }
  MatrixXd Hessian(const VectorXd& x) const override {
    MatrixXd h = MatrixXd::Zero(x.size(), x.size());
    for (int i = 0; i < x.size(); ++i) {
      h(i, i) += 3.0 * x[i] * x[i] - 1.0;
      if (i > 0) {
        h(i, i) += 0.1;
        h(i - 1, i - 1) += 0.1;
        h(i, i - 1) -= 0.1;
        h(i - 1, i) -= 0.1;
      }
    }
    return h;
  }
};

// ---- the subproblem ---------------------------------------------------------

// The exact solution from all eigenvalues, by bisection.
struct Exact {
  double change = 0.0;
  double norm = 0.0;
  double lambda = 0.0;
};

Exact SolveDensely(const MatrixXd& h, const VectorXd& g, double radius) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(h);
  const VectorXd values = eigen.eigenvalues();
  const VectorXd c = eigen.eigenvectors().transpose() * g;
  const auto step = [&](double lambda) {
    VectorXd s = VectorXd::Zero(c.size());
    for (int i = 0; i < c.size(); ++i) {
      // No part of the gradient: no part of the step.
      if (std::abs(c[i]) > 1e-12) s[i] = -c[i] / (values[i] + lambda);
    }
    return s;
  };
  Exact exact;
  double low = std::max(0.0, -values[0]);
  VectorXd s = step(low + 1e-13);
  if (s.norm() > radius) {
    double high = low + g.norm() / radius + 1.0;
    for (int k = 0; k < 200; ++k) {
      const double mid = 0.5 * (low + high);
      (step(mid).norm() > radius ? low : high) = mid;
    }
    s = step(high);
    low = high;
  } else if (values[0] < 0.0) {
    // The hard case.
    s[0] += std::sqrt(radius * radius - s.squaredNorm());
  }
  exact.change = c.dot(s) + 0.5 * s.dot(values.asDiagonal() * s);
  exact.norm = s.norm();
  exact.lambda = low;
  return exact;
}

std::unique_ptr<LinearSolver> MakeDirect() {
  Parameters parameters;
  return MakeLinearSolver(&parameters);
}

double Model(const MatrixXd& h, const VectorXd& g, const VectorXd& s) {
  return g.dot(s) + 0.5 * s.dot(h * s);
}

class SubproblemTest : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Radii,
                         SubproblemTest,
                         testing::Values(1e-3, 0.1, 1.0, 10.0, 1e4));

TEST_P(SubproblemTest, NearlyExactIsWhatEigenvaluesSay) {
  const double radius = GetParam();
  const int n = 12;
  for (const double lowest : {0.5, 1e-6, -1e-3, -1.0, -50.0}) {
    for (const bool is_hard : {false, true}) {
      SCOPED_TRACE(lowest);
      SCOPED_TRACE(is_hard ? "hard" : "easy");
      VectorXd values = VectorXd::LinSpaced(n, 1.0, 30.0);
      values[0] = lowest;
      const MatrixXd h = WithEigenvalues(values);
      const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(h);
      VectorXd g = VectorXd::LinSpaced(n, -1.0, 2.0);
      if (is_hard) {
        const VectorXd z = eigen.eigenvectors().col(0);
        g -= g.dot(z) * z;
      }
      const Exact exact = SolveDensely(h, g, radius);
      const auto linear = MakeDirect();
      NearlyExactSubproblem::Options options;
      options.least = 0.999;
      options.most = 1.001;
      NearlyExactSubproblem subproblem(options, linear.get());
      VectorXd s;
      const SubproblemStep step = subproblem.Solve(
          Lower(h), 1, 0.0, 1.0, g, radius, []() { return 0.1; }, &s);
      ASSERT_NE(step.end, SubproblemStep::End::FAILED);
      EXPECT_LE(s.norm(), 1.0011 * radius);
      EXPECT_NEAR(Model(h, g, s), exact.change, 3e-3 * std::abs(exact.change));
      EXPECT_NEAR(s.norm(), exact.norm, 2e-3 * exact.norm);
      EXPECT_LE(linear->factorizations(), 60);
      if (step.end == SubproblemStep::End::INTERIOR) {
        EXPECT_EQ(linear->factorizations(), 1);
      }
    }
  }
}

// With loose bounds: never longer than asked for, and downhill.
TEST_P(SubproblemTest, LooseStepsTakeFewFactors) {
  const int n = 12;
  VectorXd values = VectorXd::LinSpaced(n, 1e-4, 30.0);
  const MatrixXd h = WithEigenvalues(values);
  const VectorXd g = VectorXd::LinSpaced(n, -1.0, 2.0);
  const auto linear = MakeDirect();
  NearlyExactSubproblem::Options options;
  options.least = 0.1;
  options.most = 2.0;
  options.accepts_short = true;
  NearlyExactSubproblem subproblem(options, linear.get());
  VectorXd s;
  const auto solve = [&]() {
    const SubproblemStep step = subproblem.Solve(
        Lower(h), 1, 0.0, 1.0, g, GetParam(), []() { return 0.1; }, &s);
    EXPECT_NE(step.end, SubproblemStep::End::FAILED);
    EXPECT_LE(s.norm(), 2.0 * GetParam());
    EXPECT_LT(g.dot(s), 0.0);
    EXPECT_NEAR(step.change, Model(h, g, s), 1e-9 * std::abs(step.change));
    EXPECT_NEAR(step.norm2, s.squaredNorm(), 1e-12 * step.norm2);
  };
  solve();
  // The second time lambda is known.
  subproblem.Suggest(s, GetParam());
  const std::int64_t before = linear->factorizations();
  solve();
  EXPECT_LE(linear->factorizations(), before + 1);
}

TEST_P(SubproblemTest, TruncatedEndsInsideOrOnTheBoundary) {
  const double radius = GetParam();
  const int n = 12;
  for (const double lowest : {0.5, -1.0}) {
    VectorXd values = VectorXd::LinSpaced(n, 1.0, 30.0);
    values[0] = lowest;
    const MatrixXd h = WithEigenvalues(values);
    const VectorXd g = VectorXd::LinSpaced(n, -1.0, 2.0);
    VectorXd p = VectorXd::LinSpaced(n, 1.0, 5.0);  // P
    TruncatedSubproblem truncated;
    truncated.times = [&](const VectorXd& v, VectorXd* hv) { *hv = h * v; };
    truncated.solve = [&](const VectorXd& r, VectorXd* z) {
      *z = r.cwiseQuotient(p);
    };
    truncated.tolerance = 1e-12;
    truncated.max_iterations = 3 * n;
    VectorXd s;
    const SubproblemStep step = truncated.Solve(g, radius * radius, &s);
    const double norm2 = s.dot(p.cwiseProduct(s));
    EXPECT_NEAR(norm2, step.norm2, 1e-9 * norm2);
    EXPECT_NEAR(step.change, Model(h, g, s), 1e-9 * std::abs(step.change));
    // No worse than the best along the first direction (Cauchy).
    EXPECT_LT(step.change, 0.0);
    if (step.end == SubproblemStep::End::INTERIOR) {
      EXPECT_GT(lowest, 0.0);
      EXPECT_LE((h * s + g).norm(), 1e-9 * g.norm());
      EXPECT_LE(norm2, radius * radius);
    } else {
      EXPECT_NEAR(norm2, radius * radius, 1e-9 * norm2);
      if (lowest > 0.0) {
        EXPECT_EQ(step.end, SubproblemStep::End::BOUNDARY);
      }
      if (radius > 5.0) {
        EXPECT_EQ(step.end, SubproblemStep::End::CURVED);
      }
    }
  }
}

// ---- runs -------------------------------------------------------------------

TEST(Newton, QuadraticInOneStep) {
  Bowl f(VectorXd::LinSpaced(20, 1e-3, 30.0));
  const Result run = Minimize("newton:floor=0,radius=1e6",
                              &f,
                              std::vector<double>(20, 0.0),
                              Tolerance(1e-10));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_EQ(run.summary.counters.iterations, 1);
  EXPECT_EQ(run.summary.counters.factorizations, 1);
  EXPECT_EQ(run.summary.counters.hessians, 1);
  EXPECT_EQ(run.summary.counters.evaluations, 2);
}

TEST(Newton, TruncatedTakesOneIterationAnEigenvalue) {
  VectorXd values(20);
  for (int i = 0; i < 20; ++i) values[i] = 1.0 + i % 4;
  Bowl f(values);
  const Result run = Minimize("newton:subproblem=truncated,floor=0,radius=1e6",
                              &f,
                              std::vector<double>(20, 0.0),
                              Tolerance(1e-10));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_EQ(run.summary.counters.factorizations, 0);
  EXPECT_LE(run.summary.counters.linear_iterations,
            4 * run.summary.counters.iterations);
  EXPECT_LE(run.summary.counters.iterations, 8);
}

TEST(Newton, Rosenbrock) {
  for (const char* spec :
       {"newton", "newton:subproblem=truncated", "newton:step=shrink"}) {
    for (const double length : {0.0, 1e-3, 1.0, 1e3}) {
      SCOPED_TRACE(std::string(spec) + " " + std::to_string(length));
      Rosenbrock f(length > 0.0 ? 1.0 : 0.0, length);
      SolveOptions options = Tolerance(1e-9);
      options.absolute_tolerance = 1e-8;
      const Result run = Minimize(spec, &f, kRosenbrockStart, options);
      EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
      EXPECT_LE(run.summary.counters.iterations, 60);
      EXPECT_NEAR(run.x[0], 1.0, 1e-6);
      ExpectHonest(f, run);
    }
  }
}

TEST(Newton, LeavesIndefiniteRegions) {
  for (const char* spec :
       {"newton", "newton:subproblem=truncated", "newton:step=shrink"}) {
    SCOPED_TRACE(spec);
    Wells f(16);
    std::vector<double> start(16);
    for (int i = 0; i < 16; ++i) start[i] = 0.05 * std::sin(1.0 + i);
    const Result run = Minimize(spec, &f, start, Tolerance(1e-12));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    EXPECT_LE(run.summary.counters.iterations, 40);
    // A minimum, not a saddle.
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(
        f.Hessian(Eigen::Map<const VectorXd>(run.x.data(), 16)));
    EXPECT_GT(eigen.eigenvalues()[0], 0.0);
  }
}

// Of an error e, e^2 is left; and each of the last steps takes one factor.
TEST(Newton, ConvergesQuadraticallyWithOneFactorAStep) {
  Wells f(16);
  std::vector<double> start(16);
  for (int i = 0; i < 16; ++i) start[i] = 1.2 + 0.1 * std::sin(1.0 + i);
  SolveOptions options = Tolerance(1e-14);
  std::vector<double> residuals;
  options.callback = [&](const IterationState& state) {
    residuals.push_back(state.max_gradient);
    EXPECT_EQ(state.counters.factorizations, state.counters.iterations);
    return true;
  };
  const Result run = Minimize("newton", &f, start, options);
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_LE(run.summary.counters.iterations, 6);
  for (std::size_t k = 1; k < residuals.size(); ++k) {
    EXPECT_LE(residuals[k], 2.0 * residuals[k - 1] * residuals[k - 1] + 3e-15);
  }
}

// ---- what it refuses --------------------------------------------------------

TEST(Newton, RefusesFunctionsWithoutSecondDerivatives) {
  Quadratic f(5);
  const std::vector<double> start(5, 0.5);
  const Result run = Minimize("newton", &f, start);
  EXPECT_EQ(run.summary.reason, StopReason::UNSUPPORTED);
  EXPECT_EQ(run.summary.message,
            "newton needs a function with second derivatives");
  EXPECT_TRUE(SameBits(run.x, start));
}

TEST(Newton, GaussNewtonRefusesWhatIsNoSumOfOneSidedTerms) {
  Wells f(4);
  const std::vector<double> start(4, 0.5);
  const Result run = Minimize("newton:hessian=gauss_newton", &f, start);
  EXPECT_EQ(run.summary.reason, StopReason::UNSUPPORTED);
  EXPECT_TRUE(Contains(run.summary.message, "one-sided"));
  EXPECT_TRUE(SameBits(run.x, start));
}

TEST(Newton, DirectTakesNoPreconditioner) {
  std::string error;
  EXPECT_EQ(CreateSolver("newton:preconditioner=hessian", &error), nullptr);
  EXPECT_EQ(error,
            "solver 'newton': option subproblem=direct takes no "
            "preconditioner, truncated does");
}

TEST(Newton, FactorThatIsTooLargeIsRefusedWithBothNumbers) {
  for (const char* spec :
       {"newton:factor_memory=1e-7",
        "newton:subproblem=truncated,preconditioner=hessian,factor_memory=1e-7",
        "lbfgs:preconditioner=hessian,factor_memory=1e-7"}) {
    SCOPED_TRACE(spec);
    Wells f(16);  // 136 entries
    const std::vector<double> start(16, 0.5);
    const Result run = Minimize(spec, &f, start);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_MEMORY);
    EXPECT_TRUE(
        Contains(run.summary.message, "GB > 1e-07 GB (option factor_memory)"))
        << run.summary.message;
    EXPECT_TRUE(SameBits(run.x, start));
    EXPECT_EQ(run.summary.counters.evaluations, 1);
  }
}

// ---- which objects hold -----------------------------------------------------

Gaps GapsBetween(const std::vector<std::pair<int, int>>& closed) {
  Gaps gaps;
  for (const auto& [i, j] : closed) gaps.ids.push_back({i, j, {0, 0, 0}});
  gaps.ids.push_back({0, 3, {0, 0, 0}});  // open
  gaps.delta = VectorXd::Ones(static_cast<Eigen::Index>(gaps.ids.size()));
  gaps.delta[gaps.delta.size() - 1] = -1.0;
  return gaps;
}

TEST(Rigidity, TakesAwayWhatIsNotHeldAgainAndAgain) {
  // 0 to 3 hold each other; 4 has three, but 5 and 6 are not held.
  const Gaps gaps = GapsBetween({{0, 1},
                                 {0, 2},
                                 {0, 3},
                                 {1, 2},
                                 {1, 3},
                                 {2, 3},
                                 {3, 4},
                                 {4, 5},
                                 {4, 6},
                                 {7, 7}});
  const std::vector<bool> held = HeldObjects(gaps, 9, 3);
  EXPECT_EQ(held,
            (std::vector<bool>{
                true, true, true, true, false, false, false, false, false}));
  // Without the last of its three.
  const Gaps open = GapsBetween({{0, 1}, {0, 2}, {1, 2}, {1, 3}, {2, 3}});
  EXPECT_EQ(HeldObjects(open, 4, 3), std::vector<bool>(4, false));
  EXPECT_EQ(HeldObjects(open, 4, 2), std::vector<bool>(4, true));
}

}  // namespace
}  // namespace granopt
