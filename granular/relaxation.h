// granopt: one minimization of a packing, with what is measured on the result.

#ifndef GRANOPT_GRANULAR_RELAXATION_H_
#define GRANOPT_GRANULAR_RELAXATION_H_

#include <cstdint>
#include <functional>
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

// Minimizes the energy of `start` with `solver`, in the memory order of
// spatial_order.h where that is faster: the result has the order of `start`, a
// callback sees the other one. Returns false with one line in `error` if the
// packing cannot be simulated; a method that fails is no error but
// Relaxation::summary.
bool Relax(const Packing& start,
           const ContactEnergyOptions& energy_options,
           const Solver& solver,
           const SolveOptions& solve_options,
           Relaxation* result,
           std::string* error);

// Where a relaxation in legs stands: all that the next leg depends on.
struct RelaxationState {
  Packing packing;  // the start, then the best point so far
  Summary summary;  // of all legs
  std::int64_t list_builds = 0;
  int legs = 0;
};

// Evaluations a leg: some minutes of a first-order method. A packing of 4096
// discs takes a million; shorter runs have one leg and are those of Relax().
std::int64_t LegEvaluations(const Packing& packing);

// As Relax(), but the method starts afresh, from the best point so far, after
// every `leg` evaluations; `observer` is shown the state between two legs. A
// run that goes on from such a state ends bit by bit where the whole one does.
bool RelaxInLegs(const ContactEnergyOptions& energy_options,
                 const Solver& solver,
                 const SolveOptions& solve_options,
                 std::int64_t leg,
                 const std::function<void(const RelaxationState&)>& observer,
                 RelaxationState* state,
                 Relaxation* result,
                 std::string* error);

// The second half of Relax(), for those who call Minimize() themselves: what is
// measured at the point `u` that it ended with. Recenters `energy` there and
// leaves it in double precision: the summary of a run that ended in single
// precision gets the residual in double, and NO_PROGRESS if that is too large.
Relaxation Conclude(Summary summary, const double* u, ContactEnergy* energy);

// What Conclude() measures, of a packing that nothing has minimized. Returns
// false with one line in `error` where ContactEnergy::Create() does.
bool MeasureAsItIs(const Packing& packing,
                   const ContactEnergyOptions& energy_options,
                   Relaxation* result,
                   std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_RELAXATION_H_
