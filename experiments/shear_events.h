// granopt: the plastic events of a run of `shear`.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_EVENTS_H_
#define GRANOPT_EXPERIMENTS_SHEAR_EVENTS_H_

#include <string>
#include <vector>

#include "experiments/run.h"
#include "granular/plastic_events.h"

namespace granopt {

struct EventRow {
  double strain_before = 0.0, strain_after = 0.0;
  double energy = 0.0;  // before
  double energy_drop = 0.0, stress_drop = 0.0, pressure_drop = 0.0;
  double participation = 0.0;
  int opened = 0, closed = 0;
  double reversal_energy = 0.0, reversal_displacement = 0.0;
  int relaxations = 0;
  // Parts of the harmonics m = 0 ... 4 in the radial displacement around the
  // grain that moves most (RadialHarmonics, at 0.15 to 0.45 cells from it; d =
  // 2): a_m / (a_0 + ... + a_4). An elastic inclusion is m = 2.
  double harmonics[5] = {};
};

struct EventCatalogue {
  std::vector<EventRow> rows;
  int searched = 0;  // steps
  int elastic = 0;   // of them, without an event
  int relaxations = 0;
  int unconverged = 0;  // of those
  // The beginning of the search that found the largest.
  QuasistaticShearState largest;
  double largest_to = 0.0, largest_drop = 0.0;
};

Json ToJson(const EventCatalogue& catalogue);
// Throws Json::exception if `json` is not of that form.
EventCatalogue EventCatalogueOf(const Json& json);

// A column a member, in their order.
std::string EventsCsv(const std::vector<EventRow>& rows);
// False with one line in `error`.
bool ParseEvents(const std::string& csv,
                 std::vector<EventRow>* rows,
                 std::string* error);

// Locates the events of the step from `before` to strain `to`, one after the
// other, down to drops of a tenth of `threshold` of the energy. False with one
// line in `error`.
bool NoteEvents(const QuasistaticShearState& before,
                double to,
                double threshold,
                const PlasticEventOptions& options,
                const Solver& solver,
                EventCatalogue* catalogue,
                std::string* error);

std::vector<std::string> WithEventFiles(std::vector<std::string> names);

// Writes the catalogue and, in full, the largest event; returns the lines for
// the terminal.
std::string PublishEvents(const EventCatalogue& catalogue,
                          const PlasticEventOptions& options,
                          const Solver& solver,
                          Output* output,
                          Json* json);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_EVENTS_H_
