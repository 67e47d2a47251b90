#include "solvers/vector_loops.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/instruction_set.h"

namespace granopt {
namespace {

using Vector = std::vector<double>;

struct NamedLoops {
  std::string name;
  VectorLoops loops;
};

// Of the instruction sets that this machine has.
std::vector<NamedLoops> Runnable() {
  std::vector<NamedLoops> all = {{"portable", kPortableVectors}};
#ifdef __x86_64__
  if (Runs(InstructionSet::AVX2)) all.push_back({"AVX2", kAvx2Vectors});
  if (Runs(InstructionSet::AVX512)) all.push_back({"AVX-512", kAvx512Vectors});
#endif
  return all;
}

// Empty, shorter than a register, and around multiples of all lanes of a sum.
const int kLengths[] = {0, 1, 3, 7, 8, 15, 16, 17, 31, 32, 33, 1000, 1029};

Vector Waves(int n, double phase) {
  Vector x(n);
  for (int v = 0; v < n; ++v) x[v] = std::sin(phase + 7.0 * phase * v);
  return x;
}

long double ExactDot(const Vector& a, const Vector& b) {
  long double sum = 0.0;
  for (std::size_t v = 0; v < a.size(); ++v) {
    sum += static_cast<long double>(a[v]) * b[v];
  }
  return sum;
}

void ExpectDot(double value, const Vector& a, const Vector& b) {
  EXPECT_NEAR(value,
              static_cast<double>(ExactDot(a, b)),
              (1.0 + static_cast<double>(a.size())) *
                  std::numeric_limits<double>::epsilon());
}

TEST(VectorLoops, ProductsHaveTheSameBitsAndTheDefinition) {
  for (const int n : kLengths) {
    SCOPED_TRACE(n);
    const Vector a = Waves(n, 1.0), b = Waves(n, 2.0);
    const double first = kPortableVectors.dot(n, a.data(), b.data());
    ExpectDot(first, a, b);
    for (const NamedLoops& set : Runnable()) {
      SCOPED_TRACE(set.name);
      EXPECT_EQ(set.loops.dot(n, a.data(), b.data()), first);
      double sums[3];
      set.loops.dots(n, a.data(), b.data(), sums);
      EXPECT_EQ(sums[0], first);
      EXPECT_EQ(sums[1], kPortableVectors.dot(n, a.data(), a.data()));
      EXPECT_EQ(sums[2], kPortableVectors.dot(n, b.data(), b.data()));
    }
  }
}

TEST(VectorLoops, CombinationsAreThoseOfScalars) {
  for (const int n : kLengths) {
    SCOPED_TRACE(n);
    const Vector x = Waves(n, 1.0), z = Waves(n, 2.0), b = Waves(n, 3.0);
    Vector expected(n);
    for (int v = 0; v < n; ++v) expected[v] = -0.3 * (x[v] + 0.7 * z[v]);
    const double product = kPortableVectors.dot(n, expected.data(), b.data());
    for (const NamedLoops& set : Runnable()) {
      SCOPED_TRACE(set.name);
      Vector y(n);
      EXPECT_EQ(set.loops.combine(
                    n, -0.3, x.data(), 0.7, z.data(), y.data(), b.data()),
                product);
      EXPECT_EQ(y, expected);
      // In place, without a product.
      y = x;
      EXPECT_EQ(set.loops.combine(
                    n, -0.3, y.data(), 0.7, z.data(), y.data(), nullptr),
                0.0);
      EXPECT_EQ(y, expected);
    }
  }
}

TEST(VectorLoops, DifferencesAndTheirProducts) {
  for (const int n : kLengths) {
    SCOPED_TRACE(n);
    const Vector x_new = Waves(n, 1.0), x = Waves(n, 2.0);
    const Vector g_new = Waves(n, 3.0), g = Waves(n, 4.0);
    Vector s(n), y(n);
    for (int v = 0; v < n; ++v) {
      s[v] = x_new[v] - x[v];
      y[v] = g_new[v] - g[v];
    }
    for (const NamedLoops& set : Runnable()) {
      SCOPED_TRACE(set.name);
      Vector s_here(n), y_here(n);
      double sums[3];
      set.loops.differences(n,
                            x_new.data(),
                            x.data(),
                            g_new.data(),
                            g.data(),
                            s_here.data(),
                            y_here.data(),
                            sums);
      EXPECT_EQ(s_here, s);
      EXPECT_EQ(y_here, y);
      EXPECT_EQ(sums[0], kPortableVectors.dot(n, s.data(), y.data()));
      EXPECT_EQ(sums[1], kPortableVectors.dot(n, s.data(), s.data()));
      EXPECT_EQ(sums[2], kPortableVectors.dot(n, y.data(), y.data()));
    }
  }
}

TEST(VectorLoops, MovesAreThoseOfScalars) {
  for (const int n : kLengths) {
    SCOPED_TRACE(n);
    const Vector z = Waves(n, 1.0);
    Vector v = Waves(n, 2.0), x = Waves(n, 3.0);
    const Vector v_before = v, x_before = x;
    for (int k = 0; k < n; ++k) {
      v[k] = 0.75 * v[k] - 0.3 * z[k];
      x[k] += 0.1 * v[k];
    }
    for (const NamedLoops& set : Runnable()) {
      SCOPED_TRACE(set.name);
      Vector v_here = v_before, x_here = x_before;
      set.loops.move(n, 0.75, 0.3, z.data(), 0.1, v_here.data(), x_here.data());
      EXPECT_EQ(v_here, v);
      EXPECT_EQ(x_here, x);
    }
  }
}

TEST(VectorLoops, LargestMagnitudeOfEveryPlace) {
  for (const NamedLoops& set : Runnable()) {
    SCOPED_TRACE(set.name);
    EXPECT_EQ(set.loops.max_norm(0, nullptr), 0.0);
    for (const int n : kLengths) {
      Vector x = Waves(n, 1.0);
      for (int v = 0; v < n; v += 1 + n / 40) {
        const double before = x[v];
        for (const double large : {-11.0, 11.0}) {
          x[v] = large;
          EXPECT_EQ(set.loops.max_norm(n, x.data()), 11.0) << v << " of " << n;
        }
        for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
          x[v] = bad;
          EXPECT_FALSE(std::isfinite(set.loops.max_norm(n, x.data())))
              << v << " of " << n << ": " << bad;
        }
        x[v] = before;
      }
    }
  }
}

// Of one piece among others, too.
TEST(VectorLoops, LargestMagnitudeOfPieces) {
  Vector x = Waves(3 * kVectorPiece + 5, 1.0);
  for (const int v : {0, kVectorPiece, 3 * kVectorPiece + 4}) {
    const double before = x[v];
    const int n = static_cast<int>(x.size());
    x[v] = -7.0;
    EXPECT_EQ(MaxNorm(n, x.data()), 7.0);
    for (const double bad : {std::nan(""), HUGE_VAL}) {
      x[v] = bad;
      EXPECT_FALSE(std::isfinite(MaxNorm(n, x.data())));
    }
    x[v] = before;
  }
}

}  // namespace
}  // namespace granopt
