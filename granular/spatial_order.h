// granopt: the order of grains in memory.

#ifndef GRANOPT_GRANULAR_SPATIAL_ORDER_H_
#define GRANOPT_GRANULAR_SPATIAL_ORDER_H_

#include <cstdint>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"

namespace granopt {

// Place along a Morton (Z) curve of 2^20 cells a side; x has `dimension`
// entries in [0, 1].
std::uint64_t MortonCode(const double* x, int dimension);

// Grains by their place on that curve through the cell: order[k] is the k-th.
// Only box and positions are looked at.
std::vector<int> SpatialOrder(const Packing& packing);

// Would an energy be faster in that order? Where a packing outgrows the
// second-level cache and grains next to each other in memory are mostly not so
// in the cell.
bool IsScattered(const Packing& packing);

// Grain order[k] becomes grain k.
Packing Reordered(const Packing& packing, const std::vector<int>& order);

// The inverse: grain k gets its name order[k] back.
Packing Restored(const Packing& packing, const std::vector<int>& order);
std::vector<Contact> Restored(std::vector<Contact> contacts,
                              const std::vector<int>& order);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_SPATIAL_ORDER_H_
