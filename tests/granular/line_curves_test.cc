// Energies along lines that a method searched: what tests/data/line_search
// holds, and how it was made.

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/line_search.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// A step of lbfgs: where it began, and its whole length.
struct Line {
  std::vector<double> x, d;
};

// The first step that begins with max|g| <= residual mean forces, at the
// earliest the one after `iteration` iterations.
Line FindLine(const Packing& packing, int iteration, double residual) {
  const auto energy = MakeEnergy(packing, 2.0);
  std::string error;
  const auto solver = CreateSolver("lbfgs", &error);
  Line line;
  SolveOptions options;
  options.relative_tolerance = 1e-14;
  options.max_iterations = 20000;
  options.callback = [&](const IterationState& state) {
    const std::vector<double> x(state.x, state.x + state.num_parameters);
    if (!line.x.empty()) {
      line.d = x;
      for (std::size_t i = 0; i < x.size(); ++i) line.d[i] -= line.x[i];
      return false;
    }
    if (state.counters.iterations >= iteration &&
        state.max_gradient <= residual * state.scales.gradient) {
      line.x = x;
    }
    return true;
  };
  std::vector<double> x(energy->NumParameters(), 0.0);
  solver->Minimize(energy.get(), options, x.data());
  return line;
}

// The energy from its reference, or of positions rounded to one double each,
// which is what a program without a reference sees.
LinePoint At(const Packing& packing,
             const Line& line,
             double step,
             bool rounded) {
  std::vector<double> x(line.x);
  for (std::size_t i = 0; i < x.size(); ++i) x[i] += step * line.d[i];
  auto energy = MakeEnergy(packing, 2.0);
  Evaluation at;
  if (rounded) {
    Packing there = energy->Configuration(x.data());
    there.positions_low.resize(0, 0);
    at = Evaluate(*MakeEnergy(there, 2.0));
  } else {
    Evaluate(*energy, x);  // Recenter() wants the overlap of an evaluation
    energy->Recenter(line.x.data());
    at = Evaluate(*energy, x);
  }
  double slope = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i)
    slope += at.gradient[i] * line.d[i];
  return {step, at.energy, slope};
}

void Record(const Packing& packing, const Line& line, const char* name) {
  for (const bool rounded : {false, true}) {
    const std::string path = std::string(GRANOPT_TEST_DATA "/line_search/") +
                             name + (rounded ? "_rounded" : "_reference") +
                             ".csv";
    std::FILE* file = std::fopen(path.c_str(), "w");
    ASSERT_NE(file, nullptr);
    std::fprintf(file, "step,value,slope\n");
    const auto write = [&](double step) {
      const LinePoint p = At(packing, line, step, rounded);
      std::fprintf(file, "%.17g,%.17g,%.17g\n", p.step, p.value, p.slope);
    };
    write(0.0);
    for (int k = -24; k < -4; ++k) write(std::exp2(k));
    for (int k = 2; k <= 96; ++k) write(k / 32.0);
    for (int k = 2; k <= 14; ++k) write(std::exp2(k));
    std::fclose(file);
  }
}

// Along a live line, in both forms.
TEST(LineCurves, AreSearchedFromAnyFirstStep) {
  Packing near = ReadData("n1024_a2_p1e-08.xyz");
  near.Perturb(1e-9, 1);
  const Line line = FindLine(near, 5, 1.0);
  for (const bool rounded : {false, true}) {
    const LinePoint start = At(near, line, 0.0, rounded);
    ASSERT_LT(start.slope, 0.0);
    for (const double first : {1e-4, 1.0, 1e3}) {
      const LineSearchResult found = SearchLine(
          [&](double step, LinePoint* p) {
            *p = At(near, line, step, rounded);
            return LineEvaluation::OK;
          },
          start,
          first,
          {});
      EXPECT_EQ(found.end, LineSearchEnd::WOLFE) << first;
    }
  }
}

TEST(LineCurves, DISABLED_Record) {
  Packing near = ReadData("n1024_a2_p1e-08.xyz");
  near.Perturb(1e-9, 1);
  Record(near, FindLine(near, 10, 1.0), "n1024_p1e-08");
  Record(near, FindLine(near, 10, 3e-6), "n1024_p1e-08_late");
  Packing sheared = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  sheared.Deform(SimpleShear(2, 1e-3));
  Record(sheared, FindLine(sheared, 100, 1.0), "n256_sheared");
}

}  // namespace
}  // namespace granopt
