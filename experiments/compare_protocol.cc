// compare --protocol: each method drives a whole protocol by itself.
//
//   compare --protocol=jamming --particles=256 --seeds=1-3
//           --solvers="label@spec;spec;..." --tolerances=1e-4,1e-6,1e-8
//   compare --protocol=shear --phi=0.86 --strain=0.02 --strain_steps=200
//
// jamming: Algorithm 1 as published; then, with one method for all and outside
// of what is counted, the branch of the state that came out is followed down to
// its own jamming point. shear: quasistatic pure shear of one relaxed packing.

#include "experiments/compare_protocol.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <set>
#include <vector>

#include "experiments/compare_flags.h"
#include "experiments/compare_protocol_plan.h"
#include "experiments/compare_protocol_runs.h"
#include "experiments/compare_report.h"
#include "experiments/preparation.h"
#include "experiments/protocol_profiles.h"
#include "experiments/protocol_tables.h"
#include "experiments/protocol_text.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

// The raw files in `data`.
ProtocolRecords ReadProtocolRecords(const std::string& data) {
  ProtocolRecords records;
  ReadRecords(data + "/protocol_steps.csv", &records.steps);
  ReadRecords(data + "/protocol_runs.csv", &records.runs);
  return records;
}

// Of an interrupted comparison, without steps of a run that is not there: they
// will come again.
ProtocolRecords ReadWholeProtocols(const std::string& data) {
  ProtocolRecords records = ReadProtocolRecords(data);
  std::set<ProtocolPlace> whole;
  for (const ProtocolRun& run : records.runs) whole.insert(PlaceOf(run.key));
  std::vector<ProtocolStep>& steps = records.steps;
  steps.erase(std::remove_if(steps.begin(),
                             steps.end(),
                             [&whole](const ProtocolStep& step) {
                               return whole.count(PlaceOf(step.key)) == 0;
                             }),
              steps.end());
  return records;
}

void ReportProtocols(const ProtocolSetup& setup,
                     const std::string& data,
                     const ProtocolRecords& records,
                     Output* output) {
  output->Write("protocol_tables.csv",
                ProtocolTablesCsv(TabulateProtocols(setup, records.runs)));
  std::vector<std::string> arguments = {
      "protocol", setup.protocol, data, output->Path("protocol")};
  if (setup.protocol == kJammingProtocol) {
    output->Write("jamming_table.csv",
                  JammingTableCsv(TabulateJamming(setup, records.runs)));
    arguments.push_back("--epsilon=" + Neat(setup.epsilon));
  } else {
    output->Write("shear_table.csv",
                  ShearTableCsv(TabulateShear(setup, records.steps)));
    arguments.push_back("--reference=" + setup.reference);
  }
  output->Write("tables.md",
                ProtocolText(setup, records.steps, records.runs, true));
  std::fputs(ProtocolText(setup, records.steps, records.runs, false).c_str(),
             stdout);
  WriteProfiles(MakeProtocolProfiles(setup, records.steps, records.runs),
                output);
  output->Plot(arguments, {"protocol.svg", "protocol.png"});
  int finished = 0;
  for (const ProtocolRun& run : records.runs) finished += run.finished ? 1 : 0;
  std::printf(
      "\n%d of %zu protocols finished\n", finished, records.runs.size());
}

Json SummaryJson(const ProtocolPlan& plan, const ProtocolRecords& records) {
  int finished = 0;
  for (const ProtocolRun& run : records.runs) finished += run.finished ? 1 : 0;
  Json json;
  json["protocol"] = plan.setup.protocol;
  json["converged"] = finished == static_cast<int>(records.runs.size());
  json["runs"] = records.runs.size();
  json["runs_finished"] = finished;
  json["alpha"] = plan.scene.energy.alpha;
  json["k"] = plan.scene.energy.stiffness;
  json["dimension"] = plan.scene.packing.dimension();
  json["particles"] = plan.scene.packing.size();
  json["prepare_solver"] = plan.prepare->name();
  json["rows"] = Json::array();
  for (const ProtocolRow& row : TabulateProtocols(plan.setup, records.runs)) {
    // Infinite (never finished) is null in JSON.
    json["rows"].push_back(
        {{"solver", row.method.label},
         {"tolerance", row.tolerance},
         {"runs", row.runs},
         {"finished", row.finished},
         {"relaxations", row.relaxations.median},
         {"iterations", row.costs[kIterations].median},
         {"evaluations", row.costs[kEvaluations].median},
         {"factorizations", row.costs[kFactorizations].median},
         {"cpu_seconds", row.costs[kCpuSeconds].median},
         {"ratio", row.ratio.median}});
  }
  json["setup"] = Json::parse(FormatProtocolSetup(plan.setup));
  json["schema"] = "granopt/compare_protocol/1";
  json["provenance"] = Provenance();
  return json;
}

}  // namespace

int CompareProtocols() {
  const ProtocolPlan plan = MakeProtocolPlan();
  const bool resumed =
      FLAGS_resume && IsInterrupted(FormatProtocolSetup(plan.setup));
  ProtocolRecords records;
  // The last of them that is written.
  if (resumed && Exists(FLAGS_out + "/protocol_runs.csv")) {
    records = ReadWholeProtocols(FLAGS_out);
  }
  Output output;
  CreateOutput(FLAGS_out, resumed ? Kept::RAW : Kept::NOTHING, &output);
  PrintPlan(plan);
  output.Write("setup.json", FormatProtocolSetup(plan.setup));
  std::vector<Packing> starts;
  if (plan.jamming()) {
    for (const std::uint64_t seed : plan.setup.seeds) {
      starts.push_back(MakeScene(plan.phi_init, seed).packing);
    }
  } else {
    Preparation preparation(plan.scene, *plan.prepare, plan.phi, &output);
    for (const std::uint64_t seed : plan.setup.seeds) {
      starts.push_back(preparation.Relaxed(seed));
    }
    preparation.PrintLines();
    std::fflush(stdout);
  }
  if (resumed) {
    std::printf("resumed   %zu protocols were there\n", records.runs.size());
    std::fflush(stdout);
  }
  RunProtocols(plan, starts, &output, &records);
  // As they were written.
  records = ReadProtocolRecords(output.folder());
  ReportProtocols(plan.setup, output.folder(), records, &output);
  const Json json = SummaryJson(plan, records);
  output.WriteJson("summary.json", json);
  output.PrintFiles();
  return json["converged"].get<bool>() ? kConverged : kNotConverged;
}

int ReplotProtocols(const std::string& data, const std::string& text) {
  ProtocolSetup setup;
  std::string error;
  if (!ParseProtocolSetup(text, data + "/setup.json", &setup, &error)) {
    BadInput("--replot: " + error);
  }
  if (IsGiven("protocol") && FLAGS_protocol != setup.protocol) {
    BadInput("--replot: " + data + " is of --protocol=" + setup.protocol);
  }
  RefuseFlags({"tolerance", "absolute_tolerance"},
              "cannot go with --replot of a protocol");
  SetBaseline(setup.methods, &setup.baseline);
  SetReference(setup.methods, &setup.reference);
  const ProtocolRecords records = ReadProtocolRecords(data);
  Output output;
  CreateOutput(IsGiven("out") ? FLAGS_out : data, Kept::SUMMARY, &output);
  std::printf("compare   tables and figures of %s again\n", data.c_str());
  ReportProtocols(setup, data, records, &output);
  output.PrintFiles();
  return kConverged;
}

}  // namespace granopt
