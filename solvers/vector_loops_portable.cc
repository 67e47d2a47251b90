#include "solvers/vector_loops.h"

#define GRANOPT_LANES 2

namespace granopt {
namespace {

#include "solvers/vector_loops.inc"

}  // namespace

extern const VectorLoops kPortableVectors = GRANOPT_VECTOR_LOOPS;

}  // namespace granopt
