#include "experiments/extreme_flows.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "experiments/flow_work.h"
#include "experiments/run.h"
#include "granular/flow/start.h"
#include "solvers/format.h"

namespace granopt {
namespace {

struct Setup {
  FlowSceneOptions options;
  FlowStart start;
  StepperSetting stepping;
  double duration = 0.2;
  // Applied to the start.
  std::function<void(const Grains&, FlowState*)> change;
};

struct Entry {
  ExtremeScene scene;
  std::function<void(Setup*)> build;
};

void SetStrengths(double factor, Setup* s) {
  s->options.near_field = NearFieldOptions();
  s->options.near_field->law =
      RadialLaw::Powers(0.25 * factor, 1.0, 0.125 * factor, 2.0);
}

// The paper's grains, thirty of them, with its middle strengths.
void Usual(Setup* s) {
  s->start.particles = 30;
  s->start.length_ratio = 0.25;
  ImpactOptions impact;
  impact.friction = {0.2, 0.1};
  s->options.impact = impact;
  s->options.domain.kind = Domain::Kind::REENTRY;
  SetStrengths(1.0, s);
}

// Two grains on the x axis at a gap, in radii, at rest.
void Pair(double gap, Setup* s) {
  s->start.particles = 2;
  s->options.domain.kind = Domain::Kind::OPEN;
  s->change = [gap](const Grains& grains, FlowState* state) {
    std::fill(state->x.begin(), state->x.end(), 0.0);
    std::fill(state->v.begin(), state->v.end(), 0.0);
    state->x[1] = grains.radius[0] + grains.radius[1] + gap * grains.radius[0];
  };
}

std::vector<Entry> MakeEntries() {
  std::vector<Entry> entries;
  const auto add = [&entries](const std::string& group,
                              const std::string& name,
                              const std::string& what,
                              const std::function<void(Setup*)>& build,
                              bool smoke = false) {
    entries.push_back({{name, group, what, smoke, false}, [build](Setup* s) {
                         Usual(s);
                         build(s);
                       }});
  };
  for (const double factor : {1e-6, 1e-3, 1.0, 1e2, 1e4, 1e6}) {
    add(
        "strength",
        Format("strength_%g", factor),
        Format("strengths %g times (0.25, 0.125)", factor),
        [factor](Setup* s) { SetStrengths(factor, s); },
        factor == 1e-6 || factor == 1e4);
  }
  add("strength", "attraction_only", "no repulsion", [](Setup* s) {
    s->options.near_field->law = RadialLaw::Powers(0.5, 1.0, 0.0, 2.0);
  });
  add(
      "strength",
      "collapse",
      "no repulsion and no contacts: grains fall into each other",
      [](Setup* s) {
        s->options.impact.reset();
        s->options.near_field->law = RadialLaw::Powers(5.0, 2.0, 0.0, 3.0);
      },
      true);
  add("strength", "steep_repulsion", "beta2 = 8", [](Setup* s) {
    s->options.near_field->law = RadialLaw::Powers(0.25, 1.0, 1e-7, 8.0);
  });

  for (const double e : {0.0, 1.0, 1.5}) {
    add(
        "contacts",
        Format("restitution_%g", e),
        Format("e = %g", e),
        [e](Setup* s) { s->options.impact->restitution = e; },
        e == 1.5);
  }
  add("contacts", "mu_huge", "mu_s = mu_d = 1e6", [](Setup* s) {
    s->options.impact->friction = {1e6, 1e6};
  });
  add("contacts", "mu_zero", "no friction", [](Setup* s) {
    s->options.impact->friction = {0.0, 0.0};
  });
  add("contacts", "mu_reversed", "mu_d > mu_s", [](Setup* s) {
    s->options.impact->friction = {0.1, 0.2};
  });
  add("contacts", "no_contacts", "near field alone", [](Setup* s) {
    s->options.impact.reset();
  });

  for (const double gap : {1e-12, 1e-6, 1e-3}) {
    add(
        "gaps",
        Format("gap_%g", gap),
        Format("two grains at rest at a gap of %g radii", gap),
        [gap](Setup* s) { Pair(gap, s); },
        gap == 1e-12);
  }
  add(
      "gaps",
      "coincident",
      "two grains at one place",
      [](Setup* s) {
        Pair(0.0, s);
        s->change = [](const Grains&, FlowState* state) {
          std::fill(state->x.begin(), state->x.end(), 0.0);
        };
      },
      true);
  add("gaps",
      "overlapping",
      "two grains that overlap by half a radius",
      [](Setup* s) { Pair(-0.5, s); });

  for (const double dt : {1e-9, 1e-6, 1e-1, 1.0}) {
    add(
        "time step",
        Format("dt_%g", dt),
        Format("Dt = %g s", dt),
        [dt](Setup* s) {
          s->stepping.dt = dt;
          s->stepping.first_step = std::min(1e-3, dt);
          // A thousand steps, not more.
          s->duration = std::min(1.0, 1000.0 * dt);
        },
        dt == 1.0);
  }
  add("time step", "tolerance_1e-14", "TOL at roundoff", [](Setup* s) {
    s->stepping.tolerance = 1e-14;
  });

  for (const double speed : {0.0, 1e3, 1e6}) {
    add(
        "speed",
        Format("speed_%g", speed),
        Format("velocities of %g m/s", speed),
        [speed](Setup* s) {
          for (int k = 0; k < 3; ++k) {
            s->start.mean[k] = 0.0;
            s->start.perturbation[k] = speed;
          }
        },
        speed == 1e6);
  }

  for (const int n : {1, 2, 3, 1000}) {
    add(
        "number of grains",
        Format("grains_%d", n),
        Format("%d grain%s", n, n == 1 ? "" : "s"),
        [n](Setup* s) { s->start.particles = n; },
        n == 1);
  }
  add("number of grains",
      "too_dense",
      "L = 0.5: no place for all of them",
      [](Setup* s) {
        s->start.particles = 100;
        s->start.length_ratio = 0.5;
      });
  add("number of grains", "periodic", "nearest images", [](Setup* s) {
    s->options.domain.kind = Domain::Kind::NEAREST_IMAGE;
  });
  return entries;
}

const std::vector<Entry>& Entries() {
  static const std::vector<Entry>* const entries =
      new std::vector<Entry>(MakeEntries());
  return *entries;
}

// What a stepper of FlowSteppers() is to MakeStepper().
const char* SettingName(const std::string& stepper) {
  return stepper == "implicit" ? "jacobi"
         : stepper == "verlet" ? "verlet"
                               : "lbfgs";
}

}  // namespace

const std::vector<ExtremeScene>& ExtremeFlows() {
  static const std::vector<ExtremeScene>* const scenes = [] {
    auto* all = new std::vector<ExtremeScene>;
    for (const Entry& entry : Entries()) all->push_back(entry.scene);
    return all;
  }();
  return *scenes;
}

const std::vector<std::string>& FlowSteppers() {
  static const std::vector<std::string>* const names =
      new std::vector<std::string>{"implicit", "verlet", "minimize"};
  return *names;
}

bool RunExtremeFlow(const std::string& name,
                    const std::string& stepper_name,
                    double max_seconds,
                    FlowRun* run,
                    std::string* error) {
  *run = FlowRun();
  const auto found =
      std::find_if(Entries().begin(), Entries().end(), [&](const Entry& e) {
        return e.scene.name == name;
      });
  if (found == Entries().end()) {
    *error = "unknown flow '" + name + "' (--flow --list names them)";
    return false;
  }
  Setup setup;
  found->build(&setup);
  const std::vector<std::string>& known = FlowSteppers();
  if (std::find(known.begin(), known.end(), stepper_name) == known.end()) {
    *error =
        "unknown stepper '" + stepper_name + "' (implicit, verlet, minimize)";
    return false;
  }
  setup.stepping.name = SettingName(stepper_name);
  const std::unique_ptr<Stepper> stepper = MakeStepper(setup.stepping, error);
  if (stepper == nullptr) return false;
  const auto refuse = [run](const std::string& line) {
    run->refused = true;
    run->message = line;
    return true;
  };
  FlowState state;
  std::string line;
  setup.start.period = setup.options.domain.period();
  if (!MakeStart(setup.start, &setup.options.grains, &state, &line)) {
    return refuse(line);
  }
  if (setup.change) setup.change(setup.options.grains, &state);
  const auto scene = FlowScene::Create(setup.options, &line);
  if (scene == nullptr || !scene->Begin(stepper->FirstStep(), &state, &line)) {
    return refuse(line);
  }
  const double begin = CpuSeconds();
  // Work of both signs adds up to far less than what roundoff is relative to.
  double largest = 0.0;
  const bool good = RunFlow(
      *scene,
      setup.duration,
      stepper.get(),
      [&](const FlowState& now, const StepReport&) {
        largest = std::max(largest, scene->Kinetic(now.v.data()).total());
        return CpuSeconds() - begin < max_seconds;
      },
      &state,
      &line);
  run->seconds = CpuSeconds() - begin;
  run->sweeps = state.sweeps;
  run->finished = good && state.time >= setup.duration * (1.0 - 1e-9);
  run->finite = true;
  for (const double x : state.x) run->finite = run->finite && std::isfinite(x);
  for (const double v : state.v) run->finite = run->finite && std::isfinite(v);
  if (!good) return refuse(line);
  if (!run->finite) {
    run->message = "not finite";
    return true;
  }
  const KineticEnergy kinetic = scene->Kinetic(state.v.data());
  const double potential = scene->Potential(state.x.data());
  const EnergyLedger& e = state.energy;
  const double turned_over =
      state.kinetic_start + largest + std::abs(e.near_field) +
      std::abs(e.impact) + std::abs(e.friction) + std::abs(e.boundary) +
      std::abs(potential - state.potential_start) + 1e-300;
  run->closure = std::abs(scene->Closure(state, kinetic.total())) / turned_over;
  run->numerical = std::abs(scene->Numerical(state, potential)) / turned_over;
  double p[3], size = 0.0, drift = 0.0;
  scene->Momentum(state.v.data(), p);
  const int n = scene->size(), stride = scene->stride();
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < n; ++i) {
      size += scene->grains().mass[i] * std::abs(state.v[k * stride + i]);
    }
    drift = std::max(drift, std::abs(p[k] - state.momentum_start[k]));
  }
  run->momentum = drift / (size + 1e-300);
  run->message = Format(
      "%s t = %.3g s after %lld sweeps; energy closes to %.0e, the integrator "
      "made %.1e of what was turned over, momentum drifts by %.0e",
      run->finished ? "reached" : "out of time at",
      state.time,
      static_cast<long long>(state.sweeps),
      run->closure,
      run->numerical,
      run->momentum);
  return true;
}

}  // namespace granopt
