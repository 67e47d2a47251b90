#include "experiments/shear_ensemble.h"

#include <cstdio>
#include <map>

#include "experiments/children.h"
#include "experiments/scene.h"
#include "experiments/shear_events.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"

DECLARE_string(seeds);
DECLARE_string(mode);
DECLARE_double(pressure);

namespace granopt {
namespace {

// What the search for events of every packing counts (its summary's "events").
constexpr const char* kSearchCounts[] = {
    "found", "steps_searched", "steps_without", "reversible_branches"};

struct ShearMember {
  std::uint64_t seed = 0;
  bool complete = false, converged = false;
  std::string failure;
  std::vector<StrainRow> rows;
  std::vector<EventRow> events;
  bool has_events = false;
  Json search, start;  // of its summary
};

std::string NameOf(const ShearMember& member) {
  return Format("seed%llu", static_cast<unsigned long long>(member.seed));
}

void ReadMember(const std::string& folder,
                const Json& summary,
                ShearMember* member) {
  try {
    summary.at("converged").get_to(member->converged);
  } catch (const Json::exception& exception) {
    member->failure = std::string("summary.json: ") + exception.what();
    return;
  }
  std::string text;
  if (!ReadFile(folder + "/curves.csv", &text, &member->failure) ||
      !ParseCurves(text, &member->rows, &member->failure)) {
    return;
  }
  std::string none;
  member->has_events = ReadFile(folder + "/events.csv", &text, &none);
  if (member->has_events &&
      !ParseEvents(text, &member->events, &member->failure)) {
    return;
  }
  if (member->has_events) member->search = summary.value("events", Json());
  member->start = summary.value("start", Json());
  member->complete = true;
}

}  // namespace

BandPoint MakeBand(const std::vector<double>& values) {
  BandPoint point;
  if (values.empty()) return point;
  const MeanDeviation all = MeanAndDeviation(values);
  const Quantiles part = QuantilesOf(values);
  point.mean = all.mean;
  point.standard_error = all.standard_error;
  point.low = part.low;
  point.high = part.high;
  return point;
}

namespace {

// Of the quantities of BandsCsv().
struct Band {
  const char* name;
  double StrainRow::*member;
};
constexpr Band kBands[] = {{"stress_iso", &StrainRow::stress_iso},
                           {"stress_dev", &StrainRow::stress_dev},
                           {"fabric_iso", &StrainRow::fabric_iso},
                           {"fabric_dev", &StrainRow::fabric_dev},
                           {"conjugate", &StrainRow::conjugate},
                           {"phi", &StrainRow::phi}};

// Row k of all curves that go so far.
std::vector<double> At(const std::vector<std::vector<StrainRow>>& curves,
                       std::size_t k,
                       double StrainRow::*quantity) {
  std::vector<double> values;
  for (const std::vector<StrainRow>& rows : curves) {
    if (k < rows.size()) values.push_back(rows[k].*quantity);
  }
  return values;
}

}  // namespace

std::string BandsCsv(const std::vector<std::vector<StrainRow>>& members) {
  std::string csv = "increment,step,strain,curves";
  for (const Band& band : kBands) {
    csv += Format(",%s,%s_error,%s_low,%s_high",
                  band.name,
                  band.name,
                  band.name,
                  band.name);
  }
  csv += "\n";
  if (members.empty()) return csv;
  for (std::size_t k = 0; k < members[0].size(); ++k) {
    const StrainRow& first = members[0][k];
    csv += Format("%.17g,%d,%.17g,%zu",
                  first.increment,
                  first.step,
                  first.strain,
                  At(members, k, &StrainRow::strain).size());
    for (const Band& band : kBands) {
      const BandPoint p = MakeBand(At(members, k, band.member));
      csv += Format(
          ",%.17g,%.9g,%.17g,%.17g", p.mean, p.standard_error, p.low, p.high);
    }
    csv += "\n";
  }
  return csv;
}

namespace {

// Means and standard errors at the beginning and the end of each increment.
void PrintBands(const std::vector<std::vector<StrainRow>>& curves) {
  const std::vector<StrainRow>& rows = curves[0];
  std::vector<std::vector<std::string>> table = {{"increment",
                                                  "strain",
                                                  "stress iso",
                                                  "stress dev",
                                                  "fabric iso",
                                                  "fabric dev"}};
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const bool last = k + 1 == rows.size() || rows[k + 1].step == 0;
    if (rows[k].step != 0 && !last) continue;
    table.push_back(
        {Format("%g", rows[k].increment), Format("%g", rows[k].strain)});
    const auto add = [&](double StrainRow::*quantity, const char* format) {
      const BandPoint p = MakeBand(At(curves, k, quantity));
      table.back().push_back(Format(format, p.mean, p.standard_error));
    };
    add(&StrainRow::stress_iso, "%.4e +- %.1e");
    add(&StrainRow::stress_dev, "%.4e +- %.1e");
    add(&StrainRow::fabric_iso, "%.5f +- %.1e");
    add(&StrainRow::fabric_dev, "%.5f +- %.1e");
  }
  std::printf("\n%s", Grid(table, 0, false).c_str());
}

}  // namespace

int RunShearEnsemble(const Ensemble& ensemble, bool has_particles) {
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
  std::vector<Child> children;
  for (const std::uint64_t seed : ensemble.seeds) {
    ShearMember member;
    member.seed = seed;
    Child child;
    child.name = NameOf(member);
    child.arguments = {
        Format("--seed=%llu", static_cast<unsigned long long>(seed))};
    // --particles does not go to the children of an ensemble by itself.
    if (has_particles) {
      child.arguments.push_back(Format("--particles=%d", FLAGS_particles));
    }
    child.arguments.insert(
        child.arguments.end(), ensemble.passed.begin(), ensemble.passed.end());
    children.push_back(child);
    members.push_back(member);
  }
  std::printf("shear     %zu packings, %s: seeds %s; %d at a time\n",
              members.size(),
              FLAGS_mode.c_str(),
              FLAGS_seeds.c_str(),
              ensemble.jobs);
  bool interrupted = false;
  const std::vector<ChildResult> results = RunChildren("shear",
                                                       children,
                                                       ensemble.jobs,
                                                       ensemble.resume,
                                                       /*children_resume=*/true,
                                                       output,
                                                       &interrupted);
  for (std::size_t k = 0; k < members.size(); ++k) {
    members[k].failure = results[k].failure;
    if (members[k].failure.empty()) {
      ReadMember(
          output.Path(children[k].name), results[k].summary, &members[k]);
    }
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
  int counted = 0, compared = 0;
  // Sums of what the searches say, and of the starts.
  std::map<std::string, int> search;
  std::map<int, int> excess;
  int held_by_cell = 0, starts = 0;
  for (ShearMember& member : members) {
    all = all && member.complete && member.converged;
    if (!member.complete) {
      json["failures"].push_back(
          {{"run", NameOf(member)}, {"line", member.failure}});
      continue;
    }
    curves.push_back(member.rows);
    const std::vector<Agreement> agreement = CompareIncrements(member.rows);
    compared += agreement.empty() ? 0 : 1;
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
    for (const char* key : kSearchCounts) {
      search[key] +=
          member.search.is_object() ? member.search.value(key, 0) : 0;
    }
    if (member.start.is_object() &&
        member.start.contains("least_shear_modulus")) {
      ++starts;
      ++excess[member.start.at("rigid_contacts").get<int>() -
               member.start.at("isostatic_contacts").get<int>()];
      held_by_cell +=
          member.start.at("least_shear_modulus").get<double>() < 0.0 ? 1 : 0;
    }
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
      *value /= compared;
    }
  }
  json["complete"] = counted;
  json["mode"] = FLAGS_mode;
  json["agreement"] = AgreementJson(mean_agreement);
  if (has_events) json["events"] = search;
  for (const auto& [count, packings] : excess) {
    json["starts"]["excess_contacts"][Format("%d", count)] = packings;
  }
  if (starts > 0) json["starts"]["softened_by_a_shear"] = held_by_cell;
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
  if (counted > 0) PrintBands(curves);
  std::printf("%s", AgreementTable(mean_agreement).c_str());
  if (has_events) {
    std::printf(
        "  events        %zu in %d packings: in %d of %d searched steps; %d "
        "branches were left and met again\n",
        events.size(),
        counted,
        search["steps_searched"] - search["steps_without"],
        search["steps_searched"],
        search["reversible_branches"]);
  }
  if (starts > 0) {
    std::printf("  starts        contacts beyond isostatic:");
    for (const auto& [count, packings] : excess) {
      std::printf(" %d (%d)", count, packings);
    }
    std::printf("; G < 0 in some direction: %d of %d\n", held_by_cell, starts);
  }
  if (interrupted) std::printf("\ninterrupted: %d complete\n", counted);
  output.PrintFiles();
  return all && !interrupted ? kConverged : kNotConverged;
}

}  // namespace granopt
