// granopt: the files of `conditioning`: conditioning.csv, extreme eigenvalues
// of P^-1 H, and contact_changes.csv, contacts made and lost.

#ifndef GRANOPT_EXPERIMENTS_CONDITIONING_RECORDS_H_
#define GRANOPT_EXPERIMENTS_CONDITIONING_RECORDS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/tabular.h"
#include "granular/contact_changes.h"

namespace granopt {

struct ConditionRow {
  std::uint64_t seed = 0;
  double distance = 0.0;
  std::string label, spec;
  std::string shear;  // of a lagged P; "-": fresh
  bool found = false;
  int dimensions = 0;
  double lowest = 0.0, highest = 0.0;
  // Infinite unless all eigenvalues are positive.
  double number = 0.0;
  int negative = 0, below = 0, above = 0;  // below 1/2, above 2
  std::string message;
};

struct ChangeRow {
  std::uint64_t seed = 0;
  double distance = 0.0;
  std::string shear;
  double strain = 0.0;
  std::string kind;            // as in steps.csv of `compare`
  bool relaxed = false;        // the state after the step is at a minimum
  int contacts = 0;            // before
  ContactChange deformed;      // before to deformed, not yet relaxed
  ContactChange relaxation;    // deformed to relaxed
  ContactChange step;          // before to relaxed
  double newton_shift = 0.0;   // in kappa
  double newton_length = 0.0;  // in mean overlaps
  double newton_first = 0.0;   // of the step, to the first change
  int newton_opened = 0, newton_closed = 0;
  // Before to where linear response says that the step ends; -1: no such.
  ContactChange predicted = {-1, -1};
  ContactChange missed;  // there to relaxed
  std::string message;   // why there is no Newton step
};

struct ConditioningRows {
  std::vector<ConditionRow> conditions;
  std::vector<ChangeRow> changes;
};

// For FormatCsv() and ParseCsv().
void Columns(ConditionRow* row, CsvColumns* columns);
void Columns(ChangeRow* row, CsvColumns* columns);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CONDITIONING_RECORDS_H_
