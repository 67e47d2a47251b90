#include "experiments/identify_external.h"

#include <dirent.h>

#include <cstdio>
#include <map>
#include <set>

#include "experiments/checkpoint.h"
#include "experiments/identify_flags.h"
#include "experiments/identify_report.h"
#include "experiments/identify_setup.h"
#include "experiments/run.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"

namespace granopt::identify {

bool Workers::Collect(const std::string& stage,
                      const Task& task,
                      const EnsembleRule& rule,
                      const std::vector<std::int64_t>& indices,
                      std::vector<Ensemble>* ensembles) {
  std::map<std::int64_t, std::map<int, double>> found;
  std::set<std::string> files;
  if (DIR* directory = opendir(FLAGS_out.c_str())) {
    while (const dirent* entry = readdir(directory)) {
      const std::string file = entry->d_name;
      if (file.rfind("values_", 0) == 0 && file.size() > 4 &&
          file.substr(file.size() - 4) == ".csv") {
        files.insert(FLAGS_out + "/" + file);
      }
    }
    closedir(directory);
  }
  for (const std::string& file : files) {
    std::string text, error;
    if (!ReadFile(file, &text, &error)) BadInput(error);
    CsvReader csv(text, file);
    if (!csv.Begin(&error)) BadInput(error);
    while (csv.Row() && csv.error().empty()) {
      std::string of;
      std::int64_t setup = 0, index = 0;
      int run = 0;
      double value = 0.0;
      csv.Read("setup", &setup);
      csv.Read("stage", &of);
      csv.Read("index", &index);
      csv.Read("run", &run);
      csv.Read("P", &value);
      if (setup == static_cast<std::int64_t>(setup_) && of == stage) {
        found[index][run] = value;
      }
    }
    if (!csv.error().empty()) BadInput(csv.error());
  }
  std::string asked = "setup,stage,index,least,most,tolerance,common,stream";
  for (const SearchedFlag& flag : task.flags) asked += "," + flag.name;
  asked += "\n";
  for (std::size_t s = 0; s < indices.size(); ++s) {
    std::vector<double>& values = (*ensembles)[s].values;
    const auto& runs = found[indices[s]];
    for (auto run = runs.find(0); run != runs.end() && !IsSettled(rule, values);
         run = runs.find(static_cast<int>(values.size()))) {
      values.push_back(run->second);
    }
    if (IsSettled(rule, values)) continue;
    ++waiting_;
    asked += Format("%u,%s,%lld,%d,%d,%.17g,%d,%llu",
                    setup_,
                    stage.c_str(),
                    static_cast<long long>(indices[s]),
                    rule.least,
                    rule.most,
                    rule.tolerance,
                    rule.is_common ? 1 : 0,
                    static_cast<unsigned long long>(rule.stream)) +
             Values((*ensembles)[s].string) + "\n";
  }
  if (waiting_ == 0) return true;
  std::string error;
  if (!WriteFileAtomically(FLAGS_out + "/strings.csv", asked, &error)) {
    BadInput(error);
  }
  return false;
}

int RunWorker() {
  if (FLAGS_strings.empty()) BadInput("--worker needs --strings=FILE");
  int part = 0, parts = 0, used = 0;
  if (std::sscanf(FLAGS_share.c_str(), "%d/%d%n", &part, &parts, &used) != 2 ||
      used != static_cast<int>(FLAGS_share.size()) || parts < 1 || part < 1 ||
      part > parts) {
    BadInput("--share=" + FLAGS_share + " must be k/n with 1 <= k <= n");
  }
  const Task task = MakeTask();
  const std::uint32_t setup = Crc32(Setup(task).dump());
  std::string text, error;
  if (!ReadFile(FLAGS_strings, &text, &error)) BadInput("--strings: " + error);
  CsvReader csv(text, FLAGS_strings);
  if (!csv.Begin(&error)) BadInput("--strings: " + error);
  struct Row {
    std::string stage;
    std::int64_t index = 0;
    EnsembleRule rule;
    Ensemble ensemble;
  };
  std::vector<Row> rows;
  for (int number = 0; csv.Row() && csv.error().empty(); ++number) {
    Row row;
    std::int64_t asked = 0;
    csv.Read("setup", &asked);
    csv.Read("stage", &row.stage);
    csv.Read("index", &row.index);
    csv.Read("least", &row.rule.least);
    csv.Read("most", &row.rule.most);
    csv.Read("tolerance", &row.rule.tolerance);
    csv.Read("common", &row.rule.is_common);
    csv.Read("stream", &row.rule.stream);
    for (const SearchedFlag& flag : task.flags) {
      double value = 0.0;
      csv.Read(flag.name.c_str(), &value);
      row.ensemble.string.push_back(value);
    }
    if (csv.error().empty() && asked != static_cast<std::int64_t>(setup)) {
      csv.Complain("asked for with other flags than this worker's");
    }
    if (number % parts == part - 1) rows.push_back(row);
  }
  if (!csv.error().empty()) BadInput("--strings: " + csv.error());
  // Each list has files of its own: a share of this one must not take the place
  // of what others have found for those before.
  const std::string list = Format("%08x_%d_of_%d", Crc32(text), part, parts);
  const std::string name = "values_" + list + ".csv";
  const std::string about = "worker_" + list + ".json";
  Output output;
  output.Create(FLAGS_out, {name, about});
  CatchStopSignals();
  std::string values = "setup,stage,index,run,P\n";
  Progress progress;
  std::int64_t runs = 0;
  std::size_t done = 0;
  bool stopped = false;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    Row& row = rows[k];
    std::vector<Ensemble> one = {row.ensemble};
    if (!RunEnsembles(task, {row.index}, row.rule, &one, [&](int, int, int) {
          if (progress.Due()) {
            progress.Show(Format("string %zu of %zu", k + 1, rows.size()));
          }
        })) {
      stopped = true;
      break;
    }
    for (std::size_t r = 0; r < one[0].values.size(); ++r) {
      values += Format("%u,%s,%lld,%zu,%.17g\n",
                       setup,
                       row.stage.c_str(),
                       static_cast<long long>(row.index),
                       r,
                       one[0].values[r]);
    }
    runs += one[0].values.size();
    ++done;
  }
  progress.Clear();
  output.Write(name, values);
  output.WriteJson(about,
                   {{"schema", "granopt/identify_worker/1"},
                    {"strings", done},
                    {"runs", runs},
                    {"provenance", Provenance()}});
  if (stopped) {
    std::printf("stopped as asked, after %zu of %zu strings; they are in %s\n",
                done,
                rows.size(),
                output.Path(name).c_str());
    return kNotConverged;
  }
  std::printf("identify  share %d of %d: %zu strings, %lld runs, in %s\n",
              part,
              parts,
              rows.size(),
              static_cast<long long>(runs),
              output.Path(name).c_str());
  return kConverged;
}

}  // namespace granopt::identify
