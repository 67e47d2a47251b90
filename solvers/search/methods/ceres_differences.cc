// Ceres' L-BFGS on central differences whose steps are chosen from the noise.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "ceres/gradient_problem.h"
#include "ceres/gradient_problem_solver.h"
#include "solvers/format.h"
#include "solvers/quiet_log.h"
#include "solvers/search/noise.h"
#include "solvers/search/search.h"

namespace granopt {
namespace {

// f / unit of the unit box, continued by mirrors beyond it.
class Differences : public ceres::FirstOrderFunction {
 public:
  Differences(SearchRun* run, std::vector<double> steps, double unit)
      : run_(run), steps_(std::move(steps)), unit_(unit) {}

  bool Evaluate(const double* u,
                double* cost,
                double* gradient) const override {
    const int n = run_->size();
    std::vector<std::vector<double>> strings = {Mirrored(u)};
    std::vector<double> shifted(u, u + n);
    for (int k = 0; gradient != nullptr && k < n; ++k) {
      for (const double sign : {1.0, -1.0}) {
        shifted[k] = u[k] + sign * steps_[k];
        strings.push_back(Mirrored(shifted.data()));
      }
      shifted[k] = u[k];
    }
    std::vector<double> values;
    if (!run_->Evaluate(strings, &values)) return false;
    for (double& value : values) {
      if (!std::isfinite(value)) return false;
      value /= unit_;
    }
    *cost = values[0];
    for (int k = 0; gradient != nullptr && k < n; ++k) {
      gradient[k] = (values[1 + 2 * k] - values[2 + 2 * k]) / (2.0 * steps_[k]);
    }
    return true;
  }
  int NumParameters() const override { return run_->size(); }

 private:
  std::vector<double> Mirrored(const double* u) const {
    std::vector<double> folded(u, u + run_->size());
    for (double& x : folded) x = Reflect(x);
    return folded;
  }

  SearchRun* const run_;
  const std::vector<double> steps_;
  const double unit_;
};

// Ends where no line search finds a lower value: with noise that is where the
// slopes have sunk into it.
class CeresDifferences : public SearchMethod {
 public:
  explicit CeresDifferences(Parameters* parameters)
      : iterations_(parameters->Int("iterations", 20, 1, "most of them")),
        spacing_(parameters->Double("spacing",
                                    0.002,
                                    1e-12,
                                    0.1,
                                    "of the strings that the noise is measured "
                                    "with, of the box")) {}

 protected:
  void Run(SearchRun* run) const override {
    std::vector<double> u = run->Start();
    const auto evaluate = [&](const std::vector<std::vector<double>>& strings,
                              std::vector<double>* values) {
      std::vector<std::vector<double>> folded = strings;
      for (auto& string : folded) {
        for (double& x : string) x = Reflect(x);
      }
      return run->Evaluate(folded, values);
    };
    UniformRandom random(run->seed());
    DifferenceSteps chosen;
    if (!ChooseDifferenceSteps(u, spacing_, &random, evaluate, &chosen)) return;
    // Ceres' first step depends on the size of the slopes: a power of two makes
    // it that of values about 1, whatever the units.
    int exponent = 0;
    std::frexp(chosen.scale, &exponent);
    const double unit = std::ldexp(1.0, exponent);
    ceres::GradientProblem problem(new Differences(run, chosen.steps, unit));
    ceres::GradientProblemSolver::Options options;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = iterations_;
    // A change that the noise alone makes is no progress.
    const double cost = std::fabs(chosen.value);
    options.function_tolerance = cost > 0.0 ? chosen.noise / cost / 10.0 : 0.0;
    options.gradient_tolerance = 0.0;
    options.parameter_tolerance = 1e-6;
    options.max_num_line_search_step_size_iterations = 8;
    options.max_num_line_search_direction_restarts = 1;
    const QuietLog quiet;
    ceres::GradientProblemSolver::Summary summary;
    ceres::Solve(options, problem, u.data(), &summary);
    std::string steps;
    for (const double h : chosen.steps) {
      steps += Format(steps.empty() ? "%.3g" : ", %.3g", h);
    }
    run->set_message(
        Format("noise %.2g, difference steps %s of the box, %zu iterations: %s",
               chosen.noise,
               steps.c_str(),
               std::max<std::size_t>(summary.iterations.size(), 1) - 1,
               summary.message.c_str()));
  }

 private:
  const int iterations_;
  const double spacing_;
};

}  // namespace

REGISTER_SEARCH(ceres_differences,
                CeresDifferences,
                "Ceres' L-BFGS from the start, central differences with steps "
                "chosen from the noise",
                "Zohdi, Int. J. Solids Struct. 42 (2005) 539, sec. 8.1; More, "
                "Wild, SIAM J. Sci. Comput. 33 (2011) 1292");

}  // namespace granopt
