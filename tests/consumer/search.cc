// Looks for the least value of a function of one's own without its derivatives;
// links granopt::searches only.

#include "solvers/search/search.h"

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

int main() {
  std::string error;
  const std::unique_ptr<granopt::SearchMethod> method =
      granopt::CreateSearch("genetic_algorithm:generations=40", &error);
  if (method == nullptr) {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 2;
  }
  granopt::SearchProblem problem;
  problem.low = {-1.0, 0.0};
  problem.high = {2.0, 4.0};
  // |x - (0.5, 3)|.
  problem.objective = [](const std::vector<std::vector<double>>& strings,
                         std::vector<double>* values) {
    for (const std::vector<double>& x : strings) {
      values->push_back(std::hypot(x[0] - 0.5, x[1] - 3.0));
    }
    return true;
  };
  const granopt::SearchResult result = method->Search(problem);
  std::printf("%d strings\n", result.strings);
  std::printf("x = %.1f %.1f\n", result.best[0], result.best[1]);
  return result.value < 0.05 ? 0 : 1;
}
