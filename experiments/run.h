// granopt: what every experiment binary shares: flags, provenance, files,
// progress.

#ifndef GRANOPT_EXPERIMENTS_RUN_H_
#define GRANOPT_EXPERIMENTS_RUN_H_

#include <chrono>
#include <string>
#include <vector>

#include "gflags/gflags.h"
#include "granular/observables.h"
#include "granular/relaxation.h"
#include "nlohmann/json.hpp"
#include "solvers/format.h"
#include "solvers/solver.h"

DECLARE_string(out);
DECLARE_uint64(seed);
DECLARE_bool(smoke);
DECLARE_bool(pictures);

namespace granopt {

using Json = nlohmann::ordered_json;

// Exit statuses of every binary.
enum ExitStatus { kConverged = 0, kNotConverged = 1, kBadInput = 2 };

// Prints "<binary>: <line>" to stderr and exits with kBadInput.
[[noreturn]] void BadInput(const std::string& line);

// Parses the flags; --help and --version print and exit 0, anything wrong with
// a flag is one line and exit 2, and so is an argument that is no flag.
void ParseFlags(int* argc, char*** argv, const char* purpose);

// True if the user gave the flag.
bool IsGiven(const char* flag);

// BadInput "--flag: error" unless `good`.
void Require(bool good, const char* flag, const std::string& error);

// Checks that the number a flag holds lies in [low, high] (or in (low, high]).
void CheckRange(const char* flag, double value, double low, double high);
void CheckPositive(const char* flag, double value);

// The folder of --out. Create() is called after all input has been checked, so
// that bad input leaves nothing behind.
class Output {
 public:
  // Creates the folder; BadInput if that or writing in it is impossible. Files
  // of an earlier run with the `names` of this experiment are removed, so that
  // results of two runs are never mixed; summary.json is written last and marks
  // a complete run. Files `kept` stay, but for what a killed run left half
  // written of them.
  void Create(const std::string& folder,
              const std::vector<std::string>& names,
              const std::vector<std::string>& kept = {});
  const std::string& folder() const { return folder_; }
  std::string Path(const std::string& name) const {
    return folder_ + "/" + name;
  }
  // Atomic; BadInput on failure (disk full, removed folder).
  void Write(const std::string& name, const std::string& content);
  void WritePacking(const std::string& name, const Packing& packing);
  void WriteJson(const std::string& name, const Json& json);
  // packing.xyz and contacts.csv.
  void WriteRelaxation(const Relaxation& relaxation,
                       const ContactEnergyOptions& law);
  // Calls `plot.py arguments...`; false without --pictures and, with a line on
  // stderr, if python3 or matplotlib is missing or the script failed. Files
  // named `made` are listed.
  bool Plot(const std::vector<std::string>& arguments,
            const std::vector<std::string>& made);
  // packing.svg and packing.png, of what WriteRelaxation() wrote.
  bool PlotPacking();
  // The closing lines of every experiment: where the files are.
  void PrintFiles() const;

 private:
  std::string folder_;
  std::vector<std::string> files_;
};

// git revision, compiler and flags, CPU, threads, library versions, the BLAS
// that is loaded, seed, command line, time.
Json Provenance();

// The fields that every relaxation reports (DESIGN, `relax`).
Json RelaxationJson(const Relaxation& relaxation);

// i,j,image_x,image_y,image_z,overlap,force,distance,nx,ny,nz,rigid
std::string ContactsCsv(const Relaxation& relaxation);
std::string TraceCsv(const Summary& summary);

// A copy whose attributes say what the file holds (phi, pressure, ...).
Packing Annotated(const Relaxation& relaxation,
                  const ContactEnergyOptions& options);

// Of this process, all threads.
double CpuSeconds();
// Of a clock that only goes on.
double WallSeconds();

// "4096 discs, radii 0.0063 to 0.0089"
std::string Describe(const Packing& packing);

// "iteration 12: |g| / mean force 3.1e-05", for progress lines.
std::string IterationLine(const IterationState& state);

// A line that is rewritten in place on a terminal, and printed every ten
// seconds otherwise.
class Progress {
 public:
  Progress();
  ~Progress();
  // True if it is time to show something: composing the line costs too.
  bool Due();
  void Show(const std::string& line);
  // Removes the line.
  void Clear();

 private:
  const bool terminal_;
  bool shown_ = false;
  std::chrono::steady_clock::time_point last_;
};

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_RUN_H_
