#include "solvers/dense_panel.h"

#define GRANOPT_LANES 8
#define GRANOPT_VECTORS 3

namespace granopt {
namespace {

#include "solvers/dense_panel.inc"

}  // namespace

extern const DensePanel kAvx512Panel = {
    "AVX-512", FactorPanel, UpdateLower, SubtractProduct, Product};

}  // namespace granopt
