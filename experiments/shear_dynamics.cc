#include "experiments/shear_dynamics.h"

#include <cmath>
#include <cstdio>
#include <map>
#include <string>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/shear_ensemble.h"
#include "granular/damped_motion.h"

namespace granopt {
namespace {

// c / sqrt(k m): from weakly damped, where grains swing, to overdamped.
constexpr double kDampings[] = {0.1, 0.5, 2.0};
// Energies that agree to this are of one minimum.
constexpr double kSameState = 1e-6;

constexpr const char* kQuantities[] = {"energy",
                                       "pressure",
                                       "stress_dev",
                                       "fabric_iso",
                                       "fabric_dev",
                                       "coordination"};
constexpr int kNumQuantities = 6;

struct Key {
  std::string load, way;
  bool operator<(const Key& other) const {
    return load != other.load ? load < other.load : way < other.way;
  }
};
struct Group {
  std::vector<double> ratio[kNumQuantities];  // to the minimizer's
  std::vector<double> evaluations;
  int same = 0, runs = 0, converged = 0;
};

std::vector<double> Values(const Relaxation& r) {
  const Observables& o = r.observables;
  return {o.energy,
          o.pressure,
          o.stress_parts.deviatoric,
          o.fabric_parts.isotropic,
          o.fabric_parts.deviatoric,
          o.coordination};
}

}  // namespace

int RunDynamics(const std::vector<std::uint64_t>& seeds,
                double phi,
                const std::vector<double>& strains,
                std::unique_ptr<Solver> solver) {
  Output output;
  output.Create(
      FLAGS_out,
      {"summary.json", "dynamics.csv", "dynamics.svg", "dynamics.png"});
  CatchStopSignals();
  const SolveOptions solve = MakeSolveOptions();
  std::printf(
      "shear     damped motion against %s: %zu packings, phi = %g; a random "
      "start, and pure shear by",
      solver->name().c_str(),
      seeds.size(),
      phi);
  for (const double strain : strains) std::printf(" %g", strain);
  std::printf(
      "\n          m x'' = -dE/dx - c x' from rest until |g| <= %g mean "
      "forces; c / sqrt(k m) = 0.1, 0.5, 2\n",
      solve.relative_tolerance);
  std::fflush(stdout);
  std::string csv =
      "seed,load,way,damping,energy,pressure,stress_dev,fabric_iso,fabric_dev,"
      "coordination,evaluations,converged,same_state\n";
  std::map<Key, Group> groups;
  std::vector<Key> order;
  bool all = true;
  std::size_t done = 0;
  std::string error;
  Progress progress;
  for (const std::uint64_t seed : seeds) {
    if (StopRequested()) break;
    const Scene scene = MakeScene(phi, seed);
    Packing load = scene.packing;
    Packing relaxed;
    for (std::size_t k = 0; k <= strains.size(); ++k) {
      std::string name = "random start";
      if (k > 0) {
        load = relaxed;
        load.Deform(PureShear(load.dimension(), strains[k - 1]));
        name = Format("shear %g", strains[k - 1]);
      }
      if (progress.Due()) {
        progress.Show(Format("seed %llu, %s",
                             static_cast<unsigned long long>(seed),
                             name.c_str()));
      }
      Relaxation minimum;
      if (!Relax(load, scene.energy, *solver, solve, &minimum, &error)) {
        BadInput(error);
      }
      if (k == 0) relaxed = minimum.packing;
      const std::vector<double> base = Values(minimum);
      const auto note = [&](const std::string& way,
                            double damping,
                            const Relaxation& r) {
        const Key key = {name, way};
        if (groups.find(key) == groups.end()) order.push_back(key);
        Group& group = groups[key];
        const std::vector<double> values = Values(r);
        const bool same = std::abs(values[0] - base[0]) <= kSameState * base[0];
        const bool succeeded = r.summary.Succeeded();
        ++group.runs;
        group.same += same ? 1 : 0;
        group.converged += succeeded ? 1 : 0;
        all = all && succeeded;
        csv += Format("%llu,%s,%s,%g",
                      static_cast<unsigned long long>(seed),
                      name.c_str(),
                      way.c_str(),
                      damping);
        for (int q = 0; q < kNumQuantities; ++q) {
          csv += Format(",%.17g", values[q]);
          if (base[q] > 0.0) group.ratio[q].push_back(values[q] / base[q]);
        }
        csv += Format(",%lld,%d,%d\n",
                      static_cast<long long>(r.summary.counters.evaluations),
                      succeeded ? 1 : 0,
                      same ? 1 : 0);
        group.evaluations.push_back(
            static_cast<double>(r.summary.counters.evaluations));
      };
      note("minimizer", 0.0, minimum);
      for (const double damping : kDampings) {
        DampedMotionOptions options;
        options.energy = scene.energy;
        options.damping = damping;
        options.tolerance = solve.relative_tolerance;
        options.vanishing_tolerance = solve.vanishing_tolerance;
        options.max_steps = 2'000'000;
        Relaxation motion;
        if (!RelaxByDampedMotion(load, options, &motion, &error)) {
          BadInput(error);
        }
        note(Format("motion c=%g", damping), damping, motion);
      }
    }
    ++done;
  }
  const bool interrupted = done < seeds.size();
  all = all && !interrupted;
  progress.Clear();

  Json json;
  json["converged"] = all;
  json["packings"] = done;
  json["interrupted"] = interrupted;
  json["phi"] = phi;
  json["solver"] = solver->name();
  json["groups"] = Json::array();
  std::printf(
      "\n    mean ratio to the minimizer's, and its standard error over the "
      "packings\n"
      "    load           way            energy           pressure         "
      "stress dev       fabric iso       fabric dev       z                "
      "same minimum  evaluations\n");
  for (const Key& key : order) {
    const Group& group = groups[key];
    Json one = {{"load", key.load}, {"way", key.way}};
    std::printf("    %-13s  %-13s", key.load.c_str(), key.way.c_str());
    for (int q = 0; q < kNumQuantities; ++q) {
      const BandPoint p = MakeBand(group.ratio[q]);
      one[kQuantities[q]] = {{"ratio", p.mean}, {"error", p.standard_error}};
      std::printf(" %7.4f +- %.4f", p.mean, p.standard_error);
    }
    const BandPoint work = MakeBand(group.evaluations);
    one["same_state"] = group.same;
    one["runs"] = group.runs;
    one["converged"] = group.converged;
    one["evaluations"] = work.mean;
    std::printf(
        "  %2d of %-7d %12.0f%s\n",
        group.same,
        group.runs,
        work.mean,
        group.converged < group.runs
            ? Format("  %d did not converge", group.runs - group.converged)
                  .c_str()
            : "");
    json["groups"].push_back(one);
  }
  json["schema"] = "granopt/shear_dynamics/1";
  json["provenance"] = Provenance();
  output.Write("dynamics.csv", csv);
  output.WriteJson("summary.json", json);
  output.Plot(
      {"dynamics", output.Path("dynamics.csv"), output.Path("dynamics")},
      {"dynamics.svg", "dynamics.png"});
  if (interrupted) {
    std::printf(
        "\nstopped as asked, after %zu of %zu packings\n", done, seeds.size());
  }
  output.PrintFiles();
  return all ? kConverged : kNotConverged;
}

}  // namespace granopt
