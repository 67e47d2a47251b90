// Nelder and Mead's simplex by NLopt (LN_NELDERMEAD), restarted.

#include <nlopt.h>

#include <limits>
#include <memory>
#include <vector>

#include "solvers/search/search.h"

namespace granopt {
namespace {

struct Destroy {
  void operator()(nlopt_opt_s* optimizer) const { nlopt_destroy(optimizer); }
};

struct Context {
  SearchRun* run;
  nlopt_opt optimizer;
};

double Evaluate(unsigned n, const double* u, double*, void* data) {
  const Context* const context = static_cast<Context*>(data);
  std::vector<double> values;
  if (!context->run->Evaluate({std::vector<double>(u, u + n)}, &values)) {
    nlopt_force_stop(context->optimizer);
  }
  // Its comparisons are with HUGE_VAL; the simplex does arithmetic on none of
  // the values.
  return values[0];
}

class NelderMead : public SearchMethod {
 public:
  explicit NelderMead(Parameters* parameters)
      : strings_(parameters->Int("strings", 310, 1, "at most")),
        step_(parameters->Double(
            "step", 0.2, 1e-6, 1.0, "first simplex, of the box")),
        resolution_(parameters->Double(
            "resolution", 0.01, 1e-12, 1.0, "simplex that ends, of the box")) {}

 protected:
  void Run(SearchRun* run) const override {
    const int n = run->size();
    UniformRandom random(run->seed());
    std::vector<double> u = run->Start();
    int used = 0;
    for (int restart = 0; !run->ended() && used < strings_; ++restart) {
      const std::unique_ptr<nlopt_opt_s, Destroy> optimizer(
          nlopt_create(NLOPT_LN_NELDERMEAD, n));
      Context context = {run, optimizer.get()};
      nlopt_set_min_objective(optimizer.get(), &Evaluate, &context);
      nlopt_set_lower_bounds1(optimizer.get(), 0.0);
      nlopt_set_upper_bounds1(optimizer.get(), 1.0);
      nlopt_set_initial_step1(optimizer.get(), step_);
      nlopt_set_xtol_abs1(optimizer.get(), resolution_);
      nlopt_set_maxeval(optimizer.get(), strings_ - used);
      double value;
      nlopt_optimize(optimizer.get(), u.data(), &value);
      const int evaluations = nlopt_get_numevals(optimizer.get());
      if (evaluations == 0) return;  // refused: it would be again
      used += evaluations;
      for (double& x : u) x = random();
    }
  }

 private:
  const int strings_;
  const double step_, resolution_;
};

}  // namespace

REGISTER_SEARCH(nelder_mead,
                NelderMead,
                "NLopt's simplex, from the start, then from random strings",
                "Nelder, Mead, Comput. J. 7 (1965) 308; Johnson, NLopt 2.7.1");

}  // namespace granopt
