// granopt: quasistatic deformation of a packing: pure shear (paper, sec. 4.3,
// Fig. 8), simple shear in a Lees-Edwards cell, and compression.

#ifndef GRANOPT_GRANULAR_QUASISTATIC_SHEAR_H_
#define GRANOPT_GRANULAR_QUASISTATIC_SHEAR_H_

#include <functional>
#include <string>
#include <vector>

#include "granular/relaxation.h"

namespace granopt {

// How the cell is deformed, x -> F(gamma) x; 1 in the third dimension of
// shears.
enum class DeformationMode {
  PURE_SHEAR,    // F = diag(1 + gamma, 1 / (1 + gamma)), gamma > -1 (sec. 4.3)
  SIMPLE_SHEAR,  // F = 1 + gamma e_1 (x) e_2, any gamma (sec. 2.3)
  BULK,          // F = (1 + gamma)^(1/d) 1: gamma = V / V_0 - 1 > -1
};
// "pure", "simple", "bulk".
const char* DeformationModeName(DeformationMode mode);

// F(to) F(from)^-1, and its logarithm: the strain that work is done through.
SmallMatrix DeformationIncrement(DeformationMode mode,
                                 int dimension,
                                 double from,
                                 double to);
SmallMatrix StrainIncrement(DeformationMode mode,
                            int dimension,
                            double from,
                            double to);

// The stress that works against the strain of `mode`, of a stress that is
// positive in compression: dE / (V dgamma) at gamma = 0,
//   sigma_22 - sigma_11 (pure), -sigma_12 (simple), -p (bulk).
double ConjugateStress(DeformationMode mode, const SmallMatrix& stress);

// Deforms cell and centres from strain `from` to `to`. In simple shear the cell
// is kept in fixed point (Box::Rounded: strains change by 1e-15 at most) and
// folded once it is skewed by more than half an edge, so that any strain is
// served: contacts and forces stay what they are, to the last digit, whichever
// cell of the lattice is in use.
void DeformTo(DeformationMode mode, double from, double to, Packing* packing);

struct QuasistaticShearOptions {
  ContactEnergyOptions energy;
  // For each relaxation.
  SolveOptions solve;
  DeformationMode mode = DeformationMode::PURE_SHEAR;
  double strain = 0.02;  // gamma at the end
  int steps = 200;
  // The strains of steps 1, 2, ... one by one, for cycles; empty: `strain` in
  // `steps` equal increments.
  std::vector<double> path;
  // Positive: after each increment the volume relaxes, too, until the pressure
  // is this one (constant_stress.h, the isotropic strain); not with BULK.
  double pressure = 0.0;
};

// Where a run stands between two steps: plain data, all that the next one
// depends on. A run that goes on from a copy ends bitwise where the
// uninterrupted one does.
struct QuasistaticShearState {
  int step = 0;  // done; 0: the start
  double strain = 0.0;
  Packing packing;  // relaxed
  double energy = 0.0;
  SmallMatrix stress = SmallMatrix::Zero(2, 2);
  int relaxations = 0;
  int gave_up = 0;
  Counters counters;
  double seconds = 0.0;
};

// A state on the way. Step 0 is the start as it is, which nothing relaxes.
struct QuasistaticShearStep {
  int step = 0;
  double strain = 0.0;  // gamma so far
  // What the boundary has done to the packing in this step,
  //   W = -V sigma : ln D_k (sigma positive in compression),
  // with the mean of V sigma before and after: E_k - E_(k-1) to third order
  // in the strain where nothing rearranges. At constant pressure the strain
  // includes that of the volume.
  double work = 0.0;
  // E_(k-1) + W - E_k, what the rearrangements have dissipated.
  double dissipated = 0.0;
  // Valid during the call: of this state, what comes after it depends on, and
  // the state before.
  const Relaxation* result = nullptr;
  const QuasistaticShearState* state = nullptr;
  const QuasistaticShearState* before = nullptr;  // null at step 0
};

struct QuasistaticShearResult {
  // The last state; without packing if a run is continued that was complete.
  Relaxation last;
  double strain = 0.0;
  int relaxations = 0;
  // Relaxations whose method gave up; the next step starts from its best point.
  int gave_up = 0;
  Counters counters;  // sums
  double seconds = 0.0;
};

// Deforms cell and centres by F(gamma_k), each step by
//   D_k = F(gamma_k) F(gamma_(k-1))^-1
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

// The same from the state that an observer of an earlier run was shown: steps
// state->step + 1, ... `state` is left where the run ended.
bool ContinueShear(
    const QuasistaticShearOptions& options,
    const Solver& solver,
    const std::function<bool(const QuasistaticShearStep&)>& observer,
    QuasistaticShearState* state,
    QuasistaticShearResult* result,
    std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_QUASISTATIC_SHEAR_H_
