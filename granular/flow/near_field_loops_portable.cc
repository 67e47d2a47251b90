#include "granular/flow/near_field_loops.h"
#include "solvers/instruction_set.h"

#define GRANOPT_LANES 2

namespace granopt {
namespace {

#include "granular/flow/near_field_loops.inc"

}  // namespace

NearFieldLoops PortableNearFieldLoops(const RadialLaw& law, bool has_images) {
  return LoopsOf(law, has_images);
}

NearFieldLoops FastestNearFieldLoops(const RadialLaw& law, bool has_images) {
#ifdef __x86_64__
  if (Runs(InstructionSet::AVX512))
    return Avx512NearFieldLoops(law, has_images);
  if (Runs(InstructionSet::AVX2)) return Avx2NearFieldLoops(law, has_images);
#endif
  return PortableNearFieldLoops(law, has_images);
}

}  // namespace granopt
