#include "solvers/rigidity.h"

#include <cstddef>

namespace granopt {

std::vector<bool> HeldObjects(const Gaps& gaps, int num_objects, int least) {
  const auto m = gaps.ids.size();
  std::vector<int> start(num_objects + 2, 0);
  const auto counts = [&](std::size_t c) {
    return gaps.delta[c] > 0.0 && gaps.ids[c].i != gaps.ids[c].j;
  };
  for (std::size_t c = 0; c < m; ++c) {
    if (!counts(c)) continue;
    ++start[gaps.ids[c].i + 2];
    ++start[gaps.ids[c].j + 2];
  }
  std::vector<int> number(num_objects);
  for (int i = 0; i < num_objects; ++i) {
    number[i] = start[i + 2];
    start[i + 2] += start[i + 1];
  }
  std::vector<int> partner(start[num_objects + 1]);
  for (std::size_t c = 0; c < m; ++c) {
    if (!counts(c)) continue;
    partner[start[gaps.ids[c].i + 1]++] = gaps.ids[c].j;
    partner[start[gaps.ids[c].j + 1]++] = gaps.ids[c].i;
  }
  std::vector<bool> is_held(num_objects, true);
  std::vector<int> loose;
  for (int i = 0; i < num_objects; ++i) {
    if (number[i] < least) loose.push_back(i);
  }
  for (const int i : loose) is_held[i] = false;
  while (!loose.empty()) {
    const int i = loose.back();
    loose.pop_back();
    for (int k = start[i]; k < start[i + 1]; ++k) {
      const int j = partner[k];
      if (is_held[j] && --number[j] < least) {
        is_held[j] = false;
        loose.push_back(j);
      }
    }
  }
  return is_held;
}

bool RigidHessian::Evaluate(const UnilateralFunction& function,
                            const double* x,
                            SparseMatrix* hessian) {
  if (!function.EvaluateGaps(x, &gaps)) return false;
  const int block = function.BlockSize();
  const std::vector<bool> is_held =
      HeldObjects(gaps, function.NumParameters() / block, block + 1);
  const auto m = static_cast<int>(gaps.ids.size());
  const Eigen::VectorXd closure = gaps.delta.cwiseMax(0.0);
  first.resize(m);
  second.resize(m);
  function.EvaluateLaw(m, closure.data(), second.data(), first.data());
  for (int c = 0; c < m; ++c) {
    const double k = gaps.delta[c] > 0.0 ? gaps.stiffness[c] : 0.0;
    const bool both = is_held[gaps.ids[c].i] && is_held[gaps.ids[c].j];
    first[c] *= k;
    second[c] *= both ? k : 0.0;
  }
  return function.EvaluateWeightedHessian(
      x, first.data(), second.data(), hessian);
}

}  // namespace granopt
