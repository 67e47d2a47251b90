// conditioning: is it the condition number of the Hessian that makes
// relaxations near jamming long, or is it that contacts open and close?
//
//   conditioning --distances=1e-2,1e-3,... --shear=1e-6,0.3x
//                --preconditioners="none;contact;label@contact:shift=1e-8"
//                --input=F.xyz | --particles=N --phi=P --seeds=1-3 --alpha=2
//                --prepare_solver=lbfgs --out=DIR
//   conditioning --replot=DIR
//
// For states at the distances from jamming, made as `compare
// --cases=near_jamming` makes them (its prepared_*.xyz are used again):
// conditioning.csv has the extreme eigenvalues of P^-1 H for each
// preconditioner, made there ("fresh") and, for each shear step, made before
// the step with H from after it ("lagged"); contact_changes.csv which contacts
// the step and Newton's first step change. Tables and the figure are made from
// these two alone.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "experiments/comparison.h"
#include "experiments/preparation.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/atomic_file.h"
#include "granular/contact_changes.h"
#include "granular/force_network.h"
#include "solvers/condition.h"
#include "solvers/preconditioner.h"

DEFINE_string(preconditioners,
              "none;laplacian;contact;"
              "contact, shift 1e-8@contact:shift=1e-8;"
              "barrier 0.1, shift 1e-8@barrier:length=0.1,shift=1e-8;"
              "barrier 1, shift 1e-8@barrier:length=1,shift=1e-8;"
              "hessian, shift 1e-8@hessian:shift=1e-8",
              "P, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,... (see --list_solvers); none: kappa 1");
DEFINE_double(phi, 0.8438, "packing fraction of generated packings");
DEFINE_string(seeds, "1-3", "seeds as in 1-3 or 1,4,7");
DEFINE_string(distances,
              "1e-2,1e-3,1e-4,1e-5,1e-6,1e-7,1e-8",
              "distances phi - phi_J");
DEFINE_string(shear,
              "1e-6,0.3x",
              "shear steps, separated by commas: a strain, or as in 0.3x a "
              "multiple of the distance");
DEFINE_string(prepare_solver,
              granopt::kDefaultSolver,
              "the method that relaxes the states");
DEFINE_int64(prepare_evaluations,
             1000000,
             "a relaxation after a step gives up after this many evaluations "
             "(0: never)");
DEFINE_string(replot,
              "",
              "folder of an earlier run: make its tables and figure again");

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr char kNone[] = "none";

// A shear as the user wrote it: "1e-6", "0.3x".
struct Shear {
  std::string name;
  double value = 0.0;
  bool relative = false;
  double At(double distance) const {
    return relative ? value * distance : value;
  }
};

struct ConditionRow {
  std::uint64_t seed = 0;
  double distance = 0.0;
  std::string label, spec;
  std::string shear;  // of a lagged P; "-": fresh
  bool found = false;
  int dimensions = 0;
  double lowest = 0.0, highest = 0.0;
  double number = 0.0;  // infinite unless all eigenvalues are positive
  int negative = 0, below = 0, above = 0;
  std::string message;
};

struct ChangeRow {
  std::uint64_t seed = 0;
  double distance = 0.0;
  std::string shear;
  double strain = 0.0;
  std::string kind;            // as in steps.csv of `compare`
  bool relaxed = false;        // the state after the step is at a minimum
  int contacts = 0;            // before
  ContactChange deformed;      // before to deformed, not yet relaxed
  ContactChange relaxation;    // deformed to relaxed
  ContactChange step;          // before to relaxed
  double newton_shift = 0.0;   // in kappa
  double newton_length = 0.0;  // in mean overlaps
  double newton_first = 0.0;   // of the step, to the first change
  int newton_opened = 0, newton_closed = 0;
  // Before to where linear response says that the step ends; -1: no such.
  ContactChange predicted = {-1, -1};
  ContactChange missed;  // there to relaxed
  std::string message;   // why there is no Newton step
};

struct Rows {
  std::vector<ConditionRow> conditions;
  std::vector<ChangeRow> changes;
};

// ---------------------------------------------------------------- CSV

constexpr char kConditionHead[] =
    "seed,distance,preconditioner,spec,shear,found,dimensions,lowest,highest,"
    "condition,negative,below_half,above_two,message";
constexpr char kChangeHead[] =
    "seed,distance,shear,strain,kind,relaxed,contacts,deformed_opened,"
    "deformed_closed,relaxation_opened,relaxation_closed,step_opened,"
    "step_closed,newton_shift,newton_length,newton_first,newton_opened,"
    "newton_closed,predicted_opened,predicted_closed,missed_opened,"
    "missed_closed,message";

std::string Quoted(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string ConditionsCsv(const std::vector<ConditionRow>& rows) {
  std::string csv = std::string(kConditionHead) + "\n";
  for (const ConditionRow& r : rows) {
    csv += Format("%llu,", static_cast<unsigned long long>(r.seed)) +
           Neat(r.distance) + "," + Quoted(r.label) + "," + Quoted(r.spec) +
           "," + r.shear +
           Format(",%d,%d,%.9g,%.9g,%.9g,%d,%d,%d,",
                  r.found ? 1 : 0,
                  r.dimensions,
                  r.lowest,
                  r.highest,
                  r.number,
                  r.negative,
                  r.below,
                  r.above) +
           Quoted(r.message) + "\n";
  }
  return csv;
}

std::string ChangesCsv(const std::vector<ChangeRow>& rows) {
  std::string csv = std::string(kChangeHead) + "\n";
  for (const ChangeRow& r : rows) {
    csv += Format("%llu,", static_cast<unsigned long long>(r.seed)) +
           Neat(r.distance) + "," + r.shear +
           Format(
               ",%.9g,%s,%d,%d,%d,%d,%d,%d,%d,%d,%.9g,%.9g,%.9g,%d,%d,%d,%d,%d,"
               "%d,",
               r.strain,
               r.kind.c_str(),
               r.relaxed ? 1 : 0,
               r.contacts,
               r.deformed.opened,
               r.deformed.closed,
               r.relaxation.opened,
               r.relaxation.closed,
               r.step.opened,
               r.step.closed,
               r.newton_shift,
               r.newton_length,
               r.newton_first,
               r.newton_opened,
               r.newton_closed,
               r.predicted.opened,
               r.predicted.closed,
               r.missed.opened,
               r.missed.closed) +
           Quoted(r.message) + "\n";
  }
  return csv;
}

std::vector<std::string> Fields(const std::string& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t k = 0; k < line.size(); ++k) {
    const char c = line[k];
    if (c == '"') {
      if (quoted && k + 1 < line.size() && line[k + 1] == '"') {
        fields.back() += line[++k];
      } else {
        quoted = !quoted;
      }
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  return fields;
}

// The rows of a file that this binary wrote. BadInput if it is none.
std::vector<std::vector<std::string>> ReadRows(const std::string& path,
                                               const std::string& head) {
  std::string text, error;
  if (!ReadFile(path, &text, &error)) BadInput("--replot: " + error);
  std::istringstream lines(text);
  std::string line;
  if (!std::getline(lines, line) || line != head) {
    BadInput("--replot: " + path + ":1: is not the header of this file");
  }
  const std::size_t columns = Fields(head).size();
  std::vector<std::vector<std::string>> rows;
  for (int number = 2; std::getline(lines, line); ++number) {
    rows.push_back(Fields(line));
    if (rows.back().size() != columns) {
      BadInput(Format("--replot: %s:%d: %zu fields instead of %zu",
                      path.c_str(),
                      number,
                      rows.back().size(),
                      columns));
    }
    // All but words and messages.
    const std::vector<std::string> names = Fields(head);
    for (std::size_t k = 0; k < columns; ++k) {
      const std::set<std::string> words = {
          "preconditioner", "spec", "shear", "kind", "message"};
      if (words.count(names[k]) > 0) continue;
      const std::string& field = rows.back()[k];
      char* end = nullptr;
      std::strtod(field.c_str(), &end);
      if (field.empty() || *end != '\0') {
        BadInput(Format("--replot: %s:%d: %s '%s' is not a number",
                        path.c_str(),
                        number,
                        names[k].c_str(),
                        field.c_str()));
      }
    }
  }
  if (rows.empty()) BadInput("--replot: " + path + " has no rows");
  return rows;
}

Rows ReadAll(const std::string& folder) {
  Rows rows;
  const auto real = [](const std::string& text) {
    return std::strtod(text.c_str(), nullptr);
  };
  const auto whole = [&real](const std::string& text) {
    return static_cast<int>(real(text));
  };
  for (const auto& f : ReadRows(folder + "/conditioning.csv", kConditionHead)) {
    ConditionRow r;
    r.seed = std::strtoull(f[0].c_str(), nullptr, 10);
    r.distance = real(f[1]);
    r.label = f[2];
    r.spec = f[3];
    r.shear = f[4];
    r.found = whole(f[5]) != 0;
    r.dimensions = whole(f[6]);
    r.lowest = real(f[7]);
    r.highest = real(f[8]);
    r.number = real(f[9]);
    r.negative = whole(f[10]);
    r.below = whole(f[11]);
    r.above = whole(f[12]);
    r.message = f[13];
    rows.conditions.push_back(r);
  }
  for (const auto& f : ReadRows(folder + "/contact_changes.csv", kChangeHead)) {
    ChangeRow r;
    r.seed = std::strtoull(f[0].c_str(), nullptr, 10);
    r.distance = real(f[1]);
    r.shear = f[2];
    r.strain = real(f[3]);
    r.kind = f[4];
    r.relaxed = whole(f[5]) != 0;
    r.contacts = whole(f[6]);
    r.deformed = {whole(f[7]), whole(f[8])};
    r.relaxation = {whole(f[9]), whole(f[10])};
    r.step = {whole(f[11]), whole(f[12])};
    r.newton_shift = real(f[13]);
    r.newton_length = real(f[14]);
    r.newton_first = real(f[15]);
    r.newton_opened = whole(f[16]);
    r.newton_closed = whole(f[17]);
    r.predicted = {whole(f[18]), whole(f[19])};
    r.missed = {whole(f[20]), whole(f[21])};
    r.message = f[22];
    rows.changes.push_back(r);
  }
  return rows;
}

// ---------------------------------------------------------------- tables

std::string Short(double value) {
  if (std::isnan(value)) return "-";
  if (std::isinf(value)) return "inf";
  if (value < 99.95) return Format("%.3g", value);
  return Format("%.1e", value);
}

std::string Count(double value) {
  return std::isnan(value) ? "-" : Format("%.6g", value);
}

// First column to the left, others to the right.
std::string Aligned(const std::vector<std::vector<std::string>>& cells) {
  std::vector<std::size_t> width;
  for (const auto& row : cells) {
    width.resize(std::max(width.size(), row.size()), 0);
    for (std::size_t c = 0; c < row.size(); ++c) {
      width[c] = std::max(width[c], row[c].size());
    }
  }
  std::string text;
  for (const auto& row : cells) {
    std::string line = "   ";
    for (std::size_t c = 0; c < row.size(); ++c) {
      const std::string pad(width[c] - row[c].size(), ' ');
      line += c == 0 ? " " + row[c] + pad : "  " + pad + row[c];
    }
    text += line + "\n";
  }
  return text;
}

template <typename T>
void AddOnce(const T& value, std::vector<T>* list) {
  if (std::find(list->begin(), list->end(), value) == list->end()) {
    list->push_back(value);
  }
}

// Condition numbers, or how many eigenvalues are outside of [1/2, 2]: a row a
// distance and a column a P.
std::string ConditionTable(const Rows& rows,
                           const std::string& shear,
                           bool outside) {
  std::vector<std::string> labels;
  std::vector<double> distances;
  for (const ConditionRow& r : rows.conditions) {
    AddOnce(r.label, &labels);
    AddOnce(r.distance, &distances);
  }
  std::vector<std::vector<std::string>> cells = {{"phi - phi_J"}};
  cells[0].insert(cells[0].end(), labels.begin(), labels.end());
  for (const double distance : distances) {
    std::vector<std::string> line = {Neat(distance)};
    for (const std::string& label : labels) {
      std::vector<double> numbers;
      for (const ConditionRow& r : rows.conditions) {
        if (r.distance == distance && r.label == label && r.shear == shear &&
            r.found) {
          numbers.push_back(outside ? r.below + r.above : r.number);
        }
      }
      const double middle = MedianOf(numbers);
      line.push_back(
          numbers.empty() ? "-"
          : outside
              ? Count(middle) + " (" +
                    Count(*std::max_element(numbers.begin(), numbers.end())) +
                    ")"
              : Short(middle) + " (" +
                    Short(*std::max_element(numbers.begin(), numbers.end())) +
                    ")");
    }
    cells.push_back(line);
  }
  return Aligned(cells);
}

std::string ChangeTable(const Rows& rows, const std::string& shear) {
  std::vector<double> distances;
  for (const ChangeRow& r : rows.changes) AddOnce(r.distance, &distances);
  std::vector<std::vector<std::string>> cells = {{"phi - phi_J",
                                                  "contacts",
                                                  "deformed",
                                                  "predicted",
                                                  "opened",
                                                  "closed",
                                                  "of all",
                                                  "Newton: changes",
                                                  "of all",
                                                  "first after",
                                                  "shift",
                                                  "rearranging"}};
  for (const double distance : distances) {
    std::vector<double> contacts, deformed, predicted, opened, closed, part,
        newton, newton_part, first, shift;
    int steps = 0, rearranging = 0, lost = 0;
    for (const ChangeRow& r : rows.changes) {
      if (r.distance != distance || r.shear != shear) continue;
      ++steps;
      rearranging += r.kind == kRearranging ? 1 : 0;
      lost += r.relaxed ? 0 : 1;
      contacts.push_back(r.contacts);
      deformed.push_back(r.deformed.total());
      if (r.predicted.opened >= 0) predicted.push_back(r.predicted.total());
      if (r.relaxed) {
        opened.push_back(r.step.opened);
        closed.push_back(r.step.closed);
        part.push_back(100.0 * r.step.total() / r.contacts);
      }
      if (r.message.empty()) {
        newton.push_back(r.newton_opened + r.newton_closed);
        newton_part.push_back(100.0 * newton.back() / r.contacts);
        first.push_back(r.newton_first);
        shift.push_back(r.newton_shift);
      }
    }
    if (steps == 0) continue;
    const auto percent = [](double value) {
      return std::isnan(value) ? "-" : Format("%.2g %%", value);
    };
    const double median_first = MedianOf(first);
    cells.push_back({Neat(distance),
                     Count(MedianOf(contacts)),
                     Count(MedianOf(deformed)),
                     Count(MedianOf(predicted)),
                     Count(MedianOf(opened)),
                     Count(MedianOf(closed)),
                     percent(MedianOf(part)),
                     Count(MedianOf(newton)),
                     percent(MedianOf(newton_part)),
                     std::isinf(median_first) ? "never" : Short(median_first),
                     MedianOf(shift) == 0.0 ? "none" : Short(MedianOf(shift)),
                     Format("%d of %d", rearranging, steps) +
                         (lost > 0 ? Format(", %d not relaxed", lost) : "")});
  }
  return Aligned(cells);
}

std::string StrainWords(const std::string& shear) {
  return shear.back() == 'x'
             ? shear.substr(0, shear.size() - 1) + " (phi - phi_J)"
             : shear;
}

std::string TablesText(const Rows& rows) {
  std::vector<std::string> shears;
  for (const ChangeRow& r : rows.changes) AddOnce(r.shear, &shears);
  std::string text =
      "\n(1) condition number of P^-1 H, P made where H is: median over the "
      "packings, worst in brackets\n" +
      ConditionTable(rows, "-", false) +
      "\n    and how many eigenvalues of P^-1 H are outside of [1/2, 2]\n" +
      ConditionTable(rows, "-", true);
  for (const std::string& shear : shears) {
    text += "\n(2) contacts that a shear step of " + StrainWords(shear) +
            " changes; medians\n" + ChangeTable(rows, shear);
  }
  for (const std::string& shear : shears) {
    text +=
        "\n(3) condition number of P^-1 H, P from before a shear step of " +
        StrainWords(shear) + ", H from after it\n" +
        ConditionTable(rows, shear, false) +
        "\n    and how many eigenvalues of P^-1 H are outside of [1/2, 2]\n" +
        ConditionTable(rows, shear, true);
  }
  text +=
      "\n  deformed: changes by the deformation alone; predicted: from before "
      "to "
      "where linear response of the contacts before puts the end;\n"
      "  opened, closed, of all: from before the step to the relaxed state "
      "after it.\n"
      "  Newton: the straight way of the first Newton step from the deformed "
      "state; the first change comes after that part of it.\n"
      "  inf: an eigenvalue is negative or zero.\n";
  return text;
}

// The figure, from the files of `data`.
void Draw(const std::string& data, Output* output) {
  output->Plot({"conditioning",
                data + "/conditioning.csv",
                data + "/contact_changes.csv",
                output->Path("conditioning")},
               {"conditioning.svg", "conditioning.png"});
}

void PrintReadingHelp() {
  std::printf(
      "\nHow to read it: where (1) stays flat as phi - phi_J -> 0, the "
      "condition number of that P is no obstacle, and a P whose (1) is flat "
      "but whose (3) rises\n"
      "is only as good as the contacts that it was made from. In (2), many "
      "changes within one Newton step mean that a quadratic model, however "
      "well preconditioned,\n"
      "says little about the way ahead.\n");
}

// ---------------------------------------------------------------- the work

// What is measured at a state.
struct State {
  Packing packing;
  std::unique_ptr<ContactEnergy> energy;
  std::vector<double> zero;
  std::vector<Contact> contacts;
  Observables observables;
  std::vector<bool> counts;
  Scales scales;
  double cost = 0.0;
  std::vector<double> gradient;
};

State Examine(const Packing& packing, const ContactEnergyOptions& law) {
  State state;
  std::string error;
  state.packing = packing;
  state.energy = ContactEnergy::Create(packing, law, &error);
  if (state.energy == nullptr) BadInput(error);
  const int n = state.energy->NumParameters();
  state.zero.assign(n, 0.0);
  state.gradient.resize(n);
  state.energy->EvaluateWithScales(
      state.zero.data(), &state.cost, state.gradient.data(), &state.scales);
  state.contacts = state.energy->Contacts(state.zero.data());
  state.observables = Measure(packing, state.contacts, state.cost);
  state.counts = CountingGrains(state.observables, state.contacts);
  return state;
}

// The matrix of a preconditioner made at a state: all registered ones are
// sparse, and only their products are public.
bool MakeP(const std::string& spec,
           const State& state,
           SparseMatrix* p,
           std::string* why) {
  const int n = state.energy->NumParameters();
  if (spec == kNone) {
    if (!(state.scales.length > 0.0)) {
      *why = "no contact";
      return false;
    }
    p->resize(n, n);
    p->setIdentity();
    *p *= state.scales.gradient / state.scales.length;
    return true;
  }
  const std::unique_ptr<Preconditioner> made = CreatePreconditioner(spec, why);
  if (made == nullptr || !made->Supports(*state.energy, why)) return false;
  Monitor monitor(state.energy.get(), SolveOptions(), spec);
  made->Update(
      {state.zero.data(), state.cost, state.gradient.data(), state.scales},
      nullptr,
      &monitor);
  if (made->num_fallbacks() > 0) {
    *why = "P was not positive definite";
    return false;
  }
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<double> unit(n, 0.0), column(n);
  for (int c = 0; c < n; ++c) {
    unit[c] = 1.0;
    made->Multiply(unit.data(), column.data());
    unit[c] = 0.0;
    for (int r = c; r < n; ++r) {
      if (r == c || column[r] != 0.0) entries.emplace_back(r, c, column[r]);
    }
  }
  p->resize(n, n);
  p->setFromTriplets(entries.begin(), entries.end());
  return true;
}

struct Plan {
  Scene scene;
  std::unique_ptr<Solver> prepare;
  std::vector<Method> preconditioners;
  std::vector<std::uint64_t> seeds;
  std::vector<double> distances;  // increasing
  std::vector<Shear> shears;
};

ConditionRow Measured(const SparseMatrix& h,
                      const Eigen::MatrixXd& blind,
                      const SparseMatrix& p) {
  ConditionRow row;
  const Condition c = ComputeCondition(h, p, blind, ConditionOptions());
  row.found = c.found;
  row.dimensions = c.dimensions;
  row.message = c.message;
  row.number = std::numeric_limits<double>::quiet_NaN();
  if (c.found) {
    row.lowest = c.lowest;
    row.highest = c.highest;
    row.number = c.Number();
    row.negative = c.negative;
    row.below = c.below;
    row.above = c.above;
  }
  return row;
}

ChangeRow MeasuredChange(const State& before,
                         const State& deformed,
                         const State* after,
                         double strain) {
  ChangeRow row;
  const ContactPairs pairs = PairsInTouch(before.contacts, before.counts);
  // Of the same grains: a deformed state need not have a rigid part at all.
  const ContactPairs pairs_deformed =
      PairsInTouch(deformed.contacts, before.counts);
  row.contacts = static_cast<int>(pairs.size());
  row.deformed = Compare(pairs, pairs_deformed);
  row.relaxed = after != nullptr;
  if (after != nullptr) {
    const ContactPairs pairs_after =
        PairsInTouch(after->contacts, after->counts);
    row.relaxation = Compare(pairs_deformed, pairs_after);
    row.step = Compare(pairs, pairs_after);
  }
  // Newton's step moves the grains that counted before: the deformation has
  // opened contacts that relaxation closes again.
  NewtonStep newton;
  WayChanges way;
  if (ComputeNewtonStep(*deformed.energy,
                        deformed.zero.data(),
                        before.counts,
                        &newton,
                        &row.message)) {
    row.newton_shift = newton.relative_shift;
    row.newton_length = newton.length;
    if (ChangesOnTheWay(deformed.packing,
                        newton.displacement.data(),
                        before.counts,
                        &way,
                        &row.message)) {
      row.newton_first = way.first;
      row.newton_opened = way.opened;
      row.newton_closed = way.closed;
    }
  }
  // The deformed cell has its own displacements: the same to first order.
  const int d = before.packing.dimension();
  SmallMatrix gradient = SimpleShear(d, strain);
  gradient -= SmallMatrix::Identity(d, d);
  NewtonStep response;
  std::string ignored;
  if (ComputeLinearResponse(*before.energy,
                            before.zero.data(),
                            before.counts,
                            gradient,
                            &response,
                            &ignored)) {
    const ContactPairs predicted = PairsInTouch(
        deformed.energy->Contacts(response.displacement.data()), before.counts);
    row.predicted = Compare(pairs, predicted);
    if (after != nullptr) {
      row.missed =
          Compare(predicted, PairsInTouch(after->contacts, after->counts));
    }
  }
  return row;
}

// A seed and a distance: all preconditioners, all shears.
void MeasureState(const Plan& plan,
                  std::uint64_t seed,
                  double distance,
                  const Packing& base,
                  Preparation* preparation,
                  Progress* progress,
                  const std::string& where,
                  Rows* rows) {
  const ContactEnergyOptions& law = plan.scene.energy;
  const State before = Examine(base, law);
  const int d = base.dimension();
  const auto show = [&](const std::string& what) {
    if (progress->Due()) progress->Show(where + ": " + what);
  };
  const auto add =
      [&](const Method& method, const std::string& shear, ConditionRow row) {
        row.seed = seed;
        row.distance = distance;
        row.label = method.label;
        row.spec = method.spec;
        row.shear = shear;
        rows->conditions.push_back(std::move(row));
      };
  Eigen::VectorXd gradient;
  SparseMatrix h;
  if (!EvaluateAmong(
          *before.energy, before.zero.data(), before.counts, &gradient, &h)) {
    BadInput("the energy is not defined");
  }
  const Eigen::MatrixXd blind = BlindMotions(d, before.counts);
  std::map<std::string, SparseMatrix> made;  // by label
  for (const Method& method : plan.preconditioners) {
    show(method.label);
    ConditionRow row;
    SparseMatrix p;
    if (MakeP(method.spec, before, &p, &row.message)) {
      row = Measured(h, blind, p);
      made[method.label] = std::move(p);
    }
    add(method, "-", row);
  }
  for (const Shear& shear : plan.shears) {
    const double strain = shear.At(distance);
    const std::string name =
        "near_jamming_" + Neat(distance) +
        (FLAGS_input.empty()
             ? Format("_seed%llu", static_cast<unsigned long long>(seed))
             : "") +
        "_shear_" + shear.name;
    progress->Clear();
    const ShearStep step = std::move(preparation->Shear(
        base, name, seed, strain, 1, FLAGS_prepare_evaluations)[0]);
    preparation->ClearProgress();
    const State deformed = Examine(step.start, law);
    const bool at_minimum =
        step.record.minimum != "-" && step.vanishing > FLAGS_zero_pressure;
    std::unique_ptr<State> after;
    if (at_minimum) {
      after = std::make_unique<State>(Examine(
          deformed.energy->Configuration(step.displacements.data()), law));
    }
    ChangeRow change = MeasuredChange(before, deformed, after.get(), strain);
    change.seed = seed;
    change.distance = distance;
    change.shear = shear.name;
    change.strain = strain;
    change.kind = step.record.kind;
    rows->changes.push_back(change);
    if (after != nullptr &&
        !EvaluateAmong(
            *after->energy, after->zero.data(), after->counts, &gradient, &h)) {
      BadInput("the energy is not defined");
    }
    for (const Method& method : plan.preconditioners) {
      show(method.label + ", lagged by a shear of " + shear.name);
      ConditionRow row;
      row.number = std::numeric_limits<double>::quiet_NaN();
      if (after == nullptr) {
        row.message = "the step did not end at a jammed minimum";
      } else if (made.count(method.label) == 0) {
        row.message = "no P";
      } else {
        row =
            Measured(h, BlindMotions(d, after->counts), made.at(method.label));
      }
      add(method, shear.name, row);
    }
  }
}

Plan MakePlan() {
  Plan plan;
  std::string error;
  const auto require = [&error](bool good, const char* flag) {
    if (!good) BadInput(std::string("--") + flag + ": " + error);
  };
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  CheckPositive("phi", FLAGS_phi);
  CheckRange("prepare_evaluations", FLAGS_prepare_evaluations, 0.0, 9e18);
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("distances")) FLAGS_distances = "1e-2,1e-3,1e-4";
    if (!IsGiven("seeds")) FLAGS_seeds = "1";
  }
  require(ParseMethods(FLAGS_preconditioners, &plan.preconditioners, &error),
          "preconditioners");
  for (const Method& method : plan.preconditioners) {
    if (method.spec == kNone) continue;
    require(CreatePreconditioner(method.spec, &error) != nullptr,
            "preconditioners");
  }
  plan.prepare = MakeSolver("prepare_solver", FLAGS_prepare_solver);
  require(ParseNumbers(FLAGS_distances, &plan.distances, &error), "distances");
  for (const double d : plan.distances) {
    if (d > 0.5 || d < 1e-12) {
      BadInput("--distances: " + Neat(d) + " must be in [1e-12, 0.5]");
    }
  }
  std::sort(plan.distances.begin(), plan.distances.end());
  // The same words as in the cases of `compare`.
  std::string cases;
  std::istringstream items(FLAGS_shear);
  for (std::string item; std::getline(items, item, ',');) {
    cases += (cases.empty() ? "" : ",") + std::string("near_jamming=") + item;
  }
  std::vector<Case> parsed;
  if (cases.empty()) BadInput("--shear= is empty");
  require(ParseCases(cases, plan.distances, 0.0, &parsed, &error), "shear");
  for (const Case& c : parsed) {
    if (c.distance != plan.distances[0]) continue;
    plan.shears.push_back(
        {Neat(c.value) + (c.relative ? "x" : ""), c.value, c.relative});
  }
  plan.seeds = {FLAGS_seed};
  // --seed, if it alone is given.
  if (IsGiven("seeds") || !IsGiven("seed")) {
    require(ParseSeeds(FLAGS_seeds, &plan.seeds, &error), "seeds");
  }
  // With an input no random number is drawn.
  if (!FLAGS_input.empty()) plan.seeds.resize(1);
  plan.scene = MakeScene(FLAGS_phi, plan.seeds[0]);
  {
    const auto energy =
        ContactEnergy::Create(plan.scene.packing, plan.scene.energy, &error);
    for (const Method& method : plan.preconditioners) {
      if (method.spec == kNone) continue;
      require(
          CreatePreconditioner(method.spec, &error)->Supports(*energy, &error),
          "preconditioners");
    }
  }
  return plan;
}

Json NumberOrNull(double value) {
  return std::isfinite(value) ? Json(value) : Json();
}

Json SummaryJson(const Plan& plan,
                 const Preparation& preparation,
                 const Rows& rows) {
  Json json;
  std::size_t found = 0;
  for (const ConditionRow& r : rows.conditions) {
    found += r.found ? 1 : 0;
  }
  json["spectra"] = rows.conditions.size();
  json["spectra_found"] = found;
  json["alpha"] = plan.scene.energy.alpha;
  json["k"] = plan.scene.energy.stiffness;
  json["dimension"] = plan.scene.packing.dimension();
  json["particles"] = plan.scene.packing.size();
  json["prepare_solver"] = plan.prepare->name();
  json["prepared"] = preparation.json();
  json["preconditioners"] = Json::array();
  for (const Method& method : plan.preconditioners) {
    json["preconditioners"].push_back(
        {{"label", method.label}, {"spec", method.spec}});
  }
  json["condition_numbers"] = Json::array();
  std::set<std::string> shears = {"-"};
  for (const Shear& shear : plan.shears) shears.insert(shear.name);
  for (const std::string& shear : shears) {
    for (const Method& method : plan.preconditioners) {
      for (const double distance : plan.distances) {
        std::vector<double> numbers;
        for (const ConditionRow& r : rows.conditions) {
          if (r.shear == shear && r.label == method.label &&
              r.distance == distance && r.found) {
            numbers.push_back(r.number);
          }
        }
        if (numbers.empty()) continue;
        json["condition_numbers"].push_back(
            {{"shear", shear},
             {"preconditioner", method.label},
             {"distance", distance},
             {"packings", numbers.size()},
             {"median", NumberOrNull(MedianOf(numbers))},
             {"worst",
              NumberOrNull(
                  *std::max_element(numbers.begin(), numbers.end()))}});
      }
    }
  }
  json["schema"] = "granopt/conditioning/1";
  json["provenance"] = Provenance();
  return json;
}

const std::vector<std::string>& Figures() {
  static const std::vector<std::string> names = {"conditioning.svg",
                                                 "conditioning.png"};
  return names;
}

void Report(const Rows& rows, const std::string& data, Output* output) {
  const std::string text = TablesText(rows);
  output->Write("tables.txt", text);
  std::fputs(text.c_str(), stdout);
  Draw(data, output);
  PrintReadingHelp();
}

int Replot() {
  for (const char* flag : {"preconditioners",
                           "phi",
                           "seeds",
                           "seed",
                           "shear",
                           "distances",
                           "prepare_solver",
                           "prepare_evaluations",
                           "input",
                           "particles",
                           "dimension",
                           "polydispersity",
                           "alpha",
                           "tolerance",
                           "smoke",
                           "zero_pressure"}) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag + " cannot go with --replot");
    }
  }
  std::string data = FLAGS_replot;
  if (data.empty()) BadInput("--replot= is empty");
  while (data.size() > 1 && data.back() == '/') data.pop_back();
  const Rows rows = ReadAll(data);
  std::vector<std::string> names = Figures();
  names.push_back("tables.txt");
  Output output;
  output.Create(IsGiven("out") ? FLAGS_out : data, names);
  std::printf("conditioning  tables and figure of %s again\n", data.c_str());
  Report(rows, data, &output);
  output.PrintFiles();
  return kConverged;
}

int Main() {
  ListSolversIfAsked();
  if (IsGiven("replot")) return Replot();
  const Plan plan = MakePlan();
  std::vector<std::string> names = Figures();
  for (const char* name : {"conditioning.csv",
                           "contact_changes.csv",
                           "tables.txt",
                           "summary.json"}) {
    names.push_back(name);
  }
  Output output;
  output.Create(FLAGS_out, names);
  std::printf("conditioning  %s, alpha = %g, %zu distances, %zu packing%s\n",
              Describe(plan.scene.packing).c_str(),
              plan.scene.energy.alpha,
              plan.distances.size(),
              plan.seeds.size(),
              plan.seeds.size() == 1 ? "" : "s");
  const char* head = "P";
  for (const Method& method : plan.preconditioners) {
    std::printf(
        "%-13s %s%s\n",
        head,
        method.label.c_str(),
        method.label == method.spec ? "" : ("  = " + method.spec).c_str());
    head = "";
  }
  std::fflush(stdout);

  Preparation preparation(plan.scene, *plan.prepare, FLAGS_phi, &output);
  preparation.ExpectSteps(static_cast<int>(
      plan.seeds.size() * plan.distances.size() * plan.shears.size()));
  Rows rows;
  std::size_t done = 0;
  const std::size_t all = plan.seeds.size() * plan.distances.size();
  for (const std::uint64_t seed : plan.seeds) {
    std::vector<Packing> states;
    std::string error;
    if (!preparation.NearJamming(seed, plan.distances, &states, &error)) {
      preparation.ClearProgress();
      std::fprintf(stderr, "conditioning: %s\n", error.c_str());
      return kNotConverged;
    }
    preparation.ClearProgress();
    Progress progress;
    // From far to near, as one reads.
    for (std::size_t k = plan.distances.size(); k-- > 0;) {
      const std::string where = Format("state %zu of %zu (seed %llu, phi_J + ",
                                       ++done,
                                       all,
                                       static_cast<unsigned long long>(seed)) +
                                Neat(plan.distances[k]) + ")";
      MeasureState(plan,
                   seed,
                   plan.distances[k],
                   states[k],
                   &preparation,
                   &progress,
                   where,
                   &rows);
    }
  }
  output.Write("conditioning.csv", ConditionsCsv(rows.conditions));
  output.Write("contact_changes.csv", ChangesCsv(rows.changes));
  Report(rows, output.folder(), &output);
  bool converged = true;
  for (const ConditionRow& r : rows.conditions) {
    if (r.found) continue;
    converged = converged && r.shear != "-";
    std::printf("\nnot found: seed %llu at %s, %s, shear %s: %s",
                static_cast<unsigned long long>(r.seed),
                Neat(r.distance).c_str(),
                r.label.c_str(),
                r.shear.c_str(),
                r.message.c_str());
  }
  output.WriteJson("summary.json", SummaryJson(plan, preparation, rows));
  output.PrintFiles();
  return converged ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(
      &argc,
      &argv,
      "is it conditioning or contact change that makes "
      "relaxations near jamming long? eigenvalues of P^-1 H and "
      "contacts made and lost against the distance to jamming");
  return granopt::Main();
}
