// granopt: pair laws of the near field.
//
// A law is a central force of two grains at distance d. With the potential V(d)
// its attraction is f(d) = V'(d), positive where grains attract each other:
//   Psi_i = f(d) n_ij,   n_ij = (r_j - r_i) / d   (2.2), (A.2).
//
// To add a law, write a struct with the four functions below, name it in
// NearFieldLaws and give RadialLaw a maker; every kernel is compiled for every
// law. Laws are written for a number and for a vector of numbers alike: T has
// the arithmetic operators, Sqrt, Exp and Log.
//
// Source: Zohdi, Int. J. Solids Struct. 42 (2005) 539, equation numbers are
// theirs.

#ifndef GRANOPT_GRANULAR_FLOW_NEAR_FIELD_LAW_H_
#define GRANOPT_GRANULAR_FLOW_NEAR_FIELD_LAW_H_

#include <cmath>

namespace granopt {

// The numbers of a law, at unit weights.
struct RadialLaw {
  enum class Form { POWERS, MORSE };
  Form form = Form::POWERS;
  // f = strength[0] d^-exponent[0] - strength[1] d^-exponent[1]  (2.2), (2.4).
  double strength[2] = {0.0, 0.0};
  double exponent[2] = {1.0, 2.0};
  // V = depth ((1 - exp(-steepness (d - distance)))^2 - 1).
  double depth = 0.0;
  double steepness = 0.0;
  double distance = 1.0;

  // f = alpha1 d^-beta1 - alpha2 d^-beta2  (2.2), V of (2.3) with ln d where an
  // exponent is 1.
  static RadialLaw Powers(double alpha1,
                          double beta1,
                          double alpha2,
                          double beta2) {
    RadialLaw law;
    law.strength[0] = alpha1;
    law.exponent[0] = beta1;
    law.strength[1] = alpha2;
    law.exponent[1] = beta2;
    return law;
  }
  // V = C depth ((sigma / d)^n - (sigma / d)^m), C = n / (n - m) (n / m)^(m /
  // (n - m)), n > m > 0: (2.2) with beta = m + 1 and n + 1. The least V is
  // -depth. Lennard-Jones: n = 12, m = 6.
  static RadialLaw Mie(double depth, double sigma, double n, double m) {
    const double c = n / (n - m) * std::pow(n / m, m / (n - m));
    return Powers(c * depth * m * std::pow(sigma, m),
                  m + 1.0,
                  c * depth * n * std::pow(sigma, n),
                  n + 1.0);
  }
  static RadialLaw Morse(double depth, double steepness, double distance) {
    RadialLaw law;
    law.form = Form::MORSE;
    law.depth = depth;
    law.steepness = steepness;
    law.distance = distance;
    return law;
  }
};

// Of numbers. (Laws find those of vectors by their arguments.)
[[gnu::always_inline]] inline double Sqrt(double x) { return std::sqrt(x); }
[[gnu::always_inline]] inline double Exp(double x) { return std::exp(x); }
[[gnu::always_inline]] inline double Log(double x) { return std::log(x); }

// beta = 1, 2, the exponents of the paper's simulations: one root and one
// division.
struct InverseAndSquare {
  [[gnu::always_inline]] static bool Handles(const RadialLaw& law) {
    return law.form == RadialLaw::Form::POWERS && law.exponent[0] == 1.0 &&
           law.exponent[1] == 2.0;
  }
  [[gnu::always_inline]] explicit InverseAndSquare(const RadialLaw& law)
      : attraction(law.strength[0]), repulsion(law.strength[1]) {}

  // f(d) / d of d^2.
  template <typename T>
  [[gnu::always_inline]] T ForceOverDistance(T square) const {
    const T inverse = 1.0 / Sqrt(square);
    return inverse * inverse * (attraction - repulsion * inverse);
  }
  // V of d^2.
  template <typename T>
  [[gnu::always_inline]] T Potential(T square) const {
    return 0.5 * attraction * Log(square) + repulsion / Sqrt(square);
  }
  // f'(d) of d^2.
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T square) const {
    const T inverse = 1.0 / Sqrt(square);
    return inverse * inverse * (2.0 * repulsion * inverse - attraction);
  }

  double attraction, repulsion;
};

// Any exponents, integers up to 30 by products.
struct IntegerPowers {
  static constexpr double kMost = 30.0;

  [[gnu::always_inline]] static bool Handles(const RadialLaw& law) {
    for (const double beta : law.exponent) {
      if (!(beta >= 0.0 && beta <= kMost && beta == static_cast<int>(beta))) {
        return false;
      }
    }
    return law.form == RadialLaw::Form::POWERS;
  }
  [[gnu::always_inline]] explicit IntegerPowers(const RadialLaw& law)
      : strength{law.strength[0], law.strength[1]},
        exponent{static_cast<int>(law.exponent[0]),
                 static_cast<int>(law.exponent[1])} {}

  template <typename T>
  [[gnu::always_inline]] T ForceOverDistance(T square) const {
    const T inverse = 1.0 / Sqrt(square);
    return strength[0] * Power(inverse, exponent[0] + 1) -
           strength[1] * Power(inverse, exponent[1] + 1);
  }
  template <typename T>
  [[gnu::always_inline]] T Potential(T square) const {
    return Term(square, 0) - Term(square, 1);
  }
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T square) const {
    const T inverse = 1.0 / Sqrt(square);
    return strength[1] * exponent[1] * Power(inverse, exponent[1] + 1) -
           strength[0] * exponent[0] * Power(inverse, exponent[0] + 1);
  }

  // x^n, n >= 1.
  template <typename T>
  [[gnu::always_inline]] static T Power(T x, int n) {
    T result = x;
    bool is_first = true;
    for (T square = x; n > 0; n >>= 1) {
      if ((n & 1) != 0) {
        result = is_first ? square : result * square;
        is_first = false;
      }
      if (n > 1) square = square * square;
    }
    return result;
  }
  template <typename T>
  [[gnu::always_inline]] T Term(T square, int k) const {
    const int n = exponent[k];
    if (n == 0) return strength[k] * Sqrt(square);
    if (n == 1) return 0.5 * strength[k] * Log(square);
    return strength[k] / (1.0 - n) * Power(1.0 / Sqrt(square), n - 1);
  }

  double strength[2];
  int exponent[2];
};

struct RealPowers {
  [[gnu::always_inline]] static bool Handles(const RadialLaw& law) {
    return law.form == RadialLaw::Form::POWERS;
  }
  [[gnu::always_inline]] explicit RealPowers(const RadialLaw& law)
      : strength{law.strength[0], law.strength[1]},
        exponent{law.exponent[0], law.exponent[1]} {}

  template <typename T>
  [[gnu::always_inline]] T ForceOverDistance(T square) const {
    const T log = Log(square);
    return strength[0] * Exp(-0.5 * (exponent[0] + 1.0) * log) -
           strength[1] * Exp(-0.5 * (exponent[1] + 1.0) * log);
  }
  template <typename T>
  [[gnu::always_inline]] T Potential(T square) const {
    const T log = Log(square);
    return Term(log, 0) - Term(log, 1);
  }
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T square) const {
    const T log = Log(square);
    return strength[1] * exponent[1] * Exp(-0.5 * (exponent[1] + 1.0) * log) -
           strength[0] * exponent[0] * Exp(-0.5 * (exponent[0] + 1.0) * log);
  }

  template <typename T>
  [[gnu::always_inline]] T Term(T log, int k) const {
    if (exponent[k] == 1.0) return 0.5 * strength[k] * log;
    return strength[k] / (1.0 - exponent[k]) *
           Exp(0.5 * (1.0 - exponent[k]) * log);
  }

  double strength[2], exponent[2];
};

struct MorseWell {
  [[gnu::always_inline]] static bool Handles(const RadialLaw& law) {
    return law.form == RadialLaw::Form::MORSE;
  }
  [[gnu::always_inline]] explicit MorseWell(const RadialLaw& law)
      : depth(law.depth), steepness(law.steepness), distance(law.distance) {}

  template <typename T>
  [[gnu::always_inline]] T ForceOverDistance(T square) const {
    const T d = Sqrt(square);
    const T e = Exp(steepness * (distance - d));
    return 2.0 * depth * steepness * (1.0 - e) * e / d;
  }
  template <typename T>
  [[gnu::always_inline]] T Potential(T square) const {
    const T e = Exp(steepness * (distance - Sqrt(square)));
    return depth * e * (e - 2.0);
  }
  template <typename T>
  [[gnu::always_inline]] T Stiffness(T square) const {
    const T e = Exp(steepness * (distance - Sqrt(square)));
    return 2.0 * depth * steepness * steepness * e * (2.0 * e - 1.0);
  }

  double depth, steepness, distance;
};

template <typename... Laws>
struct LawList {};

// The first law that Handles() the numbers is used.
using NearFieldLaws =
    LawList<InverseAndSquare, IntegerPowers, RealPowers, MorseWell>;

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_NEAR_FIELD_LAW_H_
