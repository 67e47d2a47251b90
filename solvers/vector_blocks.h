// granopt: several operations on long vectors in one pass through memory.

#ifndef GRANOPT_SOLVERS_VECTOR_BLOCKS_H_
#define GRANOPT_SOLVERS_VECTOR_BLOCKS_H_

#include <algorithm>

namespace granopt {

// f(first, length) for consecutive pieces of [0, n), so short that a few
// vectors of that length stay in the first-level cache.
template <typename Function>
void ForBlocks(int n, const Function& f) {
  constexpr int kLength = 512;
  for (int at = 0; at < n; at += kLength) f(at, std::min(kLength, n - at));
}

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_VECTOR_BLOCKS_H_
