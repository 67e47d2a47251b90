// Minimizes a function of one's own with a method by name; links
// granopt::solvers only.

#include <cstdio>
#include <memory>
#include <string>

#include "solvers/first_order.h"
#include "solvers/registry.h"
#include "solvers/solver.h"

namespace {

// 100 (x_2 - x_1^2)^2 + (1 - x_1)^2.
class Rosenbrock : public granopt::FirstOrderFunction {
 public:
  int NumParameters() const override { return 2; }

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          granopt::Scales* scales) const override {
    const double a = x[1] - x[0] * x[0];
    const double b = 1.0 - x[0];
    *cost = 100.0 * a * a + b * b;
    if (gradient != nullptr) {
      gradient[0] = -400.0 * x[0] * a - 2.0 * b;
      gradient[1] = 200.0 * a;
    }
    if (scales != nullptr) {
      // Tolerances are relative to this.
      scales->gradient = 200.0;
      scales->length = 1.0;
    }
    return true;
  }
};

}  // namespace

int main() {
  std::string error;
  const std::unique_ptr<granopt::Solver> solver =
      granopt::CreateSolver("ceres_lbfgs:memory=10", &error);
  if (solver == nullptr) {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 2;
  }
  Rosenbrock rosenbrock;
  granopt::SolveOptions options;
  options.relative_tolerance = 1e-10;
  double x[2] = {-1.2, 1.0};
  const granopt::Summary summary = solver->Minimize(&rosenbrock, options, x);
  std::printf("%s: %s\n",
              granopt::StopReasonName(summary.reason),
              summary.message.c_str());
  std::printf("x = %.6f %.6f\n", x[0], x[1]);
  return summary.Succeeded() ? 0 : 1;
}
