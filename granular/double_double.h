// granopt: sums and products whose rounding error is kept.
//
// A position is the exact sum of two doubles, hi + lo with |lo| <= ulp(hi) / 2:
// differences of positions then keep about 32 digits, which is what makes
// contact forces exact relative to the mean force at any distance from jamming.
// Only the few operations that a pair needs are here; the compiler must not be
// allowed to reassociate (no -ffast-math).
//
// Source: Dekker, Numer. Math. 18 (1971) 224 (FastTwoSum, products); Knuth, The
// Art of Computer Programming 2, 4.2.2 (TwoSum).

#ifndef GRANOPT_GRANULAR_DOUBLE_DOUBLE_H_
#define GRANOPT_GRANULAR_DOUBLE_DOUBLE_H_

#include <cmath>

namespace granopt {

struct DoubleDouble {
  double hi = 0.0;
  double lo = 0.0;

  DoubleDouble() = default;
  DoubleDouble(double value) : hi(value) {}  // NOLINT: a double is one exactly
  DoubleDouble(double high, double low) : hi(high), lo(low) {}

  double Value() const { return hi + lo; }
};

// a + b exactly.
inline DoubleDouble TwoSum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}

// a + b exactly, if |a| >= |b| or a = 0.
inline DoubleDouble FastTwoSum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

// a * b exactly (barring underflow).
inline DoubleDouble TwoProduct(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

inline DoubleDouble operator-(const DoubleDouble& a) { return {-a.hi, -a.lo}; }

inline DoubleDouble operator+(const DoubleDouble& a, const DoubleDouble& b) {
  DoubleDouble high = TwoSum(a.hi, b.hi);
  const DoubleDouble low = TwoSum(a.lo, b.lo);
  high = FastTwoSum(high.hi, high.lo + low.hi);
  return FastTwoSum(high.hi, high.lo + low.lo);
}

inline DoubleDouble operator-(const DoubleDouble& a, const DoubleDouble& b) {
  return a + (-b);
}

inline DoubleDouble operator*(const DoubleDouble& a, const DoubleDouble& b) {
  const DoubleDouble product = TwoProduct(a.hi, b.hi);
  return FastTwoSum(product.hi, product.lo + (a.hi * b.lo + a.lo * b.hi));
}

// Square root of a >= 0: one Newton correction of the double result.
inline DoubleDouble Sqrt(const DoubleDouble& a) {
  if (!(a.hi > 0.0)) return {};
  const double root = std::sqrt(a.hi);
  const DoubleDouble remainder = a - TwoProduct(root, root);
  return FastTwoSum(root, remainder.hi / (2.0 * root));
}

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_DOUBLE_DOUBLE_H_
