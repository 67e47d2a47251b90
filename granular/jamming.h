// granopt: the jamming point of a packing (paper, sec. 2.4, Algorithm 1).

#ifndef GRANOPT_GRANULAR_JAMMING_H_
#define GRANOPT_GRANULAR_JAMMING_H_

#include <functional>
#include <string>

#include "granular/relaxation.h"

namespace granopt {

enum class JammingStage { START, GROWTH, BISECTION, DECOMPRESSION };
enum class JammingVerdict { UNJAMMED, JAMMED, UNDECIDED };
const char* JammingStageName(JammingStage stage);        // "growth"
const char* JammingVerdictName(JammingVerdict verdict);  // "jammed"

struct JammingOptions {
  ContactEnergyOptions energy;
  // For each relaxation. vanishing_tolerance decides what counts as E = 0; in
  // the decompression it is at most error_bar / 100, so that growth and
  // bisection do not depend on the error bar.
  SolveOptions solve;
  double phi_init = 0.8;
  double phi_increment = 1e-3;  // delta phi
  double accuracy = 1e-6;       // epsilon, of the bisection
  // Then follow the jammed branch down until the error bar is at most this.
  // Infinity: the published algorithm, whose bisection may end on a state that
  // is well above its own jamming point.
  double error_bar = 1e-8;
  // A relaxation that its method gave up counts as jammed if max|g| is at most
  // this part of the mean force, else it is repeated from where it ended.
  double undecided_residual = 1e-3;
  int max_attempts = 5;
};

struct JammingStep {
  JammingStage stage = JammingStage::START;
  int relaxation = 0;  // from 1
  double phi = 0.0;
  JammingVerdict verdict = JammingVerdict::UNDECIDED;
  const Relaxation* result = nullptr;  // valid during the call
  // The bracket so far: phi_ref unjammed, phi_app jammed (0 while unknown), and
  // in the decompression the error bar.
  double phi_unjammed = 0.0;
  double phi_jammed = 0.0;
  double distance = 0.0;
};

struct JammingResult {
  Packing start;        // relaxed at phi_init
  Packing unjammed;     // the last unjammed state before the jammed one
  Relaxation jammed;    // the jammed state of least packing fraction
  double phi_cr = 0.0;  // its packing fraction
  // (alpha - 1) p / p' with p' = dp/dphi along the branch: how far the jammed
  // state is above its own jamming point, p ~ (phi - phi_J)^(alpha-1).
  double distance = 0.0;
  double phi_j = 0.0;  // phi_cr - distance
  // True if distance <= min(error_bar, accuracy).
  bool converged = false;
  // Where p' comes from: two states of the branch, or the affine estimate.
  bool secant = false;
  // How often growth and bisection were run: once more for every branch that
  // ended at a finite pressure on the way down.
  int cycles = 0;
  int relaxations = 0;
  Counters counters;  // sums
  double seconds = 0.0;
};

// Algorithm 1 from `start`, whose radii are first scaled to phi_init: relax,
// grow radii by delta phi at fixed positions until a state is jammed, bisect
// between the last unjammed and the first jammed packing fraction to epsilon,
// then (if asked) decompress along the jammed branch, one decade a step. p' is
// measured by one step down the branch in any case. A branch that loses
// stability at a finite pressure has no jamming point: growth begins again from
// the state it falls to.
//
// `observer` (may be empty) sees every relaxation; returning false ends the
// run. Returns false with one line in `error` if the start is jammed at
// phi_init, if a state stays undecided, if the observer stopped, or for bad
// options.
//
// Deviations: line 16 of the published algorithm is read with phi_cr^app; line
// 25 may return the last state of the bisection even if unjammed, here the last
// jammed one is kept; the final error bar and the decompression are additions.
bool FindJamming(const Packing& start,
                 const JammingOptions& options,
                 const Solver& solver,
                 const std::function<bool(const JammingStep&)>& observer,
                 JammingResult* result,
                 std::string* error);

// The same from a jammed `start`: relaxes it as it is and follows its branch
// down to error_bar, which must be finite; growth and bisection come only after
// a branch that is lost on the way. Returns false also if the start is not
// jammed. phi_init is not used.
bool DecompressToJamming(
    const Packing& start,
    const JammingOptions& options,
    const Solver& solver,
    const std::function<bool(const JammingStep&)>& observer,
    JammingResult* result,
    std::string* error);

// dp/dphi of a growth of radii at fixed positions (no rearrangement):
//   (1 / d V) sum_c f'_c l_c (r_i + r_j) / (d phi),
// an upper estimate of p' in units of the packing.
double AffinePressureSlope(const Packing& packing,
                           const std::vector<Contact>& contacts);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_JAMMING_H_
