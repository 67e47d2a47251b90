#include "solvers/rigidity.h"

#include <cmath>

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
  const double alpha = function.Exponent();
  const auto m = static_cast<Eigen::Index>(gaps.ids.size());
  first.setZero(m);
  second.setZero(m);
  for (Eigen::Index c = 0; c < m; ++c) {
    const double delta = gaps.delta[c];
    if (!(delta > 0.0)) continue;
    const double k = gaps.stiffness[c];
    // Powers by products and roots where there are such: exact in other units.
    double force;
    if (alpha == 2.0) {
      first[c] = k;
      force = k * delta;
    } else if (alpha == 2.5) {
      const double root = std::sqrt(delta);
      first[c] = k * (root * 1.5);
      force = k * (delta * root);
    } else {
      const double power = std::pow(delta, alpha - 2.0);
      first[c] = k * ((alpha - 1.0) * power);
      force = k * (delta * power);
    }
    if (is_held[gaps.ids[c].i] && is_held[gaps.ids[c].j]) second[c] = force;
  }
  return function.EvaluateWeightedHessian(
      x, first.data(), second.data(), hessian);
}

}  // namespace granopt
