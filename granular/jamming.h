// granopt: the jamming point of a packing (paper, sec. 2.4, Algorithm 1).

#ifndef GRANOPT_GRANULAR_JAMMING_H_
#define GRANOPT_GRANULAR_JAMMING_H_

#include <array>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "granular/relaxation.h"

namespace granopt {

enum class JammingStage { START, GROWTH, BISECTION, DECOMPRESSION, FINISHED };
enum class JammingVerdict { UNJAMMED, JAMMED, UNDECIDED };
const char* JammingStageName(JammingStage stage);        // "growth"
const char* JammingVerdictName(JammingVerdict verdict);  // "jammed"

// How a packing fraction is set: the radii grow in a fixed cell, or the cell
// and the positions shrink around fixed radii. Up to the unit of length these
// are one and the same; they differ in roundoff and in the numbers that a
// reader of the packing sees.
enum class JammingRoute { RADII, CELL };
const char* JammingRouteName(JammingRoute route);  // "radii"

struct JammingOptions {
  ContactEnergyOptions energy;
  // For each relaxation. vanishing_tolerance decides what counts as E = 0; in
  // the decompression it is at most a hundredth of the error bar and of the
  // distance that a step aims at, so that growth and bisection do not depend on
  // the error bar.
  SolveOptions solve;
  JammingRoute route = JammingRoute::RADII;
  // 0: the start is taken as it is.
  double phi_init = 0.8;
  double phi_increment = 1e-3;  // delta phi
  // The published algorithm bisects, to an accuracy epsilon. A positive
  // over-compression takes the place of that: growth goes on until the state is
  // at least this far above its jamming point, which spares the many
  // relaxations next to it.
  double overcompression = 0.0;
  double accuracy = 1e-6;  // epsilon
  // Then follow the jammed branch down until the error bar is at most this.
  // Infinity: the published algorithm, whose bisection may end on a state that
  // is well above its own jamming point.
  double error_bar = 1e-8;
  // And on, decade by decade, until the contacts are as many as an isostatic
  // packing has and none opened in the last step, or until a packing fraction
  // has no digits left (kFinestDistance).
  bool until_isostatic = false;

  // About a thousand times the spacing of packing fractions in double.
  static constexpr double kFinestDistance = 2e-13;
};

// Where a search stands between two relaxations: plain data, all that the next
// one depends on. A search that goes on from a copy ends bitwise where the
// uninterrupted one does.
struct JammingState {
  JammingStage stage = JammingStage::START;  // of the next relaxation
  Packing next;                              // what it relaxes, at phi_next
  double phi_next = 0.0;
  int attempt = 0;  // how often that was undecided

  Packing start;      // relaxed at phi_init
  Packing reference;  // the last unjammed state
  Packing unjammed;   // that before the jammed one
  Packing jammed;     // the jammed state of least packing fraction
  Summary summary;    // of its relaxation
  double pressure = 0.0;
  double affine_slope = 0.0;  // of p^(1 / (alpha - 1)), see AffinePressureSlope
  std::vector<std::array<int, 2>> rigid_contacts;  // PairsInTouch()
  int excess_contacts = 0;                         // above an isostatic packing

  double phi_start = 0.0;  // where growth began
  int growth_steps = 0;
  double phi_unjammed = 0.0;
  double phi_jammed = 0.0;  // 0 while unknown
  double distance = 0.0;
  bool secant = false;
  double fraction = 0.0;  // of the distance, the next step down
  int failures = 0;       // of such steps
  int decompressions = 0;
  bool contacts_kept = false;  // by the last step down
  int cycles = 0;
  int relaxations = 0;
  Counters counters;
  double seconds = 0.0;
};

struct JammingStep {
  JammingStage stage = JammingStage::START;
  int relaxation = 0;  // from 1
  double phi = 0.0;
  JammingVerdict verdict = JammingVerdict::UNDECIDED;
  // Valid during the call.
  const Relaxation* result = nullptr;
  const JammingState* state = nullptr;  // after it
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
  // The last unjammed one before the jammed state, in the bisection the lower
  // end of its bracket: that was not monotone if phi_j is below it. 0 after a
  // jammed start.
  double phi_unjammed = 0.0;
  // (alpha - 1) p / p' with p' = dp/dphi along the branch: how far the jammed
  // state is above its own jamming point, p ~ (phi - phi_J)^(alpha-1).
  double distance = 0.0;
  double phi_j = 0.0;  // phi_cr - distance
  // True if distance <= min(error_bar, accuracy).
  bool converged = false;
  // Where p' comes from: two states of the branch, or the affine estimate.
  bool secant = false;
  // How often growth was run: once more for every branch that ended at a finite
  // pressure on the way down; 0 if the start was jammed and its branch lasted.
  int cycles = 0;
  int relaxations = 0;
  Counters counters;  // sums
  double seconds = 0.0;
};

// Sees every relaxation; returning false ends the run.
using JammingObserver = std::function<bool(const JammingStep&)>;

// Algorithm 1 from `start`, whose packing fraction is first set to phi_init:
// relax, grow radii by delta phi at fixed positions until a state is jammed,
// bisect between the last unjammed and the first jammed packing fraction to
// epsilon (or over-compress), then (if asked) decompress along the jammed
// branch, one decade a step, where p^(1/(alpha-1)) falls linearly to 0 at
// phi_J. p' is measured by one step down the branch in any case. A branch that
// loses stability at a finite pressure has no jamming point: growth begins
// again from the state it falls to. A start that is jammed is followed down at
// once, unless error_bar is infinite.
//
// Returns false with one line in `error` if the start is jammed at phi_init and
// error_bar infinite, if a state stays undecided, if the observer (which may be
// empty) stopped, or for bad options.
//
// Deviations: line 16 of the published algorithm is read with phi_cr^app; line
// 25 may return the last state of the bisection even if unjammed, here the last
// jammed one is kept; the over-compression, the final error bar and the
// decompression are additions.
bool FindJamming(const Packing& start,
                 const JammingOptions& options,
                 const Solver& solver,
                 const JammingObserver& observer,
                 JammingResult* result,
                 std::string* error);

// The same in parts, for those who keep JammingStep::state: a state to begin
// with, and the search from any state, which is left where the search ended.
bool BeginJamming(const Packing& start,
                  const JammingOptions& options,
                  JammingState* state,
                  std::string* error);
bool ContinueJamming(const JammingOptions& options,
                     const Solver& solver,
                     const JammingObserver& observer,
                     JammingState* state,
                     JammingResult* result,
                     std::string* error);

// dp/dphi of a growth of radii at fixed positions (no rearrangement):
//   (1 / d V) sum_c f'_c l_c (r_i + r_j) / (d phi),
// an upper estimate of p' in units of the packing.
double AffinePressureSlope(const Packing& packing,
                           const std::vector<Contact>& contacts);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_JAMMING_H_
