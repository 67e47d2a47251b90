// The energy as nonlinear least squares. What every method must do is in
// conformance_test.cc; this is what only this one can get wrong: residuals,
// lists of gaps, and misbehaviour of a function that it does serve.

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "solvers/unilateral.h"
#include "tests/granular/forwarding.h"
#include "tests/granular/test_packings.h"
#include "tests/solvers/run_method.h"
#include "tests/solvers/test_functions.h"

namespace granopt {
namespace {

constexpr char kBest[] = "ceres_nlls:scaled=1,differences=1,restarts=10";

// An energy that counts, and that may be told to misbehave.
class Watched : public Forwarding {
 public:
  using Forwarding::Forwarding;

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    ++evaluations;
    if (!f_->EvaluateWithScales(x, cost, gradient, scales)) return false;
    if (evaluations >= nan_from && gradient != nullptr) gradient[17] = kNan;
    return true;
  }
  int BlockSize() const override { return block_size; }
  bool EvaluateGaps(const double* x, Gaps* gaps) const override {
    ++gap_evaluations;
    if (gap_evaluations >= refuse_gaps_from) return false;
    if (!f_->EvaluateGaps(x, gaps)) return false;
    if (!only_closed) return true;
    // Not a gap more than must be told.
    Gaps closed;
    std::vector<Eigen::Triplet<double>> entries;
    std::vector<double> delta, stiffness;
    for (int c = 0; c < gaps->delta.size(); ++c) {
      if (!(gaps->delta[c] > 0.0)) continue;
      for (decltype(gaps->jacobian)::InnerIterator it(gaps->jacobian, c); it;
           ++it) {
        entries.emplace_back(
            static_cast<int>(delta.size()), it.col(), it.value());
      }
      closed.ids.push_back(gaps->ids[c]);
      delta.push_back(gaps->delta[c]);
      stiffness.push_back(gaps->stiffness[c]);
    }
    const int m = static_cast<int>(delta.size());
    closed.delta = Eigen::Map<const Eigen::VectorXd>(delta.data(), m);
    closed.stiffness = Eigen::Map<const Eigen::VectorXd>(stiffness.data(), m);
    closed.jacobian.resize(m, NumParameters());
    closed.jacobian.setFromTriplets(entries.begin(), entries.end());
    *gaps = closed;
    return true;
  }

  mutable int evaluations = 0;
  mutable int gap_evaluations = 0;
  int nan_from = 1 << 30;
  int refuse_gaps_from = 1 << 30;
  bool only_closed = false;
  int block_size = 2;
};

Packing Sheared(double alpha) {
  Packing packing = ReadData(alpha == 2.0 ? "n256_phi0.8438_a2_relaxed.xyz"
                                          : "n256_phi0.8438_a2.5_relaxed.xyz");
  packing.Deform(SimpleShear(2, 1e-5));
  return packing;
}

// E = 1/2 sum r^2 and its gradient is J^T r, with r as the method makes it.
TEST(CeresNlls, LeastSquaresAreTheEnergy) {
  for (const double alpha : {2.0, 2.5, 3.0}) {
    const auto energy = MakeEnergy(Sheared(2.0), alpha);
    const std::vector<double> u =
        RandomVector(energy->NumParameters(), 1e-4, 5);
    const Evaluation at = Evaluate(*energy, u);
    Gaps gaps;
    ASSERT_TRUE(energy->EvaluateGaps(u.data(), &gaps));
    double cost = 0.0;
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(energy->NumParameters());
    for (int c = 0; c < gaps.delta.size(); ++c) {
      if (!(gaps.delta[c] > 0.0)) continue;
      const double root = std::sqrt(2.0 * gaps.stiffness[c] / alpha);
      const double r = root * std::pow(gaps.delta[c], 0.5 * alpha);
      const double slope =
          0.5 * alpha * root * std::pow(gaps.delta[c], 0.5 * alpha - 1.0);
      cost += 0.5 * r * r;
      gradient += r * slope * gaps.jacobian.row(c).transpose();
    }
    EXPECT_NEAR(cost, at.energy, 1e-12 * at.energy);
    for (int i = 0; i < gradient.size(); ++i) {
      EXPECT_NEAR(gradient[i], at.gradient[i], 1e-12 * at.scales.gradient);
    }
  }
}

TEST(CeresNlls, AgreesWithLbfgs) {
  for (const double alpha : {2.0, 2.5}) {
    const Packing packing = Sheared(alpha);
    const auto reference = MakeEnergy(packing, alpha);
    const std::vector<double> start(reference->NumParameters(), 0.0);
    const Result lbfgs =
        Minimize("lbfgs", reference.get(), start, Tolerance(1e-11));
    ASSERT_EQ(lbfgs.summary.reason, StopReason::CONVERGED);
    for (const std::string& spec :
         {std::string(kBest), std::string(kBest) + ",strategy=dogleg"}) {
      SCOPED_TRACE(spec);
      const auto energy = MakeEnergy(packing, alpha);
      Watched f(energy.get());
      const Result run = Minimize(spec, &f, start, Tolerance(1e-9));
      ASSERT_EQ(run.summary.reason, StopReason::CONVERGED)
          << run.summary.BriefReport();
      EXPECT_NEAR(
          run.summary.cost, lbfgs.summary.cost, 1e-10 * lbfgs.summary.cost);
      // The counts are of what was done: a point is evaluated once, and so are
      // its gaps but those that a run of Ceres begins with.
      const Counters& c = run.summary.counters;
      EXPECT_EQ(c.evaluations, f.evaluations);
      EXPECT_GE(f.gap_evaluations, c.evaluations);
      EXPECT_GT(c.iterations, 5);
      EXPECT_GE(c.hessians, c.iterations);
      EXPECT_LE(c.hessians, c.evaluations + c.restarts);
      EXPECT_GT(c.factorizations, 5);
      EXPECT_EQ(c.factorizations, c.solves);
      EXPECT_GT(run.summary.linear_seconds, 0.0);
    }
  }
}

// Where only closed gaps are listed, each that closes is missing from the list;
// none is dropped.
TEST(CeresNlls, ListIsOutgrown) {
  const Packing packing = Sheared(2.0);
  const auto plain = MakeEnergy(packing, 2.0);
  const std::vector<double> start =
      RandomVector(plain->NumParameters(), 2e-3, 9);
  const Result full = Minimize(kBest, plain.get(), start, Tolerance(1e-8));
  const auto energy = MakeEnergy(packing, 2.0);
  Watched f(energy.get());
  f.only_closed = true;
  const Result run = Minimize(kBest, &f, start, Tolerance(1e-8));
  ASSERT_EQ(full.summary.reason, StopReason::CONVERGED)
      << full.summary.BriefReport();
  ASSERT_EQ(run.summary.reason, StopReason::CONVERGED)
      << run.summary.BriefReport();
  EXPECT_GT(run.summary.counters.restarts, full.summary.counters.restarts);
  EXPECT_LE(MaxGradientAt(*energy, run.x), run.summary.tolerance);
  EXPECT_LT(run.summary.cost, 0.1 * run.summary.initial_cost);
}

// Blocks are there for the layout of a matrix only.
TEST(CeresNlls, BlocksDoNotMatter) {
  const Packing packing = Sheared(2.0);
  std::vector<double> costs;
  for (const int block_size : {1, 2, 4, 3}) {
    const auto energy = MakeEnergy(packing, 2.0);
    Watched f(energy.get());
    f.block_size = block_size;  // 3 is no divisor
    const Result run = Minimize(kBest,
                                &f,
                                std::vector<double>(f.NumParameters(), 0.0),
                                Tolerance(1e-8));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    costs.push_back(run.summary.cost);
  }
  for (const double cost : costs) {
    EXPECT_NEAR(cost, costs[0], 1e-10 * costs[0]);
  }
}

// Rows of zeros in J^T J, at jamming and far above, and a gap of a grain with
// its own image, which depends on nothing.
TEST(CeresNlls, Rattlers) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(1.0 + 1e-4);
  packing.Perturb(1e-6, 3);
  for (const std::string strategy : {"lm", "dogleg"}) {
    const auto energy = MakeEnergy(packing, 2.0);
    const Result run =
        Minimize(kBest + (",strategy=" + strategy),
                 energy.get(),
                 std::vector<double>(energy->NumParameters(), 0.0),
                 Tolerance(1e-8));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
  }
  Eigen::MatrixXd positions(2, 2);
  positions << 0.25, 0.75, 0.5, 0.52;
  const auto own =
      MakeEnergy(MakePacking(Box::Cube(2, 1.0), positions, {0.6, 0.3}), 2.0);
  const Result run =
      Minimize(kBest, own.get(), std::vector<double>(4, 0.0), Tolerance(1e-8));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
}

TEST(CeresNlls, RefusesWhatIsNoSumOfGaps) {
  Quadratic quadratic(20);
  const std::vector<double> start(20, 0.25);
  const Result run = Minimize("ceres_nlls", &quadratic, start);
  EXPECT_EQ(run.summary.reason, StopReason::UNSUPPORTED);
  EXPECT_TRUE(Contains(run.summary.message, "UnilateralFunction"));
  EXPECT_EQ(run.summary.counters.evaluations, 0);
  EXPECT_TRUE(SameBits(run.x, start));
  std::string error;
  EXPECT_EQ(CreateSolver("ceres_nlls:strategy=newton", &error), nullptr);
  EXPECT_TRUE(Contains(error, "lm|dogleg")) << error;
}

// Silently, and with the best point before it.
TEST(CeresNlls, FunctionThatFails) {
  const auto energy = MakeEnergy(Sheared(2.0), 2.0);
  const std::vector<double> start(energy->NumParameters(), 0.0);
  testing::internal::CaptureStderr();
  for (const int at : {1, 2, 3, 4, 7}) {
    SCOPED_TRACE(at);
    Watched nan(energy.get());
    nan.nan_from = at;
    const Result first = Minimize(kBest, &nan, start, Tolerance(1e-9));
    EXPECT_EQ(first.summary.reason, StopReason::EVALUATION_FAILED);
    EXPECT_EQ(first.summary.message,
              "gradient[17] = nan at evaluation " + std::to_string(at));
    EXPECT_LE(first.summary.cost, first.summary.initial_cost);
    Watched refuses(energy.get());
    refuses.refuse_gaps_from = at;
    const Result second = Minimize(kBest, &refuses, start, Tolerance(1e-9));
    EXPECT_EQ(second.summary.reason, StopReason::EVALUATION_FAILED);
    EXPECT_EQ(second.summary.message, "the function refused its gaps");
    EXPECT_EQ(second.summary.cost, CostAt(*energy, second.x));
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(CeresNlls, BudgetsAndCallbacks) {
  const auto energy = MakeEnergy(Sheared(2.0), 2.0);
  const std::vector<double> start(energy->NumParameters(), 0.0);
  for (const int budget : {0, 1, 4}) {
    SolveOptions options = Tolerance(1e-9);
    options.max_iterations = budget;
    const Result run = Minimize(kBest, energy.get(), start, options);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_ITERATIONS);
    EXPECT_EQ(run.summary.counters.iterations, budget);
    ExpectBothNumbers(run.summary, "iterations", budget);
    EXPECT_EQ(SameBits(run.x, start), budget == 0);
  }
  SolveOptions options = Tolerance(1e-9);
  int calls = 0;
  double last = INFINITY;
  options.callback = [&](const IterationState& state) {
    EXPECT_EQ(state.counters.iterations, calls);
    EXPECT_LT(state.cost, last);
    last = state.cost;
    return ++calls < 4;
  };
  const Result run = Minimize(kBest, energy.get(), start, options);
  EXPECT_EQ(run.summary.reason, StopReason::CALLBACK);
  EXPECT_EQ(run.summary.counters.iterations, 3);
  options = Tolerance(1e-9);
  options.max_seconds = 0.0;
  EXPECT_EQ(Minimize(kBest, energy.get(), start, options).summary.reason,
            StopReason::MAX_SECONDS);
}

// scaled=1: energies times 2^a, and nothing changes.
TEST(CeresNlls, ScaledIsIndependentOfUnits) {
  const Packing packing = Sheared(2.0);
  std::vector<std::vector<double>> ends;
  for (const int a : {0, -60, 60}) {
    ContactEnergyOptions options;
    options.stiffness = std::exp2(a);
    const auto energy = MakeEnergy(packing, options);
    const Result run =
        Minimize(kBest,
                 energy.get(),
                 std::vector<double>(energy->NumParameters(), 0.0),
                 Tolerance(1e-8));
    EXPECT_EQ(run.summary.reason, StopReason::CONVERGED)
        << run.summary.BriefReport();
    ends.push_back(run.x);
  }
  EXPECT_TRUE(SameBits(ends[0], ends[1]));
  EXPECT_TRUE(SameBits(ends[0], ends[2]));
}

// The roundoff of the cost: Ceres' sufficient decrease ends a run there, unless
// differences come from gradients.
TEST(CeresNlls, DifferencesReachMoreDigits) {
  const auto end = [](const std::string& spec) {
    const auto energy = MakeEnergy(Sheared(2.0), 2.0);
    return Minimize(spec,
                    energy.get(),
                    std::vector<double>(energy->NumParameters(), 0.0),
                    Tolerance(1e-12))
        .summary;
  };
  const Summary as_is = end("ceres_nlls:scaled=1");
  const Summary with = end(kBest);
  EXPECT_EQ(as_is.reason, StopReason::NO_PROGRESS) << as_is.BriefReport();
  EXPECT_TRUE(Contains(as_is.message, "Ceres: ")) << as_is.message;
  EXPECT_LT(with.max_gradient, 0.1 * as_is.max_gradient) << with.BriefReport();
}

}  // namespace
}  // namespace granopt
