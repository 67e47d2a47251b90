// granopt: several operations on long vectors in one pass through memory.

#ifndef GRANOPT_SOLVERS_VECTOR_BLOCKS_H_
#define GRANOPT_SOLVERS_VECTOR_BLOCKS_H_

#include <algorithm>
#include <cstddef>
#include <vector>

#include "Eigen/Core"
#include "solvers/threads.h"

namespace granopt {

// Pieces that go to one thread or another, and blocks of which a few vectors
// stay in the first-level cache.
constexpr int kVectorPiece = 16384;
constexpr int kVectorBlock = 512;
static_assert(kVectorPiece % kVectorBlock == 0, "");

// f(first, length) for the pieces of [0, n), on NumThreads() threads.
template <typename Function>
void ForVectorPieces(int n, const Function& f) {
  if (n <= kVectorPiece) return f(0, n);
  ForEach((n + kVectorPiece - 1) / kVectorPiece, [&](int k) {
    const int at = k * kVectorPiece;
    f(at, std::min(kVectorPiece, n - at));
  });
}

// f(first, length) for the blocks of [0, n), on NumThreads() threads.
template <typename Function>
void ForBlocks(int n, const Function& f) {
  ForVectorPieces(n, [&](int at, int length) {
    for (const int end = at + length; at < end; at += kVectorBlock) {
      f(at, std::min(kVectorBlock, end - at));
    }
  });
}

// The same for f(first, length, sums), which adds to `count` sums; `add(part,
// sums)` joins those of two pieces, from left to right.
template <typename Function, typename Add>
std::vector<double> ReduceBlocks(int n,
                                 int count,
                                 const Function& f,
                                 const Add& add) {
  const int pieces = std::max(1, (n + kVectorPiece - 1) / kVectorPiece);
  std::vector<double> parts(static_cast<std::size_t>(pieces) * count, 0.0);
  ForBlocks(n, [&](int at, int length) {
    f(at, length, &parts[static_cast<std::size_t>(at / kVectorPiece) * count]);
  });
  for (int k = 1; k < pieces; ++k) add(&parts[k * count], parts.data());
  parts.resize(count);
  return parts;
}

template <typename Function>
std::vector<double> SumBlocks(int n, int count, const Function& f) {
  return ReduceBlocks(n, count, f, [count](const double* part, double* sums) {
    for (int k = 0; k < count; ++k) sums[k] += part[k];
  });
}

inline double Dot(int n, const double* a, const double* b) {
  using ConstMap = Eigen::Map<const Eigen::VectorXd>;
  if (n <= kVectorPiece) return ConstMap(a, n).dot(ConstMap(b, n));
  std::vector<double> parts((n + kVectorPiece - 1) / kVectorPiece);
  ForVectorPieces(n, [&](int at, int length) {
    parts[at / kVectorPiece] =
        ConstMap(a + at, length).dot(ConstMap(b + at, length));
  });
  double sum = 0.0;
  for (const double part : parts) sum += part;
  return sum;
}

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_VECTOR_BLOCKS_H_
