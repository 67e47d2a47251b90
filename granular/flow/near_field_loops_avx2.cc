#include "granular/flow/near_field_loops.h"
#include "immintrin.h"

#define GRANOPT_LANES 4

namespace granopt {
namespace {

#include "granular/flow/near_field_loops.inc"

}  // namespace

NearFieldLoops Avx2NearFieldLoops(const RadialLaw& law, bool has_images) {
  return LoopsOf(law, has_images);
}

}  // namespace granopt
