// granopt: units that can be changed exactly.

#ifndef GRANOPT_SOLVERS_POWER_OF_TWO_H_
#define GRANOPT_SOLVERS_POWER_OF_TWO_H_

#include <algorithm>
#include <cmath>

namespace granopt {

// The power of two nearest to v in the logarithm; 1 where v is no positive
// number.
inline double PowerOfTwo(double v) {
  if (!(v > 0.0) || !std::isfinite(v)) return 1.0;
  return std::exp2(std::clamp(std::round(std::log2(v)), -900.0, 900.0));
}

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_POWER_OF_TWO_H_
