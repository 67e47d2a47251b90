// The studies of the experiment `flow`.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "experiments/flow.h"
#include "experiments/statistics.h"
#include "solvers/registry.h"
#include "solvers/threads.h"

DECLARE_int32(seeds);
DECLARE_int32(threads);

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

Json StudyJson(const std::string& name) {
  return {{"study", name}, {"schema", "granopt/flow_study/1"}};
}

void Finish(Json json, Output* output) {
  json["provenance"] = Provenance();
  json["provenance"]["threads"] = FLAGS_threads;
  output->WriteJson("summary.json", json);
  output->PrintFiles();
}

// ---------------------------------------------------------- work, precision

// A stepper at one step, and what it is listed under.
struct Contender {
  const char* family;
  StepperSetting setting;
};

std::unique_ptr<Stepper> Verlet(double dt) {
  std::string error;
  return MakeStepper({"verlet", 1e-8, dt}, &error);
}

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
    std::printf(
        "  strength %g, %g\n    stepper         TOL     Dt       "
        "error     sweeps   CPU ms\n",
        strength.alpha1,
        strength.alpha2);
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
      std::printf(
          "    %-14s  %-6g  %-7g  %.2e  %-8.0f %.3g%s\n",
          k.name.c_str(),
          k.tolerance,
          k.dt,
          e.mean,
          sweeps,
          1e3 * median,
          columns[c].failed == 0
              ? ""
              : Format("  (%d starts failed)", columns[c].failed).c_str());
    }
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
  Finish(json, output);
  return failed.empty() ? kConverged : kNotConverged;
}

// ---------------------------------------------------------- remark 8

// One step of length Dt, from the start (and, of half of the cases, from a
// later state), by the fixed point and by minimization: does it converge, and
// in how many evaluations of forces?
int Remark8(Output* output) {
  const int seeds = FLAGS_smoke && !IsGiven("seeds") ? 2 : FLAGS_seeds;
  struct Method {
    const char* name;
    double relaxation;
  };
  const Method methods[] = {{"jacobi", 1.0},
                            {"jacobi, gamma = 0.5", 0.5},
                            {"gauss_seidel", 1.0},
                            {"lbfgs", 1.0},
                            {"ncg", 1.0},
                            {"newton", 1.0}};
  std::string csv =
      "dt,method,solved,attempts,evaluations,indefinite,cpu_seconds\n";
  Json rows = Json::array();
  std::printf(
      "flow      remark 8: can gradients solve the implicit step? Strength "
      "(0.5, 0.25), 100 grains, %d states each\n\n"
      "    Dt       tangents not    steps solved, median sweeps of those\n"
      "    / s      pos. definite ",
      2 * seeds);
  for (const Method& method : methods) std::printf(" %-20s", method.name);
  std::printf("\n");
  Progress progress;
  // Starts, and states at t = 0.5 s.
  Json failed = Json::array();
  std::vector<FlowCase> cases;
  for (int s = 0; s < 2 * seeds; ++s) {
    cases.push_back(MakePaperCase(kPaperStrengths[3],
                                  FLAGS_seed + s / 2,
                                  Domain::Kind::REENTRY,
                                  false,
                                  100));
    if (s % 2 == 0) continue;
    FlowMeasurement run = MeasureFlow(
        cases.back(), {"verlet", 1e-8, 0.001}, {FLAGS_smoke ? 0.05 : 0.5});
    if (!run.error.empty()) {
      std::printf("  failed: seed %llu: %s\n",
                  static_cast<unsigned long long>(FLAGS_seed + s / 2),
                  run.error.c_str());
      failed.push_back({{"seed", FLAGS_seed + s / 2}, {"error", run.error}});
      cases.pop_back();
      continue;
    }
    cases.back().state = std::move(run.state);
  }
  std::map<std::string, double> cost;  // CPU seconds of a step of 0.01 s
  for (const double dt : {0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2}) {
    std::map<std::string, std::vector<double>> sweeps, seconds;
    int indefinite = 0;
    for (const FlowCase& start : cases) {
      indefinite += !HasConvexStep(*start.scene, start.state, dt);
      for (const Method& method : methods) {
        StepperOptions options;
        options.step = options.first_step = dt;
        options.is_adaptive = false;
        options.tolerance = 1e-8;
        options.desired_iterations = 500;
        options.relaxation = method.relaxation;
        const std::string name = method.name;
        if (name == "gauss_seidel") {
          options.sweep = StepperOptions::Sweep::GAUSS_SEIDEL;
        }
        std::string error;
        const bool is_minimizer =
            name == "lbfgs" || name == "newton" || name == "ncg";
        const auto stepper =
            is_minimizer
                ? CreateMinimizingStepper(options, CreateSolver(name, &error))
                : CreateImplicitStepper(options);
        FlowState state = start.state;
        const std::int64_t before = state.sweeps;
        state.step = dt;
        StepReport report;
        const double cpu = CpuSeconds();
        if (stepper->Step(*start.scene, dt, &state, &report, &error)) {
          seconds[name].push_back(CpuSeconds() - cpu);
          sweeps[name].push_back(static_cast<double>(state.sweeps - before));
        }
        if (progress.Due()) {
          progress.Show(Format("Dt = %g, %s", dt, method.name));
        }
      }
    }
    progress.Clear();
    std::printf("    %-7g  %2d of %-2zu      ", dt, indefinite, cases.size());
    for (const Method& method : methods) {
      const std::vector<double>& s = sweeps[method.name];
      const double median = s.empty() ? 0.0 : MedianOf(s);
      const double cpu = s.empty() ? 0.0 : MedianOf(seconds[method.name]);
      if (dt == 0.01) cost[method.name] = cpu;
      csv += Format("%g,\"%s\",%zu,%zu,%g,%d,%.4g\n",
                    dt,
                    method.name,
                    s.size(),
                    cases.size(),
                    median,
                    indefinite,
                    cpu);
      rows.push_back({{"dt", dt},
                      {"method", method.name},
                      {"solved", s.size()},
                      {"attempts", cases.size()},
                      {"median_sweeps", median},
                      {"median_cpu_seconds", cpu},
                      {"indefinite_tangents", indefinite}});
      const std::string cell =
          s.empty() ? "0" : Format("%zu, %g", s.size(), median);
      std::printf(" %-20s", cell.c_str());
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  std::printf(
      "\n  CPU time of a step of 0.01 s over that of jacobi (%.3g ms): lbfgs "
      "%.2g, ncg %.2g, newton %.2g\n",
      1e3 * cost["jacobi"],
      cost["lbfgs"] / cost["jacobi"],
      cost["ncg"] / cost["jacobi"],
      cost["newton"] / cost["jacobi"]);
  output->Write("remark8.csv", csv);
  output->Plot(
      {"flow_remark8", output->Path("remark8.csv"), output->Path("remark8")},
      {"remark8.svg", "remark8.png"});
  Json json = StudyJson("remark8");
  json["rows"] = rows;
  json["failed"] = failed;
  Finish(json, output);
  return failed.empty() ? kConverged : kNotConverged;
}

// ---------------------------------------------------------- oscillator

// A grain about a pinned one, alpha (0.5, 0.25), mass 1: r* = 0.5.
FlowCase Pair(bool pinned,
              double zeta,
              double offset,
              double amplitude,
              double frequency,
              double* omega) {
  const double alpha1 = 0.5, alpha2 = 0.25;
  FlowSceneOptions options;
  options.grains.mass = {1.0, 1.0};
  options.grains.radius = {0.01, 0.01};
  if (pinned) options.grains.is_pinned = {1, 0};
  options.near_field = NearFieldOptions();
  options.near_field->law = RadialLaw::Powers(alpha1, 1.0, alpha2, 2.0);
  const double d = EquilibriumDistance(options.near_field->law);
  // (7.11)
  *omega =
      std::sqrt(2.0 * alpha2 * std::pow(d, -3.0) - alpha1 * std::pow(d, -2.0));
  options.damping = 2.0 * zeta * *omega;
  if (amplitude != 0.0) {
    options.external = ExternalForce();
    options.external->amplitude[0] = amplitude;
    options.external->frequency = frequency;
  }
  FlowCase flow;
  const int stride = FlowStride(2);
  flow.state.x.assign(3 * stride, 0.0);
  flow.state.v = flow.state.x;
  flow.state.x[1] = d + offset;
  std::string error;
  flow.scene = FlowScene::Create(options, &error);
  if (flow.scene == nullptr || !flow.scene->Begin(0.01, &flow.state, &error)) {
    BadInput(error);
  }
  return flow;
}

int Oscillator(Output* output) {
  double omega;
  std::string error;
  // Frequencies by the step.
  std::string csv = "stepper,dt,pinned,ratio\n";
  Json json = StudyJson("oscillator");
  Json ratios = Json::array();
  std::printf(
      "flow      the linearized oscillator (7.9)-(7.13): one grain about "
      "a pinned one, (0.5, 0.25), r* = 0.5, omega* = ");
  Pair(true, 0.0, 0.0, 0.0, 0.0, &omega);
  std::printf(
      "%.6g / s\n\n    measured frequency / omega* (free pairs: / sqrt 2 "
      "omega*)\n    Dt       Verlet, pinned  Verlet, free   backward "
      "Euler, pinned\n",
      omega);
  for (const double dt : {0.04, 0.02, 0.01, 0.005, 0.0025}) {
    double measured[3];
    for (int which = 0; which < 3; ++which) {
      FlowCase flow = Pair(which != 1, 0.0, -1e-6, 0.0, 0.0, &omega);
      StepperOptions options;
      options.step = options.first_step = dt;
      options.tolerance = 1e-13;
      options.desired_iterations = 100;
      options.is_adaptive = false;
      const auto stepper =
          which == 2 ? CreateImplicitStepper(options) : Verlet(dt);
      std::vector<double> passages;
      double last = -1e-6, t = 0.0;
      RunFlow(
          *flow.scene,
          12.0 * 2.0 * kPi / omega,
          stepper.get(),
          [&](const FlowState& state, const StepReport&) {
            const double now = state.x[1] - state.x[0] - 0.5;
            if (last < 0.0 && now >= 0.0) {
              passages.push_back(t + (state.time - t) * last / (last - now));
            }
            last = now;
            t = state.time;
            return true;
          },
          &flow.state,
          &error);
      const double period =
          passages.size() > 1
              ? (passages.back() - passages.front()) / (passages.size() - 1)
              : NAN;
      measured[which] =
          2.0 * kPi / period / (omega * (which == 1 ? std::sqrt(2.0) : 1.0));
      csv += Format("%s,%g,%d,%.12g\n",
                    which == 2 ? "implicit" : "verlet",
                    dt,
                    which != 1,
                    measured[which]);
      ratios.push_back({{"stepper", which == 2 ? "implicit" : "verlet"},
                        {"dt", dt},
                        {"pinned", which != 1},
                        {"ratio", measured[which]}});
    }
    std::printf("    %-7g  %.7f       %.7f      %.7f\n",
                dt,
                measured[0],
                measured[1],
                measured[2]);
  }
  // Free decay beside exp(-zeta omega t) cos(omega_d t).
  std::string decay = "zeta,time,measured,linear\n";
  for (const double zeta : {0.05, 0.2, 1.0, 2.0}) {
    const double q0 = 1e-4;
    FlowCase flow = Pair(true, zeta, q0, 0.0, 0.0, &omega);
    const auto stepper = Verlet(0.002);
    RunFlow(
        *flow.scene,
        4.0 * 2.0 * kPi / omega,
        stepper.get(),
        [&](const FlowState& s, const StepReport&) {
          if (s.steps % 10 != 0) return true;
          const double t = s.time;
          double linear;
          if (zeta < 1.0) {
            const double wd = omega * std::sqrt(1.0 - zeta * zeta);
            linear = std::exp(-zeta * omega * t) *
                     (std::cos(wd * t) + zeta * omega / wd * std::sin(wd * t));
          } else if (zeta == 1.0) {
            linear = std::exp(-omega * t) * (1.0 + omega * t);
          } else {
            const double root = std::sqrt(zeta * zeta - 1.0);
            const double a = omega * (-zeta + root), b = omega * (-zeta - root);
            linear = (a * std::exp(b * t) - b * std::exp(a * t)) / (a - b);
          }
          decay += Format("%g,%.9g,%.9g,%.9g\n",
                          zeta,
                          t * omega / (2.0 * kPi),
                          (s.x[1] - s.x[0] - 0.5) / q0,
                          linear);
          return true;
        },
        &flow.state,
        &error);
  }
  // Forced response: projections on sin and cos of the last periods.
  std::string response =
      "zeta,force,frequency,amplitude,phase,linear_amplitude,linear_phase\n";
  Json resonance = Json::array();
  double worst = 0.0;
  std::vector<double> frequencies;
  for (int k = 4; k <= 50; ++k) {
    // Twice as many next to the resonance.
    const bool is_wanted = k % 2 == 0 || (k >= 16 && k <= 26);
    if (FLAGS_smoke ? k % 10 == 0 : is_wanted) frequencies.push_back(0.05 * k);
  }
  for (const double zeta : {0.05, 0.1, 0.3}) {
    for (const double static_way : {1e-6, 0.02}) {
      for (const double W : frequencies) {
        const double f0 = static_way * omega * omega;
        FlowCase flow = Pair(true, zeta, 0.0, f0, W * omega, &omega);
        const double period = 2.0 * kPi / (W * omega);
        const double dt = period / 400.0;
        const auto stepper = Verlet(dt);
        // Until what is left of the start is below 1e-4.
        const int wait =
            static_cast<int>(std::ceil(9.2 / (zeta * omega) / period));
        double sine = 0.0, cosine = 0.0;
        int count = 0;
        RunFlow(
            *flow.scene,
            (wait + 4) * period,
            stepper.get(),
            [&](const FlowState& s, const StepReport&) {
              if (s.time > wait * period + 0.25 * dt && count < 1600) {
                const double q = s.x[1] - s.x[0] - 0.5;
                sine += q * std::sin(W * omega * s.time);
                cosine += q * std::cos(W * omega * s.time);
                ++count;
              }
              return true;
            },
            &flow.state,
            &error);
        sine *= 2.0 / count;
        cosine *= 2.0 / count;
        const double amplitude =
            std::sqrt(sine * sine + cosine * cosine) / static_way;
        const double phase = std::atan2(-cosine, sine);
        // (7.7), (7.8)
        const double linear = 1.0 / std::sqrt(std::pow(1.0 - W * W, 2) +
                                              std::pow(2.0 * zeta * W, 2));
        const double linear_phase = std::atan2(2.0 * zeta * W, 1.0 - W * W);
        response += Format("%g,%g,%g,%.9g,%.9g,%.9g,%.9g\n",
                           zeta,
                           static_way,
                           W,
                           amplitude,
                           phase,
                           linear,
                           linear_phase);
        if (static_way == 1e-6) {
          worst = std::max(worst, std::fabs(amplitude / linear - 1.0));
          resonance.push_back({{"zeta", zeta},
                               {"frequency", W},
                               {"amplitude", amplitude},
                               {"linear_amplitude", linear}});
        }
      }
    }
  }
  std::printf(
      "\n  forced by f0 sin(Omega t): amplitudes for small f0 are those "
      "of (7.7) within %.1e;\n  at f0 / k = 0.02, 4 %% of r*, the well "
      "is seen to be softer outside (response.csv)\n",
      worst);
  json["ratios"] = ratios;
  json["omega"] = omega;
  json["resonance"] = resonance;
  json["worst_amplitude_error"] = worst;
  output->Write("frequencies.csv", csv);
  output->Write("decay.csv", decay);
  output->Write("response.csv", response);
  output->Plot({"flow_oscillator",
                output->Path("decay.csv"),
                output->Path("response.csv"),
                output->Path("oscillator")},
               {"oscillator.svg", "oscillator.png"});
  Finish(json, output);
  return kConverged;
}

// ---------------------------------------------------------- throughput

// What one writes first: each pair once, the force on both.
void PlainForces(int n,
                 int stride,
                 const double* x,
                 const double* w,
                 double alpha1,
                 double alpha2,
                 double* force) {
  std::fill(force, force + 3 * static_cast<std::size_t>(stride), 0.0);
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j) {
      double d[3], square = 0.0;
      for (int k = 0; k < 3; ++k) {
        d[k] = x[k * stride + j] - x[k * stride + i];
        square += d[k] * d[k];
      }
      const double r = std::sqrt(square);
      const double f = w[i] * w[j] * (alpha1 / r - alpha2 / square) / r;
      for (int k = 0; k < 3; ++k) {
        force[k * stride + i] += f * d[k];
        force[k * stride + j] -= f * d[k];
      }
    }
  }
}

int Throughput(Output* output) {
  std::string csv = "particles,what,seconds,ns_per_ordered_pair,error\n";
  Json rows = Json::array();
  std::printf(
      "flow      throughput of the near field (exponents 1, 2), CPU seconds of "
      "one evaluation;\n          multipoles with errors below 1e-2, 1e-3 and "
      "1e-4 of the magnitudes of pair forces\n\n"
      "    n        plain loop   all pairs    multipoles 1e-2, 1e-3, 1e-4      "
      "  "
      "     ns a pair  plain/all  a step of Verlet\n"
      "                                                                        "
      "    (ordered)             with contacts\n");
  std::vector<int> sizes = {100, 316, 1000, 3162, 10000};
  if (!FLAGS_smoke) {
    sizes.push_back(31623);
    sizes.push_back(100000);
  }
  for (const int n : sizes) {
    FlowCase flow = MakePaperCase(
        kPaperStrengths[2], FLAGS_seed, Domain::Kind::REENTRY, false, n);
    const FlowScene& scene = *flow.scene;
    const int stride = scene.stride();
    std::vector<double> weights = scene.near_field()->weights();
    std::vector<double> force(3 * static_cast<std::size_t>(stride)),
        plain = force;
    const double pairs = 1.0 * n * (n - 1);
    // About 2e8 pairs each, alternating, medians of up to nine.
    const int repeats =
        std::clamp(static_cast<int>(2e8 / pairs), 1, FLAGS_smoke ? 3 : 9);
    const int inner = std::clamp(static_cast<int>(2e6 / pairs), 1, 1000);
    // Multipoles of three accuracies.
    constexpr double kAccuracies[] = {1e-2, 1e-3, 1e-4};
    std::unique_ptr<NearField> trees[3];
    for (int t = 0; t < 3 && n >= 10000; ++t) {
      NearFieldOptions options = scene.near_field()->options();
      options.tree_from = 1;
      options.tree_accuracy = kAccuracies[t];
      std::string error;
      trees[t] = NearField::Create(options, n, weights, 0.0, &error);
    }
    NearFieldOptions all_pairs = scene.near_field()->options();
    all_pairs.tree_from = 0;
    std::string fault;
    const auto direct = NearField::Create(all_pairs, n, weights, 0.0, &fault);
    std::vector<double> tree_error(3, 0.0);
    std::vector<double> times[6];
    const auto stepper = Verlet(1e-3);
    const bool with_plain = n <= 31623;
    for (int r = 0; r < repeats; ++r) {
      double cpu = CpuSeconds();
      if (with_plain) {
        for (int k = 0; k < inner; ++k) {
          PlainForces(n,
                      stride,
                      flow.state.x.data(),
                      weights.data(),
                      0.25,
                      0.125,
                      plain.data());
        }
        times[0].push_back((CpuSeconds() - cpu) / inner);
      }
      cpu = CpuSeconds();
      for (int k = 0; k < inner; ++k) {
        direct->Forces(flow.state.x.data(), force.data(), nullptr);
      }
      times[1].push_back((CpuSeconds() - cpu) / inner);
      for (int t = 0; t < 3; ++t) {
        if (trees[t] == nullptr) continue;
        std::vector<double> other(force.size());
        cpu = CpuSeconds();
        trees[t]->Forces(flow.state.x.data(), other.data(), nullptr);
        times[3 + t].push_back(CpuSeconds() - cpu);
        double difference = 0.0, size = 0.0;
        for (std::size_t e = 0; e < force.size(); ++e) {
          difference += (other[e] - force[e]) * (other[e] - force[e]);
          size += force[e] * force[e];
        }
        tree_error[t] = std::sqrt(difference / size);
      }
    }
    {
      FlowState state = flow.state;
      std::string error;
      const int steps = std::clamp(static_cast<int>(1e8 / pairs), 1, 200);
      StepReport report;
      stepper->Step(scene, 1.0, &state, &report, &error);
      const double cpu = CpuSeconds();
      for (int k = 0; k < steps; ++k) {
        stepper->Step(scene, 1.0, &state, &report, &error);
      }
      times[2].push_back((CpuSeconds() - cpu) / steps);
    }
    double median[6] = {};
    const char* const names[] = {"plain",
                                 "vectorized",
                                 "verlet_step",
                                 "tree_1e-2",
                                 "tree_1e-3",
                                 "tree_1e-4"};
    for (int w = 0; w < 6; ++w) {
      if (times[w].empty()) continue;
      median[w] = MedianOf(times[w]);
      const double error = w < 3 ? 0.0 : tree_error[w - 3];
      csv += Format("%d,%s,%.6g,%.6g,%.3g\n",
                    n,
                    names[w],
                    median[w],
                    1e9 * median[w] / pairs,
                    error);
      rows.push_back({{"particles", n},
                      {"what", names[w]},
                      {"seconds", median[w]},
                      {"ns_per_ordered_pair", 1e9 * median[w] / pairs},
                      {"error", error}});
    }
    std::printf("    %-7d", n);
    for (const int w : {0, 1, 3, 4, 5}) {
      std::printf("  %-11s",
                  median[w] > 0.0 ? Format("%.3g", median[w]).c_str() : "-");
    }
    std::printf(
        " %-10.3g %-10s",
        1e9 * median[1] / pairs,
        median[0] > 0.0 ? Format("%.1f", median[0] / median[1]).c_str() : "-");
    std::printf("%.3g\n", median[2]);
    std::fflush(stdout);
  }
  // Other laws, all pairs of 1000 grains.
  {
    constexpr int kGrains = 1000;
    const struct {
      const char* name;
      RadialLaw law;
    } laws[] = {
        {"exponents 1, 2", RadialLaw::Powers(0.25, 1.0, 0.125, 2.0)},
        {"exponents 0.67, 1.59", RadialLaw::Powers(0.25, 0.67, 0.125, 1.59)},
        {"lennard_jones", RadialLaw::Mie(1.0, 0.2, 12.0, 6.0)},
        {"morse", RadialLaw::Morse(1.0, 5.0, 0.3)}};
    const FlowCase flow = MakePaperCase(
        kPaperStrengths[2], FLAGS_seed, Domain::Kind::REENTRY, false, kGrains);
    std::vector<double> force(flow.state.x.size());
    std::vector<double> times[4];
    std::unique_ptr<NearField> fields[4];
    for (int k = 0; k < 4; ++k) {
      std::string fault;
      fields[k] = NearField::Create({laws[k].law, 0, 1e-3},
                                    kGrains,
                                    flow.scene->near_field()->weights(),
                                    0.0,
                                    &fault);
    }
    for (int r = 0; r < (FLAGS_smoke ? 3 : 15); ++r) {
      for (int k = 0; k < 4; ++k) {
        const double cpu = CpuSeconds();
        for (int inner = 0; inner < 10; ++inner) {
          fields[k]->Forces(flow.state.x.data(), force.data(), nullptr);
        }
        times[k].push_back((CpuSeconds() - cpu) / 10);
      }
    }
    std::printf("\n  ns an ordered pair, all pairs of %d grains:", kGrains);
    for (int k = 0; k < 4; ++k) {
      const double seconds = MedianOf(times[k]);
      const double each = 1e9 * seconds / kGrains / (kGrains - 1.0);
      std::printf("%s %s %.3g", k == 0 ? "" : ";", laws[k].name, each);
      rows.push_back({{"particles", kGrains},
                      {"what", laws[k].name},
                      {"seconds", seconds},
                      {"ns_per_ordered_pair", each},
                      {"error", 0.0}});
    }
    std::printf("\n");
  }
  output->Write("throughput.csv", csv);
  output->Plot({"flow_throughput",
                output->Path("throughput.csv"),
                output->Path("throughput")},
               {"throughput.svg", "throughput.png"});
  Json json = StudyJson("throughput");
  json["rows"] = rows;
  Finish(json, output);
  return kConverged;
}

struct Study {
  const char* name;
  std::vector<std::string> files;
  std::vector<std::string> flags;
  int (*run)(Output*);
};

const std::vector<Study>& Studies() {
  static const std::vector<Study> studies = {
      {"work_precision",
       {"work_precision.csv", "work_precision.svg", "work_precision.png"},
       {"seeds"},
       WorkPrecision},
      {"remark8",
       {"remark8.csv", "remark8.svg", "remark8.png"},
       {"seeds"},
       Remark8},
      {"oscillator",
       {"frequencies.csv",
        "decay.csv",
        "response.csv",
        "oscillator.svg",
        "oscillator.png"},
       {},
       Oscillator},
      {"throughput",
       {"throughput.csv", "throughput.svg", "throughput.png"},
       {},
       Throughput}};
  return studies;
}

}  // namespace

bool IsStudy(const std::string& name) {
  return std::any_of(Studies().begin(),
                     Studies().end(),
                     [&](const Study& study) { return study.name == name; });
}

std::vector<std::string> StudyFiles(const std::string& name) {
  for (const Study& study : Studies()) {
    if (study.name == name) return study.files;
  }
  return {};
}

std::vector<std::string> StudyFlags(const std::string& name) {
  for (const Study& study : Studies()) {
    if (study.name == name) return study.flags;
  }
  return {};
}

int RunStudy(const std::string& name, Output* output) {
  for (const Study& study : Studies()) {
    if (study.name == name) return study.run(output);
  }
  return kBadInput;
}

}  // namespace granopt
