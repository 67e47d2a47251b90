// L-BFGS of NLopt (LD_LBFGS, a translation of Luksan's PLIS).

#include <nlopt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "solvers/external_method.h"
#include "solvers/format.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

// NLopt tells nobody of its iterates. But it accepts no point except the last
// of a line search, so an evaluation off the line along which it has been
// searching means that the point before has been accepted; unless it lies down
// the gradient from the last iterate, where NLopt goes when a search failed.
class Follower {
 public:
  Follower(ExternalMethod::Problem* problem, nlopt_opt optimizer)
      : problem_(problem), optimizer_(optimizer) {}

  // An nlopt_func.
  static double Evaluate(unsigned /*n*/,
                         const double* y,
                         double* gradient,
                         void* follower) {
    return static_cast<Follower*>(follower)->Evaluate(y, gradient);
  }

 private:
  double Evaluate(const double* y, double* gradient) {
    const int n = problem_->n();
    double cost;
    if (HasAcceptedTrial(y)) {
      if (!problem_->Accept(trial_.data())) return End(gradient);
      iterate_.swap(trial_);
      iterate_gradient_.swap(trial_gradient_);
      iterate_cost_ = trial_cost_;
    }
    if (!problem_->Evaluate(y, &cost, gradient)) return End(gradient);
    if (iterate_.empty()) {
      iterate_.assign(y, y + n);
      iterate_gradient_.assign(gradient, gradient + n);
      iterate_cost_ = cost;
    } else {
      trial_.assign(y, y + n);
      trial_gradient_.assign(gradient, gradient + n);
      trial_cost_ = cost;
    }
    return cost;
  }

  // True if NLopt has made trial_ its iterate, given that it now asks for y.
  bool HasAcceptedTrial(const double* y) const {
    const int n = problem_->n();
    if (trial_.empty()) return false;
    // There is only one line. What lowers the cost is called an iterate.
    if (n == 1) return trial_cost_ < iterate_cost_;
    std::vector<double> direction(n);
    for (int i = 0; i < n; ++i) direction[i] = trial_[i] - iterate_[i];
    if (IsOnRay(direction, trial_, y)) return false;
    for (int i = 0; i < n; ++i) direction[i] = -iterate_gradient_[i];
    return !IsOnRay(direction, direction, y);
  }

  // True if y is on the ray from iterate_, up to roundoff; that of direction[i]
  // is about eps (|iterate_[i]| + |size[i]|).
  bool IsOnRay(const std::vector<double>& direction,
               const std::vector<double>& size,
               const double* y) const {
    constexpr double kRoundoff = 64 * std::numeric_limits<double>::epsilon();
    const int n = problem_->n();
    double along = 0.0, square = 0.0;
    for (int i = 0; i < n; ++i) {
      along += direction[i] * (y[i] - iterate_[i]);
      square += direction[i] * direction[i];
    }
    if (square == 0.0) return true;
    const double step = along / square;
    if (!(step > 0.0)) return false;
    for (int i = 0; i < n; ++i) {
      const double off = (y[i] - iterate_[i]) - step * direction[i];
      const double x = std::abs(iterate_[i]);
      if (!(std::abs(off) <= kRoundoff * (std::abs(y[i]) + x +
                                          step * (x + std::abs(size[i]))))) {
        return false;
      }
    }
    return true;
  }

  // Makes NLopt return: it accepts this point, whatever its line search wants,
  // and then asks whether it has been stopped.
  double End(double* gradient) {
    nlopt_force_stop(optimizer_);
    std::fill(gradient, gradient + problem_->n(), 0.0);
    return -std::numeric_limits<double>::infinity();
  }

  ExternalMethod::Problem* problem_;
  nlopt_opt optimizer_;
  std::vector<double> iterate_, iterate_gradient_;  // the last accepted
  std::vector<double> trial_, trial_gradient_;      // the last evaluated
  double iterate_cost_ = 0.0, trial_cost_ = 0.0;
};

struct Destroy {
  void operator()(nlopt_opt_s* optimizer) const { nlopt_destroy(optimizer); }
};

class NloptLbfgs : public ExternalMethod {
 public:
  explicit NloptLbfgs(Parameters* parameters)
      : ExternalMethod(parameters),
        memory_(parameters->Int(
            "memory", 10, 1, "number of stored (s, y) pairs")) {}

 protected:
  const char* library() const override { return "NLopt"; }

  // NLopt ends a run at max|g| <= 1e-8, which no option changes, and its first
  // trial step is -g. So the gradient at our tolerance becomes 2^-16 = 1.5e-5,
  // and still 1.5e-8 where new units are chosen; the first step is about
  // Scales::length all the same.
  double RelativeLengthUnit(double tolerance) const override {
    return 0x1p16 * tolerance;
  }

  std::string Run(Problem* problem, double* y) const override {
    // NLopt computes the size of its work space as an int.
    const double work =
        2.0 * memory_ * problem->n() + 2.0 * memory_ + 6.0 * problem->n();
    if (work > std::numeric_limits<int>::max()) {
      return Format("memory=%d is too much for it", memory_);
    }
    const std::unique_ptr<nlopt_opt_s, Destroy> optimizer(
        nlopt_create(NLOPT_LD_LBFGS, problem->n()));
    if (optimizer == nullptr) {
      return nlopt_result_to_string(NLOPT_OUT_OF_MEMORY);
    }
    Follower follower(problem, optimizer.get());
    nlopt_set_min_objective(optimizer.get(), &Follower::Evaluate, &follower);
    nlopt_set_vector_storage(optimizer.get(), memory_);
    // Of 0, which says that there is no tolerance, this method makes 1e-14 and
    // 1e-16. No change is below NaN.
    const double never = std::numeric_limits<double>::quiet_NaN();
    nlopt_set_ftol_rel(optimizer.get(), never);
    nlopt_set_xtol_rel(optimizer.get(), never);
    double cost;
    const nlopt_result result = nlopt_optimize(optimizer.get(), y, &cost);
    // NLOPT_SUCCESS: max|g| <= 1e-8.
    const char* details = nlopt_get_errmsg(optimizer.get());
    return std::string(nlopt_result_to_string(result)) +
           (details == nullptr ? "" : std::string(", ") + details);
  }

 private:
  const int memory_;
};

}  // namespace

REGISTER_SOLVER(nlopt_lbfgs,
                NloptLbfgs,
                "NLopt's limited-memory BFGS (LD_LBFGS)",
                "Nocedal, Math. Comp. 35 (1980) 773; Luksan, PLIS; Johnson, "
                "NLopt 2.7.1");

}  // namespace granopt
