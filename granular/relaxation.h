// granopt: one minimization of a packing, with what is measured on the result.

#ifndef GRANOPT_GRANULAR_RELAXATION_H_
#define GRANOPT_GRANULAR_RELAXATION_H_

#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/observables.h"
#include "granular/packing.h"
#include "solvers/solver.h"

namespace granopt {

struct Relaxation {
  Packing packing;  // the minimizer C_eq = arg min E(phi, C_ref), wrapped
  std::vector<Contact> contacts;
  Observables observables;
  Summary summary;
  std::int64_t list_builds = 0;
};

// Minimizes the energy of `start` with `solver`. Returns false with one line in
// `error` if the packing cannot be simulated; a method that fails is no error
// but Relaxation::summary.
bool Relax(const Packing& start,
           const ContactEnergyOptions& energy_options,
           const Solver& solver,
           const SolveOptions& solve_options,
           Relaxation* result,
           std::string* error);

// The second half of Relax(), for those who call Minimize() themselves: what is
// measured at the point `u` that it ended with. Recenters `energy` there and
// leaves it in double precision: the summary of a run that ended in single
// precision gets the residual in double, and NO_PROGRESS if that is too large.
Relaxation Conclude(Summary summary, const double* u, ContactEnergy* energy);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_RELAXATION_H_
