#include "experiments/shear_events.h"

#include <algorithm>
#include <cmath>

#include "experiments/checkpoint.h"
#include "experiments/tabular.h"
#include "granular/packing_io.h"

namespace granopt {

static void Columns(EventRow* row, CsvColumns* columns) {
  columns->Add("strain_before", &row->strain_before);
  columns->Add("strain_after", &row->strain_after);
  columns->Add("energy", &row->energy);
  columns->Add("energy_drop", &row->energy_drop);
  columns->Add("stress_drop", &row->stress_drop);
  columns->Add("pressure_drop", &row->pressure_drop);
  columns->Add("participation", &row->participation);
  columns->Add("contacts_opened", &row->opened);
  columns->Add("contacts_closed", &row->closed);
  columns->Add("reversal_energy", &row->reversal_energy);
  columns->Add("reversal_displacement", &row->reversal_displacement);
  columns->Add("relaxations", &row->relaxations);
  columns->Add("m0", &row->harmonics[0]);
  columns->Add("m1", &row->harmonics[1]);
  columns->Add("m2", &row->harmonics[2]);
  columns->Add("m3", &row->harmonics[3]);
  columns->Add("m4", &row->harmonics[4]);
}

namespace {

// More in one step are not looked for.
constexpr int kMostInAStep = 100;
constexpr int kLandscapePoints = 201;
constexpr int kHarmonics = 7;
// The far field, in cells: beyond the core, within the nearest image.
constexpr double kInner = 0.15;
constexpr double kOuter = 0.45;

EventRow RowOf(const PlasticEvent& event) {
  EventRow row;
  row.strain_before = event.strain_before;
  row.strain_after = event.strain_after;
  row.energy = event.before.observables.energy;
  row.energy_drop = event.energy_drop;
  row.stress_drop = event.stress_drop;
  row.pressure_drop = event.pressure_drop;
  row.participation = event.participation;
  row.opened = event.contacts_opened;
  row.closed = event.contacts_closed;
  row.reversal_energy = event.reversal_energy;
  row.reversal_displacement = event.reversal_displacement;
  row.relaxations = event.relaxations;
  const Packing& packing = event.before.packing;
  if (packing.dimension() != 2) return row;
  int centre = 0;
  event.displacement.colwise().squaredNorm().maxCoeff(&centre);
  const double length = packing.box.Length();
  const std::vector<double> a = RadialHarmonics(
      packing, event.displacement, centre, kInner * length, kOuter * length, 5);
  const double sum = a[0] + a[1] + a[2] + a[3] + a[4];
  for (int m = 0; m < 5 && sum > 0.0; ++m) row.harmonics[m] = a[m] / sum;
  return row;
}

}  // namespace

Json ToJson(const EventCatalogue& catalogue) {
  return {{"rows", EventsCsv(catalogue.rows)},
          {"searched", catalogue.searched},
          {"elastic", catalogue.elastic},
          {"relaxations", catalogue.relaxations},
          {"unconverged", catalogue.unconverged},
          {"largest", ToJson(catalogue.largest)},
          {"largest_to", catalogue.largest_to},
          {"largest_drop", catalogue.largest_drop}};
}

EventCatalogue EventCatalogueOf(const Json& json) {
  EventCatalogue catalogue;
  std::string error;
  if (!ParseEvents(
          json.at("rows").get<std::string>(), &catalogue.rows, &error)) {
    throw Json::other_error::create(501, "events: " + error, &json);
  }
  json.at("searched").get_to(catalogue.searched);
  json.at("elastic").get_to(catalogue.elastic);
  json.at("relaxations").get_to(catalogue.relaxations);
  json.at("unconverged").get_to(catalogue.unconverged);
  catalogue.largest = ShearStateOf(json.at("largest"));
  json.at("largest_to").get_to(catalogue.largest_to);
  json.at("largest_drop").get_to(catalogue.largest_drop);
  return catalogue;
}

std::string EventsCsv(const std::vector<EventRow>& rows) {
  return FormatCsv(rows);
}

bool ParseEvents(const std::string& csv,
                 std::vector<EventRow>* rows,
                 std::string* error) {
  return ParseCsv(csv, "events.csv", rows, error);
}

bool NoteEvents(const QuasistaticShearState& before,
                double to,
                double threshold,
                const PlasticEventOptions& options,
                const Solver& solver,
                EventCatalogue* catalogue,
                std::string* error) {
  PlasticEventOptions plain = options;
  plain.follow_mode = false;
  QuasistaticShearState state = before;
  ++catalogue->searched;
  for (int k = 0; k < kMostInAStep; ++k) {
    PlasticEvent event;
    if (!LocateEvent(
            state.packing, state.strain, to, plain, solver, &event, error)) {
      return false;
    }
    catalogue->relaxations += event.relaxations;
    catalogue->unconverged += event.unconverged;
    if (!event.found || !(event.energy_drop >
                          0.1 * threshold * event.before.observables.energy)) {
      if (k == 0) ++catalogue->elastic;
      return true;
    }
    catalogue->rows.push_back(RowOf(event));
    if (event.energy_drop > catalogue->largest_drop) {
      catalogue->largest_drop = event.energy_drop;
      catalogue->largest = state;
      catalogue->largest_to = to;
    }
    state.packing = event.after.packing;
    state.strain = event.strain_after;
    state.energy = event.after.observables.energy;
    state.stress = event.after.observables.stress;
    if (std::abs(to - state.strain) <= options.width) return true;
  }
  return true;
}

std::vector<std::string> WithEventFiles(std::vector<std::string> names) {
  names.insert(names.end(),
               {"events.csv",
                "event.xyz",
                "event_contacts.csv",
                "event_branch.csv",
                "event_landscape.csv",
                "event_harmonics.csv",
                "event.svg",
                "event.png",
                "events.svg",
                "events.png"});
  return names;
}

namespace {

// Writes the event in full; returns the lines for the terminal.
std::string PublishLargest(const PlasticEvent& event,
                           const PlasticEventOptions& options,
                           Output* output,
                           Json* json) {
  const Packing& packing = event.before.packing;
  const int d = packing.dimension();
  output->Write(
      "event.xyz",
      FormatPacking(packing, {{"displacement", &event.displacement}}));
  output->Write("event_contacts.csv", ContactsCsv(event.before));
  std::string csv = "strain,strain_left,energy,stress,lowest_eigenvalue\n";
  for (const BranchPoint& point : event.branch) {
    csv += Format("%.17g,%.17g,%.17g,%.17g,%.17g\n",
                  point.strain,
                  std::abs(event.strain_after - point.strain),
                  point.energy,
                  point.stress,
                  point.lowest_eigenvalue);
  }
  output->Write("event_branch.csv", csv);
  std::vector<double> energy;
  std::string error;
  if (!EnergyAlong(event, options, kLandscapePoints, &energy, &error)) {
    BadInput(error);
  }
  csv = "t,energy,above_the_end\n";
  const double end = event.after.observables.energy;
  for (int p = 0; p < kLandscapePoints; ++p) {
    csv += Format("%.6g,%.17g,%.17g\n",
                  static_cast<double>(p) / (kLandscapePoints - 1),
                  energy[p],
                  energy[p] - end);
  }
  output->Write("event_landscape.csv", csv);
  // Around the grain that moves most, in shells of equal width.
  int centre = 0;
  event.displacement.colwise().squaredNorm().maxCoeff(&centre);
  Json& one = *json;
  one["strain"] = event.strain_after;
  one["width"] = std::abs(event.strain_after - event.strain_before);
  one["energy_drop"] = event.energy_drop;
  one["relative_energy_drop"] =
      event.energy_drop / event.before.observables.energy;
  one["stress_drop"] = event.stress_drop;
  one["pressure_drop"] = event.pressure_drop;
  one["participation"] = event.participation;
  one["contacts_opened"] = event.contacts_opened;
  one["contacts_closed"] = event.contacts_closed;
  one["centre"] = centre;
  one["lowest_eigenvalue"] = event.branch.back().lowest_eigenvalue;
  one["lowest_eigenvalue_at_start"] = event.branch.front().lowest_eigenvalue;
  one["reversal_energy"] = event.reversal_energy;
  one["reversal_displacement"] = event.reversal_displacement;
  std::string harmonics_line;
  csv = "inner,outer,m,amplitude\n";
  if (d == 2) {
    const double length = packing.box.Length();
    for (int shell = 0; shell < 4; ++shell) {
      const double inner = 0.05 * length + 0.1 * length * shell;
      const std::vector<double> a = RadialHarmonics(packing,
                                                    event.displacement,
                                                    centre,
                                                    inner,
                                                    inner + 0.1 * length,
                                                    kHarmonics);
      for (int m = 0; m < kHarmonics; ++m) {
        csv +=
            Format("%.6g,%.6g,%d,%.9g\n", inner, inner + 0.1 * length, m, a[m]);
      }
    }
    const std::vector<double> a = RadialHarmonics(packing,
                                                  event.displacement,
                                                  centre,
                                                  kInner * length,
                                                  kOuter * length,
                                                  kHarmonics);
    double others = 0.0;
    for (int m = 0; m < kHarmonics; ++m) {
      if (m != 2) others = std::max(others, a[m]);
    }
    one["quadrupole"] = a[2];
    one["largest_other_harmonic"] = others;
    harmonics_line = Format(
        "                around its centre: radial displacement cos(2 theta) "
        "%.2g times the largest other of m = 0 ... %d\n",
        others > 0.0 ? a[2] / others : 0.0,
        kHarmonics - 1);
  }
  output->Write("event_harmonics.csv", csv);
  return Format(
      "  largest       at strain %.12f (to %.1e): energy falls by %.3g of "
      "itself, stress by %.3g;\n                %d contacts open, %d close; "
      "participation %.2g\n%s"
      "                lowest eigenvalue %.2e kappa at the beginning of the "
      "step, %.2e at the end of the branch\n",
      event.strain_after,
      std::abs(event.strain_after - event.strain_before),
      event.energy_drop / event.before.observables.energy,
      event.stress_drop,
      event.contacts_opened,
      event.contacts_closed,
      event.participation,
      harmonics_line.c_str(),
      event.branch.front().lowest_eigenvalue,
      event.branch.back().lowest_eigenvalue);
}

}  // namespace

std::string PublishEvents(const EventCatalogue& catalogue,
                          const PlasticEventOptions& options,
                          const Solver& solver,
                          Output* output,
                          Json* json) {
  output->Write("events.csv", EventsCsv(catalogue.rows));
  Json& summary = (*json)["events"];
  summary["found"] = catalogue.rows.size();
  summary["steps_searched"] = catalogue.searched;
  summary["steps_without"] = catalogue.elastic;
  summary["relaxations"] = catalogue.relaxations;
  summary["unconverged"] = catalogue.unconverged;
  double worst_energy = 0.0;
  int reversible = 0;
  for (const EventRow& row : catalogue.rows) {
    worst_energy = std::max(worst_energy, row.reversal_energy);
    reversible += row.reversal_energy < 1e-8 ? 1 : 0;
  }
  summary["reversible_branches"] = reversible;
  summary["worst_reversal_energy"] = worst_energy;
  std::string text = Format(
      "\n  events        %zu, in %d of %d steps that were searched (%d "
      "relaxations%s)%s\n",
      catalogue.rows.size(),
      catalogue.searched - catalogue.elastic,
      catalogue.searched,
      catalogue.relaxations,
      catalogue.unconverged > 0
          ? Format(", %d of them stopped after %lld evaluations",
                   catalogue.unconverged,
                   static_cast<long long>(options.solve.max_evaluations))
                .c_str()
          : "",
      catalogue.elastic > 0 ? "; the others only change contacts" : "");
  if (catalogue.rows.empty()) return text;
  text += Format(
      "  reversible    %d of %zu branches that end in one: sheared back their "
      "energy is the same to 1e-8 (worst %.1e)\n",
      reversible,
      catalogue.rows.size(),
      worst_energy);

  PlasticEvent event;
  std::string error;
  if (!LocateEvent(catalogue.largest.packing,
                   catalogue.largest.strain,
                   catalogue.largest_to,
                   options,
                   solver,
                   &event,
                   &error)) {
    BadInput(error);
  }
  text += PublishLargest(event, options, output, &summary["largest"]);
  output->Plot({"event", output->folder(), output->Path("event")},
               {"event.svg", "event.png"});
  if (catalogue.rows.size() > 3) {
    output->Plot({"events", output->Path("events.csv"), output->Path("events")},
                 {"events.svg", "events.png"});
  }
  return text;
}

}  // namespace granopt
