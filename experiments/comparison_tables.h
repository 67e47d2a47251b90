// granopt: the tables of a comparison, one for each case and level: tables.csv.

#ifndef GRANOPT_EXPERIMENTS_COMPARISON_TABLES_H_
#define GRANOPT_EXPERIMENTS_COMPARISON_TABLES_H_

#include <string>
#include <vector>

#include "experiments/comparison_records.h"
#include "experiments/statistics.h"

namespace granopt {

// The paper's Table 1.
struct PaperEntry {
  double iterations = 0.0;
  double seconds = 0.0;
};
// Null if the table has no such entry.
const PaperEntry* PaperTable1(const std::string& kind,
                              const std::string& label);

// One method in one case at one level. Runs that never reached it count as
// infinitely expensive.
struct TableRow {
  Method method;
  int runs = 0;
  int reached = 0;
  Costs<Quantiles> costs;
  // To the baseline in the same case, seed and repetition.
  Quantiles ratio;
  double function_share = 0.0, linear_share = 0.0;  // medians
  Costs<double> spent{};                            // medians, reached or not
  // The largest at the end, of the level's kind; NaN if E = 0.
  double residual = 0.0;
  std::string minima;  // "A", "A 2, B 1"
  std::string end;     // "converged", "NO_PROGRESS 1, converged 2"
  const PaperEntry* paper = nullptr;
};

struct Table {
  Case table_case;
  Level level;
  double distance = 0.0;  // near_jamming: median phi - phi_J
  std::vector<TableRow> rows;
};

// Every case at every level of the setup; rows in the order of the methods.
std::vector<Table> Tabulate(const ComparisonSetup& setup,
                            const std::vector<Event>& events,
                            const std::vector<RunRecord>& runs);

std::string TablesCsv(const std::vector<Table>& tables);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARISON_TABLES_H_
