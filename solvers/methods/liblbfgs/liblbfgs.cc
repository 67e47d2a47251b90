// L-BFGS of libLBFGS, the library that most programs embed.

#include <lbfgs.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <string>

#include "solvers/external_method.h"
#include "solvers/format.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

// 1.10 has no function that says it. Those that these options can lead to.
std::string Words(int status) {
  switch (status) {
    case LBFGS_SUCCESS:
      return "LBFGS_SUCCESS";
    case LBFGS_ALREADY_MINIMIZED:
      return "LBFGS_ALREADY_MINIMIZED";
    case LBFGSERR_OUTOFMEMORY:
      return "LBFGSERR_OUTOFMEMORY";
    case LBFGSERR_OUTOFINTERVAL:
      return "LBFGSERR_OUTOFINTERVAL";
    case LBFGSERR_INCORRECT_TMINMAX:
      return "LBFGSERR_INCORRECT_TMINMAX";
    case LBFGSERR_ROUNDING_ERROR:
      return "LBFGSERR_ROUNDING_ERROR";
    case LBFGSERR_MINIMUMSTEP:
      return "LBFGSERR_MINIMUMSTEP";
    case LBFGSERR_MAXIMUMSTEP:
      return "LBFGSERR_MAXIMUMSTEP";
    case LBFGSERR_MAXIMUMLINESEARCH:
      return "LBFGSERR_MAXIMUMLINESEARCH";
    case LBFGSERR_WIDTHTOOSMALL:
      return "LBFGSERR_WIDTHTOOSMALL";
    case LBFGSERR_INVALIDPARAMETERS:
      return "LBFGSERR_INVALIDPARAMETERS";
    case LBFGSERR_INCREASEGRADIENT:
      return "LBFGSERR_INCREASEGRADIENT";
    default:
      return Format("status %d", status);
  }
}

struct FreeVector {
  void operator()(double* v) const { lbfgs_free(v); }
};

class LibLbfgs : public ExternalMethod {
 public:
  explicit LibLbfgs(Parameters* parameters) : ExternalMethod(parameters) {
    constexpr int kLineSearch[] = {LBFGS_LINESEARCH_MORETHUENTE,
                                   LBFGS_LINESEARCH_BACKTRACKING_WOLFE,
                                   LBFGS_LINESEARCH_BACKTRACKING_STRONG_WOLFE};
    lbfgs_parameter_init(&library_options_);
    library_options_.m = parameters->Int(
        "memory", library_options_.m, 1, "number of stored (s, y) pairs");
    library_options_.linesearch = kLineSearch[parameters->Choice(
        "line_search",
        "more_thuente",
        "more_thuente|wolfe|strong_wolfe",
        "rule that accepts a step; the last two halve it or double it")];
    // Not Armijo's rule alone: nothing keeps s.y positive then, and it fails on
    // Rosenbrock's function.
    // Nothing but a gradient of zero is converged, and no step too short or too
    // long: a step is in units of x over those of the gradient.
    library_options_.epsilon = 0.0;
    library_options_.min_step = 0.0;
    library_options_.max_step = 1e300;
  }

 protected:
  const char* library() const override { return "libLBFGS"; }

  std::string Run(Problem* problem, double* y) const override {
    const int n = problem->n();
    // Padded and aligned as its vector instructions want it.
    const std::unique_ptr<double, FreeVector> x(lbfgs_malloc(n));
    if (x == nullptr) return Words(LBFGSERR_OUTOFMEMORY);
    std::copy(y, y + n, x.get());
    lbfgs_parameter_t options = library_options_;
    const int status =
        lbfgs(n, x.get(), nullptr, &Evaluate, &Progress, problem, &options);
    std::copy(x.get(), x.get() + n, y);
    return Words(status);
  }

 private:
  static double Evaluate(void* problem,
                         const double* x,
                         double* gradient,
                         int n,
                         double /*step*/) {
    double cost;
    if (static_cast<Problem*>(problem)->Evaluate(x, &cost, gradient)) {
      return cost;
    }
    // No rule but accepts this; Progress() then ends the run.
    std::fill(gradient, gradient + n, 0.0);
    return -std::numeric_limits<double>::infinity();
  }

  // Called at each accepted iterate; anything but 0 ends the run.
  static int Progress(void* problem,
                      const double* x,
                      const double* /*gradient*/,
                      double /*cost*/,
                      double /*x_norm*/,
                      double /*gradient_norm*/,
                      double /*step*/,
                      int /*n*/,
                      int /*iteration*/,
                      int /*evaluations*/) {
    return static_cast<Problem*>(problem)->Accept(x) ? 0 : 1;
  }

  lbfgs_parameter_t library_options_;
};

}  // namespace

REGISTER_SOLVER(
    liblbfgs,
    LibLbfgs,
    "libLBFGS' limited-memory BFGS",
    "Nocedal, Math. Comp. 35 (1980) 773; More, Thuente, ACM Trans. Math. "
    "Softw. 20 (1994) 286; Okazaki, libLBFGS 1.10");

}  // namespace granopt
