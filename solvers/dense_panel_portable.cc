#include "solvers/dense_panel.h"

#define GRANOPT_LANES 2
#define GRANOPT_VECTORS 2

namespace granopt {
namespace {

#include "solvers/dense_panel.inc"

}  // namespace

extern const DensePanel kPortablePanel = {
    "portable", FactorPanel, UpdateLower, SubtractProduct, Product};

}  // namespace granopt
