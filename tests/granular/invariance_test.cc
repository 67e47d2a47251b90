// Nothing is absolute: energies times 2^a and lengths times 2^b, and a method
// takes bitwise the same steps, near jamming too. And nothing is left to
// chance: the same run twice.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/method_table.h"
#include "tests/granular/test_packings.h"
#include "tests/solvers/run_method.h"

namespace granopt {
namespace {

// ---- runs -------------------------------------------------------------------

// A load near the jamming point: radii that take the packing fraction `dphi`
// above it, and a shear.
struct Load {
  const char* file;
  double phi_j;
  double dphi;
  double shear;
};

Packing Loaded(const Load& load) {
  Packing packing = ReadData(load.file);
  const int d = packing.dimension();
  packing.ScaleRadii(std::pow(1.0 + load.dphi / load.phi_j, 1.0 / d));
  packing.Deform(SimpleShear(d, load.shear));
  return packing;
}

const Load kLoads[] = {{"n64_jammed.xyz", 0.8344466513, 1e-2, 1e-6},
                       {"n64_jammed.xyz", 0.8344466513, 1e-4, 1e-6},
                       {"n64_jammed.xyz", 0.8344466513, 1e-6, 1e-6},
                       {"n64_jammed.xyz", 0.8344466513, 1e-8, 1e-6},
                       {"n64_3d_jammed.xyz", 0.6313497949, 1e-5, 1e-6}};

// Energies times 2^a, lengths times 2^b.
struct Units {
  int a = 0, b = 0;
};

// E = sum k delta^alpha / alpha grows by 2^a with k by 2^(a - alpha b).
ContactEnergyOptions InUnits(double alpha, const Units& units) {
  ContactEnergyOptions options;
  options.alpha = alpha;
  options.stiffness = std::exp2(units.a - alpha * units.b);
  return options;
}

struct Step {
  std::vector<double> x, gradient;
  double cost = 0.0;
  Scales scales;
  std::int64_t evaluations = 0;
};

struct Record {
  std::vector<Step> steps;
  Summary summary;
  std::vector<double> x;
};

Record Follow(const std::string& spec,
              const Packing& packing,
              const ContactEnergyOptions& energy_options,
              int iterations) {
  std::string error;
  const auto solver = CreateSolver(spec, &error);
  EXPECT_NE(solver, nullptr) << error;
  const auto energy = MakeEnergy(packing, energy_options);
  Record record;
  SolveOptions options;
  options.relative_tolerance = 1e-12;
  options.max_iterations = iterations;
  options.callback = [&](const IterationState& state) {
    const int n = state.num_parameters;
    record.steps.push_back(
        {std::vector<double>(state.x, state.x + n),
         std::vector<double>(state.gradient, state.gradient + n),
         state.cost,
         state.scales,
         state.counters.evaluations});
    return true;
  };
  record.x.assign(energy->NumParameters(), 0.0);
  record.summary = solver->Minimize(energy.get(), options, record.x.data());
  return record;
}

// v times a power of two is w, bit for bit.
testing::AssertionResult SameTimes(double factor,
                                   const std::vector<double>& v,
                                   const std::vector<double>& w) {
  if (v.size() != w.size()) return testing::AssertionFailure() << "sizes";
  for (std::size_t i = 0; i < v.size(); ++i) {
    if (!SameBits(factor * v[i], w[i])) {
      return testing::AssertionFailure()
             << "entry " << i << ": " << testing::PrintToString(factor * v[i])
             << " and " << testing::PrintToString(w[i]) << ", "
             << (w[i] - factor * v[i]) / (factor * v[i]) << " of it";
    }
  }
  return testing::AssertionSuccess();
}

void ExpectSameInOtherUnits(const std::string& spec,
                            const Load& load,
                            double alpha,
                            const std::vector<Units>& all_units) {
  constexpr int kIterations = 300;
  const Packing packing = Loaded(load);
  const Record plain =
      Follow(spec, packing, InUnits(alpha, {0, 0}), kIterations);
  ASSERT_GT(plain.steps.size(), 1u) << plain.summary.BriefReport();
  for (const Units& units : all_units) {
    SCOPED_TRACE("alpha = " + std::to_string(alpha) + ", energies 2^" +
                 std::to_string(units.a) + ", lengths 2^" +
                 std::to_string(units.b) +
                 ", dphi = " + std::to_string(load.dphi));
    const Record other = Follow(spec,
                                WithLengths(units.b, packing),
                                InUnits(alpha, units),
                                kIterations);
    const double energy = std::ldexp(1.0, units.a);
    const double length = std::ldexp(1.0, units.b);
    for (std::size_t k = 0;
         k < std::min(plain.steps.size(), other.steps.size());
         ++k) {
      const Step& p = plain.steps[k];
      const Step& q = other.steps[k];
      ASSERT_TRUE(SameTimes(length, p.x, q.x)) << "x of iteration " << k;
      ASSERT_TRUE(SameTimes(energy / length, p.gradient, q.gradient))
          << "gradient of iteration " << k;
      ASSERT_TRUE(SameBits(energy * p.cost, q.cost)) << k;
      ASSERT_TRUE(SameBits(length * p.scales.length, q.scales.length)) << k;
      ASSERT_EQ(p.evaluations, q.evaluations) << k;
    }
    ASSERT_EQ(plain.steps.size(), other.steps.size());
    EXPECT_EQ(plain.summary.reason, other.summary.reason);
    EXPECT_TRUE(SameTimes(length, plain.x, other.x)) << "x returned";
    EXPECT_EQ(plain.summary.counters.evaluations,
              other.summary.counters.evaluations);
    EXPECT_EQ(plain.summary.counters.recenters,
              other.summary.counters.recenters);
    EXPECT_EQ(plain.summary.counters.factorizations,
              other.summary.counters.factorizations);
  }
}

class InvarianceTest : public testing::TestWithParam<std::string> {};

INSTANTIATE_TEST_SUITE_P(Methods,
                         InvarianceTest,
                         testing::ValuesIn(InHouseSpecs(true)),
                         TestName);

TEST_P(InvarianceTest, HarmonicIsExactInAnyUnits) {
  for (const Load& load : kLoads) {
    ExpectSameInOtherUnits(
        GetParam(), load, 2.0, {{7, 3}, {-13, -5}, {7, -5}, {-13, 3}});
  }
}

// Options that change what is computed.
TEST(Invariance, OptionsAreExactInAnyUnits) {
  for (const char* spec :
       {"lbfgs:preconditioner=hessian,linear=pcg",
        "lbfgs:preconditioner=hessian,ordering=metis",
        "lbfgs:preconditioner=contact,ordering=rcm,every=1,scaling=paper",
        "lbfgs:preconditioner=laplacian,A=3,r_cut=3,refresh=0.001",
        "ncg:preconditioner=hessian,shift=0",
        "fire:delay=0,dt_max=3",
        "fire:preconditioner=hessian,dt_max=3",
        "heavy_ball:step=3",
        "newton:hessian=gauss_newton",
        "newton:step=shrink,unheld=kept,radius=1",
        "newton:subproblem=truncated,preconditioner=contact,every=1,shift=1e-6",
        "heavy_ball:preconditioner=contact,step=10"}) {
    SCOPED_TRACE(spec);
    std::string error;
    // A build may lack the package.
    if (CreateSolver(spec, &error) == nullptr) continue;
    for (const int load : {1, 3}) {
      ExpectSameInOtherUnits(spec, kLoads[load], 2.0, {{7, 3}, {-13, -5}});
      ExpectSameInOtherUnits(spec, kLoads[load], 2.5, {{7, 4}});
    }
  }
}

// Units far away: squares of energies must not leave the range of a double.
TEST_P(InvarianceTest, HarmonicIsExactInFarUnits) {
  ExpectSameInOtherUnits(GetParam(), kLoads[1], 2.0, {{151, 0}, {-90, 61}});
}

// k near 1e150 and 1e-150, where the square of a gradient is infinite or zero.
TEST(Invariance, NcgIsExactWhereSquaresOfGradientsAreNoNumbers) {
  for (const char* spec : {"ncg:beta=fr",
                           "ncg:beta=pr",
                           "ncg:beta=hs",
                           "ncg:beta=hz",
                           "ncg:beta=hz,preconditioner=contact"}) {
    SCOPED_TRACE(spec);
    ExpectSameInOtherUnits(spec, kLoads[1], 2.0, {{498, 0}, {-498, 0}});
  }
}

// delta^(5/2) by square roots: lengths times 4.
TEST_P(InvarianceTest, HertzIsExactInUnitsOfEvenPowers) {
  for (const Load& load : kLoads) {
    ExpectSameInOtherUnits(GetParam(), load, 2.5, {{7, 4}, {-13, -6}});
  }
}

// pow() is not exact, so this holds for a few iterations only, before rounding
// grows. One of Newton's is worth hundreds of others', and makes more of the
// rounding of a gradient where nothing holds an object.
TEST_P(InvarianceTest, AnyLawIsTheSameUpToRounding) {
  const double alpha = 3.3;
  const Units units = {-13, 5};
  const Packing packing = Loaded(kLoads[1]);
  const Record plain = Follow(GetParam(), packing, InUnits(alpha, {0, 0}), 6);
  const Record other = Follow(
      GetParam(), WithLengths(units.b, packing), InUnits(alpha, units), 6);
  ASSERT_EQ(plain.steps.size(), other.steps.size());
  ASSERT_EQ(plain.steps.size(), 7u);
  double size = 0.0;
  for (const Step& step : plain.steps) size = std::max(size, MaxAbs(step.x));
  const bool is_newton = TraitsOf(GetParam()).newton_on_packings;
  const double part = is_newton ? 1e-5 : 1e-12;
  for (std::size_t k = 0; k < (is_newton ? 3 : plain.steps.size()); ++k) {
    std::vector<double> back = other.steps[k].x;
    for (double& v : back) v = std::ldexp(v, -units.b);
    EXPECT_LE(MaxDifference(back, plain.steps[k].x), part * size) << k;
    EXPECT_NEAR(std::ldexp(other.steps[k].cost, -units.a),
                plain.steps[k].cost,
                part * plain.steps[0].cost);
  }
}

// ---- determinism ------------------------------------------------------------

TEST_P(InvarianceTest, TwoRunsAreBitwiseEqual) {
  const Packing packing = Loaded(kLoads[2]);
  const Record a = Follow(GetParam(), packing, InUnits(2.0, {0, 0}), 300);
  // Something else in between moves memory about.
  const std::vector<double> between(12345, 1.0);
  const Record b = Follow(GetParam(), packing, InUnits(2.0, {0, 0}), 300);
  EXPECT_TRUE(SameBits(a.x, b.x));
  EXPECT_EQ(a.summary.message, b.summary.message);
  EXPECT_EQ(a.summary.counters.evaluations, b.summary.counters.evaluations);
}

// What a child process of other surroundings prints.
TEST(Determinism, DISABLED_PrintBits) {
  Packing packing = ReadData("n1024_a2_p1e-04.xyz");
  packing.Perturb(1e-5, 5);
  for (const std::string& spec : InHouseSpecs(true)) {
    const Record run = Follow(spec, packing, InUnits(2.0, {0, 0}), 25);
    std::uint64_t hash = 14695981039346656037u;
    for (const double x : run.x) {
      std::uint64_t bits;
      std::memcpy(&bits, &x, sizeof(bits));
      hash = (hash ^ bits) * 1099511628211u;
    }
    std::printf("bits %s %016llx\n",
                spec.c_str(),
                static_cast<unsigned long long>(hash));
  }
}

std::string BitsOfAChild(const std::string& environment) {
  char path[4096];
  const ssize_t length = readlink("/proc/self/exe", path, sizeof(path) - 1);
  if (length <= 0) return "";
  const std::string command = environment + " '" + std::string(path, length) +
                              "' --gtest_also_run_disabled_tests "
                              "--gtest_filter=Determinism.DISABLED_PrintBits";
  std::FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return "";
  std::string bits;
  char line[512];
  while (std::fgets(line, sizeof(line), pipe) != nullptr) {
    if (std::strncmp(line, "bits ", 5) == 0) bits += line;
  }
  return pclose(pipe) == 0 ? bits : "";
}

TEST(Determinism, BitsDoNotDependOnTheNumberOfThreads) {
  const std::string one =
      BitsOfAChild("OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1");
  const std::string two =
      BitsOfAChild("OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2");
  EXPECT_NE(one, "");
  EXPECT_EQ(one, two);
}

}  // namespace
}  // namespace granopt
