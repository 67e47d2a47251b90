#include "experiments/compare_report.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstdio>
#include <set>

#include "experiments/basins.h"
#include "experiments/comparison_text.h"
#include "experiments/step_tables.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"

namespace granopt {
namespace {

constexpr int kCasesPerFigure = 3;
// Cases whose figures an earlier comparison may have left behind.
constexpr int kMostCases = 99;

void AddPicture(const std::string& base, std::vector<std::string>* names) {
  names->push_back(base + ".svg");
  names->push_back(base + ".png");
}

// "curves", "curves_2", ...
std::string PageName(const std::string& kind, int first_case) {
  const int page = first_case / kCasesPerFigure + 1;
  return page == 1 ? kind : kind + Format("_%d", page);
}

// `data`: the folder of the raw files; figures go to the folder of `output`.
void Draw(const ComparisonSetup& setup,
          const std::vector<StepTable>& steps,
          const std::string& data,
          Output* output) {
  std::vector<std::string> levels;
  for (const Level& level : setup.levels) {
    levels.push_back(std::string("--level=") + KindOf(level) + ":" +
                     Neat(level.value));
  }
  const auto draw = [&](const std::string& name,
                        std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), levels.begin(), levels.end());
    return output->Plot(arguments, {name + ".svg", name + ".png"});
  };
  const int cases = static_cast<int>(setup.cases.size());
  for (int first = 0; first < cases; first += kCasesPerFigure) {
    std::string chosen;
    for (int c = first; c < std::min(cases, first + kCasesPerFigure); ++c) {
      chosen += (chosen.empty() ? "" : ";") + setup.cases[c].id;
    }
    for (const std::string kind : {"curves", "work"}) {
      const std::string name = PageName(kind, first);
      if (!draw(name,
                {kind,
                 data + (kind == "curves" ? "/curves.csv" : "/events.csv"),
                 output->Path(name),
                 "--cases=" + chosen})) {
        return;
      }
    }
  }
  // Against the distance, where there are two.
  std::set<double> all, plain;
  for (const StepTable& table : steps) {
    (table.kind == "all" ? all : plain).insert(table.table_case.distance);
  }
  const std::string table = output->Path("step_tables.csv");
  if (all.size() > 1) {
    draw("distances",
         {"distances", table, output->Path("distances"), "--steps=all"});
    if (setup.paper == "fig7") {
      draw("fig7", {"fig7", table, output->Path("fig7")});
    }
  }
  if (plain.size() > 1) {
    const std::string name = "distances_non_rearranging";
    draw(name,
         {"distances",
          table,
          output->Path(name),
          std::string("--steps=") + kNonRearranging});
  }
}

}  // namespace

void CreateOutput(const std::string& folder, Kept kept, Output* output) {
  std::vector<std::string> names = {"tables.csv",
                                    "tables.md",
                                    "step_tables.csv",
                                    "basins.csv",
                                    "profile.csv",
                                    "quality.csv",
                                    "protocol_tables.csv",
                                    "jamming_table.csv",
                                    "shear_table.csv"};
  for (int first = 0; first < kMostCases; first += kCasesPerFigure) {
    AddPicture(PageName("curves", first), &names);
    AddPicture(PageName("work", first), &names);
  }
  for (const char* name : {"profile",
                           "quality",
                           "distances",
                           "distances_non_rearranging",
                           "fig7",
                           "protocol"}) {
    AddPicture(name, &names);
  }
  if (kept != Kept::SUMMARY) names.push_back("summary.json");
  if (kept == Kept::NOTHING) {
    names.insert(names.end(),
                 {"setup.json",
                  "events.csv",
                  "runs.csv",
                  "curves.csv",
                  "steps.csv",
                  "protocol_steps.csv",
                  "protocol_runs.csv"});
  }
  output->Create(folder, names);
}

bool IsInterrupted(const std::string& setup) {
  const std::string path = FLAGS_out + "/setup.json";
  std::string text, error;
  if (!Exists(path)) return false;
  if (!ReadFile(path, &text, &error)) BadInput("--resume: " + error);
  if (text != setup) {
    BadInput("--resume: " + path +
             " is of a comparison with other flags; give the same ones, or "
             "another --out");
  }
  return true;
}

bool Exists(const std::string& path) {
  struct stat status;
  return stat(path.c_str(), &status) == 0;
}

void WriteProfiles(const ComparisonProfiles& profiles, Output* output) {
  const auto write = [output](const char* name, const std::string& csv) {
    const std::string file = std::string(name) + ".csv";
    output->Write(file, csv);
    output->Plot({name, output->Path(file), output->Path(name)},
                 {std::string(name) + ".svg", std::string(name) + ".png"});
  };
  if (!profiles.profiles.empty()) {
    write("profile", ProfilesCsv(profiles.profiles));
  }
  if (!profiles.qualities.empty()) {
    write("quality", QualitiesCsv(profiles.qualities));
  }
}

RawRecords ReadRaw(const std::string& data, bool with_curves) {
  RawRecords raw;
  ReadRecords(data + "/events.csv", &raw.events);
  ReadRecords(data + "/runs.csv", &raw.runs);
  const std::string steps = data + "/steps.csv";
  if (Exists(steps)) ReadRecords(steps, &raw.steps);
  if (with_curves) ReadRecords(data + "/curves.csv", &raw.curves);
  return raw;
}

std::vector<Table> Report(const ComparisonSetup& setup,
                          const std::string& data,
                          const RawRecords& raw,
                          Output* output) {
  const std::vector<RunRecord>& runs = raw.runs;
  const std::vector<Table> tables = Tabulate(setup, raw.events, runs);
  const std::vector<StepTable> steps =
      TabulateSteps(setup, raw.events, runs, raw.steps);
  const std::vector<BasinRow> basins = TabulateBasins(setup, runs, raw.steps);
  const ComparisonProfiles profiles =
      MakeComparisonProfiles(setup, raw.events, runs);
  const auto text = [&](bool markdown) {
    return TablesText(setup, tables, runs, markdown) + (markdown ? "\n" : "") +
           StepTablesText(setup, steps, raw.steps, markdown) +
           BasinsText(setup, basins, markdown) +
           ProfilesText(profiles.profiles, markdown) +
           QualitiesText(profiles.qualities, markdown);
  };
  output->Write("tables.csv", TablesCsv(tables));
  if (!steps.empty()) output->Write("step_tables.csv", StepTablesCsv(steps));
  if (!basins.empty()) output->Write("basins.csv", BasinsCsv(basins));
  output->Write("tables.md", text(true));
  std::fputs(text(false).c_str(), stdout);
  Draw(setup, steps, data, output);
  WriteProfiles(profiles, output);
  int converged = 0;
  for (const RunRecord& run : runs) converged += run.converged ? 1 : 0;
  std::printf("\n%d of %zu runs converged\n", converged, runs.size());
  return tables;
}

}  // namespace granopt
