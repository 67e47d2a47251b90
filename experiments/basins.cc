#include "experiments/basins.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>

#include "experiments/report_text.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

// Of the steps that rows count.
std::vector<std::string> Kinds() {
  std::vector<std::string> kinds = {"all"};
  kinds.insert(kinds.end(), std::begin(kStepKinds), std::end(kStepKinds));
  return kinds;
}

int Instances(const BasinRow& row) {
  return row.judged + row.nowhere + row.unknown;
}

}  // namespace

std::vector<BasinRow> TabulateBasins(const ComparisonSetup& setup,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps) {
  std::vector<BasinRow> rows;
  if (setup.reference.empty()) return rows;
  const RunIndex index({}, runs);
  const auto step_at = StepIndex(steps);
  const std::vector<std::string> kinds = Kinds();
  // By method and kind.
  std::vector<BasinRow> sums(setup.methods.size() * kinds.size());
  for (const Case& c : setup.cases) {
    for (std::size_t m = 0; m < setup.methods.size(); ++m) {
      const Method& method = setup.methods[m];
      if (method.label == setup.reference) continue;
      std::vector<BasinRow> by_kind(kinds.size());
      for (std::size_t k = 0; k < kinds.size(); ++k) {
        by_kind[k].case_id = c.id;
        by_kind[k].method = method;
        by_kind[k].kind = kinds[k];
      }
      for (const std::uint64_t seed : setup.seeds) {
        for (int step = 1; step <= StepsOf(setup, c); ++step) {
          const Place place(c.id, seed, step);
          const RunRecord* run = index.Find(place, method.label, 1);
          const RunRecord* reference = index.Find(place, setup.reference, 1);
          if (run == nullptr || reference == nullptr) continue;
          const auto found = step_at.find(place);
          for (BasinRow& row : by_kind) {
            if (row.kind != "all" &&
                (found == step_at.end() || found->second->kind != row.kind)) {
              continue;
            }
            if (reference->minimum == "-") {
              ++row.unknown;
            } else if (run->minimum == "-") {
              ++row.nowhere;
            } else {
              ++row.judged;
              row.differ += run->minimum != reference->minimum ? 1 : 0;
            }
          }
        }
      }
      for (std::size_t k = 0; k < kinds.size(); ++k) {
        if (k == 0 || Instances(by_kind[k]) > 0) rows.push_back(by_kind[k]);
        BasinRow& sum = sums[m * kinds.size() + k];
        sum.method = method;
        sum.kind = kinds[k];
        sum.case_id = "all cases";
        sum.differ += by_kind[k].differ;
        sum.judged += by_kind[k].judged;
        sum.nowhere += by_kind[k].nowhere;
        sum.unknown += by_kind[k].unknown;
      }
    }
  }
  if (setup.cases.size() > 1) {
    for (const BasinRow& sum : sums) {
      if (Instances(sum) > 0) rows.push_back(sum);
    }
  }
  return rows;
}

std::string BasinsCsv(const std::vector<BasinRow>& rows) {
  std::string csv =
      "case,solver,spec,steps_kind,differ,judged,low,high,no_minimum,"
      "reference_at_none\n";
  for (const BasinRow& row : rows) {
    const Interval interval = Wilson(row.differ, row.judged);
    csv += Field(row.case_id) + "," + Field(row.method.label) + "," +
           Field(row.method.spec) + "," + row.kind +
           Format(",%d,%d,%.6g,%.6g,%d,%d\n",
                  row.differ,
                  row.judged,
                  interval.low,
                  interval.high,
                  row.nowhere,
                  row.unknown);
  }
  return csv;
}

std::string BasinsText(const ComparisonSetup& setup,
                       const std::vector<BasinRow>& rows,
                       bool markdown) {
  if (rows.empty()) return "";
  // Kinds as columns, those that occur.
  std::vector<std::string> kinds;
  bool nowhere = false, unknown = false;
  for (const std::string& kind : Kinds()) {
    for (const BasinRow& row : rows) {
      if (row.kind != kind) continue;
      kinds.push_back(kind);
      break;
    }
  }
  for (const BasinRow& row : rows) {
    nowhere = nowhere || row.nowhere > 0;
    unknown = unknown || row.unknown > 0;
  }
  // If no step rearranges, one column says it.
  const auto sum = [&rows](const std::string& kind) {
    int instances = 0;
    for (const BasinRow& row : rows) {
      if (row.kind == kind) instances += Instances(row);
    }
    return instances;
  };
  if (kinds.size() == 2 && sum(kinds[0]) == sum(kinds[1])) kinds.pop_back();
  std::vector<std::vector<std::string>> grid(1);
  grid[0] = {"case", "method"};
  grid[0].insert(grid[0].end(), kinds.begin(), kinds.end());
  if (nowhere) grid[0].push_back("no minimum");
  if (unknown) grid[0].push_back("reference at none");
  std::string last_case;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const BasinRow& row = rows[k];
    // Rows of one case and method begin with that of all steps.
    if (row.kind == "all") {
      grid.push_back(std::vector<std::string>(grid[0].size(), "-"));
      grid.back()[0] = row.case_id == last_case ? "" : row.case_id;
      grid.back()[1] = row.method.label;
      last_case = row.case_id;
      std::size_t at = 2 + kinds.size();
      if (nowhere) grid.back()[at++] = std::to_string(row.nowhere);
      if (unknown) grid.back()[at] = std::to_string(row.unknown);
    }
    const std::size_t column =
        std::find(kinds.begin(), kinds.end(), row.kind) - kinds.begin();
    if (row.judged > 0 && column < kinds.size()) {
      grid.back()[2 + column] = WithInterval(row.differ, row.judged);
    }
  }
  return Heading("who leaves the basin of " + setup.reference, markdown) +
         Block(Grid(grid, 0, markdown, 2), markdown) +
         Paragraph({"how many ended in another minimum than the reference, "
                    "of those in which both are at one; in brackets",
                    "Wilson's 95 % interval of the probability; unjammed "
                    "ends count as one minimum; no minimum: the method ended",
                    "above the residual that tells minima apart, the "
                    "reference did not"},
                   markdown);
}

}  // namespace granopt
