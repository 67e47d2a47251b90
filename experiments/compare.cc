// compare: methods against each other on the same packings, interleaved.
//
//   compare --solvers="label@spec;spec;..." --cases=growth,simple_shear,random
//           --input=F.xyz | --particles=N --phi=P --seeds=1-3
//           --repetitions=3 --tolerance=1e-10 | --paper=table1|fig2|fig7
//           --out=DIR [--resume]
//   compare --cases=near_jamming=1e-6,near_jamming=0.3x --steps=10
//           --reference=LABEL ...
//   compare --protocol=jamming|shear ...      (compare_protocol.cc)
//   compare --replot=DIR
//
// Raw events first (events.csv, runs.csv, curves.csv; steps.csv of chains of
// shear steps), then tables and figures from these alone, which --replot makes
// again. Times are CPU seconds of Minimize() alone; preparing the packings and
// measuring the results is not in them.

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "experiments/compare_flags.h"
#include "experiments/compare_plan.h"
#include "experiments/compare_protocol.h"
#include "experiments/compare_report.h"
#include "experiments/compare_runs.h"
#include "experiments/compare_starts.h"
#include "experiments/preparation.h"
#include "experiments/protocol_records.h"
#include "experiments/replot.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/atomic_file.h"

namespace granopt {
namespace {

int Replot() {
  RefuseOthersWithReplot(
      {"baseline", "reference", "protocol", "tolerance", "absolute_tolerance"});
  const std::string data = FolderToReplot(FLAGS_replot);
  std::string text, error;
  ComparisonSetup setup;
  if (!ReadFile(data + "/setup.json", &text, &error)) {
    BadInput("--replot: " + error);
  }
  if (IsProtocolSetup(text)) return ReplotProtocols(data, text);
  if (IsGiven("protocol")) {
    BadInput("--replot: " + data + " is of no protocol");
  }
  if (!ParseSetup(text, data + "/setup.json", &setup, &error)) {
    BadInput("--replot: " + error);
  }
  Level level;
  if (GivenLevel(&level)) {
    const std::vector<Level> ladder = Ladder(setup.levels);
    if (std::find(ladder.begin(), ladder.end(), level) == ladder.end()) {
      BadInput(
          Format("--replot: %g is none of the recorded levels (decades "
                 "and the tolerances of the runs)",
                 level.value));
    }
    const Level& stop = setup.levels[0];
    if (level.absolute == stop.absolute && level.value < stop.value) {
      BadInput(Format("--replot: the runs stopped at %g", stop.value));
    }
    setup.levels = {level};
  }
  SetBaselineAndReference(&setup);
  const RawRecords raw = ReadRaw(data, /*with_curves=*/false);
  Output output;
  CreateOutput(IsGiven("out") ? FLAGS_out : data, Kept::SUMMARY, &output);
  std::printf("compare   tables and figures of %s again\n", data.c_str());
  Report(setup, data, raw, &output);
  output.PrintFiles();
  return kConverged;
}

Json SummaryJson(const Plan& plan,
                 const Preparation& preparation,
                 const std::vector<RunRecord>& runs,
                 const std::vector<Table>& tables) {
  const Scene& scene = plan.scene;
  std::size_t converged = 0;
  for (const RunRecord& run : runs) converged += run.converged ? 1 : 0;
  Json json;
  json["converged"] = converged == runs.size();
  json["runs"] = runs.size();
  json["runs_converged"] = converged;
  json["alpha"] = scene.energy.alpha;
  json["k"] = scene.energy.stiffness;
  json["precision"] = PrecisionName(scene.energy.precision);
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["prepare_solver"] = plan.prepare->name();
  json["prepared"] = preparation.json();
  json["tables"] = Json::array();
  for (const Table& table : tables) {
    Json one;
    one["case"] = table.table_case.id;
    one["absolute"] = table.level.absolute;
    one["level"] = table.level.value;
    one["rows"] = Json::array();
    for (const TableRow& row : table.rows) {
      // Infinite (never reached) is null in JSON.
      one["rows"].push_back({{"solver", row.method.label},
                             {"runs", row.runs},
                             {"reached", row.reached},
                             {"iterations", row.costs[kIterations].median},
                             {"evaluations", row.costs[kEvaluations].median},
                             {"cpu_seconds", row.costs[kCpuSeconds].median},
                             {"ratio", row.ratio.median},
                             {"minima", row.minima},
                             {"end", row.end}});
    }
    json["tables"].push_back(one);
  }
  json["setup"] = Json::parse(FormatSetup(plan.setup));
  json["schema"] = "granopt/compare/1";
  json["provenance"] = Provenance();
  return json;
}

int Main() {
  ListSolversIfAsked();
  if (IsGiven("replot")) return Replot();
  if (IsGiven("protocol")) return CompareProtocols();
  RefuseFlags(
      {"tolerances", "phi_init", "dphi", "epsilon", "strain", "strain_steps"},
      "needs --protocol");
  const Plan plan = MakePlan();
  const bool resumed = FLAGS_resume && IsInterrupted(FormatSetup(plan.setup));
  RawRecords before;
  // The last of them that is written.
  if (resumed && Exists(FLAGS_out + "/runs.csv")) {
    before = ReadRaw(FLAGS_out, /*with_curves=*/true);
  }
  Output output;
  CreateOutput(FLAGS_out, resumed ? Kept::RAW : Kept::NOTHING, &output);
  PrintPlan(plan);
  output.Write("setup.json", FormatSetup(plan.setup));

  Preparation preparation(plan.scene, *plan.prepare, plan.phi, &output);
  Starts starts;
  std::vector<StepRecord> steps;
  std::string error;
  if (!MakeStarts(plan, &preparation, &starts, &steps, &error)) {
    preparation.ClearProgress();
    std::fprintf(stderr, "compare: near_jamming: %s\n", error.c_str());
    return kNotConverged;
  }
  preparation.PrintLines();
  if (FLAGS_input.empty() || preparation.lines().size() > 1) {
    std::printf(
        "          (kept as prepared_<name>.xyz; used again by a later "
        "comparison in this folder)\n");
  }
  std::fflush(stdout);

  if (!steps.empty()) output.Write("steps.csv", FormatCsv(steps));
  const std::vector<RunRecord> runs =
      RunAll(plan, starts, std::move(before), &output);
  const std::vector<Table> tables =
      Report(plan.setup,
             output.folder(),
             ReadRaw(output.folder(), /*with_curves=*/false),
             &output);
  const Json json = SummaryJson(plan, preparation, runs, tables);
  output.WriteJson("summary.json", json);
  output.PrintFiles();
  return json["converged"].get<bool>() ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "compare methods on the same packings: work, time and "
                      "where they end, with tables and figures");
  return granopt::Main();
}
