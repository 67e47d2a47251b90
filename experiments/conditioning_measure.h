// granopt: what `conditioning` measures: the spectrum of P^-1 H, and which
// contacts a shear step and Newton's first step of it change.

#ifndef GRANOPT_EXPERIMENTS_CONDITIONING_MEASURE_H_
#define GRANOPT_EXPERIMENTS_CONDITIONING_MEASURE_H_

#include <memory>
#include <string>
#include <vector>

#include "experiments/conditioning_records.h"
#include "granular/contact_energy.h"
#include "granular/observables.h"
#include "granular/packing.h"
#include "solvers/condition.h"
#include "solvers/preconditioner.h"

namespace granopt {

// The preconditioner that is the mean stiffness kappa times 1.
constexpr char kNone[] = "none";

// A packing and what is measured on it.
struct State {
  Packing packing;
  std::unique_ptr<ContactEnergy> energy;
  std::vector<double> zero;
  std::vector<Contact> contacts;
  Observables observables;
  std::vector<bool> counts;
  Scales scales;
  double cost = 0.0;
  std::vector<double> gradient;
};

// BadInput if the energy refuses the packing.
State Examine(const Packing& packing, const ContactEnergyOptions& law);

// The Hessian of the grains that count.
SparseMatrix HessianAt(const State& state);

// The matrix of the preconditioner `spec` made at a state; false, with the
// reason in `why`, if there is none.
bool MakeP(const std::string& spec,
           const State& state,
           SparseMatrix* p,
           std::string* why);

// The spectrum of P^-1 H, with `h` of `state`, beside its blind motions.
ConditionRow Measured(const SparseMatrix& h,
                      const State& state,
                      const SparseMatrix& p);

// `deformed`: the state before under `strain`; `after`: relaxed from there,
// null if that is at no jammed minimum.
ChangeRow MeasuredChange(const State& before,
                         const State& deformed,
                         const State* after,
                         double strain);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CONDITIONING_MEASURE_H_
