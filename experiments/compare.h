// granopt: what the two halves of `compare` share: compare.cc, runs of a
// minimization, and compare_protocol.cc, runs of a whole protocol.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_H_
#define GRANOPT_EXPERIMENTS_COMPARE_H_

#include <string>
#include <vector>

#include "experiments/comparison.h"
#include "experiments/profiles.h"
#include "experiments/run.h"
#include "gflags/gflags.h"

DECLARE_string(solvers);
DECLARE_double(phi);
DECLARE_string(seeds);
DECLARE_int32(repetitions);
DECLARE_double(max_seconds);
DECLARE_int64(max_evaluations);
DECLARE_string(prepare_solver);
DECLARE_string(reference);
DECLARE_bool(resume);
DECLARE_string(baseline);
DECLARE_string(replot);
DECLARE_string(protocol);

namespace granopt {

double WallSeconds();
bool Exists(const std::string& path);

// The label that a flag names, by itself or by its spec; BadInput if none.
std::string LabelOf(const std::vector<Method>& methods,
                    const char* flag,
                    const std::string& value);

// profile.csv and quality.csv with their figures, if there is anything in them.
void WriteProfiles(const ComparisonProfiles& profiles, Output* output);

// Files that each half writes: the other one removes them, so that a folder
// never holds two comparisons. Raw files first, then tables and figures.
std::vector<std::string> ProtocolFiles(bool raw);
std::vector<std::string> ComparisonFiles(bool raw);

// --protocol: runs the methods, or makes the tables and figures in `data` again
// from its setup.
int CompareProtocols();
int ReplotProtocols(const std::string& data, const std::string& setup);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_H_
