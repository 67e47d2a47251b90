#include "experiments/step_tables.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <tuple>

#include "experiments/report_text.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

using StepMap = std::map<Place, const StepRecord*>;

// A minimum to compare with, and its energy.
struct End {
  std::string minimum;
  double energy = 0.0;
};

// Of the reference in the given instance; false if there is none.
bool ReferenceEnd(const ComparisonSetup& setup,
                  const RunIndex& index,
                  const StepMap& steps,
                  const Place& place,
                  End* end) {
  if (setup.reference.empty()) {
    const auto found = steps.find(place);
    if (found == steps.end()) return false;
    *end = {found->second->minimum, found->second->energy};
    return true;
  }
  const RunRecord* run = index.Find(place, setup.reference, 1);
  if (run == nullptr) return false;
  *end = {run->minimum, run->energy};
  return true;
}

// Compares the ends of a run and of the reference.
void Judge(const RunRecord& run, const End& reference, StepRow* row) {
  if (run.minimum != "-" && reference.minimum != "-") {
    ++row->judged;
    row->same += run.minimum == reference.minimum ? 1 : 0;
  }
  if (reference.minimum == "-") return;
  const double size = std::max(run.energy, reference.energy);
  if ((run.minimum == "0" && reference.minimum == "0") || !(size > 0.0)) {
    return;
  }
  const double difference = (run.energy - reference.energy) / size;
  row->lower += difference < -kEnergyDifference ? 1 : 0;
  row->higher += difference > kEnergyDifference ? 1 : 0;
  if (!(std::abs(row->difference) >= std::abs(difference))) {
    row->difference = difference;
  }
}

StepRow MakeStepRow(const ComparisonSetup& setup,
                    const RunIndex& index,
                    const StepMap& steps,
                    const std::vector<Place>& chosen,
                    const Level& level,
                    const Method& method) {
  StepRow row;
  row.method = method;
  row.difference = kNan;
  Costs<std::vector<double>> costs, spent;
  for (const Place& place : chosen) {
    Costs<std::vector<double>> costs_here, spent_here;
    bool failed = false, unjammed = false;
    for (int r = 1; r <= setup.repetitions; ++r) {
      const RunRecord* run = index.Find(place, method.label, r);
      if (run == nullptr) continue;
      const Work* work = index.Reached(*run, level);
      failed = failed || work == nullptr;
      unjammed = unjammed || run->minimum == "0";
      Append(work == nullptr ? InfiniteCosts() : CostsOf(*work), &costs_here);
      Append(CostsOf(work == nullptr ? run->work : *work), &spent_here);
    }
    if (costs_here[0].empty()) continue;  // an unfinished comparison
    ++row.steps;
    row.failed += failed ? 1 : 0;
    row.unjammed += unjammed ? 1 : 0;
    Append(OfEach(costs_here, MedianOf), &costs);
    Append(OfEach(spent_here, MedianOf), &spent);
    const RunRecord* run = index.Find(place, method.label, 1);
    End reference;
    if (run != nullptr &&
        ReferenceEnd(setup, index, steps, place, &reference)) {
      Judge(*run, reference, &row);
    }
  }
  row.costs = OfEach(costs, MedianAndWorst);
  row.spent = OfEach(spent, MedianAndWorst);
  row.mean_iterations = MeanAndDeviation(spent[kIterations]);
  row.mean_seconds = MeanAndDeviation(spent[kCpuSeconds]);
  return row;
}

// All tables of one strain, level and kind of steps in one grid, a block of
// rows for each distance.
std::string GridOf(const std::vector<const StepTable*>& tables, bool markdown) {
  std::vector<StepRow> all;
  for (const StepTable* table : tables) {
    all.insert(all.end(), table->rows.begin(), table->rows.end());
  }
  const std::vector<Cost> optional =
      WithWork(all, {kHessians, kFactorizations, kLinearIterations});
  const bool reference =
      std::any_of(all.begin(), all.end(), [](const StepRow& row) {
        return row.judged > 0 || !std::isnan(row.difference);
      });
  std::vector<std::vector<std::string>> rows = {{"phi - phi_J",
                                                 "method",
                                                 "steps",
                                                 "failed",
                                                 HeadingOf(kIterations),
                                                 HeadingOf(kEvaluations)}};
  for (const Cost cost : optional) rows[0].push_back(HeadingOf(cost));
  rows[0].push_back(HeadingOf(kCpuSeconds));
  if (reference) {
    rows[0].insert(rows[0].end(),
                   {"same minimum", "E - E_ref", "lower", "higher"});
  }
  for (const StepTable* table : tables) {
    for (const StepRow& row : table->rows) {
      std::vector<std::string> cells = {
          &row == &table->rows[0] ? Neat(table->table_case.distance) : "",
          row.method.label,
          std::to_string(row.steps),
          CountOrDash(row.failed)};
      const auto add = [&](Cost cost, std::string (*print)(double)) {
        cells.push_back(WithWorst(row.costs[cost], row.spent[cost], print));
      };
      add(kIterations, Count);
      add(kEvaluations, Count);
      for (const Cost cost : optional) add(cost, Count);
      add(kCpuSeconds, Seconds);
      if (reference) {
        cells.push_back(Format("%d of %d", row.same, row.judged));
        cells.push_back(std::isnan(row.difference) ? "-"
                        : row.difference == 0.0
                            ? std::string("0")
                            : Format("%+.0e", row.difference));
        cells.push_back(CountOrDash(row.lower));
        cells.push_back(CountOrDash(row.higher));
      }
      rows.push_back(cells);
    }
  }
  return Block(Grid(rows, 0, markdown, 2), markdown);
}

// What the steps are.
std::string PreparedText(const ComparisonSetup& setup,
                         const std::vector<StepRecord>& steps,
                         bool markdown) {
  std::vector<std::vector<std::string>> rows = {{"case",
                                                 "steps",
                                                 kNonRearranging,
                                                 kRearranging,
                                                 kUnjammed,
                                                 kUndecided,
                                                 "ends apart",
                                                 "contacts",
                                                 "changed",
                                                 "pressure (least, most)"}};
  for (const Case& c : setup.cases) {
    std::map<std::string, int> count;
    std::vector<double> apart, contacts, changed, pressure;
    for (const StepRecord& step : steps) {
      if (step.case_id != c.id) continue;
      ++count[step.kind];
      apart.push_back(step.apart);
      contacts.push_back(step.contacts);
      changed.push_back(step.contacts_changed);
      pressure.push_back(step.pressure);
    }
    if (apart.empty()) continue;
    rows.push_back({c.id, std::to_string(apart.size())});
    for (const char* kind : kStepKinds) {
      rows.back().push_back(CountOrDash(count[kind]));
    }
    rows.back().push_back(
        Format("%.0e (%.0e)", MedianOf(apart), MedianAndWorst(apart).worst));
    rows.back().push_back(Count(MedianOf(contacts)));
    rows.back().push_back(
        WithWorst(MedianAndWorst(changed), {kNan, kNan}, Count));
    rows.back().push_back(
        Format("%.1e (%.0e, %.0e)",
               MedianOf(pressure),
               *std::min_element(pressure.begin(), pressure.end()),
               *std::max_element(pressure.begin(), pressure.end())));
  }
  return PartHeading("the shear steps as prepared", markdown) +
         Block(Grid(rows, 0, markdown), markdown);
}

std::string HowToRead(const ComparisonSetup& setup, bool markdown) {
  const std::string whose =
      setup.reference.empty()
          ? "the state as prepared, from which the next step starts"
          : setup.reference + " in the same step";
  return PartHeading("how to read the steps", markdown) +
         Paragraph(
             {"non-rearranging: the strain in one step and in two halves ends "
              "within 1e-3 mean overlaps (ends apart:",
              "the largest coordinate of rigid grains, median and worst); "
              "changed: "
              "contacts of rigid grains made or lost;",
              "failed: steps that never got there, infinitely expensive in "
              "medians (>N: what the median step had spent then);",
              "a step's time is the median of its repetitions; same minimum: "
              "as " +
                  whose + ";",
              Format(
                  "E - E_ref: the largest, over the larger of the two; lower, "
                  "higher: how many by more than %s;",
                  Neat(kEnergyDifference).c_str()),
              "pressure: at the ends of the steps; where it spreads, a chain "
              "has "
              "left the distance at which it began."},
             markdown);
}

}  // namespace

std::vector<StepTable> TabulateSteps(const ComparisonSetup& setup,
                                     const std::vector<Event>& events,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps) {
  const RunIndex index(events, runs);
  const auto step_at = StepIndex(steps);
  std::vector<StepTable> tables;
  for (const Case& c : setup.cases) {
    if (c.kind != "near_jamming") continue;
    // Of all steps, and of those that are known not to rearrange.
    std::vector<Place> all, plain;
    for (const std::uint64_t seed : setup.seeds) {
      for (int step = 1; step <= setup.steps; ++step) {
        const Place place(c.id, seed, step);
        const bool run =
            std::any_of(setup.methods.begin(),
                        setup.methods.end(),
                        [&](const Method& method) {
                          return index.Find(place, method.label, 1) != nullptr;
                        });
        if (!run) continue;
        all.push_back(place);
        const auto found = step_at.find(place);
        if (found != step_at.end() && found->second->kind == kNonRearranging) {
          plain.push_back(place);
        }
      }
    }
    for (const Level& level : setup.levels) {
      for (const bool only_plain : {true, false}) {
        const auto& chosen = only_plain ? plain : all;
        if (chosen.empty()) continue;
        StepTable table;
        table.table_case = c;
        table.level = level;
        table.distance = MedianDistance(runs, c.id);
        table.kind = only_plain ? kNonRearranging : "all";
        table.steps = static_cast<int>(chosen.size());
        for (const Method& method : setup.methods) {
          table.rows.push_back(
              MakeStepRow(setup, index, step_at, chosen, level, method));
        }
        tables.push_back(table);
      }
    }
  }
  return tables;
}

std::string StepTablesCsv(const std::vector<StepTable>& tables) {
  std::string csv =
      "case,strain,relative,asked_distance,distance,kind,level,steps_kind,"
      "solver,spec,steps,failed,unjammed,iterations,iterations_worst,"
      "evaluations,"
      "evaluations_worst,hessians,hessians_worst,factorizations,"
      "factorizations_worst,linear_iterations,linear_iterations_worst,"
      "cpu_seconds,cpu_seconds_worst,spent_iterations,spent_iterations_worst,"
      "spent_factorizations,spent_factorizations_worst,spent_seconds,"
      "spent_seconds_worst,iterations_mean,iterations_deviation,seconds_mean,"
      "seconds_deviation,same_minimum,judged,energy_difference,lower,higher\n";
  for (const StepTable& table : tables) {
    const Case& c = table.table_case;
    for (const StepRow& row : table.rows) {
      csv += Field(c.id) + "," + Neat(c.value) +
             Format(",%d,", c.relative ? 1 : 0) + Neat(c.distance) +
             Format(",%.9g,", table.distance) + KindOf(table.level) + "," +
             Neat(table.level.value) + "," + table.kind + "," +
             Field(row.method.label) + "," + Field(row.method.spec) +
             Format(",%d,%d,%d,", row.steps, row.failed, row.unjammed);
      const auto add = [&csv](const MedianWorst& value) {
        csv += Format("%.9g,%.9g,", value.median, value.worst);
      };
      for (const Cost cost : {kIterations,
                              kEvaluations,
                              kHessians,
                              kFactorizations,
                              kLinearIterations,
                              kCpuSeconds}) {
        add(row.costs[cost]);
      }
      for (const Cost cost : {kIterations, kFactorizations, kCpuSeconds}) {
        add(row.spent[cost]);
      }
      for (const MeanDeviation* value :
           {&row.mean_iterations, &row.mean_seconds}) {
        csv += Format("%.9g,%.9g,", value->mean, value->deviation);
      }
      csv += Format("%d,%d,%.4g,%d,%d\n",
                    row.same,
                    row.judged,
                    row.difference,
                    row.lower,
                    row.higher);
    }
  }
  return csv;
}

std::string StepTablesText(const ComparisonSetup& setup,
                           const std::vector<StepTable>& tables,
                           const std::vector<StepRecord>& steps,
                           bool markdown) {
  // One grid for each strain, level and kind of steps, in order of appearance.
  using Key = std::tuple<std::string, bool, double, std::string>;
  std::vector<Key> keys;
  std::map<Key, std::vector<const StepTable*>> grids;
  for (const StepTable& table : tables) {
    const std::string& id = table.table_case.id;
    const Key key(id.substr(0, id.find(" at ")),
                  table.level.absolute,
                  table.level.value,
                  table.kind);
    if (grids[key].empty()) keys.push_back(key);
    grids[key].push_back(&table);
  }
  std::string text;
  for (const Key& key : keys) {
    // After those that do not rearrange, all steps where there are others.
    std::vector<const StepTable*> parts = grids[key];
    const bool all = parts[0]->kind == "all";
    Key other = key;
    std::get<3>(other) = kNonRearranging;
    const bool first = !all || grids.count(other) == 0;
    if (!first) {
      const auto same = [&](const StepTable* part) {
        for (const StepTable* plain : grids[other]) {
          if (plain->table_case.id == part->table_case.id) {
            return plain->steps == part->steps;
          }
        }
        return false;
      };
      parts.erase(std::remove_if(parts.begin(), parts.end(), same),
                  parts.end());
      if (parts.empty()) continue;
    }
    const Case& c = parts[0]->table_case;
    int total = 0;
    for (const StepTable* part : parts) total += part->steps;
    text += Heading("shear steps of " + Neat(c.value) +
                        (c.relative ? " (phi - phi_J)" : "") +
                        Format(": %d, ", total) +
                        (!all    ? "those that do not rearrange"
                         : first ? "rearranging or not"
                                 : "all at the distances where some rearrange "
                                   "or unjam"),
                    markdown) +
            Paragraph({"until " + Meaning(parts[0]->level) +
                       "; median, worst in brackets"},
                      markdown) +
            GridOf(parts, markdown);
  }
  if (text.empty()) return text;
  if (!steps.empty()) text += PreparedText(setup, steps, markdown);
  return text + HowToRead(setup, markdown);
}

}  // namespace granopt
