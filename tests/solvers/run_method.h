// What tests of methods share: a run by name, and what must be true of it.

#ifndef GRANOPT_TESTS_SOLVERS_RUN_METHOD_H_
#define GRANOPT_TESTS_SOLVERS_RUN_METHOD_H_

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "solvers/solver.h"

namespace granopt {

inline void PrintTo(StopReason reason, std::ostream* out) {
  *out << StopReasonName(reason);
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

inline bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

inline bool SameBits(double a, double b) {
  return std::memcmp(&a, &b, sizeof(double)) == 0;
}

inline bool SameBits(const std::vector<double>& a,
                     const std::vector<double>& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * a.size()) == 0;
}

inline double CostAt(const FirstOrderFunction& f,
                     const std::vector<double>& x) {
  double cost;
  EXPECT_TRUE(f.Evaluate(x.data(), &cost, nullptr));
  return cost;
}

inline double MaxGradientAt(const FirstOrderFunction& f,
                            const std::vector<double>& x) {
  double cost, result = 0.0;
  std::vector<double> gradient(x.size());
  EXPECT_TRUE(f.Evaluate(x.data(), &cost, gradient.data()));
  for (const double g : gradient) result = std::max(result, std::abs(g));
  return result;
}

struct Result {
  Summary summary;
  std::vector<double> x;
};

inline Result Minimize(const std::string& spec,
                       FirstOrderFunction* function,
                       std::vector<double> x,
                       const SolveOptions& options = {}) {
  std::string error;
  const std::unique_ptr<Solver> solver = CreateSolver(spec, &error);
  if (solver == nullptr) {
    ADD_FAILURE() << error;
    return {};
  }
  Result run;
  run.summary = solver->Minimize(function, options, x.data());
  run.x = std::move(x);
  EXPECT_EQ(run.summary.solver, spec);
  EXPECT_EQ(run.summary.message.find('\n'), std::string::npos);
  return run;
}

inline SolveOptions Tolerance(double relative) {
  SolveOptions options;
  options.relative_tolerance = relative;
  // No method needs that many; a run that hangs must end.
  options.max_iterations = 20000;
  return options;
}

// The name of a test over specs.
inline std::string TestName(const testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  for (char& c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  }
  return name;
}

// Methods of optional packages need not be there.
inline bool IsRegistered(const std::string& spec) {
  const std::string name = spec.substr(0, spec.find(':'));
  for (const SolverInfo& info : ListSolvers()) {
    if (info.name == name) return true;
  }
  return false;
}

inline const std::vector<double> kRosenbrockStart = {-1.2, 1.0};

// What the summary says is true of the point that was returned.
inline void ExpectHonest(const FirstOrderFunction& f, const Result& run) {
  EXPECT_TRUE(SameBits(run.summary.cost, CostAt(f, run.x)));
  EXPECT_TRUE(SameBits(run.summary.max_gradient, MaxGradientAt(f, run.x)));
  const bool success = run.summary.max_gradient <= run.summary.tolerance ||
                       run.summary.reason == StopReason::VANISHED;
  EXPECT_EQ(run.summary.Succeeded(), success) << run.summary.BriefReport();
}

// "... |g| = 3.1e-09 > 1.0e-10 after 500 iterations ...": the first number
// exceeds the second, which is the tolerance, and the count is right.
inline void ExpectBothNumbers(const Summary& summary,
                              const char* what,
                              std::int64_t count) {
  const std::size_t at = summary.message.find("|g| = ");
  ASSERT_NE(at, std::string::npos) << summary.message;
  double left = 0.0, right = 0.0;
  long long number = -1;
  char noun[16] = "";
  ASSERT_EQ(std::sscanf(summary.message.c_str() + at,
                        "|g| = %lg > %lg after %lld %15[a-z]",
                        &left,
                        &right,
                        &number,
                        noun),
            4)
      << summary.message;
  EXPECT_GT(left, right);
  EXPECT_NEAR(right, summary.tolerance, 0.01 * summary.tolerance);
  EXPECT_EQ(number, count);
  EXPECT_STREQ(noun, what);
}

}  // namespace granopt

#endif  // GRANOPT_TESTS_SOLVERS_RUN_METHOD_H_
