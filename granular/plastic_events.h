// granopt: plastic events of a quasistatically deformed packing.

#ifndef GRANOPT_GRANULAR_PLASTIC_EVENTS_H_
#define GRANOPT_GRANULAR_PLASTIC_EVENTS_H_

#include <string>
#include <vector>

#include "granular/quasistatic_shear.h"

namespace granopt {

struct PlasticEventOptions {
  ContactEnergyOptions energy;
  // For each relaxation. Next to an instability forces are balanced almost
  // everywhere: the tolerance decides whether the packing is seen to move at
  // all, and is at most 1e-12 here. A bound of evaluations belongs here, too:
  // first-order methods may take for ever through such a place.
  SolveOptions solve;
  DeformationMode mode = DeformationMode::PURE_SHEAR;
  // The strain is located to this, > 0.
  double width = 1e-10;
  // Follow the lowest eigenvalue to the event.
  bool follow_mode = true;
};

// A state on the branch that ends at the event.
struct BranchPoint {
  double strain = 0.0;
  double energy = 0.0;
  double stress = 0.0;             // ConjugateStress()
  double lowest_eigenvalue = 0.0;  // Certificate, in kappa; 0: not asked for
};

struct PlasticEvent {
  // False: the branch goes on through the step. It has contacts that change,
  // or an instability that a step as large as that one runs into and the
  // branch does not.
  bool found = false;
  double strain_before = 0.0;  // the last strain on the branch
  double strain_after = 0.0;   // the first beyond it, `width` further
  Relaxation before, after;
  std::vector<BranchPoint> branch;  // in order of strain, to `before`
  // E(before) + W - E(after), W the work through the width: what is dissipated
  // at fixed strain; >= 0 up to roundoff.
  double energy_drop = 0.0;
  // Conjugate stress before minus after, and pressure likewise.
  double stress_drop = 0.0;
  double pressure_drop = 0.0;
  // Of the grains at fixed strain, d x N: x_after - F x_before by the shortest
  // image, without the mean over those that are rigid in both states.
  Eigen::MatrixXd displacement;
  // (sum |u_i|^2)^2 / (N' sum |u_i|^4) over those.
  double participation = 0.0;
  int contacts_opened = 0;
  int contacts_closed = 0;
  // The way back from `before` to the beginning of the step, against the state
  // that began it: |E' - E| / E, and the largest |u| of its rigid grains in
  // mean overlaps.
  double reversal_energy = 0.0;
  double reversal_displacement = 0.0;
  int relaxations = 0;
  int unconverged = 0;  // of those
};

// Looks for the instability in the step of `mode` from strain `from`, where
// `start` is relaxed, to `to`: halves the interval, following the branch from
// its last known state, until it is as narrow as `width`. A trial belongs to
// the branch if E_(k-1) + W - E_k is at most a tenth of what the whole step
// dissipates: on the branch that is an error of the third order of the strain
// (of order 3/2 next to the instability), beyond it it stays. What is found is
// therefore the first event that dissipates at least that much.
//
// Returns false with one line in `error` if the packing cannot be simulated or
// for bad options.
//
// Source: Maloney and Lemaitre, Phys. Rev. E 74 (2006) 016118 (events are
// saddle-node bifurcations: the lowest eigenvalue vanishes as the square root
// of the strain that is left).
bool LocateEvent(const Packing& start,
                 double from,
                 double to,
                 const PlasticEventOptions& options,
                 const Solver& solver,
                 PlasticEvent* event,
                 std::string* error);

// x_b - x_a of two packings of the same grains and cell by the shortest image
// of the lattice, without the mean over grains that count.
Eigen::MatrixXd DisplacementBetween(const Packing& a,
                                    const Packing& b,
                                    const std::vector<bool>& counts);

// Amplitudes a_m of the radial part of a displacement around `centre`,
//   a_m = |mean of u_r exp(i m theta)|, m = 0, 1, ... size - 1,
// over grains at distances in [inner, outer] (of the shortest image; d = 2).
// An elastic inclusion, the far field of a plastic event, is m = 2.
std::vector<double> RadialHarmonics(const Packing& packing,
                                    const Eigen::MatrixXd& displacement,
                                    int centre,
                                    double inner,
                                    double outer,
                                    int size);

// E along the straight way x_before + t u, t = 0 ... 1 in `points` values, at
// the strain after the event: the landscape that it has come down.
bool EnergyAlong(const PlasticEvent& event,
                 const PlasticEventOptions& options,
                 int points,
                 std::vector<double>* energy,
                 std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PLASTIC_EVENTS_H_
