// granopt: quasistatic pure shear of a packing (paper, sec. 4.3, Fig. 8).

#ifndef GRANOPT_GRANULAR_QUASISTATIC_SHEAR_H_
#define GRANOPT_GRANULAR_QUASISTATIC_SHEAR_H_

#include <functional>
#include <string>

#include "granular/relaxation.h"

namespace granopt {

struct QuasistaticShearOptions {
  ContactEnergyOptions energy;
  // For each relaxation.
  SolveOptions solve;
  double strain = 0.02;  // gamma at the end, > -1
  int steps = 200;
};

// A state on the way. Step 0 is the start as it is, which nothing relaxes.
struct QuasistaticShearStep {
  int step = 0;
  double strain = 0.0;  // gamma so far
  // What the boundary has done to the packing in this step,
  //   W = -V sigma : ln D_k (sigma positive in compression),
  // with the mean of the stress before and after: E_k - E_(k-1) to third order
  // in the strain where nothing rearranges, otherwise
  double work = 0.0;
  // E_(k-1) + W - E_k, what the rearrangements have dissipated.
  double dissipated = 0.0;
  const Relaxation* result = nullptr;  // valid during the call
};

struct QuasistaticShearResult {
  Relaxation last;
  double strain = 0.0;
  int relaxations = 0;
  // Relaxations whose method gave up; the next step starts from its best point.
  int gave_up = 0;
  Counters counters;  // sums
  double seconds = 0.0;
};

// Deforms cell and centres by
//   D(gamma) = diag(1 + gamma, 1 / (1 + gamma)), 1 in the third dimension,
// in `steps` equal increments of gamma, gamma_k = k gamma / steps, each
//   D_k = D(gamma_k) D(gamma_(k-1))^-1
// of the state before, and minimizes the energy after each with the cell fixed.
//
// `observer` (may be empty) sees the start and every relaxed state; returning
// false ends the run. Returns false with one line in `error` if the observer
// stopped, if the packing cannot be simulated, or for bad options. Methods that
// give up are counted, not errors.
bool ShearQuasistatically(
    const Packing& start,
    const QuasistaticShearOptions& options,
    const Solver& solver,
    const std::function<bool(const QuasistaticShearStep&)>& observer,
    QuasistaticShearResult* result,
    std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_QUASISTATIC_SHEAR_H_
