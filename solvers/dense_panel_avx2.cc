#include "solvers/dense_panel.h"

#define GRANOPT_LANES 4
#define GRANOPT_VECTORS 2

namespace granopt {
namespace {

#include "solvers/dense_panel.inc"

}  // namespace

extern const DensePanel kAvx2Panel = {
    "AVX2", FactorPanel, UpdateLower, SubtractProduct, Product};

}  // namespace granopt
