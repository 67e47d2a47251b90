// What `auto` chooses on packings, and that it never returns a worse point.

#include <cstdint>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"
#include "tests/solvers/run_method.h"

namespace granopt {
namespace {

Result Relax(const std::string& spec,
             const Packing& packing,
             double alpha,
             const SolveOptions& options) {
  const auto energy = MakeEnergy(packing, alpha);
  return Minimize(spec,
                  energy.get(),
                  std::vector<double>(energy->NumParameters(), 0.0),
                  options);
}

bool Has(const Result& run, const std::string& text) {
  return run.summary.message.find(text) != std::string::npos;
}

// As many factors next to jamming as far from it, and the minimum of a descent.
TEST(Auto, SmallLoadsTakeAFewFactors) {
  struct Load {
    const char* file;
    double alpha;
    double shear;
    const char* phase;
  };
  for (const Load& load :
       {Load{"n1024_a2_p1e-04.xyz", 2.0, 1e-7, "newton"},
        Load{"n1024_a2_p1e-04.xyz", 2.0, 1e-6, "barrier"},
        Load{"n1024_a2_p1e-04.xyz", 2.0, 6e-5, "interior_point"},
        Load{"n1024_a2_p1e-08.xyz", 2.0, 1e-11, "newton"},
        Load{"n1024_a2_p1e-08.xyz", 2.0, 6e-9, "interior_point"},
        Load{"n256_phi0.8438_a2.5_relaxed.xyz", 2.5, 1e-6, "newton"}}) {
    SCOPED_TRACE(load.file);
    const Packing packing = Sheared(load.file, load.shear);
    const Result descent = Relax("lbfgs", packing, load.alpha, Tolerance(1e-9));
    const Result run = Relax("auto", packing, load.alpha, Tolerance(1e-9));
    EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
    EXPECT_NEAR(
        run.summary.cost, descent.summary.cost, 1e-7 * descent.summary.cost);
    EXPECT_LE(run.summary.counters.factorizations, 20);
    EXPECT_GT(run.summary.counters.factorizations, 0);
    EXPECT_TRUE(Has(run, load.phase)) << run.summary.message;
    EXPECT_FALSE(Has(run, "lbfgs")) << run.summary.message;
  }
}

// Where contacts change all over, first-order steps come first, and the bits
// are theirs for as long as they last; then a few factors end the run.
TEST(Auto, RandomStartsAreForLbfgs) {
  const Packing packing = RandomPacking(2, 256, 0.9, 11);
  SolveOptions options = Tolerance(1e-9);
  const Result run = Relax("auto", packing, 2.0, options);
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  EXPECT_TRUE(Has(run, ", newton")) << run.summary.message;
  const Result whole = Relax("lbfgs:memory=8", packing, 2.0, options);
  EXPECT_LT(run.summary.counters.evaluations,
            whole.summary.counters.evaluations);
  options.max_evaluations = 90;
  const Result begun = Relax("auto", packing, 2.0, options);
  options.max_evaluations = 89;  // one went into the choice
  const Result lbfgs = Relax("lbfgs:memory=8", packing, 2.0, options);
  EXPECT_EQ(begun.summary.reason, StopReason::MAX_EVALUATIONS);
  EXPECT_EQ(begun.summary.counters.factorizations, 0);
  EXPECT_EQ(begun.x, lbfgs.x);
}

// Where interior_point gives up near jamming, the barrier preconditioner goes
// on from its best point.
TEST(Auto, GoesOnWhereContactsBuckle) {
  const Packing packing = Sheared("n1024_a2_p1e-04.xyz", 8e-4);
  const Result run = Relax("auto", packing, 2.0, Tolerance(1e-8));
  EXPECT_TRUE(run.summary.Succeeded()) << run.summary.BriefReport();
  const Result interior =
      Relax("interior_point", packing, 2.0, Tolerance(1e-8));
  ASSERT_FALSE(interior.summary.Succeeded());
  EXPECT_LE(run.summary.cost, interior.summary.cost);
  EXPECT_TRUE(Has(run, "interior_point")) << run.summary.message;
  EXPECT_TRUE(Has(run, ", barrier")) << run.summary.message;
}

// Methods change hands at the best point: whatever ends a run, it is not above
// its start, and more evaluations do not end above fewer by more than rounding.
TEST(Auto, NeverReturnsAWorsePoint) {
  for (const char* file : {"n1024_a2_p1e-04.xyz", "n1024_a2_p1e-08.xyz"}) {
    for (const double shear : {1e-9, 1e-6, 1e-3}) {
      const Packing packing = Sheared(file, shear);
      const auto energy = MakeEnergy(packing, 2.0);
      const double start =
          CostAt(*energy, std::vector<double>(energy->NumParameters(), 0.0));
      for (const std::int64_t budget : {1, 2, 3, 5, 8, 13, 21, 34, 55, 300}) {
        SolveOptions options = Tolerance(1e-12);
        options.max_evaluations = budget;
        const Result run = Relax("auto", packing, 2.0, options);
        EXPECT_LE(run.summary.cost, start) << file << shear << ' ' << budget;
        EXPECT_LE(run.summary.counters.evaluations, budget);
      }
    }
  }
}

}  // namespace
}  // namespace granopt
