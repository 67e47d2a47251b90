#include "solvers/vector_loops.h"

#include <algorithm>
#include <vector>

#include "solvers/instruction_set.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

const VectorLoops& Loops() {
  static const VectorLoops& fastest = FastestVectors();
  return fastest;
}

// f(first, length) for the pieces of [0, n).
template <typename Function>
void ForPieces(int n, const Function& f) {
  if (n <= kVectorPiece) return f(0, n);
  ForEach((n + kVectorPiece - 1) / kVectorPiece, [&](int k) {
    const int at = k * kVectorPiece;
    f(at, std::min(kVectorPiece, n - at));
  });
}

// f(first, length, sums) for each piece; `add` joins what two have found, from
// left to right.
template <std::size_t count, typename Function, typename Add>
std::array<double, count> Reduce(int n, const Function& f, const Add& add) {
  std::array<double, count> total;
  if (n <= kVectorPiece) {
    f(0, n, total.data());
    return total;
  }
  std::vector<std::array<double, count>> parts((n + kVectorPiece - 1) /
                                               kVectorPiece);
  ForPieces(n, [&](int at, int length) {
    f(at, length, parts[at / kVectorPiece].data());
  });
  total = parts[0];
  for (std::size_t k = 1; k < parts.size(); ++k) {
    for (std::size_t c = 0; c < count; ++c) {
      total[c] = add(total[c], parts[k][c]);
    }
  }
  return total;
}

template <std::size_t count, typename Function>
std::array<double, count> Sum(int n, const Function& f) {
  return Reduce<count>(n, f, [](double a, double b) { return a + b; });
}

}  // namespace

const VectorLoops& FastestVectors() {
#ifdef __x86_64__
  if (Runs(InstructionSet::AVX512)) return kAvx512Vectors;
  if (Runs(InstructionSet::AVX2)) return kAvx2Vectors;
#endif
  return kPortableVectors;
}

void CopyVector(int n, const double* from, double* to) {
  ForPieces(n, [&](int at, int length) {
    std::copy(from + at, from + at + length, to + at);
  });
}

double MaxNorm(int n, const double* x) {
  // Not std::max(): a NaN must not be passed over.
  return Reduce<1>(
      n,
      [&](int at, int length, double* norm) {
        *norm = Loops().max_norm(length, x + at);
      },
      [](double a, double b) { return b <= a   ? a
                                      : a <= b ? b
                                               : a + b; })[0];
}

double Dot(int n, const double* a, const double* b) {
  return Sum<1>(n, [&](int at, int length, double* sum) {
    *sum = Loops().dot(length, a + at, b + at);
  })[0];
}

std::array<double, 3> Dots(int n, const double* a, const double* b) {
  return Sum<3>(n, [&](int at, int length, double* sums) {
    Loops().dots(length, a + at, b + at, sums);
  });
}

double Combine(int n,
               double scale,
               const double* x,
               double a,
               const double* z,
               double* y,
               const double* b) {
  return Sum<1>(n, [&](int at, int length, double* sum) {
    *sum = Loops().combine(length,
                           scale,
                           x + at,
                           a,
                           z + at,
                           y + at,
                           b == nullptr ? nullptr : b + at);
  })[0];
}

std::array<double, 3> Differences(int n,
                                  const double* x_new,
                                  const double* x,
                                  const double* g_new,
                                  const double* g,
                                  double* s,
                                  double* y) {
  return Sum<3>(n, [&](int at, int length, double* sums) {
    Loops().differences(
        length, x_new + at, x + at, g_new + at, g + at, s + at, y + at, sums);
  });
}

void Move(int n,
          double keep,
          double push,
          const double* z,
          double h,
          double* v,
          double* x) {
  ForPieces(n, [&](int at, int length) {
    Loops().move(length, keep, push, z + at, h, v + at, x + at);
  });
}

}  // namespace granopt
