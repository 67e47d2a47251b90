// granopt: a search as pagmo sees it.

#ifndef GRANOPT_SOLVERS_SEARCH_METHODS_PAGMO_PAGMO_PROBLEM_H_
#define GRANOPT_SOLVERS_SEARCH_METHODS_PAGMO_PAGMO_PROBLEM_H_

#include <pagmo/population.hpp>
#include <pagmo/problem.hpp>
#include <utility>

#include "solvers/search/search.h"

namespace granopt {

// pagmo asks for one string after the other and offers no way to stop it: End
// is thrown through it.
struct PagmoProblem {
  struct End {};

  pagmo::vector_double fitness(const pagmo::vector_double& u) const {
    std::vector<double> values;
    if (!run->Evaluate({u}, &values)) throw End();
    return {values[0]};
  }
  std::pair<pagmo::vector_double, pagmo::vector_double> get_bounds() const {
    const int n = run != nullptr ? run->size() : 1;
    return {pagmo::vector_double(n, 0.0), pagmo::vector_double(n, 1.0)};
  }

  SearchRun* run = nullptr;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SEARCH_METHODS_PAGMO_PAGMO_PROBLEM_H_
