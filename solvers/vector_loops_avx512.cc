#include "solvers/vector_loops.h"

#define GRANOPT_LANES 8

namespace granopt {
namespace {

#include "solvers/vector_loops.inc"

}  // namespace

extern const VectorLoops kAvx512Vectors = GRANOPT_VECTOR_LOOPS;

}  // namespace granopt
