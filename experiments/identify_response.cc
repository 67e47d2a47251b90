#include "experiments/identify_response.h"

#include <cmath>
#include <cstdio>
#include <memory>
#include <utility>

#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt::identify {
namespace {

constexpr int kGrid = 101;  // times of curves that are written

}  // namespace

Response RunResponse(const Task& task,
                     const std::vector<double>& string,
                     int starts,
                     Stream stream) {
  Response response;
  for (int t = 0; t < kGrid; ++t) {
    response.time.push_back(FLAGS_duration * t / (kGrid - 1));
  }
  const EnsembleRule rule = Fixed(starts, stream);
  std::vector<EnergyCurve> curves(starts);
  std::vector<char> done(starts, 0);
  Spread(
      starts,
      [&](int s) {
        FlowCase flow;
        std::unique_ptr<Stepper> stepper;
        EnergyCurve raw;
        std::string error;
        if (!Compose(task,
                     string,
                     StartSeed(run_seed, rule, 0, s),
                     &flow,
                     &stepper,
                     &error) ||
            !RunCurve(&flow, stepper.get(), FLAGS_duration, &raw, &error)) {
          return;
        }
        for (const double t : response.time) {
          curves[s].time.push_back(t);
          curves[s].total.push_back(Interpolate(raw.time, raw.total, t));
          curves[s].bulk.push_back(Interpolate(raw.time, raw.bulk, t));
          curves[s].relative.push_back(Interpolate(raw.time, raw.relative, t));
        }
        done[s] = 1;
      },
      [](int) {});
  for (int s = 0; s < starts; ++s) {
    if (done[s]) {
      response.curves.push_back(std::move(curves[s]));
    } else {
      ++response.failed;
    }
  }
  return response;
}

EnergyCurve MeanCurve(const Response& response) {
  EnergyCurve mean;
  mean.time = response.time;
  for (std::size_t t = 0; t < response.time.size(); ++t) {
    double sums[3] = {};
    for (const EnergyCurve& c : response.curves) {
      sums[0] += c.total[t];
      sums[1] += c.bulk[t];
      sums[2] += c.relative[t];
    }
    const double n = static_cast<double>(response.curves.size());
    mean.total.push_back(sums[0] / n);
    mean.bulk.push_back(sums[1] / n);
    mean.relative.push_back(sums[2] / n);
  }
  return mean;
}

Json ReportErrors(const Task& task, const Response& response) {
  if (!HasErrors(task.target, task.weights) || response.curves.empty()) {
    return Json();
  }
  const struct {
    const char* name;
    double weight;
    double Misfit::*errors;
  } parts[] = {{"T", task.weights.total, &Misfit::total_errors},
               {"T_b", task.weights.bulk, &Misfit::bulk_errors},
               {"T_r", task.weights.relative, &Misfit::relative_errors}};
  Json json = Json::object();
  std::string text;
  for (const auto& part : parts) {
    if (!(part.weight > 0.0)) continue;
    std::vector<double> values;
    for (const EnergyCurve& curve : response.curves) {
      const Misfit misfit =
          ComputeMisfit(curve, task.target, task.weights, FLAGS_duration);
      values.push_back(misfit.*part.errors);
    }
    const double mean = MeanAndDeviation(values).mean;
    json[part.name] = mean;
    text += Format("%s%s %.3g", text.empty() ? "" : ", ", part.name, mean);
  }
  std::printf(
      "  errors        mean distance from the target in its errors, over %zu "
      "starts:\n                %s (0.8: nothing but normal errors)\n",
      response.curves.size(),
      text.c_str());
  return json;
}

std::string ResponseCsv(const Response& response, const EnergyCurve& target) {
  std::string csv =
      "time,T,T_deviation,T_first,T_target,T_b,T_b_deviation,T_b_first,"
      "T_b_target,T_r,T_r_deviation,T_r_first,T_r_target\n";
  for (std::size_t t = 0; t < response.time.size(); ++t) {
    csv += Number(response.time[t]);
    for (const auto part :
         {&EnergyCurve::total, &EnergyCurve::bulk, &EnergyCurve::relative}) {
      std::vector<double> values;
      for (const EnergyCurve& c : response.curves) {
        values.push_back((c.*part)[t]);
      }
      const MeanDeviation m = MeanAndDeviation(values);
      csv += Format(",%.17g,%.17g,%.17g,%.17g",
                    m.mean,
                    m.deviation,
                    values.empty() ? NAN : values[0],
                    Interpolate(target.time, target.*part, response.time[t]));
    }
    csv += "\n";
  }
  return csv;
}

}  // namespace granopt::identify
