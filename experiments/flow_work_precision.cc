// `flow --study=work_precision`: what errors cost in each stepper.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "experiments/flow.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

// A stepper at one step, and what it is listed under.
struct Contender {
  const char* family;
  StepperSetting setting;
};

// How many times as many sweeps as Verlet backward Euler takes for the errors
// of Verlet's steps, where both have an error like that.
void PrintRatios(const Json& rows) {
  double low = INFINITY, high = 0.0;
  for (const int number : {2, 3, 4}) {
    // log error, log sweeps, by falling error.
    std::vector<std::pair<double, double>> euler, verlet;
    for (const Json& row : rows) {
      const bool is_verlet = row.at("stepper") == "verlet";
      if (row.at("case") != number ||
          !(is_verlet ||
            (row.at("stepper") == "jacobi" && row.at("tolerance") == 1e-4))) {
        continue;
      }
      (is_verlet ? verlet : euler)
          .push_back({std::log(row.at("error").get<double>()),
                      std::log(row.at("sweeps").get<double>())});
    }
    for (const auto& [error, sweeps] : verlet) {
      for (std::size_t k = 0; k + 1 < euler.size(); ++k) {
        const auto& a = euler[k];
        const auto& b = euler[k + 1];
        if (!(error <= a.first && error >= b.first)) continue;
        const double s = (a.first - error) / (a.first - b.first);
        const double ratio =
            std::exp(a.second + s * (b.second - a.second) - sweeps);
        low = std::min(low, ratio);
        high = std::max(high, ratio);
      }
    }
  }
  if (high > 0.0) {
    std::printf(
        "\n  for the errors of Verlet's steps, backward Euler (jacobi, TOL = "
        "1e-4) takes %.2g to %.2g times as many sweeps\n",
        low,
        high);
  }
}

}  // namespace

int WorkPrecision(Output* output) {
  const int seeds = !IsGiven("seeds") ? (FLAGS_smoke ? 1 : 10) : FLAGS_seeds;
  const double end = FLAGS_smoke ? 0.05 : 0.3;
  const double fine = FLAGS_smoke ? 1e-4 : 1e-5;
  std::vector<Contender> contenders;
  for (const double dt : {0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002}) {
    contenders.push_back({"fixed point", {"jacobi", 1e-4, dt}});
    contenders.push_back({"fixed point", {"jacobi", 1e-8, dt}});
    contenders.push_back({"fixed point", {"gauss_seidel", 1e-8, dt}});
    contenders.push_back({"Verlet", {"verlet", 1e-8, dt}});
    if (dt >= 0.002) {
      contenders.push_back({"minimization", {"lbfgs", 1e-8, dt}});
    }
    if (dt >= 0.005) {
      contenders.push_back({"minimization", {"newton", 1e-8, dt}});
    }
  }
  std::string csv =
      "case,family,stepper,tolerance,dt,error,error_deviation,sweeps,seconds,"
      "rejected,failed\n";
  Json rows = Json::array(), failed = Json::array();
  Progress progress;
  std::printf(
      "flow      work and precision: |T(%g s) - T_exact| / T_exact, "
      "mean of %d starts; exact: Verlet at Dt = %g\n\n",
      end,
      seeds,
      fine);
  for (const int number : {2, 3, 4}) {
    const Strength strength = kPaperStrengths[number - 1];
    std::vector<std::vector<std::string>> table = {
        {"stepper", "TOL", "Dt", "error", "sweeps", "CPU ms", ""}};
    struct Column {
      std::vector<double> errors, sweeps, seconds, rejected;
      int failed = 0;
    };
    std::vector<Column> columns(contenders.size());
    // Interleaved: seeds outside, contenders inside.
    for (int s = 0; s < seeds; ++s) {
      const FlowCase flow = MakePaperCase(
          strength, FLAGS_seed + s, Domain::Kind::REENTRY, false, 100);
      const auto fail = [&](const StepperSetting& setting,
                            const std::string& error) {
        failed.push_back({{"case", number},
                          {"seed", FLAGS_seed + s},
                          {"stepper", setting.name},
                          {"tolerance", setting.tolerance},
                          {"dt", setting.dt},
                          {"error", error}});
      };
      const StepperSetting finest = {"verlet", 1e-8, fine};
      const FlowMeasurement exact = MeasureFlow(flow, finest, {end});
      if (!exact.error.empty()) {
        fail(finest, exact.error);
        continue;
      }
      for (std::size_t c = 0; c < contenders.size(); ++c) {
        const FlowMeasurement run =
            MeasureFlow(flow, contenders[c].setting, {end});
        if (!run.error.empty()) {
          fail(contenders[c].setting, run.error);
          ++columns[c].failed;
          continue;
        }
        columns[c].seconds.push_back(run.seconds);
        columns[c].errors.push_back(
            std::fabs(run.kinetic[0].total() / exact.kinetic[0].total() - 1.0));
        columns[c].sweeps.push_back(static_cast<double>(run.state.sweeps));
        columns[c].rejected.push_back(static_cast<double>(run.state.rejected));
        if (progress.Due()) {
          progress.Show(
              Format("strength %d of 2-4, start %d of %d, stepper "
                     "%zu of %zu",
                     number,
                     s + 1,
                     seeds,
                     c + 1,
                     contenders.size()));
        }
      }
    }
    progress.Clear();
    for (std::size_t c = 0; c < contenders.size(); ++c) {
      const StepperSetting& k = contenders[c].setting;
      const MeanDeviation e = MeanAndDeviation(columns[c].errors);
      const double median = MedianOf(columns[c].seconds);
      const double sweeps = MeanAndDeviation(columns[c].sweeps).mean;
      csv += Format("%d,%s,%s,%g,%g,%.6g,%.6g,%.6g,%.6g,%.6g,%d\n",
                    number,
                    contenders[c].family,
                    k.name.c_str(),
                    k.tolerance,
                    k.dt,
                    e.mean,
                    e.deviation,
                    sweeps,
                    median,
                    MeanAndDeviation(columns[c].rejected).mean,
                    columns[c].failed);
      rows.push_back({{"case", number},
                      {"stepper", k.name},
                      {"tolerance", k.tolerance},
                      {"dt", k.dt},
                      {"error", e.mean},
                      {"sweeps", sweeps},
                      {"seconds", median},
                      {"failed", columns[c].failed}});
      table.push_back({k.name,
                       Format("%g", k.tolerance),
                       Format("%g", k.dt),
                       Format("%.2e", e.mean),
                       Format("%.0f", sweeps),
                       Format("%.3g", 1e3 * median),
                       columns[c].failed == 0
                           ? ""
                           : Format("%d starts failed", columns[c].failed)});
    }
    std::printf("  strength %g, %g\n%s\n",
                strength.alpha1,
                strength.alpha2,
                Grid(table, 1, false).c_str());
    std::fflush(stdout);
  }
  PrintRatios(rows);
  for (const Json& run : failed) {
    std::printf("  failed: strength %d, seed %llu, %s at Dt = %g: %s\n",
                run.at("case").get<int>(),
                run.at("seed").get<unsigned long long>(),
                run.at("stepper").get<std::string>().c_str(),
                run.at("dt").get<double>(),
                run.at("error").get<std::string>().c_str());
  }
  output->Write("work_precision.csv", csv);
  output->Plot({"flow_work",
                output->Path("work_precision.csv"),
                output->Path("work_precision")},
               {"work_precision.svg", "work_precision.png"});
  Json json = StudyJson("work_precision");
  json["rows"] = rows;
  json["failed"] = failed;
  json["end"] = end;
  json["seeds"] = seeds;
  FinishStudy(json, output);
  return failed.empty() ? kConverged : kNotConverged;
}

}  // namespace granopt
