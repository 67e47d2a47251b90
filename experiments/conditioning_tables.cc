#include "experiments/conditioning_tables.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "experiments/comparison_records.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

std::string Short(double value) {
  if (std::isnan(value)) return "-";
  if (std::isinf(value)) return "inf";
  if (value < 99.95) return Format("%.3g", value);
  return Format("%.1e", value);
}

// A median of counts, which may be between two.
std::string Half(double value) {
  return std::isnan(value) ? "-" : Format("%.6g", value);
}

template <typename T>
void AddOnce(const T& value, std::vector<T>* list) {
  if (std::find(list->begin(), list->end(), value) == list->end()) {
    list->push_back(value);
  }
}

// Condition numbers, or how many eigenvalues are outside of [1/2, 2]: a row a
// distance and a column a P.
std::string ConditionTable(const ConditioningRows& rows,
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
      if (numbers.empty()) {
        line.push_back("-");
        continue;
      }
      const auto print = outside ? Half : Short;
      const MedianWorst value = MedianAndWorst(numbers);
      line.push_back(print(value.median) + " (" + print(value.worst) + ")");
    }
    cells.push_back(line);
  }
  return Grid(cells, 0, /*markdown=*/false);
}

std::string ChangeTable(const ConditioningRows& rows,
                        const std::string& shear) {
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
                     Half(MedianOf(contacts)),
                     Half(MedianOf(deformed)),
                     Half(MedianOf(predicted)),
                     Half(MedianOf(opened)),
                     Half(MedianOf(closed)),
                     percent(MedianOf(part)),
                     Half(MedianOf(newton)),
                     percent(MedianOf(newton_part)),
                     std::isinf(median_first) ? "never" : Short(median_first),
                     MedianOf(shift) == 0.0 ? "none" : Short(MedianOf(shift)),
                     Format("%d of %d", rearranging, steps) +
                         (lost > 0 ? Format(", %d not relaxed", lost) : "")});
  }
  return Grid(cells, 0, /*markdown=*/false);
}

std::string StrainWords(const std::string& shear) {
  return shear.back() == 'x'
             ? shear.substr(0, shear.size() - 1) + " (phi - phi_J)"
             : shear;
}

}  // namespace

std::string TablesText(const ConditioningRows& rows) {
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

}  // namespace granopt
