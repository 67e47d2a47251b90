#include "experiments/comparison_text.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "experiments/minima.h"
#include "experiments/report_text.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Of long chains so many lines about minima; all are in runs.csv.
constexpr int kMostLines = 6;

// A seed and a step of one case.
using Instance = std::pair<std::uint64_t, int>;

std::string Name(const Instance& instance, bool chain) {
  return "seed " + std::to_string(instance.first) +
         (chain ? Format(", step %d", instance.second) : "");
}

std::string Joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

// "1", "1-3", "1, 3".
std::string Numbers(const std::set<std::uint64_t>& numbers) {
  const std::uint64_t first = *numbers.begin(), last = *numbers.rbegin();
  if (numbers.size() > 2 && last - first + 1 == numbers.size()) {
    return std::to_string(first) + "-" + std::to_string(last);
  }
  std::vector<std::string> words;
  for (const std::uint64_t n : numbers) words.push_back(std::to_string(n));
  return Joined(words);
}

// Equal failures of several repetitions together.
std::vector<std::string> FailureNotes(
    const ComparisonSetup& setup, const std::vector<const RunRecord*>& runs) {
  std::vector<std::pair<std::string, std::set<std::uint64_t>>> failures;
  for (const RunRecord* run : runs) {
    if (run->converged) continue;
    const RunKey& key = run->key;
    const std::string line =
        key.label +
        (setup.seeds.size() > 1 ? ", " + Name({key.seed, key.step}, false)
                                : "") +
        ": " + run->stop_reason + ", " + run->message;
    auto found =
        std::find_if(failures.begin(), failures.end(), [&](const auto& one) {
          return one.first == line;
        });
    if (found == failures.end()) {
      found = failures.insert(failures.end(), {line, {}});
    }
    found->second.insert(key.repetition);
  }
  std::vector<std::string> notes;
  for (const auto& [line, repetitions] : failures) {
    notes.push_back(
        "! " + line +
        (setup.repetitions > 1
             ? (repetitions.size() == 1 ? " (repetition " : " (repetitions ") +
                   Numbers(repetitions) + ")"
             : ""));
  }
  return notes;
}

// Of a chain, failures of one method and kind together.
std::vector<std::string> ChainFailureNotes(
    const std::vector<const RunRecord*>& runs) {
  struct FailedSteps {
    std::set<Instance> steps;
    std::string first;
  };
  std::map<std::pair<std::string, std::string>, FailedSteps> failures;
  std::set<Instance> all;
  for (const RunRecord* run : runs) {
    const Instance instance = {run->key.seed, run->key.step};
    all.insert(instance);
    if (run->converged) continue;
    FailedSteps& failed = failures[{run->key.label, run->stop_reason}];
    if (failed.steps.empty()) {
      failed.first = Name(instance, true) + ": " + run->message;
    }
    failed.steps.insert(instance);
  }
  std::vector<std::string> notes;
  for (const auto& [end, failed] : failures) {
    notes.push_back(
        "! " + end.first + ": " + end.second +
        Format(" in %zu of %zu steps, as ", failed.steps.size(), all.size()) +
        failed.first);
  }
  return notes;
}

// Counts are decided by no clock, unless a run was ended by one.
std::vector<std::string> CountNotes(const std::vector<const RunRecord*>& runs) {
  using Counts = std::pair<std::int64_t, std::int64_t>;
  std::map<std::pair<Instance, std::string>, Counts> counts;
  std::set<std::string> differ;
  for (const RunRecord* run : runs) {
    if (run->stop_reason == StopReasonName(StopReason::MAX_SECONDS)) continue;
    const RunKey& key = run->key;
    const Counts now = {run->work.iterations, run->work.evaluations};
    const auto first = counts.insert({{{key.seed, key.step}, key.label}, now});
    if (first.first->second != now) differ.insert(key.label);
  }
  std::vector<std::string> notes;
  for (const std::string& label : differ) {
    notes.push_back("! " + label +
                    ": counts differ between repetitions, which they should "
                    "not");
  }
  return notes;
}

// Where runs end; instances in which all agree are said together.
std::vector<std::string> MinimaNotes(const std::vector<const RunRecord*>& runs,
                                     bool chain) {
  struct Ended {
    double energy = 0.0;
    std::vector<std::string> labels;
  };
  std::map<Instance, std::map<std::string, Ended>> minima;
  for (const RunRecord* run : runs) {
    const RunKey& key = run->key;
    Ended& ended = minima[{key.seed, key.step}][run->minimum];
    ended.energy = run->energy;
    if (std::find(ended.labels.begin(), ended.labels.end(), key.label) ==
        ended.labels.end()) {
      ended.labels.push_back(key.label);
    }
  }
  std::vector<std::string> notes;
  std::map<std::string, std::set<std::uint64_t>> alike;  // seeds
  std::map<std::string, int> alike_steps;
  int more = 0;
  for (const auto& [instance, tags] : minima) {
    if (tags.size() == 1 && tags.begin()->first != "-") {
      const std::string end = tags.begin()->first == "0"
                                  ? "unjammed (E = 0 or on the way there)"
                                  : "in one minimum";
      alike[end].insert(instance.first);
      ++alike_steps[end];
      continue;
    }
    if (chain && static_cast<int>(notes.size()) == kMostLines) {
      ++more;
      continue;
    }
    std::string line;
    for (const auto& [tag, ended] : tags) {
      line += (line.empty() ? "" : "; ") +
              (tag == "-"   ? "no minimum"
               : tag == "0" ? "E = 0"
                            : Format("minimum %s with E = %.10g",
                                     tag.c_str(),
                                     ended.energy)) +
              " (" + Joined(ended.labels) + ")";
    }
    notes.push_back(Name(instance, chain) + ": " + line);
  }
  if (more > 0) {
    notes.push_back(
        Format("and %d more steps whose runs do not end in one minimum "
               "(runs.csv)",
               more));
  }
  if (chain) {
    for (const auto& [end, count] : alike_steps) {
      notes.push_back(Format("%d of %zu steps: all runs end %s",
                             count,
                             minima.size(),
                             end.c_str()));
    }
    return notes;
  }
  for (const auto& [end, seeds] : alike) {
    notes.push_back((minima.size() == 1
                         ? "all runs end "
                         : (seeds.size() == 1 ? "seed " : "seeds ") +
                               Numbers(seeds) + ": all runs end ") +
                    end);
  }
  return notes;
}

// What a reader must know about the runs of a case beyond its tables.
std::vector<std::string> Notes(const ComparisonSetup& setup,
                               const Case& c,
                               const std::vector<RunRecord>& all) {
  std::vector<const RunRecord*> runs;
  for (const RunRecord& run : all) {
    if (run.key.case_id == c.id) runs.push_back(&run);
  }
  const bool chain = IsChain(setup, c);
  std::vector<std::string> notes =
      chain ? ChainFailureNotes(runs) : FailureNotes(setup, runs);
  for (const auto& more : {CountNotes(runs), MinimaNotes(runs, chain)}) {
    notes.insert(notes.end(), more.begin(), more.end());
  }
  return notes;
}

// `last`: the table of the level where runs stop says how they end.
std::string GridOf(const ComparisonSetup& setup,
                   const Table& table,
                   bool last,
                   bool markdown) {
  const std::vector<Cost> optional = WithWork(
      table.rows, {kHessians, kFactorizations, kSolves, kLinearIterations});
  bool paper = false;
  double paper_base = 0.0;
  for (const TableRow& row : table.rows) {
    paper = paper || row.paper != nullptr;
    if (row.paper != nullptr && row.method.label == setup.baseline) {
      paper_base = row.paper->seconds;
    }
  }
  std::vector<std::vector<std::string>> rows(1);
  rows[0] = {"method", HeadingOf(kIterations), HeadingOf(kEvaluations)};
  const auto add_headings = [&rows](const std::vector<std::string>& names) {
    rows[0].insert(rows[0].end(), names.begin(), names.end());
  };
  for (const Cost cost : optional) add_headings({HeadingOf(cost)});
  add_headings({HeadingOf(kCpuSeconds), "ratio", "f/lin/rest %"});
  if (paper) add_headings({"paper its", "paper s", "paper ratio"});
  if (last) add_headings({"residual", "minimum", "end"});
  for (const TableRow& row : table.rows) {
    std::vector<std::string> cells = {row.method.label};
    for (const Cost cost : {kIterations, kEvaluations}) {
      cells.push_back(Spread(row.costs[cost], row.spent[cost], Count));
    }
    for (const Cost cost : optional) {
      cells.push_back(Spread(row.costs[cost], kNan, Count));
    }
    cells.push_back(
        Spread(row.costs[kCpuSeconds], row.spent[kCpuSeconds], Seconds));
    cells.push_back(Spread(row.ratio, kNan, Ratio));
    cells.push_back(
        row.runs == 0 ? "-" : Shares(row.function_share, row.linear_share));
    if (paper && row.paper == nullptr) {
      cells.insert(cells.end(), 3, "-");
    } else if (paper) {
      cells.push_back(Count(row.paper->iterations));
      cells.push_back(Seconds(row.paper->seconds));
      cells.push_back(paper_base > 0.0 ? Ratio(row.paper->seconds / paper_base)
                                       : "-");
    }
    if (last) {
      cells.push_back(std::isnan(row.residual) ? "-"
                                               : Format("%.1e", row.residual));
      cells.push_back(row.minima);
      cells.push_back(
          row.end +
          (row.reached == row.runs
               ? ""
               : Format(" (%d of %d got there)", row.reached, row.runs)));
    }
    rows.push_back(cells);
  }
  return Grid(rows, last ? 2 : 0, markdown);
}

std::string HowToRead(const ComparisonSetup& setup, bool markdown) {
  return PartHeading("how to read this", markdown) +
         Lines(
             {"numbers are medians over " + Plural(setup.seeds.size(), "seed") +
                  " and " + Plural(setup.repetitions, "repetition") +
                  ", 20-80 % quantiles in brackets where they differ;",
              "a run that never got there counts as infinitely expensive: >N "
              "is what it had spent when it ended;",
              "CPU s: of Minimize() alone; ratio: to " + setup.baseline +
                  " in the same repetition; counts are exact, times are of "
                  "this machine;",
              std::string("residual: the largest at the end of a run, judged "
                          "in quadruple precision; minimum: runs of a seed ") +
                  (setup.steps > 1 ? "and step " : "") + "with one letter",
              Format("ended within %g of the energy and %g mean overlaps of "
                     "each other; 0: E = 0 or on the way there; -: above %s "
                     "mean",
                     Minima::kEnergyBound,
                     Minima::kOverlapBound,
                     Neat(Minima::kResidualBound).c_str()),
              "forces, too far from a minimum to say which."},
             markdown);
}

}  // namespace

std::string TablesText(const ComparisonSetup& setup,
                       const std::vector<Table>& tables,
                       const std::vector<RunRecord>& runs,
                       bool markdown) {
  std::string text;
  if (markdown) {
    text += Introduction("Comparison of methods",
                         setup.what,
                         setup.repetitions,
                         setup.seeds.size(),
                         setup.conditions,
                         setup.methods);
  }
  bool any_brief = false;
  for (std::size_t t = 0; t < tables.size(); ++t) {
    const Table& table = tables[t];
    const Case& c = table.table_case;
    // The tables of many steps say more on a terminal.
    const bool brief = !markdown && IsChain(setup, c);
    any_brief = any_brief || brief;
    if (t == 0 || tables[t - 1].table_case.id != c.id) {
      text += Heading(c.id, markdown);
      if (!brief) {
        text += Lines(
            {Meaning(c) + (c.kind == "near_jamming"
                               ? Format(" (phi - phi_J = %.3g)", table.distance)
                               : "")},
            markdown);
      }
    }
    if (!brief) {
      text += "\n" + Paragraph({"until " + Meaning(table.level)}, markdown) +
              GridOf(setup, table, table.level == setup.levels[0], markdown);
    }
    if (t + 1 < tables.size() && tables[t + 1].table_case.id == c.id) continue;
    if (markdown) text += "\n";
    for (const std::string& note : Notes(setup, c, runs)) {
      text += (markdown ? "- " : "    ") + note + "\n";
    }
    if (markdown) text += "\n";
  }
  if (!setup.assumptions.empty()) {
    std::vector<std::vector<std::string>> rows = {
        {"left open", "assumed here"}};
    for (const auto& [open, assumed] : setup.assumptions) {
      rows.push_back({open, assumed});
    }
    text += PartHeading("what the paper leaves open", markdown) +
            Block(Grid(rows, 1, markdown), markdown);
  }
  text += HowToRead(setup, markdown);
  if (any_brief) {
    text += Lines({"Each case has its own table in tables.md."}, markdown);
  }
  return text;
}

}  // namespace granopt
