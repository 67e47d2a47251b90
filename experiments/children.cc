#include "experiments/children.h"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>

#include "experiments/help.h"
#include "experiments/jobs.h"
#include "granular/atomic_file.h"

namespace granopt {
namespace {

// Without the flags that do not change the result.
std::vector<std::string> ThatMatter(const std::vector<std::string>& words) {
  std::vector<std::string> kept;
  for (const std::string& word : words) {
    if (word.rfind("--out=", 0) != 0 && word.rfind("--resume", 0) != 0) {
      kept.push_back(word);
    }
  }
  return kept;
}

// False where there is no summary.json that can be parsed.
bool ReadSummary(const std::string& folder, Json* json) {
  std::string text, none;
  if (!ReadFile(folder + "/summary.json", &text, &none)) return false;
  *json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  return !json->is_discarded() && json->is_object();
}

// True if the run that left `json` was given these words.
bool IsOf(const Json& json, const std::vector<std::string>& arguments) {
  try {
    std::vector<std::string> command =
        json.at("provenance").at("command").get<std::vector<std::string>>();
    if (command.empty() || json.value("interrupted", false)) return false;
    command.erase(command.begin());
    return ThatMatter(command) ==
           ThatMatter({arguments.begin() + 1, arguments.end()});
  } catch (const Json::exception&) {
    return false;
  }
}

std::string LastLine(const std::string& path) {
  std::ifstream file(path);
  std::string last;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty()) last = line;
  }
  return last;
}

}  // namespace

std::vector<std::string> PassedFlags(const std::vector<std::string>& own) {
  std::vector<std::string> passed;
  for (const auto& flag : OwnFlags()) {
    if (!flag.is_default &&
        std::find(own.begin(), own.end(), flag.name) == own.end()) {
      passed.push_back("--" + flag.name + "=" + flag.current_value);
    }
  }
  return passed;
}

std::vector<ChildResult> RunChildren(const std::string& binary,
                                     const std::vector<Child>& children,
                                     int at_once,
                                     bool resume,
                                     bool children_resume,
                                     const Output& output,
                                     bool* interrupted,
                                     bool quiet) {
  std::vector<ChildResult> results(children.size());
  std::vector<Job> jobs;
  std::vector<std::size_t> child_of_job;
  for (std::size_t k = 0; k < children.size(); ++k) {
    const Child& child = children[k];
    const std::string folder = output.Path(child.name);
    Job job;
    job.name = child.name;
    job.program = kThisProgram;
    job.log = folder + "/log.txt";
    job.weight = child.weight;
    job.arguments = {binary};
    job.arguments.insert(
        job.arguments.end(), child.arguments.begin(), child.arguments.end());
    job.arguments.push_back("--out=" + folder);
    job.arguments.push_back("--pictures=false");
    Json json;
    const bool ended = ReadSummary(folder, &json);
    if (resume && ended && IsOf(json, job.arguments)) continue;
    if (mkdir(folder.c_str(), 0755) != 0 && errno != EEXIST) {
      BadInput("--out: cannot create folder '" + folder +
               "': " + std::strerror(errno));
    }
    // What an earlier run left behind must not be taken for the result of one
    // that did not get that far.
    std::remove((folder + "/summary.json").c_str());
    // A run that ended was one with other flags: there is nothing to go on
    // from.
    if (resume && children_resume && !ended) {
      job.arguments.push_back("--resume");
    }
    child_of_job.push_back(k);
    jobs.push_back(job);
  }
  if (jobs.size() < children.size()) {
    std::printf("          %zu of them complete, not run again\n",
                children.size() - jobs.size());
  }
  std::fflush(stdout);

  std::vector<JobOutcome> outcomes;
  {
    Progress progress;
    outcomes = RunJobs(
        jobs,
        at_once,
        [&progress](const JobProgress& p) {
          if (!progress.Due()) return;
          std::string line = Format("%d of %d runs done, %d running, %.0f s",
                                    p.done,
                                    p.total,
                                    p.running,
                                    p.seconds);
          if (p.interrupted) {
            line += "; interrupted, waiting for those to end";
          } else if (p.done > 0) {
            line += Format(", about %.0f s left", p.seconds_left);
          }
          progress.Show(line);
        },
        interrupted);
  }
  for (std::size_t k = 0; k < jobs.size(); ++k) {
    const JobOutcome& outcome = outcomes[k];
    if (outcome.state == JobOutcome::EXITED &&
        (outcome.status == kConverged || outcome.status == kNotConverged)) {
      continue;
    }
    std::string& failure = results[child_of_job[k]].failure;
    failure = Describe(outcome);
    if (outcome.state == JobOutcome::NOT_STARTED) continue;
    const std::string last = LastLine(jobs[k].log);
    if (outcome.state == JobOutcome::EXITED && !last.empty()) {
      failure += ": " + last;
    }
    if (quiet) continue;
    std::fprintf(stderr,
                 "%s: %s: %s\n",
                 binary.c_str(),
                 jobs[k].name.c_str(),
                 failure.c_str());
  }
  for (std::size_t k = 0; k < children.size(); ++k) {
    ChildResult& result = results[k];
    if (result.failure.empty() &&
        !ReadSummary(output.Path(children[k].name), &result.summary)) {
      result.failure = "no summary.json that can be read";
    }
  }
  return results;
}

}  // namespace granopt
