#include "solvers/vector_loops.h"

#define GRANOPT_LANES 4

namespace granopt {
namespace {

#include "solvers/vector_loops.inc"

}  // namespace

extern const VectorLoops kAvx2Vectors = GRANOPT_VECTOR_LOOPS;

}  // namespace granopt
