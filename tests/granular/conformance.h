// What the tests of every registered method share.

#ifndef GRANOPT_TESTS_GRANULAR_CONFORMANCE_H_
#define GRANOPT_TESTS_GRANULAR_CONFORMANCE_H_

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/method_table.h"
#include "tests/granular/test_packings.h"
#include "tests/solvers/run_method.h"

namespace granopt {

inline bool Supports(const std::string& spec, const FirstOrderFunction& f) {
  std::string error;
  const auto solver = CreateSolver(spec, &error);
  EXPECT_NE(solver, nullptr) << error;
  return solver != nullptr && solver->Supports(f, &error);
}

// What must be true of any run of any method on any function that it serves.
// Costs may change in their last digits when the reference moves.
inline void ExpectSound(const FirstOrderFunction& f,
                        const std::vector<double>& start,
                        const Result& run) {
  const Summary& s = run.summary;
  for (const double x : run.x) ASSERT_TRUE(std::isfinite(x));
  EXPECT_FALSE(s.message.empty());
  EXPECT_EQ(s.message.find("nan >"), std::string::npos) << s.message;
  if (s.reason == StopReason::EVALUATION_FAILED &&
      s.counters.evaluations <= 1) {
    EXPECT_TRUE(SameBits(run.x, start));
    return;
  }
  EXPECT_LE(s.cost, s.initial_cost + 1e-10 * std::abs(s.initial_cost));
  EXPECT_TRUE(std::isfinite(s.cost));
  EXPECT_TRUE(std::isfinite(s.max_gradient));
  if (s.reason == StopReason::CONVERGED) {
    EXPECT_LE(s.max_gradient, s.tolerance) << s.BriefReport();
  } else if (s.reason != StopReason::VANISHED) {
    EXPECT_GT(s.max_gradient, s.tolerance) << s.BriefReport();
  }
  // Both sides of the test that failed.
  const bool numbers = s.reason == StopReason::CONVERGED ||
                       s.reason == StopReason::MAX_ITERATIONS ||
                       s.reason == StopReason::MAX_EVALUATIONS ||
                       s.reason == StopReason::MAX_SECONDS ||
                       s.reason == StopReason::CALLBACK ||
                       s.reason == StopReason::NO_PROGRESS;
  double left = -1.0, right = -1.0;
  char relation[3] = "";
  const std::size_t at = s.message.find("|g| = ");
  if (numbers) {
    ASSERT_NE(at, std::string::npos) << s.message;
    ASSERT_EQ(std::sscanf(s.message.c_str() + at,
                          "|g| = %lg %2[<=>] %lg",
                          &left,
                          relation,
                          &right),
              3)
        << s.message;
    if (s.reason == StopReason::CONVERGED) {
      EXPECT_LE(left, right);
    } else {
      EXPECT_GT(left, right) << s.message;
    }
  }
  // The point is what the summary says.
  double cost;
  std::vector<double> g(run.x.size());
  Scales scales;
  ASSERT_TRUE(f.EvaluateWithScales(run.x.data(), &cost, g.data(), &scales));
  EXPECT_NEAR(cost, s.cost, 1e-10 * std::abs(cost));
  const double slack = 1e-10 * s.max_gradient + 1e-13 * scales.gradient;
  EXPECT_NEAR(MaxAbs(g), s.max_gradient, slack);
}

class Conformance : public testing::TestWithParam<std::string> {
 protected:
  const std::string& spec() const { return GetParam(); }
  MethodTraits traits() const { return TraitsOf(spec()); }

  // Fletcher & Reeves' rule creeps after one short step, as is well known
  // (Nocedal, Wright, 2nd ed., p. 127); only a preconditioner near the Hessian
  // helps.
  bool Creeps() const {
    return Contains(spec(), "ncg:") && Contains(spec(), "beta=fr") &&
           (Contains(spec(), "=none") || Contains(spec(), "=laplacian"));
  }
};

}  // namespace granopt

#endif  // GRANOPT_TESTS_GRANULAR_CONFORMANCE_H_
