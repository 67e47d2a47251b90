// interior_point and what it is made of, on packings.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Core"
#include "granular/contact_energy.h"
#include "granular/packing.h"
#include "gtest/gtest.h"
#include "solvers/barrier.h"
#include "tests/granular/forwarding.h"
#include "tests/granular/test_packings.h"
#include "tests/solvers/run_method.h"

namespace granopt {
namespace {

Result Relax(const std::string& spec,
             const Packing& packing,
             double alpha,
             double tolerance) {
  const auto energy = MakeEnergy(packing, alpha);
  return Minimize(spec, energy.get(), Zero(*energy), Tolerance(tolerance));
}

// ---- the central path ----

TEST(Barrier, ClosuresSolveTheRelaxedComplementarity) {
  const double length = 0.3;
  for (const double alpha : {2.0, 2.5, 3.3}) {
    const auto energy = MakeEnergy(ReadData("n64_jammed.xyz"), alpha);
    const std::vector<double> delta = {
        -1e6, -1e3, -1.0, -0.3, -1e-9, 0.0, 1e-9, 0.3, 1.0, 1e3, 1e6};
    const int n = static_cast<int>(delta.size());
    std::vector<double> e(n), s(n);
    CentralClosures(*energy, n, delta.data(), length, e.data(), s.data());
    for (int c = 0; c < n; ++c) {
      SCOPED_TRACE(delta[c]);
      EXPECT_GT(e[c], 0.0);
      EXPECT_GT(s[c], 0.0);
      EXPECT_NEAR(
          std::pow(e[c], alpha - 1.0) * s[c], std::pow(length, alpha), 1e-11);
      const double size = std::max({std::abs(delta[c]), e[c], s[c]});
      EXPECT_NEAR(e[c] - s[c], delta[c], 1e-12 * size);
      if (alpha == 2.0 && std::abs(delta[c]) < 2.0) {
        const double root =
            std::sqrt(delta[c] * delta[c] + 4.0 * length * length);
        EXPECT_NEAR(e[c], 0.5 * (delta[c] + root), 1e-12);
      }
    }
    EXPECT_NEAR(
        ComplementarityOf(*energy, length), std::pow(length, alpha), 1e-15);
  }
}

// ---- small loads ----

// The same minimum as a descent, for a hundredth of its evaluations.
TEST(InteriorPoint, FindsTheMinimumOfADescent) {
  struct Load {
    const char* file;
    double alpha;
    double shear;
  };
  for (const Load& load : {Load{"n1024_a2_p1e-04.xyz", 2.0, 1e-6},
                           Load{"n1024_a2_p1e-04.xyz", 2.0, 1e-5},
                           Load{"n256_phi0.8438_a2_relaxed.xyz", 2.0, 1e-5},
                           Load{"n256_phi0.8438_a2.5_relaxed.xyz", 2.5, 1e-5},
                           Load{"n64_3d_jammed.xyz", 2.0, 1e-6}}) {
    SCOPED_TRACE(load.file);
    const Packing packing = Sheared(load.file, load.shear);
    const Result descent = Relax("lbfgs", packing, load.alpha, 1e-10);
    const Result run = Relax("interior_point", packing, load.alpha, 1e-10);
    EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
    EXPECT_NEAR(
        run.summary.cost, descent.summary.cost, 1e-9 * descent.summary.cost);
    EXPECT_LE(run.summary.counters.factorizations, 20);
    EXPECT_LT(10 * run.summary.counters.evaluations,
              descent.summary.counters.evaluations);
  }
}

// A step of 1e-9 from Delta phi = 1e-8, where overlaps are 1e-8 radii: as few
// factors as far from jamming. A descent takes some ten thousand evaluations.
TEST(InteriorPoint, TakesAsFewFactorsNextToJamming) {
  const Packing packing = Sheared("n1024_a2_p1e-08.xyz", 1e-9);
  const Result run = Relax("interior_point", packing, 2.0, 1e-9);
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_LE(run.summary.counters.factorizations, 20);
  const Result descent = Relax("lbfgs", packing, 2.0, 1e-9);
  EXPECT_NEAR(
      run.summary.cost, descent.summary.cost, 1e-7 * descent.summary.cost);
}

TEST(InteriorPoint, ReachesTheFloor) {
  for (const char* file : {"n1024_a2_p1e-04.xyz", "n1024_a2_p1e-08.xyz"}) {
    SCOPED_TRACE(file);
    const Result run = Relax("interior_point", Sheared(file, 1e-9), 2.0, 1e-14);
    EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  }
}

// Below jamming there is a point at which no gap is closed, and the path leads
// there: E = 0 exactly.
TEST(InteriorPoint, UnjammedStatesReachZero) {
  Packing packing = ReadData("n1024_a2_p1e-04.xyz");
  packing.ScaleRadii(1.0 - 1e-3);
  packing.Perturb(5e-4, 3);
  const auto energy = MakeEnergy(packing, 2.0);
  ASSERT_GT(CostAt(*energy, Zero(*energy)), 0.0);
  const Result run = Relax("interior_point", packing, 2.0, 1e-10);
  EXPECT_EQ(run.summary.reason, StopReason::VANISHED)
      << run.summary.BriefReport();
  EXPECT_EQ(run.summary.cost, 0.0);
  EXPECT_LE(run.summary.counters.factorizations, 40);
}

// ---- what it says where it fails ----

TEST(InteriorPoint, KnowsEarlyThatItLeadsNowhere) {
  const Result run =
      Relax("interior_point", RandomPacking(2, 256, 0.9, 11), 2.0, 1e-9);
  if (run.summary.Succeeded()) return;
  EXPECT_EQ(run.summary.reason, StopReason::NO_PROGRESS);
  EXPECT_LE(run.summary.counters.factorizations, 60);
  EXPECT_LE(run.summary.cost, run.summary.initial_cost);
}

// ---- lists ----

// Forgets the list of gaps after each evaluation, by one far away.
class Forgetful : public Forwarding {
 public:
  using Forwarding::Forwarding;

  bool EvaluateGaps(const double* x, Gaps* gaps) const override {
    std::vector<double> far(x, x + NumParameters());
    for (std::size_t i = 0; i < far.size(); ++i) {
      far[i] += 0.1 * static_cast<double>((i * 7919) % 13);
    }
    double cost;
    return f_->Evaluate(far.data(), &cost, nullptr) &&
           f_->EvaluateGaps(x, gaps);
  }
};

TEST(InteriorPoint, ClosuresSurviveNewLists) {
  const Packing packing = Sheared("n1024_a2_p1e-04.xyz", 1e-5);
  const auto plain = MakeEnergy(packing, 2.0);
  const Result kept =
      Minimize("interior_point", plain.get(), Zero(*plain), Tolerance(1e-10));
  const auto energy = MakeEnergy(packing, 2.0);
  Forgetful forgetful(energy.get());
  const Result run =
      Minimize("interior_point", &forgetful, Zero(*energy), Tolerance(1e-10));
  EXPECT_GT(energy->num_list_builds(), 2 * run.summary.counters.iterations);
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_EQ(run.summary.counters.iterations, kept.summary.counters.iterations);
  EXPECT_NEAR(run.summary.cost, kept.summary.cost, 1e-12 * kept.summary.cost);
}

TEST(InteriorPoint, NamesTheMemoryThatItMayNotTake) {
  const Packing packing = Sheared("n1024_a2_p1e-04.xyz", 1e-6);
  const Result run =
      Relax("interior_point:factor_memory=1e-7", packing, 2.0, 1e-9);
  EXPECT_EQ(run.summary.reason, StopReason::MAX_MEMORY);
  EXPECT_TRUE(
      Contains(run.summary.message, "GB > 1e-07 GB (option factor_memory)"))
      << run.summary.message;
  EXPECT_EQ(run.summary.counters.iterations, 0);
  const Result next =
      Relax("interior_point:factor_memory=1e-7|lbfgs", packing, 2.0, 1e-9);
  EXPECT_TRUE(next.summary.Succeeded()) << next.summary.BriefReport();
}

// ---- methods in turn ----

TEST(SolverSequence, TheNextGoesOnWhereOneGaveUp) {
  const Packing packing = RandomPacking(2, 64, 0.9, 11);
  const Result first = Relax("interior_point", packing, 2.0, 1e-9);
  const Result run = Relax("interior_point|lbfgs", packing, 2.0, 1e-9);
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_EQ(run.summary.solver, "interior_point|lbfgs");
  EXPECT_EQ(run.summary.initial_cost, first.summary.initial_cost);
  if (first.summary.Succeeded()) return;
  EXPECT_TRUE(Contains(run.summary.message, "lbfgs: |g|"));
  EXPECT_EQ(run.summary.counters.factorizations,
            first.summary.counters.factorizations);
  EXPECT_GT(run.summary.counters.evaluations,
            first.summary.counters.evaluations);
}

TEST(SolverSequence, BudgetsAreForAllOfThem) {
  const auto energy = MakeEnergy(RandomPacking(2, 64, 0.9, 11), 2.0);
  for (const int budget : {1, 3, 10, 40, 100}) {
    SolveOptions options = Tolerance(1e-12);
    options.max_evaluations = budget;
    std::int64_t seen = 0;
    options.callback = [&](const IterationState& state) {
      EXPECT_GE(state.counters.evaluations, seen);
      seen = state.counters.evaluations;
      return true;
    };
    const Result run =
        Minimize("interior_point|lbfgs", energy.get(), Zero(*energy), options);
    EXPECT_LE(run.summary.counters.evaluations, budget);
    EXPECT_EQ(run.summary.reason, StopReason::MAX_EVALUATIONS);
  }
}

TEST(SolverSequence, PassesOverWhatCannotServe) {
  const auto energy = MakeEnergy(ReadData("n64_jammed.xyz"), 2.0);
  // A function that is nothing but its gradient.
  class First : public FirstOrderFunction {
   public:
    explicit First(ContactEnergy* f) : f_(f) {}
    int NumParameters() const override { return f_->NumParameters(); }
    bool EvaluateWithScales(const double* x,
                            double* cost,
                            double* gradient,
                            Scales* scales) const override {
      return f_->EvaluateWithScales(x, cost, gradient, scales);
    }

   private:
    ContactEnergy* f_;
  } first(energy.get());
  std::vector<double> start = Zero(*energy);
  start[3] = 1e-6;
  const Result run =
      Minimize("interior_point|lbfgs", &first, start, Tolerance(1e-8));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  const Result none =
      Minimize("newton|interior_point", &first, start, Tolerance(1e-8));
  EXPECT_EQ(none.summary.reason, StopReason::UNSUPPORTED);
}

}  // namespace
}  // namespace granopt
