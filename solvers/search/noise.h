// granopt: how noisy a function is, and the differences that suit it.

#ifndef GRANOPT_SOLVERS_SEARCH_NOISE_H_
#define GRANOPT_SOLVERS_SEARCH_NOISE_H_

#include <functional>
#include <vector>

#include "solvers/random.h"

namespace granopt {

// The standard deviation of the noise in values f_0 ... f_m at equidistant
// points, from their table of differences:
//   s_k^2 = (k!)^2 / (2 k)! / (m + 1 - k) sum_i (Delta^k f_i)^2,
// s_k of the first k at which s_k, s_(k+1), s_(k+2) agree within a factor 4 and
// Delta^k f changes sign; the last s_k where there is none (the points are too
// far apart for the noise, or it is 0).
// Source: More, Wild, SIAM J. Sci. Comput. 33 (2011) 1292, ECnoise.
double EstimateNoise(const std::vector<double>& values);

struct DifferenceSteps {
  double value = 0.0;  // f at the point
  double noise = 0.0;  // standard deviation
  double scale = 0.0;  // the largest |f| about the point
  std::vector<double> steps;
};

// Steps h_k = 8^(1/4) (noise / |f''_k|)^(1/2) in the unit box, in [0.01, 0.2].
// They balance noise and curvature of one-sided differences; taken on both
// sides the error from the noise, noise / (sqrt 2 h), is what remains. Second
// derivatives are differences of step (noise / scale)^(1/4), at least 0.1: f in
// other units gives the same steps. The noise is measured with strings that are
// `spacing` apart, in a random direction. Evaluates 9 + 2 n strings in two
// lists; false if `evaluate` said so or a value is not finite.
// Source: More, Wild, ACM Trans. Math. Softw. 38 (2012) 19.
bool ChooseDifferenceSteps(
    const std::vector<double>& point,
    double spacing,
    UniformRandom* random,
    const std::function<bool(const std::vector<std::vector<double>>&,
                             std::vector<double>*)>& evaluate,
    DifferenceSteps* chosen);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_SEARCH_NOISE_H_
