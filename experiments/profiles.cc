#include "experiments/profiles.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "experiments/minima.h"
#include "experiments/report_text.h"
#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The place of a label; -1 if there is none.
int IndexOf(const std::vector<Method>& methods, const std::string& label) {
  for (std::size_t m = 0; m < methods.size(); ++m) {
    if (methods[m].label == label) return static_cast<int>(m);
  }
  return -1;
}

std::string Percent(double fraction) {
  return Format("%.0f %%", 100.0 * fraction);
}

std::string MeasureName(const std::string& measure) {
  if (measure == "evaluations") return "evaluations";
  if (measure == "cpu_seconds") return "CPU seconds";
  if (measure == "energy") return "E - E_best";
  if (measure == "path") return "|E - E_ref|";
  return "(phi_cr - phi_J) / epsilon";
}

}  // namespace

StepFunction Distribution(const std::vector<double>& values, int total) {
  std::vector<double> sorted;
  for (const double value : values) {
    if (std::isfinite(value)) sorted.push_back(value);
  }
  std::sort(sorted.begin(), sorted.end());
  StepFunction steps;
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    if (k + 1 < sorted.size() && sorted[k + 1] == sorted[k]) continue;
    steps.push_back({sorted[k], static_cast<double>(k + 1) / total});
  }
  return steps;
}

double ValueAt(const StepFunction& steps, double at) {
  double fraction = 0.0;
  for (const StepPoint& point : steps) {
    if (point.at > at) break;
    fraction = point.fraction;
  }
  return fraction;
}

std::vector<double> Column(const std::vector<std::vector<double>>& table,
                           std::size_t method) {
  std::vector<double> column;
  for (const std::vector<double>& row : table) column.push_back(row[method]);
  return column;
}

std::vector<std::vector<double>> PerformanceRatios(
    const std::vector<std::vector<double>>& costs) {
  std::vector<std::vector<double>> ratios = costs;
  for (std::vector<double>& row : ratios) {
    const double best = *std::min_element(row.begin(), row.end());
    for (double& value : row) {
      if (value == best && std::isfinite(best)) {
        value = 1.0;  // 0 / 0 too
      } else {
        value = best > 0.0 && std::isfinite(value) ? value / best : kInfinity;
      }
    }
  }
  return ratios;
}

std::vector<std::vector<double>> EnergyDifferences(
    const std::vector<std::vector<double>>& energies, int reference) {
  std::vector<std::vector<double>> differences = energies;
  for (std::vector<double>& row : differences) {
    double base = kInfinity;
    if (reference >= 0) {
      base = row[reference];
    } else {
      for (const double energy : row) {
        if (energy < base) base = energy;
      }
    }
    for (double& energy : row) {
      const double size = std::max(std::abs(energy), std::abs(base));
      if (!std::isfinite(energy) || !std::isfinite(base)) {
        energy = kInfinity;
      } else {
        energy = size > 0.0 ? std::abs(energy - base) / size : 0.0;
      }
    }
  }
  return differences;
}

Profile MakeProfile(const std::string& problems,
                    const std::string& measure,
                    const std::vector<Method>& methods,
                    const std::vector<std::vector<double>>& costs) {
  Profile profile;
  profile.problems = problems;
  profile.measure = measure;
  profile.count = static_cast<int>(costs.size());
  profile.methods = methods;
  const std::vector<std::vector<double>> ratios = PerformanceRatios(costs);
  for (std::size_t m = 0; m < methods.size(); ++m) {
    int solved = 0;
    for (const std::vector<double>& row : costs) {
      solved += std::isfinite(row[m]) ? 1 : 0;
    }
    profile.solved.push_back(solved);
    profile.steps.push_back(Distribution(Column(ratios, m), profile.count));
  }
  return profile;
}

Quality MakeQuality(const Problems& problems, const std::string& reference) {
  Quality quality;
  quality.problems = "case, seed, step";
  quality.measure = "energy";
  quality.count = static_cast<int>(problems.energies.size());
  quality.methods = problems.methods;
  quality.agreement = "minimum";
  quality.reference = reference;
  const int base = IndexOf(problems.methods, reference);
  const std::vector<std::vector<double>> differences =
      EnergyDifferences(problems.energies, -1);
  for (std::size_t m = 0; m < problems.methods.size(); ++m) {
    quality.steps.push_back(
        Distribution(Column(differences, m), quality.count));
    int agree = 0, judged = 0;
    for (const std::vector<std::string>& minima : problems.minima) {
      if (base < 0 || minima[base] == "-") continue;
      ++judged;
      agree += minima[m] == minima[base] ? 1 : 0;
    }
    quality.agree.push_back(agree);
    quality.judged.push_back(judged);
  }
  return quality;
}

std::string ProfilesCsv(const std::vector<Profile>& profiles) {
  std::string csv =
      "problems,measure,solver,spec,count,solved,ratio,fraction\n";
  for (const Profile& profile : profiles) {
    for (std::size_t m = 0; m < profile.methods.size(); ++m) {
      const std::string head =
          Field(profile.problems) + "," + profile.measure + "," +
          Field(profile.methods[m].label) + "," +
          Field(profile.methods[m].spec) +
          Format(",%d,%d,", profile.count, profile.solved[m]);
      StepFunction steps = profile.steps[m];
      if (steps.empty()) steps = {{kInfinity, 0.0}};
      for (const StepPoint& point : steps) {
        csv += head + Format("%.9g,%.9g\n", point.at, point.fraction);
      }
    }
  }
  return csv;
}

std::string QualitiesCsv(const std::vector<Quality>& qualities) {
  std::string csv =
      "problems,measure,solver,spec,count,value,fraction,agreement,reference,"
      "agree,judged,low,high\n";
  for (const Quality& quality : qualities) {
    for (std::size_t m = 0; m < quality.methods.size(); ++m) {
      const Interval interval = Wilson(quality.agree[m], quality.judged[m]);
      StepFunction steps = quality.steps[m];
      if (steps.empty()) steps = {{kInfinity, 0.0}};
      for (const StepPoint& point : steps) {
        csv +=
            Field(quality.problems) + "," + quality.measure + "," +
            Field(quality.methods[m].label) + "," +
            Field(quality.methods[m].spec) +
            Format(",%d,%.9g,%.9g,", quality.count, point.at, point.fraction) +
            Field(quality.agreement) + "," + Field(quality.reference) +
            Format(",%d,%d,%.6g,%.6g\n",
                   quality.agree[m],
                   quality.judged[m],
                   interval.low,
                   interval.high);
      }
    }
  }
  return csv;
}

std::string ProfilesText(const std::vector<Profile>& profiles, bool markdown) {
  std::string text;
  for (const Profile& profile : profiles) {
    std::vector<std::vector<std::string>> rows = {
        {"method", "cheapest", "within 2 x", "within 10 x", "solved"}};
    for (std::size_t m = 0; m < profile.methods.size(); ++m) {
      const StepFunction& steps = profile.steps[m];
      rows.push_back({profile.methods[m].label,
                      Percent(ValueAt(steps, 1.0)),
                      Percent(ValueAt(steps, 2.0)),
                      Percent(ValueAt(steps, 10.0)),
                      Format("%d of %d", profile.solved[m], profile.count)});
    }
    text += Heading(Format("performance profile, %s, %d problems (%s)",
                           MeasureName(profile.measure).c_str(),
                           profile.count,
                           profile.problems.c_str()),
                    markdown) +
            Block(Grid(rows, 0, markdown), markdown);
  }
  if (text.empty()) return text;
  return text +
         Paragraph({"part of the problems that a method solved with at most "
                    "so many times the work of the cheapest method of each;",
                    "the order of two methods below the best may change when "
                    "a third is left out"},
                   markdown);
}

std::string QualitiesText(const std::vector<Quality>& qualities,
                          bool markdown) {
  std::string text;
  for (const Quality& quality : qualities) {
    const bool excess = quality.measure == "excess";
    const std::vector<double> bounds =
        excess ? std::vector<double>{1.0, 10.0, 100.0}
               : std::vector<double>{1e-9, 1e-6, 1e-3};
    std::vector<std::vector<std::string>> rows = {{"method"}};
    for (const double bound : bounds) rows[0].push_back("<= " + Neat(bound));
    rows[0].push_back("as " + quality.reference + ": " + quality.agreement);
    for (std::size_t m = 0; m < quality.methods.size(); ++m) {
      const std::string& label = quality.methods[m].label;
      rows.push_back({label});
      for (const double bound : bounds) {
        rows.back().push_back(Percent(ValueAt(quality.steps[m], bound)));
      }
      rows.back().push_back(
          quality.judged[m] == 0 || label == quality.reference
              ? "-"
              : WithInterval(quality.agree[m], quality.judged[m]));
    }
    std::vector<std::string> lines;
    if (excess) {
      lines = {
          "part of the runs whose phi_cr is at most so many epsilon above the "
          "phi_J of the branch it is on; last column:",
          "phi_cr within epsilon of that of the reference from the same start, "
          "in brackets Wilson's 95 % interval"};
    } else if (quality.measure == "path") {
      lines = {
          "part of the strains at which the energy is the reference's to so "
          "much of the larger; last column: whole runs",
          Format("whose energies agree to %s all the way, in brackets Wilson's "
                 "95 %% interval",
                 Neat(Minima::kEnergyBound).c_str())};
    } else {
      lines = {
          "part of the problems that end with an energy at most so much of the "
          "larger above the least that a method found;",
          "last column: problems that end in the reference's minimum, in "
          "brackets Wilson's 95 % interval"};
    }
    text += Heading(Format("quality profile, %s, %d problems (%s)",
                           MeasureName(quality.measure).c_str(),
                           quality.count,
                           quality.problems.c_str()),
                    markdown) +
            Block(Grid(rows, 0, markdown), markdown) +
            Paragraph(lines, markdown);
  }
  return text;
}

Problems CollectProblems(const ComparisonSetup& setup,
                         const std::vector<Event>& events,
                         const std::vector<RunRecord>& runs) {
  const RunIndex index(events, runs);
  Problems problems;
  problems.methods = setup.methods;
  for (const Case& c : setup.cases) {
    for (const std::uint64_t seed : setup.seeds) {
      for (int step = 1; step <= StepsOf(setup, c); ++step) {
        const Place place(c.id, seed, step);
        std::vector<double> evaluations, seconds, energies;
        std::vector<std::string> minima;
        for (const Method& method : setup.methods) {
          std::vector<double> counts, times;
          for (int r = 1; r <= setup.repetitions; ++r) {
            const RunRecord* run = index.Find(place, method.label, r);
            if (run == nullptr) continue;
            const Work* work = index.Reached(*run, setup.levels[0]);
            counts.push_back(work == nullptr
                                 ? kInfinity
                                 : static_cast<double>(work->evaluations));
            times.push_back(work == nullptr ? kInfinity : work->cpu_seconds);
          }
          // Not run: such a problem is left out.
          if (counts.empty()) break;
          evaluations.push_back(MedianOf(counts));
          seconds.push_back(MedianOf(times));
          const RunRecord* first = index.Find(place, method.label, 1);
          energies.push_back(first == nullptr ? kNan : first->energy);
          minima.push_back(first == nullptr ? "-" : first->minimum);
        }
        if (evaluations.size() < setup.methods.size()) continue;
        problems.evaluations.push_back(evaluations);
        problems.cpu_seconds.push_back(seconds);
        problems.energies.push_back(energies);
        problems.minima.push_back(minima);
      }
    }
  }
  return problems;
}

ComparisonProfiles MakeComparisonProfiles(const ComparisonSetup& setup,
                                          const std::vector<Event>& events,
                                          const std::vector<RunRecord>& runs) {
  ComparisonProfiles result;
  const Problems problems = CollectProblems(setup, events, runs);
  if (static_cast<int>(problems.methods.size()) < kLeastMethods ||
      static_cast<int>(problems.evaluations.size()) < kLeastProblems) {
    return result;
  }
  const std::string what = "case, seed, step";
  result.profiles = {
      MakeProfile(what, "evaluations", problems.methods, problems.evaluations),
      MakeProfile(what, "cpu_seconds", problems.methods, problems.cpu_seconds)};
  result.qualities = {MakeQuality(
      problems, setup.reference.empty() ? setup.baseline : setup.reference)};
  return result;
}

}  // namespace granopt
