// granopt: checkpoints of long runs, and how a run is asked to stop.
//
// A checkpoint is one line of text,
//
//   granopt-checkpoint 1 <bytes> <CRC-32 of the rest, hexadecimal>
//
// and then, in CBOR, which keeps every bit of a double, an object of two:
// "setup", what the run was asked to do, and "state", where it stands.

#ifndef GRANOPT_EXPERIMENTS_CHECKPOINT_H_
#define GRANOPT_EXPERIMENTS_CHECKPOINT_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/flow/flow.h"
#include "granular/jamming.h"
#include "granular/quasistatic_shear.h"
#include "granular/relaxation.h"
#include "granular/stress_shear.h"

namespace granopt {

// The file of that name and the one before it, "<path>.previous".
class Checkpoint {
 public:
  Checkpoint(std::string path, Json setup)
      : path_(std::move(path)), setup_(std::move(setup)) {}

  // Atomic: at any moment `path` is whole, and the one before is kept. Returns
  // false with one line in `error` (disk full, removed folder).
  bool Write(const Json& state, std::string* error) const;

  enum class Found { NONE, OTHER_SETUP, OK };
  // The newest of the two that is whole. `faults` gets a line for each that is
  // not ("F: cut short, 812 of 4096 bytes"), `error` what is asked for
  // differently now than then (OTHER_SETUP).
  Found Read(Json* state,
             std::vector<std::string>* faults,
             std::string* error) const;

  const std::string& path() const { return path_; }
  std::string previous() const { return path_ + ".previous"; }

 private:
  const std::string path_;
  const Json setup_;
};

// The checkpoint in --out, and the names that its files have there.
std::string CheckpointPath();
std::vector<std::string> CheckpointFiles();

// What every setup of a run with a packing says: packing, law, method, and how
// far states are relaxed.
Json SceneSetup(const Scene& scene, const SolveOptions& solve);

// Output::Create() of a run with checkpoints, which stay if it is to `resume`;
// stop signals are noticed from here on.
void CreateOutput(std::vector<std::string> names, bool resume, Output* output);

// True for each of the first 512 steps, then for every second, fourth, ... one:
// a state that grows with the steps is then written in linear time.
bool IsCheckpointStep(std::size_t step);

// BadInput where it cannot be written.
void Save(const Checkpoint& checkpoint, const Json& state);

// "stopped as asked, <where>: the same command with --resume goes on"; returns
// the exit status.
int StoppedAsAsked(const std::string& where);

// For --resume: the state to go on from, with a line on the terminal for what
// was found; false if nothing was written yet. BadInput for files that cannot
// be gone on from.
bool Resume(const Checkpoint& checkpoint, Json* state);
// The same, handed to `read`; BadInput if that throws Json::exception.
bool Resume(const Checkpoint& checkpoint,
            const std::function<void(const Json&)>& read);
// BadInput for a checkpoint whose state is not of the form that is read here.
[[noreturn]] void RefuseState(const Checkpoint& checkpoint,
                              const Json::exception& exception);

// CRC-32 (ISO-HDLC, as in zip files) of the bytes.
std::uint32_t Crc32(const std::string& bytes);

// A search for a jamming point, exactly.
Json ToJson(const JammingState& state);
// Throws Json::exception if `json` is not of that form.
JammingState JammingStateOf(const Json& json);

// A relaxation between two legs, exactly; the same.
Json ToJson(const RelaxationState& state);
RelaxationState RelaxationStateOf(const Json& json);

// A flow after a step, exactly; the same.
Json ToJson(const FlowState& state);
FlowState FlowStateOf(const Json& json);

// A quasistatic deformation between two steps, exactly; the same.
Json ToJson(const QuasistaticShearState& state);
QuasistaticShearState ShearStateOf(const Json& json);

// A deformation by a given stress between two steps, exactly; the same.
Json ToJson(const StressShearState& state);
StressShearState StressShearStateOf(const Json& json);

// From now on SIGINT and SIGTERM are noticed instead of ending the process;
// the second one ends it.
void CatchStopSignals();
// True if one came.
bool StopRequested();

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CHECKPOINT_H_
