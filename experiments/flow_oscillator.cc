// `flow --study=oscillator`: the linearized oscillator (7.9)-(7.13).

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "experiments/flow.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

std::unique_ptr<Stepper> Verlet(double dt) {
  StepperOptions options;
  options.step = dt;
  return CreateVerletStepper(options);
}

// alpha (0.5, 0.25), mass 1: r* = 0.5.
RadialLaw Law() { return RadialLaw::Powers(0.5, 1.0, 0.25, 2.0); }

// (7.11)
double Omega() {
  const RadialLaw law = Law();
  const double d = EquilibriumDistance(law);
  return std::sqrt(2.0 * law.strength[1] * std::pow(d, -3.0) -
                   law.strength[0] * std::pow(d, -2.0));
}

// A grain about another one, which is pinned or not.
FlowCase Pair(bool pinned,
              double zeta,
              double offset,
              double amplitude,
              double frequency) {
  FlowSceneOptions options;
  options.grains.mass = {1.0, 1.0};
  options.grains.radius = {0.01, 0.01};
  if (pinned) options.grains.is_pinned = {1, 0};
  options.near_field = NearFieldOptions();
  options.near_field->law = Law();
  options.damping = 2.0 * zeta * Omega();
  if (amplitude != 0.0) {
    options.external = ExternalForce();
    options.external->amplitude[0] = amplitude;
    options.external->frequency = frequency;
  }
  FlowCase flow;
  const int stride = FlowStride(2);
  flow.state.x.assign(3 * stride, 0.0);
  flow.state.v = flow.state.x;
  flow.state.x[1] = EquilibriumDistance(Law()) + offset;
  std::string error;
  flow.scene = FlowScene::Create(options, &error);
  if (flow.scene == nullptr || !flow.scene->Begin(0.01, &flow.state, &error)) {
    BadInput(error);
  }
  return flow;
}

// Frequencies by the step.
std::string Frequencies(Json* ratios) {
  const double omega = Omega();
  std::string csv = "stepper,dt,pinned,ratio\n", error;
  std::vector<std::vector<std::string>> table = {
      {"Dt", "Verlet, pinned", "Verlet, free", "backward Euler, pinned"}};
  for (const double dt : {0.04, 0.02, 0.01, 0.005, 0.0025}) {
    double measured[3];
    for (int which = 0; which < 3; ++which) {
      FlowCase flow = Pair(which != 1, 0.0, -1e-6, 0.0, 0.0);
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
      ratios->push_back({{"stepper", which == 2 ? "implicit" : "verlet"},
                         {"dt", dt},
                         {"pinned", which != 1},
                         {"ratio", measured[which]}});
    }
    table.push_back({Format("%g", dt),
                     Format("%.7f", measured[0]),
                     Format("%.7f", measured[1]),
                     Format("%.7f", measured[2])});
  }
  std::fputs(Grid(table, 0, false, 0).c_str(), stdout);
  return csv;
}

// Free decay beside exp(-zeta omega t) cos(omega_d t).
std::string FreeDecay() {
  const double omega = Omega();
  std::string error;
  std::string decay = "zeta,time,measured,linear\n";
  for (const double zeta : {0.05, 0.2, 1.0, 2.0}) {
    const double q0 = 1e-4;
    FlowCase flow = Pair(true, zeta, q0, 0.0, 0.0);
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
  return decay;
}

// Forced response: projections on sin and cos of the last periods. `worst`: of
// the amplitudes for small forces, relative to (7.7).
std::string ForcedResponse(Json* resonance, double* worst) {
  const double omega = Omega();
  std::string error;
  *worst = 0.0;
  std::string response =
      "zeta,force,frequency,amplitude,phase,linear_amplitude,linear_phase\n";
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
        FlowCase flow = Pair(true, zeta, 0.0, f0, W * omega);
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
          *worst = std::max(*worst, std::fabs(amplitude / linear - 1.0));
          resonance->push_back({{"zeta", zeta},
                                {"frequency", W},
                                {"amplitude", amplitude},
                                {"linear_amplitude", linear}});
        }
      }
    }
  }
  return response;
}

}  // namespace

int Oscillator(Output* output) {
  Json json = StudyJson("oscillator");
  std::printf(
      "flow      the linearized oscillator (7.9)-(7.13): one grain about "
      "a pinned one, (0.5, 0.25), r* = 0.5, omega* = "
      "%.6g / s\n\n  measured frequency / omega* (free pairs: / sqrt 2 "
      "omega*)\n",
      Omega());
  Json ratios = Json::array(), resonance = Json::array();
  double worst;
  output->Write("frequencies.csv", Frequencies(&ratios));
  output->Write("decay.csv", FreeDecay());
  output->Write("response.csv", ForcedResponse(&resonance, &worst));
  std::printf(
      "\n  forced by f0 sin(Omega t): amplitudes for small f0 are those "
      "of (7.7) within %.1e;\n  at f0 / k = 0.02, 4 %% of r*, the well "
      "is seen to be softer outside (response.csv)\n",
      worst);
  json["ratios"] = ratios;
  json["omega"] = Omega();
  json["resonance"] = resonance;
  json["worst_amplitude_error"] = worst;
  output->Plot({"flow_oscillator",
                output->Path("decay.csv"),
                output->Path("response.csv"),
                output->Path("oscillator")},
               {"oscillator.svg", "oscillator.png"});
  FinishStudy(json, output);
  return kConverged;
}

}  // namespace granopt
