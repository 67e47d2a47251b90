// The studies of the experiment `flow`.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Cholesky"
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

// A stepper of a family at one step.
struct Contender {
  const char* family;
  const char* name;
  double tolerance;
  double dt;
};

std::unique_ptr<Stepper> Make(const Contender& c) {
  StepperOptions options;
  options.step = c.dt;
  options.first_step = std::min(options.first_step, c.dt);
  options.tolerance = c.tolerance;
  const std::string name = c.name;
  if (name == "verlet") return CreateVerletStepper(options);
  if (name == "gauss_seidel") {
    options.sweep = StepperOptions::Sweep::GAUSS_SEIDEL;
  }
  if (name == "groups") options.sweep = StepperOptions::Sweep::GROUPS;
  if (name == "lbfgs" || name == "newton") {
    std::string error;
    return CreateMinimizingStepper(options, CreateSolver(name, &error));
  }
  return CreateImplicitStepper(options);
}

int WorkPrecision(Output* output) {
  const int seeds = FLAGS_smoke ? 1 : std::min(FLAGS_seeds, 10);
  const double end = FLAGS_smoke ? 0.05 : 0.3;
  const double fine = FLAGS_smoke ? 1e-4 : 1e-5;
  std::vector<Contender> contenders;
  for (const double dt : {0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002}) {
    contenders.push_back({"fixed point", "jacobi", 1e-4, dt});
    contenders.push_back({"fixed point", "jacobi", 1e-8, dt});
    contenders.push_back({"fixed point", "gauss_seidel", 1e-8, dt});
    contenders.push_back({"Verlet", "verlet", 1e-8, dt});
    if (dt >= 0.002) {
      contenders.push_back({"minimization", "lbfgs", 1e-8, dt});
      if (dt >= 0.005) {
        contenders.push_back({"minimization", "newton", 1e-8, dt});
      }
    }
  }
  std::string csv =
      "case,family,stepper,tolerance,dt,error,error_deviation,sweeps,seconds,"
      "rejected\n";
  Json rows = Json::array();
  Progress progress;
  std::printf(
      "flow      work and precision: |T(%g s) - T_exact| / T_exact, "
      "mean of %d starts; exact: Verlet at Dt = %g\n\n",
      end,
      seeds,
      fine);
  for (const int number : {2, 3, 4}) {
    const Strength strength = kPaperStrengths[number - 1];
    std::vector<double> exact;
    for (int s = 0; s < seeds; ++s) {
      FlowCase flow = MakePaperCase(
          strength, FLAGS_seed + s, Domain::Kind::REENTRY, false, 100);
      const auto stepper = Make({"", "verlet", 1e-8, fine});
      std::string error;
      flow.state.step = stepper->FirstStep();
      if (!RunFlow(
              *flow.scene, end, stepper.get(), nullptr, &flow.state, &error)) {
        BadInput(error);
      }
      exact.push_back(flow.scene->Kinetic(flow.state.v.data()).total());
    }
    std::printf(
        "  strength %g, %g\n    stepper         TOL     Dt       "
        "error     sweeps   CPU ms\n",
        strength.alpha1,
        strength.alpha2);
    std::vector<std::vector<double>> errors(contenders.size()),
        sweeps(contenders.size()), seconds(contenders.size()),
        rejected(contenders.size());
    // Interleaved: seeds outside, contenders inside.
    for (int s = 0; s < seeds; ++s) {
      for (std::size_t c = 0; c < contenders.size(); ++c) {
        FlowCase flow = MakePaperCase(
            strength, FLAGS_seed + s, Domain::Kind::REENTRY, false, 100);
        const auto stepper = Make(contenders[c]);
        flow.state.step = stepper->FirstStep();
        const double cpu = CpuSeconds();
        std::string error;
        if (!RunFlow(*flow.scene,
                     end,
                     stepper.get(),
                     nullptr,
                     &flow.state,
                     &error)) {
          BadInput(error);
        }
        seconds[c].push_back(CpuSeconds() - cpu);
        errors[c].push_back(std::fabs(
            flow.scene->Kinetic(flow.state.v.data()).total() / exact[s] - 1.0));
        sweeps[c].push_back(static_cast<double>(flow.state.sweeps));
        rejected[c].push_back(static_cast<double>(flow.state.rejected));
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
      const Contender& k = contenders[c];
      const MeanDeviation e = MeanAndDeviation(errors[c]);
      std::sort(seconds[c].begin(), seconds[c].end());
      const double median = seconds[c][seconds[c].size() / 2];
      const double mean_sweeps = MeanAndDeviation(sweeps[c]).mean;
      csv += Format("%d,%s,%s,%g,%g,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                    number,
                    k.family,
                    k.name,
                    k.tolerance,
                    k.dt,
                    e.mean,
                    e.deviation,
                    mean_sweeps,
                    median,
                    MeanAndDeviation(rejected[c]).mean);
      rows.push_back({{"case", number},
                      {"stepper", k.name},
                      {"tolerance", k.tolerance},
                      {"dt", k.dt},
                      {"error", e.mean},
                      {"sweeps", mean_sweeps},
                      {"seconds", median}});
      std::printf("    %-14s  %-6g  %-7g  %.2e  %-8.0f %.3g\n",
                  k.name,
                  k.tolerance,
                  k.dt,
                  e.mean,
                  mean_sweeps,
                  1e3 * median);
    }
  }
  output->Write("work_precision.csv", csv);
  output->Plot({"flow_work",
                output->Path("work_precision.csv"),
                output->Path("work_precision")},
               {"work_precision.svg", "work_precision.png"});
  Json json = StudyJson("work_precision");
  json["rows"] = rows;
  json["end"] = end;
  json["seeds"] = seeds;
  Finish(json, output);
  return kConverged;
}

// ---------------------------------------------------------- remark 8

// One step of length Dt, from the start (and, of half of the cases, from a
// later state), by the fixed point and by minimization: does it converge, and
// in how many evaluations of forces?
int Remark8(Output* output) {
  const int seeds = FLAGS_smoke ? 2 : std::min(FLAGS_seeds, 20);
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
  std::string csv = "dt,method,solved,attempts,evaluations,indefinite\n";
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
  std::vector<FlowCase> cases;
  for (int s = 0; s < 2 * seeds; ++s) {
    cases.push_back(MakePaperCase(kPaperStrengths[3],
                                  FLAGS_seed + s / 2,
                                  Domain::Kind::REENTRY,
                                  false,
                                  100));
    if (s % 2 == 0) continue;
    const auto stepper = Make({"", "verlet", 1e-8, 0.001});
    std::string error;
    RunFlow(*cases.back().scene,
            FLAGS_smoke ? 0.05 : 0.5,
            stepper.get(),
            nullptr,
            &cases.back().state,
            &error);
  }
  for (const double dt : {0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2}) {
    std::map<std::string, std::vector<double>> sweeps;
    int indefinite = 0;
    for (const FlowCase& start : cases) {
      // The tangent m / Dt^2 + V'' at r^L, dense: is it positive definite?
      const int n = start.scene->size(), stride = start.scene->stride();
      const double mass = start.scene->grains().mass[0];
      Eigen::MatrixXd tangent =
          Eigen::MatrixXd::Identity(3 * n, 3 * n) * (mass / (dt * dt));
      for (int i = 0; i < n; ++i) {
        for (int j = i + 1; j < n; ++j) {
          Eigen::Vector3d r;
          for (int k = 0; k < 3; ++k) {
            r[k] =
                start.state.x[k * stride + j] - start.state.x[k * stride + i];
          }
          const double d = r.norm();
          const RadialValues f =
              EvaluateLaw(start.scene->near_field()->law(), d);
          const Eigen::Matrix3d block =
              mass * mass *
              ((f.stiffness - f.force_over_distance) / (d * d) * r *
                   r.transpose() +
               f.force_over_distance * Eigen::Matrix3d::Identity());
          tangent.block<3, 3>(3 * i, 3 * i) += block;
          tangent.block<3, 3>(3 * j, 3 * j) += block;
          tangent.block<3, 3>(3 * i, 3 * j) -= block;
          tangent.block<3, 3>(3 * j, 3 * i) -= block;
        }
      }
      indefinite +=
          Eigen::LLT<Eigen::MatrixXd>(tangent).info() != Eigen::Success;
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
        if (stepper->Step(*start.scene, dt, &state, &report, &error)) {
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
      std::vector<double>& s = sweeps[method.name];
      std::sort(s.begin(), s.end());
      const double median = s.empty() ? 0.0 : s[s.size() / 2];
      csv += Format("%g,\"%s\",%zu,%zu,%g,%d\n",
                    dt,
                    method.name,
                    s.size(),
                    cases.size(),
                    median,
                    indefinite);
      rows.push_back({{"dt", dt},
                      {"method", method.name},
                      {"solved", s.size()},
                      {"attempts", cases.size()},
                      {"median_sweeps", median},
                      {"indefinite_tangents", indefinite}});
      const std::string cell =
          s.empty() ? "0" : Format("%zu, %g", s.size(), median);
      std::printf(" %-20s", cell.c_str());
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  output->Write("remark8.csv", csv);
  output->Plot(
      {"flow_remark8", output->Path("remark8.csv"), output->Path("remark8")},
      {"remark8.svg", "remark8.png"});
  Json json = StudyJson("remark8");
  json["rows"] = rows;
  Finish(json, output);
  return kConverged;
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
      const Contender c = {"", which == 2 ? "jacobi" : "verlet", 1e-13, dt};
      StepperOptions options;
      options.step = options.first_step = dt;
      options.tolerance = 1e-13;
      options.desired_iterations = 100;
      options.is_adaptive = false;
      const auto stepper =
          which == 2 ? CreateImplicitStepper(options) : Make(c);
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
    const auto stepper = Make({"", "verlet", 1e-8, 0.002});
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
        const auto stepper = Make({"", "verlet", 1e-8, dt});
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
    const auto stepper = Make({"", "verlet", 1e-8, 1e-3});
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
      std::sort(times[w].begin(), times[w].end());
      median[w] = times[w][times[w].size() / 2];
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
  int (*run)(Output*);
};

const std::vector<Study>& Studies() {
  static const std::vector<Study> studies = {
      {"work_precision",
       {"work_precision.csv", "work_precision.svg", "work_precision.png"},
       WorkPrecision},
      {"remark8", {"remark8.csv", "remark8.svg", "remark8.png"}, Remark8},
      {"oscillator",
       {"frequencies.csv",
        "decay.csv",
        "response.csv",
        "oscillator.svg",
        "oscillator.png"},
       Oscillator},
      {"throughput",
       {"throughput.csv", "throughput.svg", "throughput.png"},
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

int RunStudy(const std::string& name, Output* output) {
  for (const Study& study : Studies()) {
    if (study.name == name) return study.run(output);
  }
  return kBadInput;
}

}  // namespace granopt
