// granopt: random numbers that are the same on every machine.

#ifndef GRANOPT_SOLVERS_RANDOM_H_
#define GRANOPT_SOLVERS_RANDOM_H_

#include <cstdint>
#include <random>

namespace granopt {

// The standard fixes the output of mt19937_64 but not of its distributions, so
// the map to [0, 1) is ours: 53 random bits.
class UniformRandom {
 public:
  explicit UniformRandom(std::uint64_t seed) : engine_(seed) {}
  // In [0, 1).
  double operator()() {
    return static_cast<double>(engine_() >> 11) * 0x1.0p-53;
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_RANDOM_H_
