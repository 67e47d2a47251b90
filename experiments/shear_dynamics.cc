#include "experiments/shear_dynamics.h"

#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <utility>

#include "experiments/checkpoint.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "experiments/shear_ensemble.h"
#include "experiments/tabular.h"
#include "granular/damped_motion.h"

DECLARE_bool(resume);

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

// One relaxation.
struct DynamicsRow {
  std::uint64_t seed = 0;
  std::string load, way;
  double damping = 0.0;
  std::vector<double> values;  // kQuantities
  std::int64_t evaluations = 0;
  bool converged = false, same = false;
};

Json ToJson(const DynamicsRow& row) {
  return {row.seed,
          row.load,
          row.way,
          row.damping,
          row.values,
          row.evaluations,
          row.converged,
          row.same};
}
DynamicsRow DynamicsRowOf(const Json& json) {
  DynamicsRow row;
  json.at(0).get_to(row.seed);
  json.at(1).get_to(row.load);
  json.at(2).get_to(row.way);
  json.at(3).get_to(row.damping);
  json.at(4).get_to(row.values);
  json.at(5).get_to(row.evaluations);
  json.at(6).get_to(row.converged);
  json.at(7).get_to(row.same);
  return row;
}

using Key = std::pair<std::string, std::string>;  // load, way
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

// Rows of one packing: relaxed both ways as it is and, from the minimizer's
// state, after each strain.
void RunPacking(const Scene& scene,
                std::uint64_t seed,
                const std::vector<double>& strains,
                const Solver& solver,
                Progress* progress,
                std::vector<DynamicsRow>* rows) {
  const SolveOptions solve = MakeSolveOptions();
  std::string error;
  Packing load = scene.packing;
  Packing relaxed;
  for (std::size_t k = 0; k <= strains.size(); ++k) {
    std::string name = "random start";
    if (k > 0) {
      load = relaxed;
      load.Deform(PureShear(load.dimension(), strains[k - 1]));
      name = Format("shear %g", strains[k - 1]);
    }
    if (progress->Due()) {
      progress->Show(Format("seed %llu, %s",
                            static_cast<unsigned long long>(seed),
                            name.c_str()));
    }
    Relaxation minimum;
    if (!Relax(load, scene.energy, solver, solve, &minimum, &error)) {
      BadInput(error);
    }
    if (k == 0) relaxed = minimum.packing;
    const double energy = minimum.observables.energy;
    const auto note =
        [&](const std::string& way, double damping, const Relaxation& r) {
          rows->push_back(
              {seed,
               name,
               way,
               damping,
               Values(r),
               r.summary.counters.evaluations,
               r.summary.Succeeded(),
               std::abs(r.observables.energy - energy) <= kSameState * energy});
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
      if (!RelaxByDampedMotion(load, options, &motion, &error)) BadInput(error);
      note(Format("motion c=%g", damping), damping, motion);
    }
  }
}

// Writes and prints what all rows say; true if every run converged.
bool Publish(const std::vector<DynamicsRow>& rows,
             std::size_t packings,
             double phi,
             const Solver& solver,
             Output* output) {
  std::string csv = "seed,load,way,damping";
  for (const char* quantity : kQuantities) csv += Format(",%s", quantity);
  csv += ",evaluations,converged,same_state\n";
  std::map<Key, Group> groups;
  std::vector<Key> order;
  bool all = true;
  std::vector<double> base;  // of the minimizer, which comes first
  for (const DynamicsRow& row : rows) {
    if (row.damping == 0.0) base = row.values;
    const Key key = {row.load, row.way};
    if (groups.find(key) == groups.end()) order.push_back(key);
    Group& group = groups[key];
    ++group.runs;
    group.same += row.same ? 1 : 0;
    group.converged += row.converged ? 1 : 0;
    all = all && row.converged;
    group.evaluations.push_back(static_cast<double>(row.evaluations));
    csv += Format("%llu,%s,%s,%g",
                  static_cast<unsigned long long>(row.seed),
                  row.load.c_str(),
                  row.way.c_str(),
                  row.damping);
    for (int q = 0; q < kNumQuantities; ++q) {
      csv += Format(",%.17g", row.values[q]);
      if (base[q] > 0.0) group.ratio[q].push_back(row.values[q] / base[q]);
    }
    csv += Format(",%lld,%d,%d\n",
                  static_cast<long long>(row.evaluations),
                  row.converged ? 1 : 0,
                  row.same ? 1 : 0);
  }

  Json json;
  json["converged"] = all;
  json["packings"] = packings;
  json["phi"] = phi;
  json["solver"] = solver.name();
  json["groups"] = Json::array();
  std::vector<std::vector<std::string>> table = {{"load", "way"}};
  for (const char* quantity : kQuantities) table[0].push_back(quantity);
  table[0].insert(table[0].end(),
                  {"same minimum", "not converged", "evaluations"});
  for (const Key& key : order) {
    const Group& group = groups[key];
    Json one = {{"load", key.first}, {"way", key.second}};
    table.push_back({key.first, key.second});
    for (int q = 0; q < kNumQuantities; ++q) {
      const BandPoint p = MakeBand(group.ratio[q]);
      one[kQuantities[q]] = {{"ratio", p.mean}, {"error", p.standard_error}};
      table.back().push_back(Format("%.4f +- %.4f", p.mean, p.standard_error));
    }
    const BandPoint work = MakeBand(group.evaluations);
    one["same_state"] = group.same;
    one["runs"] = group.runs;
    one["converged"] = group.converged;
    one["evaluations"] = work.mean;
    table.back().insert(table.back().end(),
                        {Format("%d of %d", group.same, group.runs),
                         Format("%d", group.runs - group.converged),
                         Format("%.0f", work.mean)});
    json["groups"].push_back(one);
  }
  json["schema"] = "granopt/shear_dynamics/1";
  json["provenance"] = Provenance();
  output->Write("dynamics.csv", csv);
  output->WriteJson("summary.json", json);
  output->Plot(
      {"dynamics", output->Path("dynamics.csv"), output->Path("dynamics")},
      {"dynamics.svg", "dynamics.png"});
  std::printf(
      "\n    mean ratio to the minimizer's, and its standard error over the "
      "packings\n%s",
      Grid(table, 0, false, 2).c_str());
  output->PrintFiles();
  return all;
}

}  // namespace

int RunDynamics(const std::vector<std::uint64_t>& seeds,
                double phi,
                const std::vector<double>& strains,
                std::unique_ptr<Solver> solver) {
  const SolveOptions solve = MakeSolveOptions();
  Scene first = MakeScene(phi, seeds.front());
  first.solver = std::move(solver);
  std::printf(
      "shear     damped motion against %s: %zu packings, phi = %g; a random "
      "start, and pure shear by",
      first.solver->name().c_str(),
      seeds.size(),
      phi);
  for (const double strain : strains) std::printf(" %g", strain);
  std::printf(
      "\n          m x'' = -dE/dx - c x' from rest until |g| <= %g mean "
      "forces; c / sqrt(k m) = 0.1, 0.5, 2\n",
      solve.relative_tolerance);
  Json setup = SceneSetup(first, solve);
  setup.update({{"seeds", seeds}, {"phi", phi}, {"strains", strains}});
  const Checkpoint checkpoint(CheckpointPath(), setup);
  std::vector<DynamicsRow> rows;
  std::size_t done = 0;
  if (FLAGS_resume && Resume(checkpoint, [&](const Json& json) {
        json.at("done").get_to(done);
        for (const Json& row : json.at("rows")) {
          rows.push_back(DynamicsRowOf(row));
        }
      })) {
    std::printf("          resumed after %zu packings\n", done);
  }
  Output output;
  CreateOutput({"summary.json", "dynamics.csv", "dynamics.svg", "dynamics.png"},
               FLAGS_resume,
               &output);
  std::fflush(stdout);
  Progress progress;
  while (done < seeds.size() && !StopRequested()) {
    RunPacking(MakeScene(phi, seeds[done]),
               seeds[done],
               strains,
               *first.solver,
               &progress,
               &rows);
    ++done;
    Json state = {{"done", done}, {"rows", Json::array()}};
    for (const DynamicsRow& row : rows) state["rows"].push_back(ToJson(row));
    Save(checkpoint, state);
  }
  progress.Clear();
  if (done < seeds.size()) {
    return StoppedAsAsked(
        Format("after %zu of %zu packings", done, seeds.size()));
  }
  return Publish(rows, done, phi, *first.solver, &output) ? kConverged
                                                          : kNotConverged;
}

}  // namespace granopt
