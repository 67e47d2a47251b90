// CMA-ES by pagmo, restarted until the budget is used.

#include <algorithm>
#include <pagmo/algorithms/cmaes.hpp>
#include <vector>

#include "solvers/search/methods/pagmo/pagmo_problem.h"

namespace granopt {
namespace {

class CmaEs : public SearchMethod {
 public:
  explicit CmaEs(Parameters* parameters)
      : population_(parameters->Int("population", 10, 5, "strings")),
        generations_(
            parameters->Int("generations", 30, 1, "of all restarts, at most")),
        sigma_(parameters->Double(
            "sigma", 0.3, 1e-6, 1.0, "first step, of the box")) {}

 protected:
  void Run(SearchRun* run) const override {
    try {
      UniformRandom random(run->seed());
      for (unsigned left = generations_; left > 0;) {
        const auto seed = static_cast<unsigned>(4294967295.0 * random());
        pagmo::population population(
            pagmo::problem(PagmoProblem{run}), 0, seed);
        const std::vector<double> low(run->size(), 0.0), high(run->size(), 1.0);
        std::vector<std::vector<double>> first =
            RandomStrings(population_, low, high, &random);
        if (left == static_cast<unsigned>(generations_) && run->HasStart()) {
          first[0] = run->Start();
        }
        for (const auto& string : first) population.push_back(string);
        pagmo::cmaes method(
            left, -1, -1, -1, -1, sigma_, 1e-4, 1e-3, false, true, seed);
        const auto before = population.get_problem().get_fevals();
        population = method.evolve(population);
        const auto done =
            (population.get_problem().get_fevals() - before) / population_;
        left -= std::min<unsigned>(left, 1 + static_cast<unsigned>(done));
      }
    } catch (const PagmoProblem::End&) {
    }
  }

 private:
  const int population_, generations_;
  const double sigma_;
};

}  // namespace

REGISTER_SEARCH(
    cma_es,
    CmaEs,
    "pagmo's evolution strategy with an adapted covariance, restarted",
    "Hansen, in: Towards a new evolutionary computation (2006) 75; "
    "Biscani, Izzo, J. Open Source Softw. 5 (2020) 2338");

}  // namespace granopt
