#include "experiments/protocol_tables.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>

#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double Range(const std::vector<double>& values) {
  if (values.empty()) return 0.0;
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return *most - *least;
}

}  // namespace

std::vector<ProtocolRow> TabulateProtocols(
    const ProtocolSetup& setup, const std::vector<ProtocolRun>& runs) {
  const ProtocolIndex index(runs);
  std::vector<ProtocolRow> rows;
  for (const double tolerance : setup.tolerances) {
    for (const Method& method : setup.methods) {
      ProtocolRow row;
      row.method = method;
      row.tolerance = tolerance;
      Costs<std::vector<double>> costs, spent;
      std::vector<double> relaxations, ratios, function_shares, linear_shares;
      for (const std::uint64_t seed : setup.seeds) {
        for (int r = 1; r <= setup.repetitions; ++r) {
          const ProtocolRun* run = index.Run(tolerance, seed, method.label, r);
          if (run == nullptr) continue;
          ++row.runs;
          row.finished += run->finished ? 1 : 0;
          row.undecided += run->undecided;
          row.gave_up += run->gave_up;
          const Work& work = run->work;
          relaxations.push_back(run->finished ? run->relaxations : kInfinity);
          Append(run->finished ? CostsOf(work) : InfiniteCosts(), &costs);
          Append(CostsOf(work), &spent);
          function_shares.push_back(work.function_share);
          linear_shares.push_back(work.linear_share);
          const ProtocolRun* base =
              index.Run(tolerance, seed, setup.baseline, r);
          if (base != nullptr && base->finished &&
              base->work.cpu_seconds > 0.0) {
            ratios.push_back(costs[kCpuSeconds].back() /
                             base->work.cpu_seconds);
          }
        }
      }
      row.relaxations = QuantilesOf(relaxations);
      row.costs = OfEach(costs, QuantilesOf);
      row.spent = OfEach(spent, MedianOf);
      row.ratio = QuantilesOf(ratios);
      row.function_share = MedianOf(function_shares);
      row.linear_share = MedianOf(linear_shares);
      rows.push_back(row);
    }
  }
  return rows;
}

std::vector<JammingRow> TabulateJamming(const ProtocolSetup& setup,
                                        const std::vector<ProtocolRun>& runs) {
  const ProtocolIndex index(runs);
  std::vector<JammingRow> rows;
  for (const double tolerance : setup.tolerances) {
    for (const Method& method : setup.methods) {
      JammingRow row;
      row.method = method;
      row.tolerance = tolerance;
      row.least_phi = kInfinity;
      row.most_phi = -kInfinity;
      row.worst_excess = kNan;
      std::vector<double> excess, pressures, contacts;
      for (const std::uint64_t seed : setup.seeds) {
        const ProtocolRun* run = index.Run(tolerance, seed, method.label);
        if (run == nullptr || !run->finished) continue;
        ++row.runs;
        row.least_phi = std::min(row.least_phi, run->phi_cr);
        row.most_phi = std::max(row.most_phi, run->phi_cr);
        pressures.push_back(run->pressure);
        contacts.push_back(run->contacts_excess);
        row.most_contacts =
            contacts.size() == 1
                ? run->contacts_excess
                : std::max(row.most_contacts, run->contacts_excess);
        row.lost += run->branch == kLost ? 1 : 0;
        row.spurious += run->branch == kSpurious ? 1 : 0;
        row.unknown += run->branch == kUnknown ? 1 : 0;
        row.non_monotone += run->NonMonotone(setup.epsilon) ? 1 : 0;
        if (std::isfinite(run->Excess())) excess.push_back(run->Excess());
        const ProtocolRun* reference =
            index.Run(tolerance, seed, setup.reference);
        if (reference != nullptr && reference->finished) {
          row.apart =
              std::max(row.apart, std::abs(run->phi_cr - reference->phi_cr));
        }
      }
      row.excess = QuantilesOf(excess);
      if (!excess.empty()) {
        row.worst_excess = *std::max_element(excess.begin(), excess.end());
      }
      row.pressure = MedianOf(pressures);
      row.contacts = MedianOf(contacts);
      rows.push_back(row);
    }
  }
  return rows;
}

std::vector<SeedSpread> SpreadOfSeeds(const ProtocolSetup& setup,
                                      const std::vector<ProtocolRun>& runs) {
  const ProtocolIndex index(runs);
  std::vector<SeedSpread> spreads;
  for (const std::uint64_t seed : setup.seeds) {
    SeedSpread spread;
    spread.seed = seed;
    spread.least_phi = spread.least_phi_j = kInfinity;
    spread.most_phi = spread.most_phi_j = -kInfinity;
    std::map<std::string, std::vector<double>> of_method;
    std::map<double, std::vector<double>> of_tolerance;
    for (const double tolerance : setup.tolerances) {
      for (const Method& method : setup.methods) {
        const ProtocolRun* run = index.Run(tolerance, seed, method.label);
        if (run == nullptr || !run->finished) continue;
        ++spread.runs;
        spread.least_phi = std::min(spread.least_phi, run->phi_cr);
        spread.most_phi = std::max(spread.most_phi, run->phi_cr);
        if (run->branch == kFollowed) {
          spread.least_phi_j = std::min(spread.least_phi_j, run->phi_j);
          spread.most_phi_j = std::max(spread.most_phi_j, run->phi_j);
        }
        of_method[method.label].push_back(run->phi_cr);
        of_tolerance[tolerance].push_back(run->phi_cr);
      }
    }
    for (const auto& [label, values] : of_method) {
      spread.by_tolerance = std::max(spread.by_tolerance, Range(values));
    }
    for (const auto& [tolerance, values] : of_tolerance) {
      spread.by_method = std::max(spread.by_method, Range(values));
    }
    spreads.push_back(spread);
  }
  return spreads;
}

std::vector<ShearRow> TabulateShear(const ProtocolSetup& setup,
                                    const std::vector<ProtocolStep>& steps) {
  const ProtocolIndex index({}, steps);
  std::vector<ShearRow> rows;
  for (const double tolerance : setup.tolerances) {
    for (const Method& method : setup.methods) {
      for (const std::uint64_t seed : setup.seeds) {
        const auto& mine = index.Steps(tolerance, seed, method.label);
        const auto& other = index.Steps(tolerance, seed, setup.reference);
        if (mine.empty() || other.empty()) continue;
        ShearRow row;
        row.method = method;
        row.tolerance = tolerance;
        row.seed = seed;
        const std::size_t common = std::min(mine.size(), other.size());
        row.steps = static_cast<int>(common) - 1;
        const std::size_t first = FirstDifference(mine, other);
        if (first < common) {
          row.first_difference = mine[first]->step;
          row.strain = mine[first]->strain;
        }
        double scale = 0.0, sum = 0.0;
        for (std::size_t k = 0; k < common; ++k) {
          scale = std::max(scale, other[k]->deviatoric);
        }
        for (std::size_t k = 0; k < common; ++k) {
          const double difference =
              scale > 0.0
                  ? std::abs(mine[k]->deviatoric - other[k]->deviatoric) / scale
                  : 0.0;
          row.largest = std::max(row.largest, difference);
          sum += difference * difference;
          row.dissipated += mine[k]->dissipated;
        }
        row.rms = std::sqrt(sum / static_cast<double>(common));
        const double start = mine[0]->energy;
        row.dissipated = start > 0.0 ? row.dissipated / start : 0.0;
        rows.push_back(row);
      }
    }
  }
  return rows;
}

std::string ProtocolTablesCsv(const std::vector<ProtocolRow>& rows) {
  std::string csv =
      "tolerance,solver,spec,runs,finished,undecided,gave_up,relaxations,"
      "iterations,evaluations,evaluations_q20,evaluations_q80,hessians,"
      "factorizations,linear_iterations,cpu_seconds,cpu_seconds_q20,"
      "cpu_seconds_q80,ratio,ratio_q20,ratio_q80,function_share,linear_share,"
      "spent_evaluations,spent_seconds\n";
  const auto three = [](const Quantiles& q) {
    return Format("%.9g,%.9g,%.9g,", q.median, q.low, q.high);
  };
  for (const ProtocolRow& row : rows) {
    csv += Neat(row.tolerance) + "," + Field(row.method.label) + "," +
           Field(row.method.spec) +
           Format(",%d,%d,%d,%d,%.9g,%.9g,",
                  row.runs,
                  row.finished,
                  row.undecided,
                  row.gave_up,
                  row.relaxations.median,
                  row.costs[kIterations].median) +
           three(row.costs[kEvaluations]) +
           Format("%.9g,%.9g,%.9g,",
                  row.costs[kHessians].median,
                  row.costs[kFactorizations].median,
                  row.costs[kLinearIterations].median) +
           three(row.costs[kCpuSeconds]) + three(row.ratio) +
           Format("%.4g,%.4g,%.9g,%.9g\n",
                  row.function_share,
                  row.linear_share,
                  row.spent[kEvaluations],
                  row.spent[kCpuSeconds]);
  }
  return csv;
}

std::string JammingTableCsv(const std::vector<JammingRow>& rows) {
  std::string csv =
      "tolerance,solver,spec,runs,phi_cr_least,phi_cr_most,apart,excess,"
      "excess_q20,excess_q80,excess_most,pressure,contacts_excess,"
      "contacts_excess_most,non_monotone,lost,spurious,unknown\n";
  for (const JammingRow& row : rows) {
    csv += Neat(row.tolerance) + "," + Field(row.method.label) + "," +
           Field(row.method.spec) +
           Format(
               ",%d,%.12g,%.12g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d,%d,%d,"
               "%d,%d\n",
               row.runs,
               row.least_phi,
               row.most_phi,
               row.apart,
               row.excess.median,
               row.excess.low,
               row.excess.high,
               row.worst_excess,
               row.pressure,
               row.contacts,
               row.most_contacts,
               row.non_monotone,
               row.lost,
               row.spurious,
               row.unknown);
  }
  return csv;
}

std::string ShearTableCsv(const std::vector<ShearRow>& rows) {
  std::string csv =
      "tolerance,seed,solver,spec,steps,first_difference,strain,largest,rms,"
      "dissipated\n";
  for (const ShearRow& row : rows) {
    csv += Neat(row.tolerance) +
           Format(",%llu,", static_cast<unsigned long long>(row.seed)) +
           Field(row.method.label) + "," + Field(row.method.spec) +
           Format(",%d,%d,%.9g,%.6g,%.6g,%.6g\n",
                  row.steps,
                  row.first_difference,
                  row.strain,
                  row.largest,
                  row.rms,
                  row.dissipated);
  }
  return csv;
}

}  // namespace granopt
