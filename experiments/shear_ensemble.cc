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

constexpr double Agreement::*kAgreements[] = {&Agreement::small_strain,
                                              &Agreement::all,
                                              &Agreement::agrees_until,
                                              &Agreement::small_strain_fabric,
                                              &Agreement::all_fabric};

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

// Of all members that are complete.
struct Totals {
  Json failures = Json::array();
  bool converged = true;
  std::vector<std::vector<StrainRow>> curves;
  std::vector<Agreement> agreement;  // means
  std::vector<EventRow> events;
  std::string events_csv = "seed," + EventsCsv({});
  bool has_events = false;
  // Sums of what the searches say, and of the starts.
  std::map<std::string, int> search;
  std::map<int, int> excess;
  int held_by_cell = 0, starts = 0;
};

void Add(const ShearMember& member, Totals* all) {
  all->curves.push_back(member.rows);
  for (const char* key : kSearchCounts) {
    all->search[key] +=
        member.search.is_object() ? member.search.value(key, 0) : 0;
  }
  const Json& start = member.start;
  if (start.is_object() && start.contains("least_shear_modulus")) {
    ++all->starts;
    ++all->excess[start.at("rigid_contacts").get<int>() -
                  start.at("isostatic_contacts").get<int>()];
    all->held_by_cell +=
        start.at("least_shear_modulus").get<double>() < 0.0 ? 1 : 0;
  }
  all->has_events = all->has_events || member.has_events;
  for (const EventRow& row : member.events) {
    const std::string line = EventsCsv({row});
    all->events_csv +=
        Format("%llu,", static_cast<unsigned long long>(member.seed)) +
        line.substr(line.find('\n') + 1);
    all->events.push_back(row);
  }
}

Totals Sum(const std::vector<ShearMember>& members) {
  Totals all;
  int compared = 0;
  for (const ShearMember& member : members) {
    all.converged = all.converged && member.complete && member.converged;
    if (!member.complete) {
      all.failures.push_back(
          {{"run", NameOf(member)}, {"line", member.failure}});
      continue;
    }
    Add(member, &all);
    const std::vector<Agreement> agreement = CompareIncrements(member.rows);
    compared += agreement.empty() ? 0 : 1;
    if (all.agreement.empty()) all.agreement.resize(agreement.size());
    for (std::size_t k = 0; k < agreement.size(); ++k) {
      Agreement& sum = all.agreement[k];
      sum.increment = agreement[k].increment;
      sum.finest = agreement[k].finest;
      for (const auto quantity : kAgreements) {
        sum.*quantity += agreement[k].*quantity;
      }
    }
  }
  for (Agreement& mean : all.agreement) {
    for (const auto quantity : kAgreements) mean.*quantity /= compared;
  }
  return all;
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

  const Totals all = Sum(members);
  Json json;
  json["packings"] = members.size();
  json["interrupted"] = interrupted;
  json["failures"] = all.failures;
  json["complete"] = all.curves.size();
  json["mode"] = FLAGS_mode;
  json["agreement"] = AgreementJson(all.agreement);
  if (all.has_events) json["events"] = all.search;
  for (const auto& [count, packings] : all.excess) {
    json["starts"]["excess_contacts"][Format("%d", count)] = packings;
  }
  if (all.starts > 0) {
    json["starts"]["softened_by_a_shear"] = all.held_by_cell;
  }
  json["schema"] = "granopt/shear_ensemble/1";
  json["provenance"] = Provenance();
  output.Write("bands.csv", BandsCsv(all.curves));
  if (!all.agreement.empty()) {
    output.Write("agreement.csv", AgreementCsv(all.agreement));
  }
  if (all.has_events) output.Write("events.csv", all.events_csv);
  output.WriteJson("summary.json", json);
  if (!all.curves.empty()) {
    output.Plot(
        {"shear",
         output.Path("bands.csv"),
         output.Path("bands"),
         "--mode=" + FLAGS_mode,
         Format("--first=%s", FLAGS_pressure > 0.0 ? "phi" : "stress_iso")},
        {"bands.svg", "bands.png"});
  }
  if (all.events.size() > 3) {
    output.Plot({"events", output.Path("events.csv"), output.Path("events")},
                {"events.svg", "events.png"});
  }
  if (!all.curves.empty()) PrintBands(all.curves);
  std::printf("%s", AgreementTable(all.agreement).c_str());
  if (all.has_events) {
    std::printf(
        "  events        %zu in %zu packings: in %d of %d searched steps; %d "
        "branches were left and met again\n",
        all.events.size(),
        all.curves.size(),
        all.search.at("steps_searched") - all.search.at("steps_without"),
        all.search.at("steps_searched"),
        all.search.at("reversible_branches"));
  }
  if (all.starts > 0) {
    std::printf("  starts        contacts beyond isostatic:");
    for (const auto& [count, packings] : all.excess) {
      std::printf(" %d (%d)", count, packings);
    }
    std::printf(
        "; G < 0 in some direction: %d of %d\n", all.held_by_cell, all.starts);
  }
  if (interrupted) {
    std::printf("\ninterrupted: %zu complete\n", all.curves.size());
  }
  output.PrintFiles();
  return all.converged && !interrupted ? kConverged : kNotConverged;
}

}  // namespace granopt
