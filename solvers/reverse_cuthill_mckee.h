// granopt: an ordering of sparse symmetric matrices with a small band.

#ifndef GRANOPT_SOLVERS_REVERSE_CUTHILL_MCKEE_H_
#define GRANOPT_SOLVERS_REVERSE_CUTHILL_MCKEE_H_

#include <vector>

#include "solvers/second_order.h"

namespace granopt {

// order[k] is the unknown that comes k-th. Each connected component starts from
// an end of it (a pseudo-peripheral node).
// Source: Cuthill, McKee, Proc. 24th Nat. Conf. ACM (1969) 157; reversed after
// George, Liu, Computer Solution of Large Sparse Positive Definite Systems
// (1981).
std::vector<int> ReverseCuthillMcKee(const SparseMatrix& lower);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_REVERSE_CUTHILL_MCKEE_H_
