#include "experiments/shear_ensemble.h"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>

#include "experiments/jobs.h"
#include "experiments/scene.h"
#include "experiments/shear_events.h"

DECLARE_string(seeds);
DECLARE_string(mode);
DECLARE_double(pressure);

namespace granopt {
namespace {

struct ShearMember {
  std::uint64_t seed = 0;
  bool complete = false, converged = false;
  std::string failure;
  std::vector<StrainRow> rows;
  std::vector<EventRow> events;
  bool has_events = false;
};

std::string NameOf(const ShearMember& member) {
  return Format("seed%llu", static_cast<unsigned long long>(member.seed));
}

std::string ReadText(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

// The words that decide on the result.
std::vector<std::string> ThatMatter(const std::vector<std::string>& words) {
  std::vector<std::string> kept;
  for (std::size_t k = 1; k < words.size(); ++k) {
    if (words[k].rfind("--out=", 0) != 0 &&
        words[k].rfind("--resume", 0) != 0) {
      kept.push_back(words[k]);
    }
  }
  return kept;
}

bool IsComplete(const std::string& folder,
                const std::vector<std::string>& arguments) {
  const Json json = Json::parse(
      ReadText(folder + "/summary.json"), nullptr, /*allow_exceptions=*/false);
  try {
    return ThatMatter(json.at("provenance")
                          .at("command")
                          .get<std::vector<std::string>>()) ==
           ThatMatter(arguments);
  } catch (const Json::exception&) {
    return false;
  }
}

void ReadMember(const std::string& folder, ShearMember* member) {
  const Json json = Json::parse(
      ReadText(folder + "/summary.json"), nullptr, /*allow_exceptions=*/false);
  try {
    json.at("converged").get_to(member->converged);
  } catch (const Json::exception& exception) {
    member->failure = std::string("summary.json: ") + exception.what();
    return;
  }
  if (!ParseCurves(
          ReadText(folder + "/curves.csv"), &member->rows, &member->failure)) {
    return;
  }
  const std::string events = ReadText(folder + "/events.csv");
  member->has_events = !events.empty();
  if (member->has_events) ParseEvents(events, &member->events);
  member->complete = true;
}

double Quantile(const std::vector<double>& sorted, double part) {
  const double at = part * static_cast<double>(sorted.size() - 1);
  const std::size_t k = static_cast<std::size_t>(at);
  if (k + 1 >= sorted.size()) return sorted.back();
  return sorted[k] +
         (at - static_cast<double>(k)) * (sorted[k + 1] - sorted[k]);
}

}  // namespace

BandPoint MakeBand(std::vector<double> values) {
  BandPoint point;
  if (values.empty()) return point;
  std::sort(values.begin(), values.end());
  const double n = static_cast<double>(values.size());
  double sum = 0.0;
  for (const double v : values) sum += v - values[0];
  point.mean = values[0] + sum / n;
  double squares = 0.0;
  for (const double v : values) squares += (v - point.mean) * (v - point.mean);
  if (values.size() > 1) {
    point.standard_error = std::sqrt(squares / (n - 1.0) / n);
  }
  point.low = Quantile(values, 0.2);
  point.high = Quantile(values, 0.8);
  return point;
}

std::string BandsCsv(const std::vector<std::vector<StrainRow>>& members) {
  std::string csv = "increment,step,strain,curves";
  for (const char* name : {"stress_iso",
                           "stress_dev",
                           "fabric_iso",
                           "fabric_dev",
                           "conjugate",
                           "phi"}) {
    csv += Format(",%s,%s_error,%s_low,%s_high", name, name, name, name);
  }
  csv += "\n";
  if (members.empty()) return csv;
  for (std::size_t k = 0; k < members[0].size(); ++k) {
    const StrainRow& first = members[0][k];
    std::vector<double> values[6];
    for (const std::vector<StrainRow>& rows : members) {
      if (k >= rows.size()) continue;
      const StrainRow& r = rows[k];
      values[0].push_back(r.stress_iso);
      values[1].push_back(r.stress_dev);
      values[2].push_back(r.fabric_iso);
      values[3].push_back(r.fabric_dev);
      values[4].push_back(r.conjugate);
      values[5].push_back(r.phi);
    }
    csv += Format("%.17g,%d,%.17g,%zu",
                  first.increment,
                  first.step,
                  first.strain,
                  values[0].size());
    for (const std::vector<double>& v : values) {
      const BandPoint p = MakeBand(v);
      csv += Format(
          ",%.17g,%.9g,%.17g,%.17g", p.mean, p.standard_error, p.low, p.high);
    }
    csv += "\n";
  }
  return csv;
}

int RunShearEnsemble(const Ensemble& ensemble, DeformationMode mode) {
  Output output;
  output.Create(FLAGS_out,
                {"summary.json",
                 "bands.csv",
                 "agreement.csv",
                 "events.csv",
                 "bands.svg",
                 "bands.png",
                 "events.svg",
                 "events.png"});
  std::vector<ShearMember> members;
  std::vector<Job> jobs;
  std::vector<std::size_t> member_of_job;
  for (const std::uint64_t seed : ensemble.seeds) {
    ShearMember member;
    member.seed = seed;
    Job job;
    job.name = NameOf(member);
    const std::string folder = output.Path(job.name);
    job.program = kThisProgram;
    job.log = folder + "/log.txt";
    job.arguments = {
        "shear",
        Format("--seed=%llu", static_cast<unsigned long long>(seed)),
        "--out=" + folder,
        "--pictures=false"};
    // --particles does not go to the children of an ensemble by itself.
    if (IsGiven("particles")) {
      job.arguments.push_back(Format("--particles=%d", FLAGS_particles));
    }
    job.arguments.insert(
        job.arguments.end(), ensemble.passed.begin(), ensemble.passed.end());
    struct stat status;
    const bool ended = stat((folder + "/summary.json").c_str(), &status) == 0;
    if (!(ensemble.resume && ended && IsComplete(folder, job.arguments))) {
      if (mkdir(folder.c_str(), 0755) != 0 && errno != EEXIST) {
        BadInput("--out: cannot create folder '" + folder +
                 "': " + std::strerror(errno));
      }
      std::remove((folder + "/summary.json").c_str());
      if (ensemble.resume && !ended) job.arguments.push_back("--resume");
      member_of_job.push_back(members.size());
      jobs.push_back(job);
    }
    members.push_back(member);
  }
  std::printf("shear     %zu packings, %s: seeds %s; %d at a time\n",
              members.size(),
              DeformationModeName(mode),
              FLAGS_seeds.c_str(),
              ensemble.jobs);
  if (jobs.size() < members.size()) {
    std::printf("          %zu of them complete, not run again\n",
                members.size() - jobs.size());
  }
  std::fflush(stdout);
  bool interrupted = false;
  std::vector<JobOutcome> outcomes;
  {
    Progress progress;
    outcomes = RunJobs(
        jobs,
        ensemble.jobs,
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
        &interrupted);
  }
  for (std::size_t k = 0; k < jobs.size(); ++k) {
    const JobOutcome& outcome = outcomes[k];
    if (outcome.state == JobOutcome::EXITED &&
        (outcome.status == kConverged || outcome.status == kNotConverged)) {
      continue;
    }
    members[member_of_job[k]].failure = Describe(outcome);
  }

  std::vector<std::vector<StrainRow>> curves;
  std::vector<EventRow> events;
  std::string events_csv = "seed," + EventsCsv({});
  bool all = true, has_events = false;
  Json json;
  json["packings"] = members.size();
  json["interrupted"] = interrupted;
  json["failures"] = Json::array();
  std::vector<Agreement> mean_agreement;
  int counted = 0;
  for (ShearMember& member : members) {
    if (member.failure.empty()) {
      ReadMember(output.Path(NameOf(member)), &member);
    }
    all = all && member.complete && member.converged;
    if (!member.complete) {
      std::fprintf(stderr,
                   "shear: %s: %s\n",
                   NameOf(member).c_str(),
                   member.failure.c_str());
      json["failures"].push_back(
          {{"run", NameOf(member)}, {"line", member.failure}});
      continue;
    }
    curves.push_back(member.rows);
    const std::vector<Agreement> agreement = CompareIncrements(member.rows);
    if (mean_agreement.empty()) mean_agreement.resize(agreement.size());
    for (std::size_t k = 0; k < agreement.size(); ++k) {
      Agreement& sum = mean_agreement[k];
      sum.increment = agreement[k].increment;
      sum.finest = agreement[k].finest;
      sum.small_strain += agreement[k].small_strain;
      sum.all += agreement[k].all;
      sum.agrees_until += agreement[k].agrees_until;
      sum.small_strain_fabric += agreement[k].small_strain_fabric;
      sum.all_fabric += agreement[k].all_fabric;
    }
    ++counted;
    has_events = has_events || member.has_events;
    for (const EventRow& row : member.events) {
      const std::string line = EventsCsv({row});
      events_csv +=
          Format("%llu,", static_cast<unsigned long long>(member.seed)) +
          line.substr(line.find('\n') + 1);
      events.push_back(row);
    }
  }
  for (Agreement& a : mean_agreement) {
    for (double* value : {&a.small_strain,
                          &a.all,
                          &a.agrees_until,
                          &a.small_strain_fabric,
                          &a.all_fabric}) {
      *value /= counted;
    }
  }
  json["complete"] = counted;
  json["mode"] = DeformationModeName(mode);
  json["agreement"] = AgreementJson(mean_agreement);
  if (has_events) json["events"] = events.size();
  json["schema"] = "granopt/shear_ensemble/1";
  json["provenance"] = Provenance();
  output.Write("bands.csv", BandsCsv(curves));
  if (!mean_agreement.empty()) {
    output.Write("agreement.csv", AgreementCsv(mean_agreement));
  }
  if (has_events) output.Write("events.csv", events_csv);
  output.WriteJson("summary.json", json);
  if (counted > 0) {
    output.Plot(
        {"shear",
         output.Path("bands.csv"),
         output.Path("bands"),
         "--mode=" + FLAGS_mode,
         Format("--first=%s", FLAGS_pressure > 0.0 ? "phi" : "stress_iso")},
        {"bands.svg", "bands.png"});
  }
  if (events.size() > 3) {
    output.Plot({"events", output.Path("events.csv"), output.Path("events")},
                {"events.svg", "events.png"});
  }
  if (counted > 0) {
    const std::vector<StrainRow>& rows = curves[0];
    std::printf(
        "\n    increment   strain   stress iso  stress dev             fabric "
        "iso  fabric dev            (means and standard errors)\n");
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const bool last = k + 1 == rows.size() || rows[k + 1].step == 0;
      if (rows[k].step != 0 && !last) continue;
      std::vector<double> values[4];
      for (const std::vector<StrainRow>& one : curves) {
        if (k >= one.size()) continue;
        values[0].push_back(one[k].stress_iso);
        values[1].push_back(one[k].stress_dev);
        values[2].push_back(one[k].fabric_iso);
        values[3].push_back(one[k].fabric_dev);
      }
      BandPoint p[4];
      for (int q = 0; q < 4; ++q) p[q] = MakeBand(values[q]);
      std::printf(
          "    %9g   %6g   %10.4e  %10.4e +- %7.1e   %10.5f  %10.5f +- %7.1e\n",
          rows[k].increment,
          rows[k].strain,
          p[0].mean,
          p[1].mean,
          p[1].standard_error,
          p[2].mean,
          p[3].mean,
          p[3].standard_error);
    }
  }
  std::printf("%s", AgreementTable(mean_agreement).c_str());
  if (has_events) {
    std::printf("  events        %zu in %d packings\n", events.size(), counted);
  }
  if (interrupted) std::printf("\ninterrupted: %d complete\n", counted);
  output.PrintFiles();
  return all && !interrupted ? kConverged : kNotConverged;
}

}  // namespace granopt
