#include "granular/contact_law.h"

#include <quadmath.h>

#include <cmath>
#include <limits>
#include <type_traits>

#include "granular/pair_loops.h"
#include "gtest/gtest.h"

namespace granopt {

// __float128 as a class, so that the laws find its sqrt and pow by name lookup.
struct WideReal {
  __float128 v;
  WideReal(__float128 value) : v(value) {}  // NOLINT: converts like a number
  WideReal(double value) : v(value) {}      // NOLINT
  WideReal(int value) : v(value) {}         // NOLINT
  friend WideReal operator+(WideReal a, WideReal b) { return a.v + b.v; }
  friend WideReal operator-(WideReal a, WideReal b) { return a.v - b.v; }
  friend WideReal operator*(WideReal a, WideReal b) { return a.v * b.v; }
  friend WideReal operator/(WideReal a, WideReal b) { return a.v / b.v; }
  friend WideReal sqrt(WideReal a) { return sqrtq(a.v); }
  friend WideReal pow(WideReal a, WideReal b) { return powq(a.v, b.v); }
};

namespace {

constexpr double kEps = std::numeric_limits<double>::epsilon();

// (4), (8) and (9) at k = 1, with no care but 33 digits.
__float128 EnergyOracle(__float128 delta, double alpha) {
  return powq(delta, alpha) / alpha;
}
__float128 ForceOracle(__float128 delta, double alpha) {
  return powq(delta, (__float128)alpha - 1);
}
__float128 StiffnessOracle(__float128 delta, double alpha) {
  return ((__float128)alpha - 1) * powq(delta, (__float128)alpha - 2);
}

double RelativeError(__float128 value, __float128 expected) {
  return static_cast<double>(fabsq(value / expected - 1));
}

// Calls check(delta) for overlaps over 14 decades with all bits in use.
template <typename Check>
void ForOverlaps(const Check& check) {
  for (int k = -140; k <= 10; ++k) check(std::pow(10.0, 0.1 * k));
}

// A law has four roundings or a pow (below 1 ulp) and two roundings: 4 eps.
template <typename Law>
void ExpectLawIsThePowerLaw(double alpha) {
  const Law law(alpha);
  ForOverlaps([&](double delta) {
    EXPECT_LT(RelativeError(law.Energy(delta), EnergyOracle(delta, alpha)),
              4 * kEps)
        << "delta = " << delta << ", alpha = " << alpha;
    EXPECT_LT(RelativeError(law.Force(delta), ForceOracle(delta, alpha)),
              4 * kEps)
        << "delta = " << delta << ", alpha = " << alpha;
    EXPECT_LT(
        RelativeError(law.Stiffness(delta), StiffnessOracle(delta, alpha)),
        4 * kEps)
        << "delta = " << delta << ", alpha = " << alpha;
  });
}

TEST(ContactLaw, HarmonicIsEquations4And8And9) {
  ExpectLawIsThePowerLaw<Harmonic>(2.0);
}

TEST(ContactLaw, HertzIsEquations4And8And9) {
  ExpectLawIsThePowerLaw<Hertz>(2.5);
}

TEST(ContactLaw, PowerLawIsEquations4And8And9) {
  for (const double alpha : {2.0, 2.1, 2.5, 3.0, 3.3, 4.0, 7.25}) {
    ExpectLawIsThePowerLaw<PowerLaw>(alpha);
  }
}

TEST(ContactLaw, PowerLawWithExponentTwoIsHarmonic) {
  const PowerLaw power(2.0);
  const Harmonic harmonic(2.0);
  ForOverlaps([&](double delta) {
    EXPECT_NEAR(power.Energy(delta) / harmonic.Energy(delta), 1.0, 1e-15);
    EXPECT_NEAR(power.Force(delta) / harmonic.Force(delta), 1.0, 1e-15);
    EXPECT_NEAR(power.Stiffness(delta) / harmonic.Stiffness(delta), 1.0, 1e-15);
  });
}

TEST(ContactLaw, PowerLawWithExponentFiveHalvesIsHertz) {
  const PowerLaw power(2.5);
  const Hertz hertz(2.5);
  ForOverlaps([&](double delta) {
    EXPECT_NEAR(power.Energy(delta) / hertz.Energy(delta), 1.0, 1e-15);
    EXPECT_NEAR(power.Force(delta) / hertz.Force(delta), 1.0, 1e-15);
    EXPECT_NEAR(power.Stiffness(delta) / hertz.Stiffness(delta), 1.0, 1e-15);
  });
}

// Central differences in 33 digits, relative step 1e-9: the truncation error is
// about 1e-18 relative, the roundoff 1e-24.
template <typename Law>
void ExpectDerivatives(double alpha) {
  const Law law(alpha);
  ForOverlaps([&](double overlap) {
    const __float128 delta = overlap;
    const __float128 h = 1e-9 * delta;
    const __float128 dE = (law.Energy(WideReal(delta + h)).v -
                           law.Energy(WideReal(delta - h)).v) /
                          (2 * h);
    const __float128 dF =
        (law.Force(WideReal(delta + h)).v - law.Force(WideReal(delta - h)).v) /
        (2 * h);
    EXPECT_LT(RelativeError(dE, law.Force(WideReal(delta)).v), 1e-16);
    EXPECT_LT(RelativeError(dF, law.Stiffness(WideReal(delta)).v), 1e-16);
  });
}

TEST(ContactLaw, ForceAndStiffnessAreTheDerivativesOfTheEnergy) {
  ExpectDerivatives<Harmonic>(2.0);
  ExpectDerivatives<Hertz>(2.5);
  for (const double alpha : {2.0, 2.1, 2.5, 3.3, 7.25}) {
    ExpectDerivatives<PowerLaw>(alpha);
  }
}

// 33 digits in, 33 digits out: nothing passes through double.
TEST(ContactLaw, KeepsThePrecisionOfItsScalar) {
  const __float128 delta = 1 / (__float128)3;
  EXPECT_LT(RelativeError(Hertz(2.5).Energy(WideReal(delta)).v,
                          EnergyOracle(delta, 2.5)),
            1e-32);
  EXPECT_LT(RelativeError(Hertz(2.5).Stiffness(WideReal(delta)).v,
                          StiffnessOracle(delta, 2.5)),
            1e-32);
  EXPECT_LT(RelativeError(PowerLaw(3.3).Energy(WideReal(delta)).v,
                          EnergyOracle(delta, 3.3)),
            1e-31);
}

TEST(ContactLaw, ScalesBitwiseWithPowersOfTwoForHarmonicAndOfFourForHertz) {
  const Harmonic harmonic(2.0);
  const Hertz hertz(2.5);
  ForOverlaps([&](double delta) {
    for (const int b : {-31, -1, 1, 6, 33}) {
      EXPECT_EQ(harmonic.Energy(std::ldexp(delta, b)),
                std::ldexp(harmonic.Energy(delta), 2 * b));
      EXPECT_EQ(harmonic.Force(std::ldexp(delta, b)),
                std::ldexp(harmonic.Force(delta), b));
      EXPECT_EQ(hertz.Energy(std::ldexp(delta, 2 * b)),
                std::ldexp(hertz.Energy(delta), 5 * b));
      EXPECT_EQ(hertz.Force(std::ldexp(delta, 2 * b)),
                std::ldexp(hertz.Force(delta), 3 * b));
      EXPECT_EQ(hertz.Stiffness(std::ldexp(delta, 2 * b)),
                std::ldexp(hertz.Stiffness(delta), b));
    }
  });
}

TEST(ContactLaw, OverlapZeroIsTheFiniteLimit) {
  for (const double alpha : {2.0, 2.5, 3.3}) {
    const PowerLaw law(alpha);
    EXPECT_EQ(law.Energy(0.0), 0.0);
    EXPECT_EQ(law.Force(0.0), 0.0);
    EXPECT_EQ(law.Stiffness(0.0), alpha == 2.0 ? 1.0 : 0.0);
  }
  EXPECT_EQ(Hertz(2.5).Stiffness(0.0), 0.0);
}

TEST(ContactLaw, TheFirstLawThatHandlesAnExponentIsTheSpecialOne) {
  static_assert(std::is_same_v<std::tuple_element_t<0, ContactLaws>, Harmonic>);
  static_assert(std::is_same_v<std::tuple_element_t<1, ContactLaws>, Hertz>);
  EXPECT_TRUE(Harmonic::Handles(2.0));
  EXPECT_TRUE(Hertz::Handles(2.5));
  for (const double alpha : {2.1, 2.499, 2.501, 3.0, 3.3}) {
    EXPECT_FALSE(Harmonic::Handles(alpha));
    EXPECT_FALSE(Hertz::Handles(alpha));
    EXPECT_TRUE(PowerLaw::Handles(alpha));
  }
  for (const double alpha : {1.999, 1.0, 0.0, -2.0, std::nan("")}) {
    EXPECT_FALSE(Harmonic::Handles(alpha) || Hertz::Handles(alpha) ||
                 PowerLaw::Handles(alpha));
  }
}

TEST(ContactLaw, KernelsExistForTwoAndThreeDimensionsAndExponentsFromTwo) {
  for (const int dimension : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.3}) {
      EXPECT_NE(FastestPairLoops(dimension, alpha).sweep, nullptr);
    }
    EXPECT_EQ(FastestPairLoops(dimension, 1.9).sweep, nullptr);
    EXPECT_EQ(FastestPairLoops(dimension, std::nan("")).sweep, nullptr);
  }
  EXPECT_EQ(FastestPairLoops(1, 2.0).sweep, nullptr);
  EXPECT_EQ(FastestPairLoops(4, 2.0).sweep, nullptr);
}

}  // namespace
}  // namespace granopt
