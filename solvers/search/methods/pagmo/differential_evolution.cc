// Differential evolution by pagmo.

#include <pagmo/algorithms/de.hpp>
#include <vector>

#include "solvers/search/methods/pagmo/pagmo_problem.h"

namespace granopt {
namespace {

class DifferentialEvolution : public SearchMethod {
 public:
  explicit DifferentialEvolution(Parameters* parameters)
      : population_(parameters->Int("population", 20, 5, "strings")),
        generations_(
            parameters->Int("generations", 15, 1, "after the first, at most")),
        weight_(parameters->Double("weight", 0.7, 0.0, 1.0, "F")),
        crossover_(parameters->Double("crossover", 0.9, 0.0, 1.0, "CR")) {}

 protected:
  void Run(SearchRun* run) const override {
    try {
      UniformRandom random(run->seed());
      const auto seed = static_cast<unsigned>(4294967295.0 * random());
      pagmo::population population(pagmo::problem(PagmoProblem{run}), 0, seed);
      const std::vector<double> low(run->size(), 0.0), high(run->size(), 1.0);
      std::vector<std::vector<double>> first =
          RandomStrings(population_, low, high, &random);
      if (run->HasStart()) first[0] = run->Start();
      for (const auto& string : first) population.push_back(string);
      // rand/1/exp; no tolerance ends it.
      const pagmo::de method(
          generations_, weight_, crossover_, 2u, 0.0, 0.0, seed);
      method.evolve(population);
    } catch (const PagmoProblem::End&) {
    }
  }

 private:
  const int population_, generations_;
  const double weight_, crossover_;
};

}  // namespace

REGISTER_SEARCH(
    differential_evolution,
    DifferentialEvolution,
    "pagmo's differential evolution, rand/1/exp",
    "Storn, Price, J. Glob. Optim. 11 (1997) 341; Biscani, Izzo, J. "
    "Open Source Softw. 5 (2020) 2338");

}  // namespace granopt
