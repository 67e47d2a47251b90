// `flow --study=throughput`: the near field, and a step with it.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "experiments/flow.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt {
namespace {

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

// Other laws, all pairs.
void MeasureLaws(Json* rows) {
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
    rows->push_back({{"particles", kGrains},
                     {"what", laws[k].name},
                     {"seconds", seconds},
                     {"ns_per_ordered_pair", each},
                     {"error", 0.0}});
  }
  std::printf("\n");
}

}  // namespace

int Throughput(Output* output) {
  std::string csv = "particles,what,seconds,ns_per_ordered_pair,error\n";
  Json rows = Json::array();
  std::printf(
      "flow      throughput of the near field (exponents 1, 2), CPU seconds of "
      "one evaluation;\n          multipoles with errors below 1e-2, 1e-3 and "
      "1e-4 of the magnitudes of pair forces\n\n");
  std::vector<std::vector<std::string>> table = {{"n",
                                                  "plain loop",
                                                  "all pairs",
                                                  "multipoles 1e-2",
                                                  "1e-3",
                                                  "1e-4",
                                                  "ns a pair",
                                                  "plain / all",
                                                  "step of Verlet"}};
  Progress progress;
  std::vector<int> sizes = {100, 316, 1000, 3162, 10000};
  if (!FLAGS_smoke) {
    sizes.push_back(31623);
    sizes.push_back(100000);
  }
  for (const int n : sizes) {
    if (progress.Due()) progress.Show(Format("%d grains", n));
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
    const auto stepper = MakeStepper({"verlet", 1e-8, 1e-3}, &fault);
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
    table.push_back({std::to_string(n)});
    for (const int w : {0, 1, 3, 4, 5}) {
      table.back().push_back(median[w] > 0.0 ? Format("%.3g", median[w]) : "-");
    }
    table.back().push_back(Format("%.3g", 1e9 * median[1] / pairs));
    table.back().push_back(
        median[0] > 0.0 ? Format("%.1f", median[0] / median[1]) : "-");
    table.back().push_back(Format("%.3g", median[2]));
  }
  progress.Clear();
  std::fputs(Grid(table, 0, false, 0).c_str(), stdout);
  MeasureLaws(&rows);
  output->Write("throughput.csv", csv);
  output->Plot({"flow_throughput",
                output->Path("throughput.csv"),
                output->Path("throughput")},
               {"throughput.svg", "throughput.png"});
  Json json = StudyJson("throughput");
  json["rows"] = rows;
  FinishStudy(json, output);
  return kConverged;
}

}  // namespace granopt
