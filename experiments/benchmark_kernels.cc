// benchmark_kernels: energy and gradient of a relaxed packing against a plain
// scalar loop over the same pairs, and what else a method waits for: neighbour
// list, reference configuration, Hessian, its analysis, factor and solve, in
// one interleaved run.
//
//   benchmark_kernels [PACKING.xyz] --benchmark_enable_random_interleaving=true
//                     --benchmark_repetitions=9
//
// Counter: nanoseconds per grain. For instruction counts, which do not depend
// on what else the machine does, start from a file (written by `relax
// --particles=4096`):
//
//   valgrind --tool=callgrind --toggle-collect='*TimedContactEnergy*'
//            benchmark_kernels PACKING.xyz --benchmark_filter=ContactEnergy/1
//
// The packing: discs in a square cell; without a file 4096 (1:1, ratio 1.4) at
// phi = 0.8438, relaxed from a random start. Arguments count its periodic
// copies, 1, 4, 16 and 64, and threads.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Core"
#include "Eigen/SparseCholesky"
#include "benchmark/benchmark.h"
#include "granular/contact_energy.h"
#include "granular/flow/flow.h"
#include "granular/flow/start.h"
#include "granular/neighbor_list.h"
#include "granular/packing_generator.h"
#include "granular/packing_io.h"
#include "granular/relaxation.h"
#include "solvers/multifrontal_cholesky.h"
#include "solvers/registry.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

// Of the smallest radius, as ContactEnergy's own.
constexpr double kSkin = 0.05;

Packing RelaxedPacking() {
  GeneratorOptions options;
  options.particles = 4096;
  options.packing_fraction = 0.8438;
  Packing packing;
  std::string error;
  Relaxation relaxation;
  SolveOptions solve;
  solve.relative_tolerance = 1e-6;
  const std::unique_ptr<Solver> solver =
      CreateSolver("ceres_lbfgs:scaled=1,differences=1", &error);
  if (!GeneratePacking(options, &packing, &error) ||
      !Relax(packing, {}, *solver, solve, &relaxation, &error)) {
    std::fprintf(stderr, "benchmark_kernels: %s\n", error.c_str());
    std::exit(2);
  }
  return relaxation.packing;
}

// What one writes first: plain coordinates, nearest image of a square cell, the
// force scattered to both grains.
class PlainLoop {
 public:
  explicit PlainLoop(const Packing& packing)
      : length_(packing.box.edges()(0, 0)),
        radii_(packing.radii.data(), packing.radii.data() + packing.size()) {
    std::string error;
    BuildNeighborList(packing.box,
                      packing.positions,
                      packing.radii,
                      kSkin * packing.radii.minCoeff(),
                      &list_,
                      &error);
  }

  double operator()(const double* x, double* gradient) const {
    const int n = static_cast<int>(radii_.size());
    std::fill(gradient, gradient + 2 * n, 0.0);
    double energy = 0.0;
    for (int i = 0; i < n; ++i) {
      for (int p = list_.row_start[i]; p < list_.row_start[i + 1]; ++p) {
        const int j = list_.j[p];
        double dx = x[2 * i] - x[2 * j];
        double dy = x[2 * i + 1] - x[2 * j + 1];
        if (dx > 0.5 * length_) dx -= length_;
        if (dx < -0.5 * length_) dx += length_;
        if (dy > 0.5 * length_) dy -= length_;
        if (dy < -0.5 * length_) dy += length_;
        const double sum = radii_[i] + radii_[j];
        const double d2 = dx * dx + dy * dy;
        if (d2 >= sum * sum) continue;
        const double d = std::sqrt(d2);
        const double delta = sum - d;
        energy += 0.5 * delta * delta;
        const double f = delta / d;
        gradient[2 * i] -= f * dx;
        gradient[2 * i + 1] -= f * dy;
        gradient[2 * j] += f * dx;
        gradient[2 * j + 1] += f * dy;
      }
    }
    return energy;
  }

 private:
  const double length_;
  const std::vector<double> radii_;
  NeighborList list_;
};

std::string* InputFile() {
  static std::string file;
  return &file;
}

const Packing& PackingOf(int copies) {
  static std::map<int, Packing> packings;
  if (packings.empty()) {
    Packing& packing = packings[1];
    std::string error;
    if (InputFile()->empty()) {
      packing = RelaxedPacking();
    } else if (!ReadPacking(*InputFile(), &packing, &error)) {
      std::fprintf(stderr, "benchmark_kernels: %s\n", error.c_str());
      std::exit(2);
    }
    const SmallMatrix& edges = packing.box.edges();
    if (packing.dimension() != 2 ||
        edges != edges(0, 0) * SmallMatrix::Identity(2, 2)) {
      std::fprintf(stderr,
                   "benchmark_kernels: %s: the cell must be a square\n",
                   InputFile()->c_str());
      std::exit(2);
    }
  }
  const auto found = packings.find(copies);
  if (found != packings.end()) return found->second;
  return packings[copies] = packings[1].Copies(
             static_cast<int>(std::lround(std::sqrt(copies))));
}

__attribute__((noinline)) double TimedContactEnergy(const ContactEnergy& energy,
                                                    const double* u,
                                                    double* gradient) {
  double value;
  energy.EvaluateWithScales(u, &value, gradient, nullptr);
  return value;
}

__attribute__((noinline)) double TimedPlainLoop(const PlainLoop& loop,
                                                const double* x,
                                                double* gradient) {
  return loop(x, gradient);
}

void PerGrain(benchmark::State& state, const Packing& packing) {
  state.counters["grains"] = packing.size();
  state.counters["ns/grain"] =
      benchmark::Counter(1e-9 * packing.size(),
                         benchmark::Counter::kIsIterationInvariantRate |
                             benchmark::Counter::kInvert);
}

void TimeEnergy(benchmark::State& state,
                const Packing& packing,
                const ContactEnergyOptions& law) {
  std::string error;
  const auto energy = ContactEnergy::Create(packing, law, &error);
  std::vector<double> u(energy->NumParameters(), 0.0);
  std::vector<double> gradient(u.size());
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        TimedContactEnergy(*energy, u.data(), gradient.data()));
  }
  PerGrain(state, packing);
}

void BM_ContactEnergy(benchmark::State& state) {
  TimeEnergy(state, PackingOf(static_cast<int>(state.range(0))), {});
}

// Double or single precision (the last argument) of a random packing.
void BM_Precision(benchmark::State& state) {
  GeneratorOptions generator;
  generator.dimension = static_cast<int>(state.range(0));
  generator.packing_fraction = generator.dimension == 2 ? 0.88 : 0.7;
  generator.particles = static_cast<int>(state.range(2));
  ContactEnergyOptions law;
  law.alpha = 0.1 * static_cast<double>(state.range(1));
  law.precision = state.range(3) == 0 ? Precision::DOUBLE : Precision::FLOAT;
  std::string error;
  Packing packing;
  GeneratePacking(generator, &packing, &error);
  TimeEnergy(state, packing, law);
}

void BM_PlainLoop(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  const PlainLoop loop(packing);
  std::vector<double> gradient(2 * packing.size());
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        TimedPlainLoop(loop, packing.positions.data(), gradient.data()));
  }
  PerGrain(state, packing);
}

void BM_NeighborList(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  NeighborList list;
  std::string error;
  for (auto _ : state) {
    BuildNeighborList(packing.box,
                      packing.positions,
                      packing.radii,
                      kSkin * packing.radii.minCoeff(),
                      &list,
                      &error);
    benchmark::DoNotOptimize(list.j.data());
  }
  PerGrain(state, packing);
}

// The reference configuration made anew, in twice the digits.
void BM_Rebase(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  std::string error;
  const auto energy = ContactEnergy::Create(packing, {}, &error);
  std::vector<double> u(energy->NumParameters(), 0.0);
  for (auto _ : state) energy->Rebase(u.data());
  PerGrain(state, packing);
}

// A packing's Hessian and what is made of it.
struct Stiff {
  explicit Stiff(const Packing& packing) {
    std::string error;
    energy = ContactEnergy::Create(packing, {}, &error);
    x.assign(energy->NumParameters(), 0.0);
    energy->EvaluateHessian(x.data(), &hessian);
  }

  std::unique_ptr<ContactEnergy> energy;
  std::vector<double> x;
  SparseMatrix hessian;
};
constexpr double kShift = 1e-3;  // rattlers have no stiffness

void BM_Hessian(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  Stiff stiff(packing);
  for (auto _ : state) {
    stiff.energy->EvaluateHessian(stiff.x.data(), &stiff.hessian);
    benchmark::DoNotOptimize(stiff.hessian.valuePtr());
  }
  PerGrain(state, packing);
}

void BM_Analyze(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  const Stiff stiff(packing);
  for (auto _ : state) {
    MultifrontalCholesky factor;
    benchmark::DoNotOptimize(factor.Analyze(stiff.hessian));
  }
  PerGrain(state, packing);
}

void BM_Factorize(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  const Stiff stiff(packing);
  MultifrontalCholesky factor;
  factor.Analyze(stiff.hessian);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        factor.Factorize(stiff.hessian.valuePtr(), kShift));
  }
  PerGrain(state, packing);
}

// A Hessian that is not positive definite, that of a random start as large as
// the packing: Eigen's LDL^T, whose pivots may be negative, with no more of a
// shift than rattlers need, or our factor (the last argument) with a shift that
// makes it definite.
void BM_IndefiniteFactor(benchmark::State& state) {
  GeneratorOptions options;
  options.particles = PackingOf(static_cast<int>(state.range(0))).size();
  options.packing_fraction = 0.8438;
  Packing packing;
  std::string error;
  GeneratePacking(options, &packing, &error);
  const Stiff stiff(packing);
  bool is_done = true;
  if (state.range(1) == 0) {
    Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower> factor;
    factor.setShift(kShift);
    factor.analyzePattern(stiff.hessian);
    for (auto _ : state) {
      factor.factorize(stiff.hessian);
      is_done = is_done && factor.info() == Eigen::Success;
    }
    state.counters["negative"] =
        static_cast<double>((factor.vectorD().array() < 0.0).count());
  } else {
    MultifrontalCholesky factor;
    factor.Analyze(stiff.hessian);
    const double shift = 2.0 * stiff.hessian.norm();
    for (auto _ : state) {
      is_done = is_done && factor.Factorize(stiff.hessian.valuePtr(), shift);
    }
  }
  if (!is_done) state.SkipWithError("a pivot vanishes");
  PerGrain(state, packing);
}

void BM_Solve(benchmark::State& state) {
  const Packing& packing = PackingOf(static_cast<int>(state.range(0)));
  Stiff stiff(packing);
  MultifrontalCholesky factor;
  factor.Analyze(stiff.hessian);
  factor.Factorize(stiff.hessian.valuePtr(), kShift);
  const std::vector<double> b(stiff.x.size(), 1.0);
  for (auto _ : state) {
    factor.Solve(b.data(), stiff.x.data());
    benchmark::DoNotOptimize(stiff.x.data());
  }
  PerGrain(state, packing);
}

// An iteration of a method, evaluation included, on a packing that is displaced
// by a tenth of its mean overlap and far from converged; the second argument is
// the number of threads.
void BM_Iteration(benchmark::State& state, const char* method) {
  Packing packing = PackingOf(static_cast<int>(state.range(0)));
  packing.Perturb(1e-4 * packing.MeanRadius(), 1);
  std::string error;
  const auto energy = ContactEnergy::Create(packing, {}, &error);
  const auto solver = CreateSolver(method, &error);
  SolveOptions options;
  options.relative_tolerance = 1e-14;
  options.max_evaluations = 50;
  SetNumThreads(static_cast<int>(state.range(1)));
  std::int64_t evaluations = 0;
  for (auto _ : state) {
    std::vector<double> u(energy->NumParameters(), 0.0);
    evaluations +=
        solver->Minimize(energy.get(), options, u.data()).counters.evaluations;
  }
  SetNumThreads(1);
  state.counters["grains"] = packing.size();
  state.counters["ns/grain"] = benchmark::Counter(
      1e-9 * packing.size() * static_cast<double>(evaluations),
      benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

// By so many threads: the second argument.
void BM_Threads(benchmark::State& state, void (*benchmark)(benchmark::State&)) {
  SetNumThreads(static_cast<int>(state.range(1)));
  benchmark(state);
  SetNumThreads(1);
}

// What memory gives: a = b + c of so many doubles each, two read and one
// written.
void BM_Memory(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  Eigen::VectorXd a = Eigen::VectorXd::Zero(n), b = a, c = a;
  for (auto _ : state) {
    a = b + c;
    benchmark::DoNotOptimize(a.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * 3 * 8 * n);
}

// A random flow's near field, exponents 1 and 2 (0), real ones (1), Morse (2);
// time of an ordered pair.
void BM_NearField(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  FlowStart start;
  start.particles = n;
  Grains grains;
  FlowState flow;
  std::string error;
  if (!MakeStart(start, &grains, &flow, &error)) std::exit(2);
  std::vector<double> weights(FlowStride(n), 0.0), force(3 * FlowStride(n));
  for (int i = 0; i < n; ++i) weights[i] = grains.mass[i];
  NearFieldOptions options;
  options.tree_from = 0;
  options.law = state.range(1) == 0 ? RadialLaw::Powers(0.25, 1.0, 0.125, 2.0)
                : state.range(1) == 1
                    ? RadialLaw::Powers(0.36, 0.67, 0.26, 1.59)
                    : RadialLaw::Morse(1.0, 4.0, 0.3);
  const auto field = NearField::Create(options, n, weights, 0.0, &error);
  for (auto _ : state) {
    field->Forces(flow.x.data(), force.data(), nullptr);
    benchmark::DoNotOptimize(force.data());
  }
  state.counters["pair"] = benchmark::Counter(
      n * (n - 1.0) * state.iterations(),
      benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

// Overlapping grains of a random flow, by the grid.
void BM_FlowContacts(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  FlowStart start;
  start.particles = n;
  start.attempts = 0;
  Grains grains;
  FlowState flow;
  std::string error;
  if (!MakeStart(start, &grains, &flow, &error)) std::exit(2);
  ContactSearch search;
  std::vector<ClosePair> pairs;
  for (auto _ : state) {
    search.Find(
        n, FlowStride(n), flow.x.data(), grains.radius.data(), 0.0, &pairs);
    benchmark::DoNotOptimize(pairs.data());
  }
}

BENCHMARK(BM_NearField)
    ->ArgNames({"grains", "law"})
    ->ArgsProduct({{100, 1000, 10000}, {0, 1, 2}});
BENCHMARK(BM_FlowContacts)->Arg(1000)->Arg(10000)->Arg(100000);
BENCHMARK(BM_ContactEnergy)->Arg(1)->Arg(64);
BENCHMARK_CAPTURE(BM_Iteration, fire, "fire")
    ->ArgsProduct({{1, 4, 64}, {1, 2}})
    ->UseRealTime();
BENCHMARK_CAPTURE(BM_Iteration, lbfgs, "lbfgs")
    ->ArgsProduct({{1, 4, 64}, {1, 2}})
    ->UseRealTime();
BENCHMARK_CAPTURE(BM_Threads, energy, BM_ContactEnergy)
    ->ArgsProduct({{4, 64}, {1, 2}})
    ->UseRealTime();
BENCHMARK_CAPTURE(BM_Threads, list, BM_NeighborList)
    ->ArgsProduct({{4, 64}, {1, 2}})
    ->UseRealTime();
BENCHMARK_CAPTURE(BM_Threads, rebase, BM_Rebase)
    ->ArgsProduct({{4, 64}, {1, 2}})
    ->UseRealTime();
BENCHMARK(BM_Memory)->Arg(1 << 11)->Arg(1 << 15)->Arg(1 << 19)->Arg(1 << 23);
BENCHMARK(BM_Precision)
    ->ArgNames({"d", "10alpha", "grains", "float"})
    ->ArgsProduct({{2, 3}, {20, 25}, {1024, 4096, 262144}, {0, 1}});
BENCHMARK(BM_PlainLoop)->Arg(1)->Arg(64);
BENCHMARK(BM_NeighborList)->Arg(1)->Arg(64);
BENCHMARK(BM_Rebase)->Arg(1)->Arg(64);
BENCHMARK(BM_Hessian)->Arg(1)->Arg(64);
BENCHMARK(BM_Analyze)->Arg(1)->Arg(16);
BENCHMARK(BM_Factorize)->Arg(1)->Arg(16);
BENCHMARK(BM_IndefiniteFactor)->Args({1, 0})->Args({1, 1});
BENCHMARK(BM_Solve)->Arg(1)->Arg(16);

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc > 2 || (argc == 2 && argv[1][0] == '-')) {
    std::fprintf(
        stderr, "usage: %s [PACKING.xyz] [--benchmark_...]\n", argv[0]);
    return 2;
  }
  if (argc == 2) *granopt::InputFile() = argv[1];
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
