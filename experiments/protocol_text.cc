#include "experiments/protocol_text.h"

#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "experiments/minima.h"
#include "experiments/protocol_profiles.h"
#include "experiments/protocol_tables.h"
#include "experiments/report_text.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::string Brief(double value) {
  return std::isnan(value) ? "-" : Format("%.1e", value);
}

std::string WorkText(const ProtocolSetup& setup,
                     const std::vector<ProtocolRun>& runs,
                     bool markdown) {
  const std::vector<ProtocolRow> table = TabulateProtocols(setup, runs);
  const std::vector<Cost> optional =
      WithWork(table, {kHessians, kFactorizations, kLinearIterations});
  std::vector<std::vector<std::string>> grid(1);
  grid[0] = {"tolerance",
             "method",
             "finished",
             "relaxations",
             "gave up",
             HeadingOf(kIterations),
             HeadingOf(kEvaluations)};
  for (const Cost cost : optional) grid[0].push_back(HeadingOf(cost));
  grid[0].insert(grid[0].end(),
                 {HeadingOf(kCpuSeconds), "ratio", "f/lin/rest %"});
  double last = kNan;
  for (const ProtocolRow& row : table) {
    std::vector<std::string> cells = {
        row.tolerance == last ? "" : Neat(row.tolerance),
        row.method.label,
        Format("%d of %d", row.finished, row.runs),
        Spread(row.relaxations, kNan, Count),
        CountOrDash(row.gave_up),
        Spread(row.costs[kIterations], kNan, Count),
        Spread(row.costs[kEvaluations], row.spent[kEvaluations], Count)};
    last = row.tolerance;
    for (const Cost cost : optional) {
      cells.push_back(Spread(row.costs[cost], kNan, Count));
    }
    cells.push_back(
        Spread(row.costs[kCpuSeconds], row.spent[kCpuSeconds], Seconds));
    cells.push_back(Spread(row.ratio, kNan, Ratio));
    cells.push_back(
        row.runs == 0 ? "-" : Shares(row.function_share, row.linear_share));
    grid.push_back(cells);
  }
  std::string text =
      Heading(setup.protocol == kJammingProtocol
                  ? "the work of growth and bisection"
                  : Format("the work of a pure shear to %s in %d steps",
                           Neat(setup.strain).c_str(),
                           setup.strain_steps),
              markdown) +
      Block(Grid(grid, 0, markdown, 2), markdown);
  std::map<std::string, int> failures;
  std::vector<std::string> notes;
  for (const ProtocolRun& run : runs) {
    if (run.finished || ++failures[run.key.label] > 2) continue;
    notes.push_back(
        "! " + run.key.label + ", tolerance " + Neat(run.key.tolerance) +
        Format(", seed %llu: ", static_cast<unsigned long long>(run.key.seed)) +
        run.message);
  }
  if (!notes.empty()) text += Paragraph(notes, markdown);
  return text +
         Paragraph(
             {"totals, medians over " + Plural(setup.seeds.size(), "seed") +
                  " and " + Plural(setup.repetitions, "repetition") +
                  ", 20-80 % in brackets; a protocol that did not end "
                  "counts as infinitely",
              "expensive (> what it had spent); gave up: relaxations, "
              "over all runs; CPU s: of the relaxations and what is",
              "measured on them; ratio: to " + setup.baseline +
                  " from the same start"},
             markdown);
}

std::string JammingText(const ProtocolSetup& setup,
                        const std::vector<ProtocolRun>& runs,
                        bool markdown) {
  std::vector<std::vector<std::string>> grid = {{"tolerance",
                                                 "method",
                                                 "runs",
                                                 "phi_cr",
                                                 "from " + setup.reference,
                                                 "phi_cr - phi_J",
                                                 "worst",
                                                 "pressure",
                                                 "contacts",
                                                 "non-monotone",
                                                 "lost",
                                                 "spurious",
                                                 "unknown"}};
  double last = kNan;
  for (const JammingRow& row : TabulateJamming(setup, runs)) {
    const std::string tolerance =
        row.tolerance == last ? "" : Neat(row.tolerance);
    last = row.tolerance;
    if (row.runs == 0) {
      grid.push_back({tolerance, row.method.label, "0"});
      grid.back().resize(grid[0].size(), "-");
      continue;
    }
    grid.push_back(
        {tolerance,
         row.method.label,
         std::to_string(row.runs),
         Format("%.6f-%.6f", row.least_phi, row.most_phi),
         row.method.label == setup.reference ? "-" : Brief(row.apart),
         Brief(row.excess.median),
         Brief(row.worst_excess),
         Brief(row.pressure),
         Format("%+.0f (%+d)", row.contacts, row.most_contacts),
         CountOrDash(row.non_monotone),
         CountOrDash(row.lost),
         CountOrDash(row.spurious),
         CountOrDash(row.unknown)});
  }
  std::string text =
      Heading("how far the published Algorithm 1 can be believed, epsilon = " +
                  Neat(setup.epsilon),
              markdown) +
      Block(Grid(grid, 0, markdown, 2), markdown);
  text += Paragraph(
      {"phi_cr: least and most over seeds; from: largest distance to the "
       "reference's phi_cr from the same start; phi_J: where the",
       "branch of the returned state unjams, followed down by one method for "
       "all; contacts: above isostatic, median (most);",
       "non-monotone: jammed on its branch more than epsilon below the state "
       "that the bisection calls unjammed; lost: the branch",
       "ends at a finite pressure, phi_J is lower still; spurious: relaxed "
       "further, the state is not jammed"},
      markdown);
  grid = {{"seed",
           "runs",
           "phi_cr, all methods and tolerances",
           "spread / epsilon",
           "by tolerance",
           "by method",
           "phi_J of the branches"}};
  for (const SeedSpread& spread : SpreadOfSeeds(setup, runs)) {
    if (spread.runs == 0) continue;
    grid.push_back(
        {Format("%llu", static_cast<unsigned long long>(spread.seed)),
         std::to_string(spread.runs),
         Format("%.7f-%.7f", spread.least_phi, spread.most_phi),
         Format("%.0f", (spread.most_phi - spread.least_phi) / setup.epsilon),
         Format("%.0f", spread.by_tolerance / setup.epsilon),
         Format("%.0f", spread.by_method / setup.epsilon),
         spread.least_phi_j > spread.most_phi_j
             ? "-"
             : Format("%.7f-%.7f", spread.least_phi_j, spread.most_phi_j)});
  }
  if (grid.size() == 1) return text;
  return text + Heading("one start, many jamming points", markdown) +
         Block(Grid(grid, 0, markdown), markdown) +
         Paragraph({"spreads in epsilon: largest difference of phi_cr from one "
                    "start, between tolerances with one method, and",
                    "between methods at one tolerance"},
                   markdown);
}

std::string ShearText(const ProtocolSetup& setup,
                      const std::vector<ProtocolStep>& steps,
                      bool markdown) {
  std::vector<std::vector<std::string>> grid = {{"tolerance",
                                                 "method",
                                                 "seed",
                                                 "first difference",
                                                 "stress apart",
                                                 "rms",
                                                 "dissipated"}};
  std::pair<double, std::string> last = {kNan, ""};
  for (const ShearRow& row : TabulateShear(setup, steps)) {
    const bool same = row.tolerance == last.first;
    const bool reference = row.method.label == setup.reference;
    grid.push_back(
        {same ? "" : Neat(row.tolerance),
         same && row.method.label == last.second ? "" : row.method.label,
         Format("%llu", static_cast<unsigned long long>(row.seed)),
         reference ? "-"
         : row.first_difference == 0
             ? "none"
             : Format("step %d, %.4g", row.first_difference, row.strain),
         reference ? "-" : Brief(row.largest),
         reference ? "-" : Brief(row.rms),
         Format("%.3g", row.dissipated)});
    last = {row.tolerance, row.method.label};
  }
  return Heading("the curves beside that of " + setup.reference, markdown) +
         Block(Grid(grid, 0, markdown, 2), markdown) +
         Paragraph(
             {Format("first difference: step and strain where the energies "
                     "first differ by more than %s of the larger: another "
                     "rearrangement;",
                     Neat(Minima::kEnergyBound).c_str()),
              "stress apart, rms: of the deviatoric stress, in the largest of "
              "the reference; dissipated: in rearrangements, in the energy of "
              "the start"},
             markdown);
}

}  // namespace

std::string ProtocolText(const ProtocolSetup& setup,
                         const std::vector<ProtocolStep>& steps,
                         const std::vector<ProtocolRun>& runs,
                         bool markdown) {
  std::string text;
  if (markdown) {
    text += Introduction(
        "Comparison of methods over a whole protocol: " + setup.protocol,
        setup.what,
        setup.repetitions,
        setup.seeds.size(),
        setup.conditions,
        setup.methods);
  }
  text += WorkText(setup, runs, markdown);
  text += setup.protocol == kJammingProtocol
              ? JammingText(setup, runs, markdown)
              : ShearText(setup, steps, markdown);
  const ComparisonProfiles profiles = MakeProtocolProfiles(setup, steps, runs);
  return text + ProfilesText(profiles.profiles, markdown) +
         QualitiesText(profiles.qualities, markdown);
}

}  // namespace granopt
