// granopt: several operations on long vectors in one pass through memory.

#ifndef GRANOPT_SOLVERS_VECTOR_BLOCKS_H_
#define GRANOPT_SOLVERS_VECTOR_BLOCKS_H_

#include <algorithm>
#include <array>
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

// The same for f(first, length, sums), which adds to kSums sums; `add(part,
// sums)` joins those of two pieces, from left to right.
template <std::size_t kSums, typename Function, typename Add>
std::array<double, kSums> ReduceBlocks(int n,
                                       const Function& f,
                                       const Add& add) {
  using Sums = std::array<double, kSums>;
  Sums sums = {};
  if (n <= kVectorPiece) {
    ForBlocks(n, [&](int at, int length) { f(at, length, &sums); });
    return sums;
  }
  std::vector<Sums> parts((n + kVectorPiece - 1) / kVectorPiece, Sums{});
  ForBlocks(
      n, [&](int at, int length) { f(at, length, &parts[at / kVectorPiece]); });
  for (const Sums& part : parts) add(part, &sums);
  return sums;
}

template <std::size_t kSums, typename Function>
std::array<double, kSums> SumBlocks(int n, const Function& f) {
  using Sums = std::array<double, kSums>;
  return ReduceBlocks<kSums>(n, f, [](const Sums& part, Sums* sums) {
    for (std::size_t k = 0; k < kSums; ++k) (*sums)[k] += part[k];
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
