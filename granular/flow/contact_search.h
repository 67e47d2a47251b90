// granopt: which grains of a flow overlap.

#ifndef GRANOPT_GRANULAR_FLOW_CONTACT_SEARCH_H_
#define GRANOPT_GRANULAR_FLOW_CONTACT_SEARCH_H_

#include <vector>

namespace granopt {

// Two grains that overlap.
struct ClosePair {
  int i = 0;
  int j = 0;
  double distance = 0.0;
  double normal[3] = {};  // n_ij, from i to j; 0 for coincident centres
};

// All pairs with |r_j - r_i| < b_i + b_j, in increasing order of (i, j). `x` in
// the layout of near_field_loops.h; `period` > 0: with the nearest image in a
// cube of that side (at least two diameters wide, else images beyond the
// nearest would be missed: the caller checks). A grid of cells, one diameter of
// the largest grain wide or more; O(n) for grains of similar size.
class ContactSearch {
 public:
  void Find(int n,
            int stride,
            const double* x,
            const double* radius,
            double period,
            std::vector<ClosePair>* pairs);

 private:
  // Grid: grains sorted by cell.
  std::vector<int> cell_, start_, sorted_;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_CONTACT_SEARCH_H_
