// granopt: the packings that a comparison applies its loads to.

#ifndef GRANOPT_EXPERIMENTS_PREPARATION_H_
#define GRANOPT_EXPERIMENTS_PREPARATION_H_

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "experiments/cases.h"
#include "experiments/comparison_records.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/jamming.h"

namespace granopt {

// A state under strain from which methods start, and where its own method ended
// from there.
struct ShearStep {
  Packing start;
  StepRecord record;
  // For Minima::Tag(). Displacements from `start`.
  std::vector<double> displacements;
  std::vector<bool> is_rattler;
  double energy = 0.0, residual = 0.0, vanishing = 0.0, mean_overlap = 0.0;
  bool unjammed = false;
};

// Makes states by a method of its own and keeps them as
// OUT/prepared_<name>.xyz. A file that is there already and says that it was
// made in the same way (from the same input, by the same method) is used again.
class Preparation {
 public:
  static constexpr double kTolerance = 1e-12;  // in mean forces
  static constexpr double kCompressedFrom = 0.80;
  static constexpr double kStep = 1e-3;  // in phi, of the compression
  // A step is non-rearranging if its strain in one step and in two halves end
  // within this many mean overlaps of each other...
  static constexpr double kApartBound = 1e-3;
  // ...and both ends are relaxed to this many mean forces, else undecided.
  static constexpr double kEndBound = 1e-9;

  // `phi`: packing fraction of generated packings. With --input every state
  // comes from the packing of `scene`.
  Preparation(const Scene& scene,
              const Solver& solver,
              double phi,
              Output* output)
      : scene_(scene), solver_(solver), phi_(phi), output_(output) {}

  // The input as it is, or a random start relaxed at phi.
  Packing Relaxed(std::uint64_t seed);

  // The input as it is, or a random start compressed from kCompressedFrom to
  // `phi`: radii grow in steps of kStep at fixed positions and the packing is
  // relaxed after each, as in Algorithm 1 of the paper.
  Packing Compressed(std::uint64_t seed, double phi);

  // States at phi_J + each of `distances` (increasing), with phi_J in
  // attributes["phi_j"]: from the relaxed packing, compressed if it is
  // unjammed, down its branch to a tenth of the least distance, which gives
  // phi_J; then compressed from distance to distance. Returns false with one
  // line in `error` if phi_J is not found.
  bool NearJamming(std::uint64_t seed,
                   const std::vector<double>& distances,
                   std::vector<Packing>* states,
                   std::string* error);

  // A chain of `steps` shear steps of the case near_jamming `c` from `base`,
  // the NearJamming() state at its distance: each deforms the state before by
  // StrainOf(c) and relaxes it. OUT/prepared_<name>_step_<k>.xyz hold the
  // relaxed states and what was found about their steps. A relaxation gives up
  // after `max_evaluations` (0: never). A state that has become unjammed or is
  // at no minimum is the last one: nothing after it is a step near jamming.
  std::vector<ShearStep> Shear(const Packing& base,
                               const Case& c,
                               std::uint64_t seed,
                               int steps,
                               std::int64_t max_evaluations);
  // How many steps all calls of Shear() will ask for, for the progress line.
  void ExpectSteps(int steps) { expected_steps_ = steps; }

  void ClearProgress() { progress_.Clear(); }

  // What was made so far: one line a state, and the same for summary.json.
  const std::vector<std::string>& lines() const { return lines_; }
  // Prints the lines, in place of the progress.
  void PrintLines();
  const Json& json() const { return json_; }

 private:
  // How a state is made, which its file says.
  std::string Recipe(const std::string& what,
                     std::uint64_t seed,
                     double phi) const;
  // The state `name`: made before, from its file, or made now.
  Packing State(const std::string& name,
                const std::string& recipe,
                const std::function<Packing()>& make);
  bool Reuse(const std::string& name,
             const std::string& recipe,
             Packing* packing,
             bool note = true);
  void Keep(const std::string& name,
            const std::string& recipe,
            Packing packing,
            bool note = true);
  void Note(const std::string& name,
            const Packing& packing,
            const char* remark);

  // Step k of the chain `name` from `before`: made before, from its file, or
  // made now.
  Packing Step(const std::string& name,
               int k,
               double strain,
               const std::string& origin,
               const Packing& before,
               std::int64_t max_evaluations,
               bool* used_again);
  void NoteChain(const std::string& name,
                 double strain,
                 int steps,
                 const std::vector<ShearStep>& chain,
                 bool used_again);
  // One step of a chain from `before`; `gave_up`: a relaxation did.
  Packing MakeStep(const Packing& before,
                   double strain,
                   std::int64_t max_evaluations,
                   bool* gave_up);

  SolveOptions Options(double tolerance);
  Packing Minimized(const Packing& start, double tolerance);
  bool FindPhiJ(std::uint64_t seed,
                double error_bar,
                JammingResult* result,
                std::string* error);

  const Scene& scene_;
  const Solver& solver_;
  const double phi_;
  Output* output_;
  Progress progress_;
  std::string stage_;  // for the progress line
  int expected_steps_ = 0, done_steps_ = 0, made_steps_ = 0;
  double step_seconds_ = 0.0;  // of all made_steps_
  std::map<std::string, Packing> made_;
  std::vector<std::string> lines_;
  Json json_ = Json::array();
};

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_PREPARATION_H_
