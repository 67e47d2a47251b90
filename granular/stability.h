// granopt: is a packing at a strict minimum of its energy?

#ifndef GRANOPT_GRANULAR_STABILITY_H_
#define GRANOPT_GRANULAR_STABILITY_H_

#include <string>
#include <vector>

#include "Eigen/Core"
#include "granular/contact_energy.h"

namespace granopt {

enum class StabilityVerdict {
  STRICT_MINIMUM,  // see Certify()
  SADDLE,          // stationary, but with a direction of negative curvature
  NOT_CERTIFIED,   // stationary; flat directions, or too close to that
  NOT_STATIONARY,  // the residual is too large for either
  DISCONNECTED,    // pieces that do not touch: each may translate
  UNJAMMED,        // nothing carries a force
  FAILED,          // the lowest mode could not be computed
};
// "strict minimum", "stationary, not a minimum", "stationary, not certified",
// "not stationary", "not certified, disconnected", "unjammed", "not certified".
const char* StabilityVerdictName(StabilityVerdict verdict);

struct StabilityOptions {
  // tau: eigenvalues within +-tau kappa of zero count as zero. Roundoff in H is
  // some 1e-15 kappa; the lowest eigenvalue of 1024 to 4096 discs was 2e-7 to
  // 1e-5 kappa between 1e-8 and 1e-6 above jamming.
  double zero = 1e-10;
  // Scales::vanishing up to which the energy counts as zero, as in
  // SolveOptions.
  double vanishing_tolerance = 1e-13;
  // Lowest modes wanted, at least one.
  int modes = 1;
};

// A normal mode of the grains that count: H e = eigenvalue e
// with |e| = 1, orthogonal to translations.
struct NormalMode {
  double eigenvalue = 0.0;  // energy / length^2
  double residual = 0.0;    // |H e - eigenvalue e|
  // (sum |e_i|^2)^2 / (N' sum |e_i|^4): 1 / N' on one grain, 1 on all alike.
  double participation = 0.0;
  Eigen::MatrixXd displacement;  // d x N; zero for grains that do not count
  // The fewest grains that carry half of sum |e_i|^2, largest first.
  std::vector<int> carriers;
};

struct Certificate {
  StabilityVerdict verdict = StabilityVerdict::FAILED;
  std::string message;  // one line: the numbers behind the verdict

  int grains = 0;    // N', those that count
  int contacts = 0;  // among them
  int pieces = 0;    // connected by those
  // kappa = (alpha - 1) mean force / mean overlap, over those.
  double stiffness = 0.0;
  double mean_overlap = 0.0;
  // max|g| of those contacts alone, and the largest force of any other contact,
  // both in mean forces.
  double residual = 0.0;
  double other_force = 0.0;
  // Of H in the complement of translations, in units of kappa; infinity for a
  // single grain, which has nothing else.
  double lowest_eigenvalue = 0.0;
  std::vector<NormalMode> modes;  // increasing eigenvalues
  // Where H is positive definite, and in units of the mean overlap: the largest
  // change of a separation in Newton's step, the smallest overlap and gap (of
  // gaps below 5 % of the smallest radius; infinity: none).
  double newton_step = 0.0;
  double smallest_overlap = 0.0;
  double smallest_gap = 0.0;
  // Of a STRICT_MINIMUM: |u - u_min| <= distance mean overlaps, translations
  // apart; E(u) - E(u_min) <= excess_energy E(u); pairs that may open or close
  // on the way.
  double distance = 0.0;
  double excess_energy = 0.0;
  int undecided_pairs = 0;

  bool IsStrictMinimum() const {
    return verdict == StabilityVerdict::STRICT_MINIMUM;
  }
};

// Tries to prove that the packing of `energy` at displacement u is at a strict
// minimum, up to what rounding leaves open.
//
// E' is the energy of the contacts with each other of grains that count
// (CountingGrains(): those that are held or carry forces), E' <= E.
//
// STRICT_MINIMUM means: E' has exactly one minimum, translations apart, in
//   B = {u + x : x.H x <= R^2},  R = 4 nu,  nu^2 = g.H^-1 g,
// it is strict and there is no other stationary point in B. Proof:
// (1) H - tau kappa 1 without the rows and columns of one grain has a Cholesky
// factor. Those with that grain held and the translations span everything, and
// H t = 0 for a translation t, so H > 0 on the complement of translations;
// adding a translation only lengthens a vector there, so that its lowest
// eigenvalue lambda there exceeds tau kappa. (2) In B a separation changes by
// |s| <= sqrt(2 / lambda) R, along the contact by
// |n.s| <= R sqrt((1 + |H_p| / lambda) / kappa_c) with the pre-stress H_p, as
// x.(H + H_p) x >= kappa_c (n.s)^2. From these follow, for each contact and for
// each gap that could close, bounds of stiffness, force, length and direction,
// and a matrix H_- below every H in B, those across an opening or closing
// contact included. (3) 2 H_- - H, the same grain held, has a Cholesky factor
// (with 1e-13 kappa to spare). Then E'(u + x) >= E'(u) + g.x + x.H x / 4, which
// exceeds E'(u) where x.H x = R^2, and E' is strictly convex in B.
// What is taken on trust: lambda in (2) is that of a converged Lanczos run; the
// gradient has an error of 16 eps mean forces an entry, which is added to nu.
// Rattlers can move freely and are no part of the statement.
//
// Does not depend on the neighbour list or reference of `energy`. Energies in
// units of 2^a and lengths in units of 2^b give bitwise the scaled result (as
// far as the contact law does).
Certificate Certify(const ContactEnergy& energy,
                    const double* u,
                    const StabilityOptions& options);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_STABILITY_H_
