// `flow --study=remark8`: can gradients solve the implicit step?

#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "experiments/flow.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "solvers/registry.h"

namespace granopt {

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
      "  steps solved, median sweeps of those; tangents that are not positive "
      "definite\n",
      2 * seeds);
  std::vector<std::vector<std::string>> table = {{"Dt / s", "tangents"}};
  for (const Method& method : methods) table[0].push_back(method.name);
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
    table.push_back(
        {Format("%g", dt), Format("%d of %zu", indefinite, cases.size())});
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
      table.back().push_back(s.empty() ? "0"
                                       : Format("%zu, %g", s.size(), median));
    }
  }
  progress.Clear();
  std::fputs(Grid(table, 0, false, 0).c_str(), stdout);
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
  FinishStudy(json, output);
  return failed.empty() ? kConverged : kNotConverged;
}

}  // namespace granopt
