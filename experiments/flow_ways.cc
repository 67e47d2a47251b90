#include "experiments/flow_ways.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "experiments/cases.h"
#include "experiments/flow_scene.h"
#include "experiments/statistics.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

constexpr int kTimes = 10;

// A step of Verlet, in seconds of some machine: decisions are made by counts.
double StepCost(const FlowScene& scene) {
  const double n = scene.size();
  const bool has_field = scene.near_field() != nullptr;
  return (has_field ? 4e-10 * n * n : 0.0) + 1.3e-7 * n;
}

Way MakeWay(const std::string& family, double tolerance, double dt) {
  Way way;
  way.family = family;
  way.setting.name = family == "relaxed" ? "jacobi" : family;
  way.setting.tolerance = tolerance;
  way.setting.dt = way.setting.first_step = dt;
  if (family == "relaxed") {
    // Each iteration leaves three tenths of what was there.
    way.setting.relaxation = 0.7;
    way.setting.iterations = 30;
  }
  return way;
}

// Levels of Dt = `longest` / 2^k: all that the reference can judge.
void AddLadders(double longest, int finest, FlowTask* task) {
  const auto dt = [&](int level) { return std::ldexp(longest, -level); };
  task->fine = MakeWay("verlet", 1e-8, dt(finest - 1));
  task->finest = MakeWay("verlet", 1e-8, dt(finest));
  for (int k = 0; k <= finest - 3; ++k) {
    task->ways.push_back(MakeWay("verlet", 1e-8, dt(k)));
  }
  const struct {
    const char* family;
    double tolerance;
  } iterations[] = {{"jacobi", 1e-2},
                    {"jacobi", 1e-4},
                    {"jacobi", 1e-6},
                    {"jacobi", 1e-8},
                    {"gauss_seidel", 1e-4},
                    {"gauss_seidel", 1e-8},
                    {"groups", 1e-4},
                    {"groups", 1e-8},
                    {"relaxed", 1e-4},
                    {"relaxed", 1e-8},
                    {"lbfgs", 1e-4},
                    {"lbfgs", 1e-8}};
  for (const auto& each : iterations) {
    for (int k = 0; k <= std::min(7, finest - 4); ++k) {
      task->ways.push_back(MakeWay(each.family, each.tolerance, dt(k)));
    }
  }
}

// The scene of `way`'s forces.
std::unique_ptr<FlowScene> WithForces(const FlowScene& scene, double accuracy) {
  FlowSceneOptions options = scene.options();
  if (options.near_field && accuracy >= 0.0) {
    options.near_field->tree_from = accuracy > 0.0 ? 1 : 0;
    if (accuracy > 0.0) options.near_field->tree_accuracy = accuracy;
  }
  std::string error;
  std::unique_ptr<FlowScene> result = FlowScene::Create(options, &error);
  if (result == nullptr) BadInput(error);
  return result;
}

FlowCase WithoutContacts(FlowCase flow) {
  FlowSceneOptions options = flow.scene->options();
  options.impact.reset();
  std::string error;
  flow.scene = FlowScene::Create(options, &error);
  if (flow.scene == nullptr || !flow.scene->Begin(0.001, &flow.state, &error)) {
    BadInput(error);
  }
  return flow;
}

// Of relative motion in all motion; 0 at rest.
double RelativePart(const KineticEnergy& k) {
  return k.total() > 0.0 ? k.relative / k.total() : 0.0;
}

std::vector<double> Errors(const FlowScene& scene,
                           const FlowMeasurement& run,
                           const FlowMeasurement& exact) {
  double kinetic = 0.0, part = 0.0, square = 0.0, radius = 0.0;
  for (std::size_t t = 0; t < exact.kinetic.size(); ++t) {
    const KineticEnergy& a = run.kinetic[t];
    const KineticEnergy& b = exact.kinetic[t];
    if (b.total() > 0.0) {
      kinetic = std::max(kinetic, std::fabs(a.total() - b.total()) / b.total());
    }
    part = std::max(part, std::fabs(RelativePart(a) - RelativePart(b)));
  }
  const int n = scene.size(), stride = scene.stride();
  const double period = scene.options().domain.period();
  for (int i = 0; i < n; ++i) {
    radius += scene.grains().radius[i] / n;
    for (int k = 0; k < 3; ++k) {
      double d = run.state.x[k * stride + i] - exact.state.x[k * stride + i];
      if (period > 0.0) d -= period * std::nearbyint(d / period);
      square += d * d / n;
    }
  }
  return {kinetic, part, std::sqrt(square) / radius, run.drift};
}

}  // namespace

std::string LabelOf(const Way& way) {
  std::string label = way.family;
  if (way.field_accuracy == 0.0) label = "all pairs";
  if (way.field_accuracy > 0.0) {
    label = Format("multipoles %g", way.field_accuracy);
  }
  if (way.threads > 1) label += Format(", %d threads", way.threads);
  if (way.field_accuracy >= 0.0) return label;
  if (way.setting.name != "verlet") {
    label += Format(" %g", way.setting.tolerance);
  }
  return label + Format(" Dt %.4g", way.setting.dt);
}

std::string FlagsOf(const Way& way) {
  const StepperSetting& s = way.setting;
  std::string flags;
  if (s.name == "verlet") {
    flags = Format("--stepper=verlet --dt=%g", s.dt);
  } else if (StepperOptions::Sweep sweep; ParseSweep(s.name, &sweep)) {
    flags = Format(
        "--stepper=implicit --sweep=%s --tolerance=%g --dt=%g "
        "--first_dt=%g",
        s.name.c_str(),
        s.tolerance,
        s.dt,
        s.dt);
  } else {
    flags = Format("--stepper=minimize --solver=%s --tolerance=%g --dt=%g",
                   s.name.c_str(),
                   s.tolerance,
                   s.dt);
  }
  if (s.relaxation != 1.0) {
    flags +=
        Format(" --relaxation=%g --iterations=%d", s.relaxation, s.iterations);
  }
  if (way.field_accuracy == 0.0) flags += " --multipole_from=0";
  if (way.field_accuracy > 0.0) {
    flags +=
        Format(" --multipole_from=1 --field_accuracy=%g", way.field_accuracy);
  }
  if (way.threads > 1) flags += Format(" --threads=%d", way.threads);
  return flags;
}

const std::vector<std::string>& FlowTaskNames() {
  static const std::vector<std::string> names = {
      "smooth", "paper", "strong", "many", "user"};
  return names;
}

std::string DescribeFlowTask(const std::string& name) {
  if (name == "smooth") {
    return "100 grains, (0.25, 0.125), no contacts, no boundary, 0.4 s";
  }
  if (name == "paper") {
    return "100 grains, (0.25, 0.125), impacts, x -> -x, 0.4 s";
  }
  if (name == "strong") {
    return "100 grains, (0.5, 0.25), impacts, x -> -x, 1 s";
  }
  if (name == "many") {
    return "40000 grains, (0.25, 0.125), no contacts, two steps of Verlet: "
           "forces alone";
  }
  return "that of the flags";
}

FlowTask MakeFlowTask(const std::string& name,
                      std::uint64_t seed,
                      double max_seconds,
                      bool smoke) {
  FlowTask task;
  task.name = name;
  const int particles = smoke ? 30 : 100;
  if (name == "smooth") {
    task.end = 0.4;
    task.flow = WithoutContacts(MakePaperCase(
        kPaperStrengths[2], seed, Domain::Kind::OPEN, false, particles));
  } else if (name == "paper" || name == "strong") {
    task.end = name == "paper" ? 0.4 : 1.0;
    task.flow = MakePaperCase(kPaperStrengths[name == "paper" ? 2 : 3],
                              seed,
                              Domain::Kind::REENTRY,
                              false,
                              particles);
  } else if (name == "many") {
    task.end = 0.02;
    task.flow = WithoutContacts(MakePaperCase(kPaperStrengths[2],
                                              seed,
                                              Domain::Kind::OPEN,
                                              false,
                                              smoke ? 2000 : 40000));
    task.times = {0.01, 0.02};
    for (const int threads : {1, 2}) {
      for (const double accuracy : {0.0, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8}) {
        Way way = MakeWay("verlet", 1e-8, 0.01);
        way.field_accuracy = accuracy;
        way.threads = threads;
        task.ways.push_back(way);
      }
    }
    // The same step: what differs is the force.
    task.fine = task.finest = task.ways[0];
    return task;
  } else {
    task.end = FLAGS_duration;
    FLAGS_seed = seed;
    std::string relaxed, error;
    if (!MakeCase(&task.flow, &relaxed, &error) ||
        !task.flow.scene->Begin(0.001, &task.flow.state, &error)) {
      BadInput(error);
    }
  }
  for (int t = 1; t <= kTimes; ++t) task.times.push_back(task.end * t / kTimes);
  // Two runs of 2^k and 2^(k - 1) steps between times.
  const double most = max_seconds / (1.5 * kTimes * StepCost(*task.flow.scene));
  const int finest = std::clamp(
      static_cast<int>(std::log2(std::max(most, 1.0))), 4, smoke ? 8 : 13);
  AddLadders(task.times[0], finest, &task);
  return task;
}

Json MeasureFlowTask(const FlowTask& task, int repetitions) {
  std::vector<std::vector<double>> seconds(task.ways.size()), walls = seconds;
  std::vector<FlowMeasurement> runs(task.ways.size());
  const auto run = [&](const Way& way) {
    SetNumThreads(way.threads);
    FlowCase flow;
    flow.scene = WithForces(*task.flow.scene, way.field_accuracy);
    flow.state = task.flow.state;
    FlowMeasurement result = MeasureFlow(flow, way.setting, task.times);
    SetNumThreads(1);
    return result;
  };
  const FlowMeasurement fine = run(task.fine);
  const FlowMeasurement exact = run(task.finest);
  Json json = {{"scene", task.name},
               {"particles", task.flow.scene->size()},
               {"end", task.end},
               {"reference_dt", task.finest.setting.dt}};
  for (const FlowMeasurement* each : {&fine, &exact}) {
    if (each->error.empty()) continue;
    json["error"] = each->error;
    return json;
  }
  for (int r = 0; r < repetitions; ++r) {
    for (const int w : MethodOrder(static_cast<int>(task.ways.size()), r)) {
      FlowMeasurement result = run(task.ways[w]);
      seconds[w].push_back(result.seconds);
      walls[w].push_back(result.wall);
      if (r == 0) runs[w] = std::move(result);
    }
  }
  const auto ends = [](const FlowMeasurement& m) -> Json {
    const KineticEnergy& k = m.kinetic.back();
    return {{"kinetic", k.total()}, {"relative_part", RelativePart(k)}};
  };
  json["reference"] = ends(exact);
  json["reference_apart"] = Errors(*task.flow.scene, fine, exact);
  Json rows = Json::array();
  for (std::size_t w = 0; w < task.ways.size(); ++w) {
    const FlowMeasurement& m = runs[w];
    Json row = {{"label", LabelOf(task.ways[w])},
                {"sweeps", m.state.sweeps},
                {"steps", m.state.steps},
                {"rejected", m.state.rejected},
                {"cpu_seconds", MedianOf(seconds[w])},
                {"wall_seconds", MedianOf(walls[w])}};
    if (m.error.empty()) {
      row["end"] = ends(m);
      row["errors"] = Errors(*task.flow.scene, m, exact);
    } else {
      row["error"] = m.error;
    }
    rows.push_back(row);
  }
  json["rows"] = rows;
  return json;
}

}  // namespace granopt
