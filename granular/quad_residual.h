// granopt: the judge.
//
// Energy, forces and residual of a packing in quadruple precision (__float128,
// 33 digits), straight from (4)-(8) without the difference form of the kernel:
// the oracle that tests compare the kernel with, and the number that a result
// is judged by.

#ifndef GRANOPT_GRANULAR_QUAD_RESIDUAL_H_
#define GRANOPT_GRANULAR_QUAD_RESIDUAL_H_

#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"

namespace granopt {

struct QuadResidual {
  double energy = 0.0;        // rounded from quadruple
  double max_gradient = 0.0;  // max |dE/dx|
  double mean_force = 0.0;    // over contacts
  int contacts = 0;
  std::vector<double> gradient;  // d N, each rounded once

  // max_gradient / mean_force; 0 without contacts.
  double Relative() const {
    return mean_force > 0.0 ? max_gradient / mean_force : 0.0;
  }
};

// `displacements` (d N entries) may be null: zero. Returns false with one line
// in `error` where ContactEnergy::Create() would.
bool EvaluateQuad(const Packing& packing,
                  const ContactEnergyOptions& options,
                  const double* displacements,
                  QuadResidual* result,
                  std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_QUAD_RESIDUAL_H_
