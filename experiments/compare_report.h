// granopt: the files of `compare`, and its tables and figures made from the raw
// ones.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_REPORT_H_
#define GRANOPT_EXPERIMENTS_COMPARE_REPORT_H_

#include <string>
#include <vector>

#include "experiments/comparison_records.h"
#include "experiments/comparison_tables.h"
#include "experiments/profiles.h"
#include "experiments/run.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"

namespace granopt {

// What is kept of an earlier comparison, of either half, in a folder.
enum class Kept {
  NOTHING,
  RAW,      // of an interrupted one with the same setup
  SUMMARY,  // and the raw files: its tables and figures are made again
};
// Creates the folder and removes what is not kept, so that it never holds two
// comparisons.
void CreateOutput(const std::string& folder, Kept kept, Output* output);

// True if --out has an interrupted comparison with the same setup.json; false
// if there is none. BadInput if it is of another one.
bool IsInterrupted(const std::string& setup);
bool Exists(const std::string& path);

// profile.csv and quality.csv with their figures, if there is anything in them.
void WriteProfiles(const ComparisonProfiles& profiles, Output* output);

// A raw file; BadInput on any fault.
template <typename Record>
void ReadRecords(const std::string& path, std::vector<Record>* records) {
  std::string text, error;
  if (!ReadFile(path, &text, &error) ||
      !ParseCsv(text, path, records, &error)) {
    BadInput(error);
  }
}

struct RawRecords {
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  std::vector<StepRecord> steps;  // empty without chains
  std::vector<CurveRow> curves;
};
// Of `data`; curves.csv only if asked for. BadInput on any fault.
RawRecords ReadRaw(const std::string& data, bool with_curves);

// Tables and figures from the raw files in `data`, as they were read; prints
// the tables.
std::vector<Table> Report(const ComparisonSetup& setup,
                          const std::string& data,
                          const RawRecords& raw,
                          Output* output);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_REPORT_H_
