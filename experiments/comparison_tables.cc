#include "experiments/comparison_tables.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "experiments/report_text.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

std::string EndOf(const RunRecord& run) {
  if (run.stop_reason == StopReasonName(StopReason::CONVERGED)) {
    return "converged";
  }
  if (run.stop_reason == StopReasonName(StopReason::VANISHED)) {
    return "unjammed";
  }
  return run.stop_reason;
}

TableRow MakeTableRow(const ComparisonSetup& setup,
                      const RunIndex& index,
                      const Case& c,
                      const Level& level,
                      const Method& method) {
  TableRow row;
  row.method = method;
  if (setup.paper == "table1") row.paper = PaperTable1(c.kind, method.label);
  Costs<std::vector<double>> costs, spent;
  std::vector<double> ratios, function_shares, linear_shares, residuals;
  std::vector<std::string> minima, ends;
  const auto add_run = [&](const Place& place, int repetition) {
    const RunRecord* run = index.Find(place, method.label, repetition);
    if (run == nullptr) return;
    const Work* work = index.Reached(*run, level);
    ++row.runs;
    row.reached += work != nullptr ? 1 : 0;
    Append(work == nullptr ? InfiniteCosts() : CostsOf(*work), &costs);
    const Work& done = work == nullptr ? run->work : *work;
    Append(CostsOf(done), &spent);
    function_shares.push_back(done.function_share);
    linear_shares.push_back(done.linear_share);
    const RunRecord* base = index.Find(place, setup.baseline, repetition);
    const Work* base_work =
        base == nullptr ? nullptr : index.Reached(*base, level);
    if (base_work != nullptr && base_work->cpu_seconds > 0.0) {
      ratios.push_back(costs[kCpuSeconds].back() / base_work->cpu_seconds);
    }
    // Relative to forces that fade, a residual says nothing.
    if (level.absolute || run->minimum != "0") {
      residuals.push_back(level.absolute ? run->quad_max_gradient
                                         : run->quad_residual);
    }
    minima.push_back(run->minimum);
    ends.push_back(EndOf(*run));
  };
  for (const std::uint64_t seed : setup.seeds) {
    for (int step = 1; step <= StepsOf(setup, c); ++step) {
      for (int r = 1; r <= setup.repetitions; ++r) {
        add_run({c.id, seed, step}, r);
      }
    }
  }
  row.costs = OfEach(costs, QuantilesOf);
  row.spent = OfEach(spent, MedianOf);
  row.ratio = QuantilesOf(ratios);
  row.function_share = MedianOf(function_shares);
  row.linear_share = MedianOf(linear_shares);
  row.residual = residuals.empty()
                     ? std::numeric_limits<double>::quiet_NaN()
                     : *std::max_element(residuals.begin(), residuals.end());
  row.minima = Tally(minima);
  row.end = Tally(ends);
  return row;
}

}  // namespace

const PaperEntry* PaperTable1(const std::string& kind,
                              const std::string& label) {
  struct Row {
    const char* kind;
    const char* label;
    PaperEntry entry;
  };
  static constexpr Row kRows[] = {
      {"growth", "L-BFGS", {2003, 24.3}},
      {"growth", "P-L-BFGS (A = 0)", {705, 11.8}},
      {"growth", "P-L-BFGS (A = 3)", {813, 16.2}},
      {"growth", "FR-CG", {4574, 58.9}},
      {"growth", "P-FR-CG", {1101, 18.5}},
      {"simple_shear", "L-BFGS", {2749, 29.2}},
      {"simple_shear", "P-L-BFGS (A = 0)", {986, 15.8}},
      {"simple_shear", "P-L-BFGS (A = 3)", {1351, 27.1}},
      {"simple_shear", "FR-CG", {7306, 90.1}},
      {"simple_shear", "P-FR-CG", {2013, 33.5}},
      {"random", "L-BFGS", {602, 7.5}},
      {"random", "P-L-BFGS (A = 0)", {380, 6.8}},
      {"random", "P-L-BFGS (A = 3)", {432, 9.1}},
      {"random", "FR-CG", {940, 11.9}},
      {"random", "P-FR-CG", {528, 9.2}}};
  for (const Row& row : kRows) {
    if (kind == row.kind && label == row.label) return &row.entry;
  }
  return nullptr;
}

std::vector<Table> Tabulate(const ComparisonSetup& setup,
                            const std::vector<Event>& events,
                            const std::vector<RunRecord>& runs) {
  const RunIndex index(events, runs);
  std::vector<Table> tables;
  for (const Case& c : setup.cases) {
    for (const Level& level : setup.levels) {
      Table table;
      table.table_case = c;
      table.level = level;
      table.distance = MedianDistance(runs, c.id);
      for (const Method& method : setup.methods) {
        table.rows.push_back(MakeTableRow(setup, index, c, level, method));
      }
      tables.push_back(table);
    }
  }
  return tables;
}

std::string TablesCsv(const std::vector<Table>& tables) {
  std::string csv =
      "case,distance,kind,level,solver,spec,runs,reached,iterations,"
      "iterations_q20,iterations_q80,evaluations,evaluations_q20,"
      "evaluations_q80,hessians,factorizations,solves,linear_iterations,"
      "cpu_seconds,cpu_seconds_q20,cpu_seconds_q80,ratio,ratio_q20,ratio_q80,"
      "function_share,linear_share,spent_iterations,spent_evaluations,"
      "spent_seconds,residual,minima,end,paper_iterations,paper_seconds\n";
  const auto three = [](const Quantiles& q) {
    return Format("%.9g,%.9g,%.9g,", q.median, q.low, q.high);
  };
  for (const Table& table : tables) {
    for (const TableRow& row : table.rows) {
      csv += Field(table.table_case.id) + Format(",%.9g,", table.distance) +
             KindOf(table.level) + "," + Neat(table.level.value) + "," +
             Field(row.method.label) + "," + Field(row.method.spec) +
             Format(",%d,%d,", row.runs, row.reached) +
             three(row.costs[kIterations]) + three(row.costs[kEvaluations]) +
             Format("%.9g,%.9g,%.9g,%.9g,",
                    row.costs[kHessians].median,
                    row.costs[kFactorizations].median,
                    row.costs[kSolves].median,
                    row.costs[kLinearIterations].median) +
             three(row.costs[kCpuSeconds]) + three(row.ratio) +
             Format("%.4g,%.4g,%.9g,%.9g,%.9g,%.9g,",
                    row.function_share,
                    row.linear_share,
                    row.spent[kIterations],
                    row.spent[kEvaluations],
                    row.spent[kCpuSeconds],
                    row.residual) +
             Field(row.minima) + "," + Field(row.end) + ",";
      if (row.paper != nullptr) {
        csv += Format("%.9g,%.9g", row.paper->iterations, row.paper->seconds);
      } else {
        csv += ",";
      }
      csv += "\n";
    }
  }
  return csv;
}

}  // namespace granopt
