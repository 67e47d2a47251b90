// granopt: random numbers, which searches use, too.

#ifndef GRANOPT_GRANULAR_RANDOM_H_
#define GRANOPT_GRANULAR_RANDOM_H_

#include "solvers/random.h"  // IWYU pragma: export

#endif  // GRANOPT_GRANULAR_RANDOM_H_
