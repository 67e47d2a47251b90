#include <cstdint>
#include <tuple>

#include "granular/contact_law.h"
#include "granular/pair_loops.h"
#include "solvers/instruction_set.h"

#define GRANOPT_LANES 2

namespace granopt {
namespace {

#include "granular/pair_loops.inc"

}  // namespace

PairLoops PortablePairLoops(int dimension, double alpha) {
  return Find(dimension, alpha);
}

PairLoops FastestPairLoops(int dimension, double alpha) {
#ifdef __x86_64__
  if (Runs(InstructionSet::AVX512)) return Avx512PairLoops(dimension, alpha);
  if (Runs(InstructionSet::AVX2)) return Avx2PairLoops(dimension, alpha);
#endif
  return PortablePairLoops(dimension, alpha);
}

}  // namespace granopt
