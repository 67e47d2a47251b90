// granopt: the energy of one contact.
//
//   e(delta) = k delta^alpha / alpha for an overlap delta > 0, else 0  (4), (6)
//   f(delta) = k delta^(alpha-1)                                       (8)
//   f'(delta) = (alpha-1) k delta^(alpha-2)                            (9)
//
// A law is a struct with the three functions at k = 1; every kernel is compiled
// for every law in ContactLaws below. To add a law, write its struct and name
// it there. Laws are written for any scalar that has sqrt and pow.

#ifndef GRANOPT_GRANULAR_CONTACT_LAW_H_
#define GRANOPT_GRANULAR_CONTACT_LAW_H_

#include <cmath>
#include <tuple>

namespace granopt {

// alpha = 2, Hooke's law.
struct Harmonic {
  [[gnu::always_inline]] static bool Handles(double alpha) {
    return alpha == 2.0;
  }
  [[gnu::always_inline]] explicit Harmonic(double /*alpha*/) {}

  template <typename T>
  [[gnu::always_inline]] T Energy(T delta) const {
    return delta * delta / 2;
  }
  template <typename T>
  [[gnu::always_inline]] T Force(T delta) const {
    return delta;
  }
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T /*delta*/) const {
    return T(1);
  }
};

// alpha = 5/2, Hertz' law. Square roots only, so that lengths scaled by 4 give
// bitwise the scaled result.
struct Hertz {
  [[gnu::always_inline]] static bool Handles(double alpha) {
    return alpha == 2.5;
  }
  [[gnu::always_inline]] explicit Hertz(double /*alpha*/) {}

  template <typename T>
  [[gnu::always_inline]] T Energy(T delta) const {
    using std::sqrt;
    return delta * delta * sqrt(delta) * (T(2) / T(5));
  }
  template <typename T>
  [[gnu::always_inline]] T Force(T delta) const {
    using std::sqrt;
    return delta * sqrt(delta);
  }
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T delta) const {
    using std::sqrt;
    return sqrt(delta) * (T(3) / T(2));
  }
};

// Any alpha >= 2.
struct PowerLaw {
  [[gnu::always_inline]] static bool Handles(double alpha) {
    return alpha >= 2.0;
  }
  [[gnu::always_inline]] explicit PowerLaw(double exponent) : alpha(exponent) {}

  template <typename T>
  [[gnu::always_inline]] T Energy(T delta) const {
    using std::pow;
    return pow(delta, T(alpha)) / T(alpha);
  }
  template <typename T>
  [[gnu::always_inline]] T Force(T delta) const {
    using std::pow;
    return pow(delta, T(alpha) - 1);
  }
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T delta) const {
    using std::pow;
    return (T(alpha) - 1) * pow(delta, T(alpha) - 2);
  }

  double alpha;
};

// The first law that Handles(alpha) is used.
using ContactLaws = std::tuple<Harmonic, Hertz, PowerLaw>;

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_CONTACT_LAW_H_
