#include <cstdint>
#include <tuple>

#include "granular/contact_law.h"
#include "granular/pair_loops.h"
#include "immintrin.h"

#define GRANOPT_LANES 4

namespace granopt {
namespace {

#include "granular/pair_loops.inc"

}  // namespace

PairLoops Avx2PairLoops(int dimension, double alpha) {
  return Find(dimension, alpha);
}

}  // namespace granopt
