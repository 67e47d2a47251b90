// granopt: the flags of `compare`, but for those of protocols, and what both of
// its halves, runs of a minimization and runs of a whole protocol, do with
// them.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_FLAGS_H_
#define GRANOPT_EXPERIMENTS_COMPARE_FLAGS_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "experiments/cases.h"
#include "gflags/gflags.h"
#include "solvers/solver.h"

DECLARE_string(cases);
DECLARE_double(phi);
DECLARE_string(seeds);
DECLARE_string(solvers);
DECLARE_int32(repetitions);
DECLARE_double(absolute_tolerance);
DECLARE_int64(max_evaluations);
DECLARE_string(distances);
DECLARE_double(shear);
DECLARE_int32(steps);
DECLARE_int64(prepare_evaluations);
DECLARE_bool(resume);
DECLARE_string(paper);
DECLARE_string(replot);

namespace granopt {

// The methods of --solvers; BadInput unless all can be made.
std::vector<Method> MethodsOfFlags(
    std::vector<std::unique_ptr<Solver>>* solvers);
std::unique_ptr<Solver> PrepareSolverOfFlags();
// --seeds, else --seed.
std::vector<std::uint64_t> SeedsOfFlags();

// Replaces the label of the baseline or of the reference if its flag is given.
void SetBaseline(const std::vector<Method>& methods, std::string* baseline);
void SetReference(const std::vector<Method>& methods, std::string* reference);

// --max_seconds and --max_evaluations, after which a method gives up. BadInput
// if they make no sense.
void CheckLimits();
void SetLimits(SolveOptions* options);
// "; at most 5 s<per>; at most 100 evaluations<per>".
std::string LimitsText(const std::string& per);

// BadInput if one of the flags is given.
void RefuseFlags(const std::vector<const char*>& flags,
                 const std::string& words);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_FLAGS_H_
