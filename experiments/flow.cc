// flow: near-field granular flow (granular/flow/flow.h).
//
//   flow                 one run of one scene: energies, ledger, trajectory
//   flow --paper         Figs 4 to 6 of Zohdi, Int. J. Solids Struct. 42 (2005)
//                        539: four strengths, 20 starts each, mean and spread
//   flow --study=NAME    work_precision, remark8, oscillator or throughput

#include "experiments/flow.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "solvers/registry.h"
#include "solvers/threads.h"

DEFINE_bool(list_solvers, false, "print the methods and exit");
DEFINE_int32(threads, 1, "results are the same bits on any number");
// ---- modes
DEFINE_bool(paper, false, "Figs 4 to 6 with the parameters of sec. 7.1");
DEFINE_int32(seeds,
             20,
             "starts of --paper and of studies (work_precision: 10)");
DEFINE_string(study, "", "work_precision, remark8, oscillator or throughput");
DEFINE_int32(frames, 101, "of the trajectory, and rows of energy.csv");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out; ends in the same bits");
DEFINE_int64(
    checkpoint_every,
    0,
    "steps between checkpoints of one run (0: as many as take some 2e9 "
    "pairs, 100 at least)");

namespace granopt {
namespace {

// BadInput for a flag of a flow that the user gave and a mode has no use for.
void RefuseOtherFlags(const std::vector<std::string>& used,
                      const std::string& mode) {
  for (const auto& flag : FlagsDefinedIn("experiments/flow")) {
    if (flag.is_default ||
        std::find(used.begin(), used.end(), flag.name) != used.end()) {
      continue;
    }
    BadInput("--" + flag.name + " cannot go with " + mode);
  }
}

int RunTheStudy() {
  if (FLAGS_paper) BadInput("--study and --paper exclude each other");
  if (FLAGS_resume) BadInput("--study has no --resume: studies take minutes");
  const auto study =
      std::find_if(Studies().begin(), Studies().end(), [](const Study& each) {
        return each.name == FLAGS_study;
      });
  if (study == Studies().end()) {
    BadInput("--study=" + FLAGS_study +
             " must be work_precision, remark8, oscillator or throughput");
  }
  std::vector<std::string> used = study->flags;
  used.insert(used.end(), {"study", "threads"});
  RefuseOtherFlags(used, "--study=" + FLAGS_study);
  CheckRange("seeds", FLAGS_seeds, 1, 100000);
  std::vector<std::string> names = study->files;
  names.push_back("summary.json");
  Output output;
  output.Create(FLAGS_out, names);
  return study->run(&output);
}

int Main() {
  if (FLAGS_list_solvers) {
    std::fputs(SolverTable().c_str(), stdout);
    return kConverged;
  }
  CheckRange("threads", FLAGS_threads, 1, 1024);
  if (!SetNumThreads(FLAGS_threads)) {
    BadInput(Format("--threads=%d: built without OpenMP", FLAGS_threads));
  }
  if (!FLAGS_study.empty()) return RunTheStudy();
  if (!FLAGS_paper) return RunScene();
  std::vector<std::string> used = StepFlags();
  used.insert(used.end(),
              {"paper", "resume", "threads", "seeds", "particles", "duration"});
  RefuseOtherFlags(used, "--paper, which sets the parameters of sec. 7.1");
  return RunPaper();
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "near-field granular flow: charged grains that collide "
                      "and rub (--paper: Figs 4-6 of Zohdi 2005)");
  return granopt::Main();
}
