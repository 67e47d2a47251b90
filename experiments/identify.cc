// identify: the parameters that make a near-field flow behave as asked (Zohdi,
// Int. J. Solids Struct. 42 (2005) 539, sec. 8).
//
//   identify                    a search, its winners on fresh starts, what is
//                               determined and what is not
//   identify --paper            Fig. 7, Table 1, Fig. 8; other methods on the
//                               same budget; a profile; a recovery
//   identify --external ...     writes strings that others evaluate:
//   identify --worker ...       evaluates a share of them

#include <algorithm>
#include <cstdio>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/identify_alternatives.h"
#include "experiments/identify_external.h"
#include "experiments/identify_flags.h"
#include "experiments/identify_profile.h"
#include "experiments/identify_record.h"
#include "experiments/identify_report.h"
#include "experiments/identify_response.h"
#include "experiments/identify_search.h"
#include "experiments/identify_setup.h"
#include "experiments/run.h"
#include "solvers/search/search.h"

namespace granopt::identify {
namespace {

// Table 1.
struct Published {
  double string[4];
  double value;
};
constexpr Published kTable1[] = {
    {{0.35935, 0.67398, 0.25659, 1.58766}, 0.065228},
    {{0.31214, 0.67816, 0.22113, 1.65054}, 0.065690},
    {{0.30032, 0.54474, 0.22240, 1.51649}, 0.070433},
    {{0.31143, 0.57278, 0.25503, 1.36696}, 0.073200},
    {{0.32872, 0.74653, 0.25560, 1.56315}, 0.078229},
    {{0.30580, 0.74276, 0.27228, 1.36962}, 0.090701}};

int Leave(Record* record, const Workers& workers) {
  record->Clear();
  if (workers.waiting() > 0) {
    std::printf(
        "\n%d strings wait in %s/strings.csv: evaluate them by --worker and "
        "give the same command again\n",
        workers.waiting(),
        FLAGS_out.c_str());
  } else {
    std::printf(
        "\nstopped as asked, after %lld runs: the same command with "
        "--resume goes on\n",
        static_cast<long long>(record->runs()));
  }
  return kNotConverged;
}

// What runs do on average with known values; empty if asked to stop.
EnergyCurve KnownTarget(const Task& task, const std::vector<double>& values) {
  const Response response =
      RunResponse(task, values, FLAGS_smoke ? 5 : 20, kRecover);
  if (StopRequested()) return {};
  if (response.failed > 0) {
    BadInput(Format("the parameters to recover fail on %d of %zu starts",
                    response.failed,
                    response.failed + response.curves.size()));
  }
  return MeanCurve(response);
}

Candidate Given(const std::string& origin, const std::vector<double>& string) {
  Candidate candidate;
  candidate.origin = origin;
  candidate.string = string;
  return candidate;
}

void PrintTask(const Task& task) {
  std::string searched;
  for (const SearchedFlag& flag : task.flags) {
    searched += Format("%s%s in [%g, %g]",
                       searched.empty() ? "" : ", ",
                       flag.name.c_str(),
                       flag.low,
                       flag.high);
  }
  std::printf("identify  %s\n", searched.c_str());
  if (!FLAGS_recover.empty()) {
    std::printf("          target: what %s do on average\n",
                FLAGS_recover.c_str());
  } else if (!FLAGS_target.empty()) {
    std::printf("          target: %s, %zu times\n",
                FLAGS_target.c_str(),
                task.target.time.size());
  } else {
    std::printf("          target: T, T_b, T_r = %s J/kg at all times\n",
                FLAGS_target_energies.c_str());
  }
  std::fflush(stdout);
}

// What is found beside what it was looked for in.
struct Findings {
  Identification id;
  std::vector<ProfilePoint> profile;
  // The flow that the paper's best string makes, found again.
  Task recovery_task;
  Identification recovery;
  std::vector<AlternativeRun> alternatives;
};

// False if halted.
bool FindAll(Record* record,
             const Task& task,
             const EnsembleRule& rule,
             const std::vector<double>& known,
             Findings* found) {
  std::vector<Candidate> others;
  if (FLAGS_paper) {
    for (std::size_t k = 0; k < std::size(kTable1); ++k) {
      others.push_back(
          Given(Format("Table 1, %zu", k + 1),
                {std::begin(kTable1[k].string), std::end(kTable1[k].string)}));
      others.back().reported = kTable1[k].value;
    }
  }
  if (!known.empty()) others.push_back(Given("known", known));
  if (!Identify(record, "", task, rule, FLAGS_gradient, others, &found->id)) {
    return false;
  }
  if (FLAGS_profile && !RunProfile(record, task, found->id, &found->profile)) {
    return false;
  }
  if (FLAGS_recovery) {
    const std::vector<double> first(std::begin(kTable1[0].string),
                                    std::end(kTable1[0].string));
    found->recovery_task = task;
    found->recovery_task.target = KnownTarget(task, first);
    if (StopRequested()) {
      record->Save();
      return false;
    }
    if (!Identify(record,
                  "recovery_",
                  found->recovery_task,
                  SearchRule(false),
                  false,
                  {Given("known", first)},
                  &found->recovery)) {
      return false;
    }
  }
  return !FLAGS_alternatives ||
         RunAlternatives(
             record, task, found->id.search.runs, &found->alternatives);
}

// One flow of a string, its start and its end.
void WriteFlow(const Task& task,
               const std::vector<double>& string,
               Output* output) {
  FlowCase flow;
  std::unique_ptr<Stepper> stepper;
  EnergyCurve curve;
  std::string error;
  if (!Compose(task,
               string,
               StartSeed(run_seed, Fixed(1, kFresh), 0, 0),
               &flow,
               &stepper,
               &error)) {
    return;
  }
  output->Write("best_start.xyz", Frame(*flow.scene, flow.state, 17));
  RunCurve(&flow, stepper.get(), FLAGS_duration, &curve, &error);
  output->Write("best_final.xyz", Frame(*flow.scene, flow.state, 17));
}

void Plot(const char* figure,
          const std::vector<std::string>& tables,
          Output* output) {
  std::vector<std::string> arguments = {std::string("identify_") + figure};
  for (const std::string& table : tables) {
    arguments.push_back(output->Path(table));
  }
  arguments.push_back(output->Path(figure));
  output->Plot(arguments,
               {std::string(figure) + ".svg", std::string(figure) + ".png"});
}

Json Report(const Task& task,
            const Findings& found,
            const Response& response,
            const Record& record,
            Output* output) {
  const Candidate& best = found.id.candidates[found.id.best];
  PrintIdentification(task, found.id, 6);
  Json json = IdentificationJson(task, found.id);
  const Json errors = ReportErrors(task, response);
  if (!errors.is_null()) json["best"]["errors_of_target"] = errors;
  json["parameters"] = Json::array();
  for (const SearchedFlag& flag : task.flags) {
    json["parameters"].push_back(
        {{"name", flag.name}, {"low", flag.low}, {"high", flag.high}});
  }
  json["method"] = FLAGS_method;
  json["ensemble"] = FLAGS_ensemble;
  json["ensemble_tolerance"] = FLAGS_ensemble_tolerance;
  output->Write("history.csv", HistoryCsv(found.id));
  output->Write("fresh.csv", FreshCsv(task, found.id));
  output->Write("strings_evaluated.csv", StringsCsv(task, record));
  output->Write("target.csv", FormatCurve(task.target));
  output->Write("response.csv", ResponseCsv(response, task.target));
  WriteFlow(task, best.string, output);
  if (!found.profile.empty()) {
    ReportProfile(task, best, found.profile, output);
  }
  if (!found.alternatives.empty()) {
    json["alternatives"] = ReportAlternatives(task, found.alternatives, output);
  }
  if (FLAGS_recovery) {
    std::printf(
        "\n  recovery of the first string of Table 1 from what it does "
        "on average over %d starts\n",
        FLAGS_smoke ? 5 : 20);
    PrintIdentification(found.recovery_task, found.recovery, 3);
    json["recovery"] = IdentificationJson(found.recovery_task, found.recovery);
    output->Write("recovery.csv",
                  FreshCsv(found.recovery_task, found.recovery));
  }
  Plot("convergence", {"history.csv"}, output);
  Plot("response", {"response.csv"}, output);
  Plot("valley", {"fresh.csv", "strings_evaluated.csv"}, output);
  if (!found.profile.empty()) Plot("profile", {"profile.csv"}, output);
  if (!found.alternatives.empty()) {
    Plot("alternatives", {"alternatives.csv"}, output);
  }
  return json;
}

int RunIdentify() {
  Task task = MakeTask();
  std::vector<double> known;
  if (!FLAGS_recover.empty()) {
    if (IsGiven("target") || IsGiven("target_energies")) {
      BadInput("--recover makes its target itself: no --target");
    }
    known = ReadNumbers("recover", FLAGS_recover);
    if (known.size() != task.flags.size()) {
      BadInput(Format("--recover=%s: %zu values for %zu parameters",
                      FLAGS_recover.c_str(),
                      known.size(),
                      task.flags.size()));
    }
  }
  CatchStopSignals();
  PrintTask(task);
  // The known values are in the set-up themselves.
  const Json setup = Setup(task);
  if (!known.empty()) task.target = KnownTarget(task, known);
  const Checkpoint checkpoint(CheckpointPath(), setup);
  Workers workers(Crc32(setup.dump()));
  // Workers are told whole lists.
  Record record(
      &checkpoint,
      [&](const std::string& stage,
          const Task& of,
          const EnsembleRule& by,
          const std::vector<std::int64_t>& indices,
          std::vector<Ensemble>* ensembles,
          const std::function<void(int, int, int)>& show) {
        return FLAGS_external
                   ? workers.Collect(stage, of, by, indices, ensembles)
                   : RunEnsembles(of, indices, by, ensembles, show);
      },
      FLAGS_external ? std::numeric_limits<std::size_t>::max()
                     : std::max(8, FLAGS_threads));
  if (StopRequested()) return Leave(&record, workers);
  const EnsembleRule rule = SearchRule(FLAGS_ensemble == "paper");
  std::printf(
      "          %s; at least %d starts a string, until two means in a "
      "row agree to %g\n",
      FLAGS_method.c_str(),
      rule.least,
      rule.tolerance);
  Json written;
  if ((FLAGS_resume || FLAGS_external) && Resume(checkpoint, &written)) {
    try {
      record.Load(written);
    } catch (const Json::exception& exception) {
      RefuseState(checkpoint, exception);
    }
    std::printf("          resumed after %lld runs\n",
                static_cast<long long>(record.loaded()));
  }
  std::fflush(stdout);
  std::vector<std::string> names = {"summary.json",
                                    "strings_evaluated.csv",
                                    "history.csv",
                                    "fresh.csv",
                                    "response.csv",
                                    "target.csv",
                                    "profile.csv",
                                    "alternatives.csv",
                                    "recovery.csv",
                                    "best_start.xyz",
                                    "best_final.xyz",
                                    "strings.csv"};
  for (const char* figure :
       {"convergence", "response", "valley", "profile", "alternatives"}) {
    names.push_back(std::string(figure) + ".svg");
    names.push_back(std::string(figure) + ".png");
  }
  const std::vector<std::string> kept = CheckpointFiles();
  const bool goes_on = FLAGS_resume || FLAGS_external;
  if (!goes_on) names.insert(names.end(), kept.begin(), kept.end());
  Output output;
  output.Create(FLAGS_out, names, kept);
  const double cpu = CpuSeconds();

  Findings found;
  if (!FindAll(&record, task, rule, known, &found)) {
    return Leave(&record, workers);
  }
  record.Save();
  record.Clear();
  const Response response =
      RunResponse(task, found.id.candidates[found.id.best].string, 20, kFresh);
  if (StopRequested()) return Leave(&record, workers);
  Json json = Report(task, found, response, record, &output);
  // A flow that was cut short is no result.
  if (StopRequested()) return Leave(&record, workers);
  json["cpu_seconds"] = CpuSeconds() - cpu;
  json["all_runs"] = record.runs();
  json["schema"] = "granopt/identify/1";
  json["provenance"] = Provenance();
  json["provenance"]["threads"] = FLAGS_threads;
  output.WriteJson("summary.json", json);
  std::printf("\n  %lld runs in all; %.3g CPU seconds of this run\n",
              static_cast<long long>(record.runs()),
              json["cpu_seconds"].get<double>());
  output.PrintFiles();
  return kConverged;
}

int Main() {
  if (FLAGS_list_methods) {
    std::fputs(SearchTable().c_str(), stdout);
    return kConverged;
  }
  run_seed = FLAGS_seed;
  CheckFlags();
  return FLAGS_worker ? RunWorker() : RunIdentify();
}

}  // namespace
}  // namespace granopt::identify

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "parameters of a near-field flow from its energies "
                      "(--paper: sec. 8.2 of Zohdi 2005)");
  return granopt::identify::Main();
}
