// compare: methods against each other on the same packings, interleaved.
//
//   compare --solvers="label@spec;spec;..." --cases=growth,simple_shear,random
//           --input=F.xyz | --particles=N --phi=P --seeds=1-3
//           --repetitions=3 --tolerance=1e-10 | --paper=table1|fig2|fig7
//           --out=DIR [--resume]
//   compare --cases=near_jamming=1e-6,near_jamming=0.3x --steps=10
//           --reference=LABEL ...
//   compare --protocol=jamming|shear ...      (compare_protocol.cc)
//   compare --replot=DIR
//
// Raw events first (events.csv, runs.csv, curves.csv; steps.csv of chains of
// shear steps), then tables and figures from these alone, which --replot makes
// again. Times are CPU seconds of
// Minimize() alone; preparing the packings and measuring the results is not in
// them.

#include "experiments/compare.h"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "experiments/comparison.h"
#include "experiments/preparation.h"
#include "experiments/profiles.h"
#include "experiments/protocols.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/atomic_file.h"
#include "granular/quad_residual.h"
#include "granular/relaxation.h"
#include "solvers/sparse_cholesky.h"

DEFINE_string(solvers,
              "lbfgs;lbfgs:preconditioner=laplacian;"
              "lbfgs:preconditioner=contact;ncg;fire;"
              "ceres_lbfgs:scaled=1,differences=1,restarts=10",
              "methods, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,... (see --list_solvers)");
DEFINE_string(
    cases,
    "growth,simple_shear,random",
    "what is relaxed, separated by commas: growth, simple_shear, "
    "pure_shear, random, fig2, near_jamming, start, user; with a size as in "
    "growth=5e-5; near_jamming=0.3x is a strain of 0.3 (phi - phi_J)");
DEFINE_double(phi, 0.8438, "packing fraction of generated packings");
DEFINE_string(seeds, "", "seeds as in 1-3 or 1,4,7; default: --seed");
DEFINE_int32(repetitions, 3, "how often each run is repeated, for its time");
DEFINE_double(
    absolute_tolerance,
    0.0,
    "if > 0: stop at max|g| <= this instead, in units k = 1, box = 1");
DEFINE_double(max_seconds, 0.0, "a run gives up after this time (0: never)");
DEFINE_int64(max_evaluations,
             0,
             "a run gives up after this many evaluations (0: never)");
DEFINE_string(distances,
              "1e-2,1e-3,1e-4,1e-5,1e-6,1e-7,1e-8",
              "distances phi - phi_J of the case near_jamming");
DEFINE_double(shear, 1e-6, "shear step of the case near_jamming");
DEFINE_int32(steps,
             1,
             "shear steps of the case near_jamming, one after another: each "
             "starts from the state before, relaxed by --prepare_solver");
DEFINE_string(prepare_solver,
              granopt::kDefaultSolver,
              "the method that relaxes the packings before the loads");
DEFINE_int64(
    prepare_evaluations,
    1000000,
    "a relaxation of these steps gives up after this many evaluations, "
    "which ends their chain (0: never)");
DEFINE_string(reference,
              "",
              "label of the method whose minima the others' are compared with: "
              "who leaves its basin, how often");
DEFINE_bool(resume,
            false,
            "go on with an interrupted comparison in --out: what it has run is "
            "not run again");
DEFINE_string(baseline,
              "",
              "label of the method that times are divided by; default: the "
              "first");
DEFINE_string(
    paper,
    "",
    "the paper's parameters: table1, fig2 or fig7 (each can be changed by "
    "its flag)");
DEFINE_string(replot,
              "",
              "folder of an earlier comparison: make its tables and figures "
              "again, run nothing");

namespace granopt {
namespace {

constexpr int kCurveBuckets = 95;
constexpr int kCasesPerFigure = 3;
// Cases whose figures an earlier comparison may have left behind.
constexpr int kMostCases = 99;
constexpr double kFig2Phi = 0.8389;
// Of a run with --paper: more than ten times what the slowest method there
// took.
constexpr int kPaperEvaluations = 100000;

constexpr char kTable1Solvers[] =
    "L-BFGS@lbfgs:memory=5;"
    "P-L-BFGS (A = 0)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=0;"
    "P-L-BFGS (A = 3)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=3;"
    "FR-CG@ncg:beta=fr;"
    "P-FR-CG@ncg:beta=fr,preconditioner=laplacian";
constexpr char kFig2Solvers[] =
    "L-BFGS@lbfgs:memory=5;"
    "P-L-BFGS (A = 0)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=0;"
    "FR-CG@ncg:beta=fr;"
    "P-FR-CG@ncg:beta=fr,preconditioner=laplacian";

// The paper has the first two; beside them FR-CG, second-order methods, `auto`.
constexpr char kFig7Solvers[] =
    "L-BFGS@lbfgs:memory=5;"
    "P-L-BFGS (A = 0)@lbfgs:memory=5,scaling=paper,preconditioner=laplacian,"
    "A=0;"
    "FR-CG@ncg:beta=fr;newton;interior_point;auto";

// ---------------------------------------------------------------- figures

// The files of the figures of that many cases.
void AddPictures(int cases, std::vector<std::string>* names) {
  const auto add = [names](const std::string& base) {
    names->push_back(base + ".svg");
    names->push_back(base + ".png");
  };
  for (int page = 1; (page - 1) * kCasesPerFigure < cases; ++page) {
    add(page == 1 ? "curves" : Format("curves_%d", page));
    add(page == 1 ? "work" : Format("work_%d", page));
  }
  add("profile");
  add("quality");
  add("distances");
  add("distances_non_rearranging");
  add("fig7");
}

}  // namespace

double WallSeconds() {
  return std::chrono::duration<double>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

bool Exists(const std::string& path) {
  struct stat status;
  return stat(path.c_str(), &status) == 0;
}

std::string LabelOf(const std::vector<Method>& methods,
                    const char* flag,
                    const std::string& value) {
  std::string known;
  for (const Method& method : methods) {
    if (method.label == value || method.spec == value) return method.label;
    known += (known.empty() ? "" : "; ") + method.label;
  }
  BadInput(std::string("--") + flag + ": no method is labelled '" + value +
           "'; there are " + known);
}

void WriteProfiles(const ComparisonProfiles& profiles, Output* output) {
  const auto write = [output](const char* name, const std::string& csv) {
    const std::string file = std::string(name) + ".csv";
    output->Write(file, csv);
    output->Plot({name, output->Path(file), output->Path(name)},
                 {std::string(name) + ".svg", std::string(name) + ".png"});
  };
  if (!profiles.profiles.empty()) {
    write("profile", ProfilesCsv(profiles.profiles));
  }
  if (!profiles.qualities.empty()) {
    write("quality", QualitiesCsv(profiles.qualities));
  }
}

std::vector<std::string> ComparisonFiles(bool raw) {
  std::vector<std::string> names = {"tables.csv",
                                    "tables.md",
                                    "step_tables.csv",
                                    "basins.csv",
                                    "profile.csv",
                                    "quality.csv",
                                    "summary.json"};
  AddPictures(kMostCases, &names);
  if (raw) {
    names.insert(
        names.end(),
        {"setup.json", "events.csv", "runs.csv", "curves.csv", "steps.csv"});
  }
  return names;
}

namespace {

// `data`: the folder of the raw files; figures go to the folder of `output`.
void Draw(const ComparisonSetup& setup,
          const std::vector<StepTable>& steps,
          const std::string& data,
          Output* output) {
  std::vector<std::string> levels;
  for (const Level& level : setup.levels) {
    levels.push_back(
        "--level=" + std::string(level.absolute ? "absolute:" : "relative:") +
        Neat(level.value));
  }
  const auto draw = [&](const std::string& name,
                        std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), levels.begin(), levels.end());
    return output->Plot(arguments, {name + ".svg", name + ".png"});
  };
  const int cases = static_cast<int>(setup.cases.size());
  for (int first = 0; first < cases; first += kCasesPerFigure) {
    std::string chosen;
    for (int c = first; c < std::min(cases, first + kCasesPerFigure); ++c) {
      chosen += (chosen.empty() ? "" : ";") + setup.cases[c].id;
    }
    const std::string page =
        first == 0 ? "" : Format("_%d", first / kCasesPerFigure + 1);
    for (const std::string kind : {"curves", "work"}) {
      const std::string name = kind + page;
      if (!draw(name,
                {kind,
                 data + (kind == "curves" ? "/curves.csv" : "/events.csv"),
                 output->Path(name),
                 "--cases=" + chosen})) {
        return;
      }
    }
  }
  // Against the distance, where there are two.
  std::set<double> all, plain;
  for (const StepTable& table : steps) {
    (table.kind == "all" ? all : plain).insert(table.table_case.distance);
  }
  const std::string table = output->Path("step_tables.csv");
  if (all.size() > 1) {
    draw("distances",
         {"distances", table, output->Path("distances"), "--steps=all"});
    if (setup.paper == "fig7") {
      draw("fig7", {"fig7", table, output->Path("fig7")});
    }
  }
  if (plain.size() > 1) {
    const std::string name = "distances_non_rearranging";
    draw(name,
         {"distances",
          table,
          output->Path(name),
          std::string("--steps=") + kNonRearranging});
  }
}

struct Raw {
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  std::vector<StepRecord> steps;  // empty without chains
  std::vector<CurveRow> curves;   // read by --resume only
};

Raw ReadRaw(const std::string& data) {
  Raw raw;
  std::string text, error;
  if (!ReadFile(data + "/events.csv", &text, &error) ||
      !ParseEvents(text, data + "/events.csv", &raw.events, &error) ||
      !ReadFile(data + "/runs.csv", &text, &error) ||
      !ParseRuns(text, data + "/runs.csv", &raw.runs, &error)) {
    BadInput(error);
  }
  if (Exists(data + "/steps.csv") &&
      (!ReadFile(data + "/steps.csv", &text, &error) ||
       !ParseSteps(text, data + "/steps.csv", &raw.steps, &error))) {
    BadInput(error);
  }
  return raw;
}

// Tables and figures from the raw files in `data`, as they were read; prints
// the tables.
std::vector<Table> Report(const ComparisonSetup& setup,
                          const std::string& data,
                          const Raw& raw,
                          Output* output) {
  const std::vector<RunRecord>& runs = raw.runs;
  const std::vector<Table> tables = Tabulate(setup, raw.events, runs);
  const std::vector<StepTable> steps =
      TabulateSteps(setup, raw.events, runs, raw.steps);
  const std::vector<BasinRow> basins = TabulateBasins(setup, runs, raw.steps);
  const ComparisonProfiles profiles =
      MakeComparisonProfiles(setup, raw.events, runs);
  const auto text = [&](bool markdown) {
    return TablesText(setup, tables, runs, markdown) + (markdown ? "\n" : "") +
           StepTablesText(setup, steps, raw.steps, markdown) +
           BasinsText(setup, basins, markdown) +
           ProfilesText(profiles.profiles, markdown) +
           QualitiesText(profiles.qualities, markdown);
  };
  output->Write("tables.csv", TablesCsv(tables));
  if (!steps.empty()) output->Write("step_tables.csv", StepTablesCsv(steps));
  if (!basins.empty()) output->Write("basins.csv", BasinsCsv(basins));
  output->Write("tables.md", text(true));
  std::fputs(text(false).c_str(), stdout);
  Draw(setup, steps, data, output);
  WriteProfiles(profiles, output);
  int converged = 0;
  for (const RunRecord& run : runs) converged += run.converged ? 1 : 0;
  std::printf("\n%d of %zu runs converged\n", converged, runs.size());
  return tables;
}

// The level that the flags ask for, if any.
bool GivenLevel(Level* level) {
  if (IsGiven("absolute_tolerance") && FLAGS_absolute_tolerance > 0.0) {
    *level = {true, FLAGS_absolute_tolerance};
    return true;
  }
  *level = {false, FLAGS_tolerance};
  return IsGiven("tolerance");
}

void SetBaselineAndReference(ComparisonSetup* setup) {
  if (IsGiven("baseline")) {
    setup->baseline = LabelOf(setup->methods, "baseline", FLAGS_baseline);
  } else if (setup->baseline.empty()) {
    setup->baseline = setup->methods[0].label;
  }
  if (IsGiven("reference")) {
    setup->reference = LabelOf(setup->methods, "reference", FLAGS_reference);
  }
}

int Replot() {
  for (const char* flag : {"solvers",
                           "cases",
                           "phi",
                           "seeds",
                           "seed",
                           "repetitions",
                           "max_seconds",
                           "max_evaluations",
                           "shear",
                           "distances",
                           "steps",
                           "resume",
                           "paper",
                           "prepare_solver",
                           "prepare_evaluations",
                           "input",
                           "particles",
                           "dimension",
                           "polydispersity",
                           "alpha",
                           "smoke",
                           "zero_pressure",
                           "tolerances",
                           "phi_init",
                           "dphi",
                           "epsilon",
                           "strain",
                           "strain_steps"}) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag + " cannot go with --replot");
    }
  }
  std::string data = FLAGS_replot, text, error;
  while (data.size() > 1 && data.back() == '/') data.pop_back();
  ComparisonSetup setup;
  if (!ReadFile(data + "/setup.json", &text, &error)) {
    BadInput("--replot: " + error);
  }
  if (IsProtocolSetup(text)) return ReplotProtocols(data, text);
  if (IsGiven("protocol")) {
    BadInput("--replot: " + data + " is of no protocol");
  }
  if (!ParseSetup(text, data + "/setup.json", &setup, &error)) {
    BadInput("--replot: " + error);
  }
  Level level;
  if (GivenLevel(&level)) {
    const std::vector<Level> ladder = Ladder(setup.levels);
    if (std::find(ladder.begin(), ladder.end(), level) == ladder.end()) {
      BadInput(
          Format("--replot: %g is none of the recorded levels (decades "
                 "and the tolerances of the runs)",
                 level.value));
    }
    const Level& stop = setup.levels[0];
    if (level.absolute == stop.absolute && level.value < stop.value) {
      BadInput(Format("--replot: the runs stopped at %g", stop.value));
    }
    setup.levels = {level};
  }
  SetBaselineAndReference(&setup);
  const Raw raw = ReadRaw(data);
  std::vector<std::string> names = ProtocolFiles(/*raw=*/false);
  for (const std::string& name : ComparisonFiles(/*raw=*/false)) {
    if (name != "summary.json") names.push_back(name);
  }
  Output output;
  output.Create(IsGiven("out") ? FLAGS_out : data, names);
  std::printf("compare   tables and figures of %s again\n", data.c_str());
  Report(setup, data, raw, &output);
  output.PrintFiles();
  return kConverged;
}

// ---------------------------------------------------------------- runs

// A packing that methods start from.
struct Start {
  Packing packing;
  double distance = 0.0;
  // Of a shear step near jamming: where it was prepared to end.
  std::unique_ptr<ShearStep> step;
};

// The seeds of a case: with an input only random displacements depend on one.
std::vector<std::uint64_t> SeedsOf(const ComparisonSetup& setup,
                                   const Case& c) {
  if (FLAGS_input.empty() || c.kind == "random") return setup.seeds;
  return {setup.seeds[0]};
}

// A packing that all methods run on: case, seed, step.
using Place = std::tuple<std::string, std::uint64_t, int>;
using Starts = std::map<Place, Start>;

Place PlaceOf(const RunKey& key) { return {key.case_id, key.seed, key.step}; }

struct Records {
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  std::vector<CurveRow> curves;
  std::map<Place, Minima> minima;
  // --resume: energy and minimum of runs whose ends are no longer known.
  std::map<std::pair<Place, std::string>, std::pair<double, std::string>> ends;
};

// The minimum that a run ended in. Repetitions end where the first did.
std::string MinimumOf(const RunKey& key,
                      const Start& start,
                      const Observables& o,
                      double residual,
                      double vanishing,
                      const std::vector<double>& displacements,
                      Records* records) {
  const auto known = records->ends.find({PlaceOf(key), key.label});
  if (known != records->ends.end() && known->second.first == o.energy) {
    return known->second.second;
  }
  const auto [found, is_new] =
      records->minima.try_emplace(PlaceOf(key), Minima());
  if (is_new) {
    // The state as prepared is the first one.
    if (start.step != nullptr) {
      const ShearStep& step = *start.step;
      found->second.Tag(step.energy,
                        step.residual,
                        step.vanishing,
                        step.mean_overlap,
                        step.displacements,
                        step.is_rattler);
    }
    std::set<std::string> letters;
    for (const auto& [place, end] : records->ends) {
      if (place.first == PlaceOf(key)) letters.insert(end.second);
    }
    if (!letters.empty()) {
      found->second.Reserve(static_cast<int>(letters.size()) + 1);
    }
  }
  return found->second.Tag(o.energy,
                           residual,
                           vanishing,
                           o.mean_overlap,
                           displacements,
                           o.is_rattler);
}

// CPU seconds at a wall time, linear between the moments when both were read.
double Interpolate(const std::vector<std::pair<double, double>>& knots,
                   double wall) {
  const auto above = std::lower_bound(
      knots.begin() + 1, knots.end() - 1, std::make_pair(wall, 0.0));
  const auto& [w1, c1] = *above;
  const auto& [w0, c0] = *(above - 1);
  if (!(w1 > w0)) return c1;
  return c0 + (c1 - c0) * std::min(1.0, (wall - w0) / (w1 - w0));
}

void RunOne(const RunKey& key,
            int position,
            const Start& start,
            const ContactEnergyOptions& law,
            const Solver& solver,
            const ComparisonSetup& setup,
            const std::function<void(const IterationState&)>& show,
            Records* records) {
  const double unit = ForceUnit(start.packing, law);
  SolveOptions options = MakeSolveOptions();
  if (setup.levels[0].absolute) {
    options.absolute_tolerance = setup.levels[0].value * unit;
  } else {
    options.relative_tolerance = setup.levels[0].value;
  }
  if (FLAGS_max_seconds > 0.0) options.max_seconds = FLAGS_max_seconds;
  if (FLAGS_max_evaluations > 0) {
    options.max_evaluations = FLAGS_max_evaluations;
  }
  // Repetitions differ by their times only; of a chain the first step will do.
  const bool curve = key.repetition == 1 && key.step == 1;
  options.record_trace = curve;

  std::string error;
  const auto energy = ContactEnergy::Create(start.packing, law, &error);
  if (energy == nullptr) BadInput(key.case_id + ": " + error);
  std::vector<double> u(energy->NumParameters(), 0.0);

  Crossings crossings(Ladder(setup.levels), unit);
  std::vector<std::pair<double, double>> knots = {{0.0, 0.0}};
  double begin = 0.0;
  options.callback = [&](const IterationState& state) {
    if (crossings.Due(state.max_gradient, state.scales.gradient)) {
      const double cpu = CpuSeconds() - begin;
      crossings.Note(key,
                     state.max_gradient,
                     state.scales.gradient,
                     MakeWork(state.counters,
                              cpu,
                              state.seconds,
                              state.function_seconds,
                              state.linear_seconds),
                     state.cost,
                     &records->events);
      knots.push_back({state.seconds, cpu});
    }
    show(state);
    return true;
  };
  // Else who comes second in a block would pay less.
  SparseCholesky::ForgetAnalysis();
  begin = CpuSeconds();
  Summary summary = solver.Minimize(energy.get(), options, u.data());
  const double cpu = CpuSeconds() - begin;
  knots.push_back({summary.seconds, cpu});
  const Work work = MakeWork(summary.counters,
                             cpu,
                             summary.seconds,
                             summary.function_seconds,
                             summary.linear_seconds);
  // The iterate that meets the tolerance is not shown to the callback.
  crossings.Note(key,
                 summary.max_gradient,
                 summary.scales.gradient,
                 work,
                 summary.cost,
                 &records->events);

  const Packing end = energy->Configuration(u.data());
  const int d = end.dimension();
  std::vector<double> displacements(u.size());
  for (int i = 0; i < end.size(); ++i) {
    for (int k = 0; k < d; ++k) {
      const DoubleDouble a = end.Position(i, k),
                         b = start.packing.Position(i, k);
      displacements[d * i + k] = (a.hi - b.hi) + (a.lo - b.lo);
    }
  }
  const Relaxation result =
      Conclude(std::move(summary), u.data(), energy.get());
  const Summary& s = result.summary;
  const Observables& o = result.observables;
  QuadResidual judge;
  if (!EvaluateQuad(result.packing, law, nullptr, &judge, &error)) {
    BadInput(key.case_id + ": " + error);
  }
  RunRecord run;
  run.key = key;
  run.position = position;
  run.converged = s.Succeeded();
  run.stop_reason = StopReasonName(s.reason);
  run.message = s.message;
  run.residual =
      s.scales.gradient > 0.0 ? s.max_gradient / s.scales.gradient : 0.0;
  run.quad_residual = judge.Relative();
  run.quad_max_gradient = judge.max_gradient / unit;
  run.energy = o.energy;
  run.pressure = o.pressure;
  run.phi = o.packing_fraction;
  run.rattlers = o.rattlers;
  run.minimum = MinimumOf(key,
                          start,
                          o,
                          judge.Relative(),
                          s.scales.vanishing,
                          displacements,
                          records);
  run.distance = start.distance;
  run.list_builds = result.list_builds;
  run.restarts = s.counters.restarts;
  run.recenters = s.counters.recenters;
  run.rebases = s.counters.rebases;
  run.work = work;
  run.seconds = s.seconds;
  records->runs.push_back(run);

  if (curve) {
    std::vector<double> residuals;
    for (const TraceRow& row : s.trace) residuals.push_back(row.max_gradient);
    for (const int k : ThinTrace(residuals, kCurveBuckets)) {
      const TraceRow& row = s.trace[k];
      records->curves.push_back({key.case_id,
                                 key.seed,
                                 key.label,
                                 row.iteration,
                                 row.evaluations,
                                 Interpolate(knots, row.seconds),
                                 row.gradient_scale > 0.0
                                     ? row.max_gradient / row.gradient_scale
                                     : 0.0,
                                 row.max_gradient / unit,
                                 row.cost});
    }
  }
}

// ---------------------------------------------------------------- the plan

// All that the flags ask for, checked.
struct Plan {
  ComparisonSetup setup;
  std::vector<std::unique_ptr<Solver>> solvers;  // as setup.methods
  std::unique_ptr<Solver> prepare;
  std::vector<double> distances;
  double phi = 0.0;
  double phi_fig2 = 0.0;
  // The input, or the random start of the first seed.
  Scene scene;
  int runs = 0;
};

void AddAssumptions(Plan* plan) {
  ComparisonSetup& setup = plan->setup;
  auto& rows = setup.assumptions;
  const double alpha = plan->scene.energy.alpha;
  rows.emplace_back("exponent alpha",
                    Neat(alpha) + (IsGiven("alpha") ? ", given by --alpha"
                                   : alpha == 2.0   ? ", the harmonic law"
                                                    : ", the input's own"));
  std::string levels;
  for (const Level& level : setup.levels) {
    levels += (levels.empty() ? "" : ", ") + Neat(level.value) +
              (level.absolute ? " absolute" : " mean forces");
  }
  rows.emplace_back(
      "tolerance",
      "max|g| <= " + levels +
          (setup.levels.size() > 1 ? "; all from the runs to the first" : ""));
  rows.emplace_back("units of an absolute tolerance",
                    "k = 1, L = V^(1/d) = 1: max|g| / (k L^(alpha-1))");
  rows.emplace_back("memory m, line search, r_nn, mu",
                    "the methods' options; what is not given has its default "
                    "(--list_solvers)");
  rows.emplace_back("meaning of n_iter",
                    "accepted steps; evaluations of E and its gradient beside "
                    "them");
  const std::string random =
      "uniform random centres, radii 1 : 1.4 half and half";
  if (setup.paper == "fig2") {
    rows.emplace_back(
        "the unjammed state",
        !FLAGS_input.empty()
            ? "the input " + FLAGS_input
            : random +
                  Format("; relaxed at phi = %g, radii grown to phi in "
                         "steps of %g, relaxed after each, by ",
                         Preparation::kCompressedFrom,
                         Preparation::kStep) +
                  plan->prepare->name());
    rows.emplace_back("phi of the caption", "that before the radii grow");
  } else if (setup.paper == "fig7") {
    rows.emplace_back("the packings",
                      !FLAGS_input.empty()
                          ? "the input " + FLAGS_input
                          : random +
                                "; relaxed above jamming, followed down to "
                                "phi_J, compressed from distance to distance");
    rows.emplace_back("strains of 1e-6 to 1e-5 in 10 steps",
                      "ten steps of 1e-6, each from the state before");
    rows.emplace_back("the methods",
                      "the paper has the first two; its error bars are "
                      "standard deviations here");
  } else {
    rows.emplace_back("the over-jammed state",
                      !FLAGS_input.empty()
                          ? "the input " + FLAGS_input
                          : random +
                                Format("; relaxed at phi to %g mean forces by ",
                                       Preparation::kTolerance) +
                                plan->prepare->name());
    rows.emplace_back("random perturbation O(1e-4)",
                      "each coordinate by a uniform number in +-1e-4 L");
    rows.emplace_back("shear strain",
                      "cell and centres deformed affinely, then relaxed in the "
                      "deformed periodic cell");
  }
  rows.emplace_back("end of a method that stalls",
                    Format("after %lld evaluations",
                           static_cast<long long>(FLAGS_max_evaluations)));
  if (FLAGS_max_evaluations == 0) rows.pop_back();
  rows.emplace_back(
      "time",
      "CPU seconds of this machine; compare ratios to " + setup.baseline);
}

void ApplyPreset(Plan* plan) {
  ComparisonSetup& setup = plan->setup;
  setup.paper = FLAGS_paper;
  if (!FLAGS_paper.empty()) {
    const bool table1 = FLAGS_paper == "table1";
    const bool fig7 = FLAGS_paper == "fig7";
    if (!table1 && !fig7 && FLAGS_paper != "fig2") {
      BadInput("--paper=" + FLAGS_paper + " must be table1, fig2 or fig7");
    }
    if (!IsGiven("solvers")) {
      FLAGS_solvers = table1 ? kTable1Solvers
                      : fig7 ? kFig7Solvers
                             : kFig2Solvers;
    }
    if (!IsGiven("cases")) {
      FLAGS_cases = table1 ? "growth,simple_shear,random"
                    : fig7 ? "near_jamming=1e-6"
                           : "fig2";
    }
    if (fig7) {
      if (!IsGiven("distances")) {
        FLAGS_distances =
            FLAGS_smoke ? "1e-2,1e-3,1e-4" : "1e-2,1e-3,1e-4,1e-5,1e-6";
      }
      if (!IsGiven("steps")) FLAGS_steps = FLAGS_smoke ? 2 : 10;
      // Set as by the user: IsGiven() decides whether there is a list.
      if (!IsGiven("seeds") && !IsGiven("seed") && FLAGS_input.empty()) {
        gflags::SetCommandLineOption("seeds", FLAGS_smoke ? "1-2" : "1-10");
      }
      if (!IsGiven("repetitions")) FLAGS_repetitions = 1;
    }
    if (!IsGiven("particles") && FLAGS_input.empty() && !FLAGS_smoke) {
      FLAGS_particles = 4096;
    }
    if (!IsGiven("max_evaluations")) FLAGS_max_evaluations = kPaperEvaluations;
    setup.levels = {{true, 1e-13}};
    // An absolute one would be four digits at 1e-2 and none at 1e-6.
    if (fig7) setup.levels = {{false, 1e-7}};
    if (table1) {
      setup.levels.push_back({true, 1e-10});
      setup.levels.push_back({false, 1e-6});
    }
  }
  if (FLAGS_smoke) {
    if (!IsGiven("particles") && FLAGS_input.empty()) FLAGS_particles = 64;
    if (!IsGiven("repetitions")) FLAGS_repetitions = 2;
    if (!IsGiven("distances")) FLAGS_distances = "1e-2,1e-3,1e-4";
  }
  Level level;
  if (GivenLevel(&level) || setup.levels.empty()) setup.levels = {level};
}

Plan MakePlan() {
  Plan plan;
  ComparisonSetup& setup = plan.setup;
  std::string error;
  const auto require = [&error](bool good, const char* flag) {
    if (!good) BadInput(std::string("--") + flag + ": " + error);
  };
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  CheckPositive("phi", FLAGS_phi);
  CheckPositive("tolerance", FLAGS_tolerance);
  CheckRange("absolute_tolerance", FLAGS_absolute_tolerance, 0.0, 1e300);
  CheckRange("max_seconds", FLAGS_max_seconds, 0.0, 1e300);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 0.0, 9e18);
  CheckRange("prepare_evaluations", FLAGS_prepare_evaluations, 0.0, 9e18);
  CheckPositive("shear", FLAGS_shear);
  CheckRange("shear", FLAGS_shear, 0.0, 1.0);
  CheckRange("steps", FLAGS_steps, 1.0, 1e5);
  ApplyPreset(&plan);
  CheckRange("repetitions", FLAGS_repetitions, 1.0, 1e6);
  setup.repetitions = FLAGS_repetitions;

  require(ParseMethods(FLAGS_solvers, &setup.methods, &error), "solvers");
  for (const Method& method : setup.methods) {
    plan.solvers.push_back(MakeSolver("solvers", method.spec));
  }
  plan.prepare = MakeSolver("prepare_solver", FLAGS_prepare_solver);
  require(ParseNumbers(FLAGS_distances, &plan.distances, &error), "distances");
  for (const double d : plan.distances) {
    if (d > 0.5 || d < 1e-12) {
      BadInput("--distances: " + Neat(d) + " must be in [1e-12, 0.5]");
    }
  }
  require(ParseCases(
              FLAGS_cases, plan.distances, FLAGS_shear, &setup.cases, &error),
          "cases");
  std::sort(plan.distances.begin(), plan.distances.end());
  setup.seeds = {FLAGS_seed};
  if (IsGiven("seeds")) {
    require(ParseSeeds(FLAGS_seeds, &setup.seeds, &error), "seeds");
  }
  SetBaselineAndReference(&setup);

  plan.phi = plan.phi_fig2 = FLAGS_phi;
  bool all_fig2 = true, any_near = false;
  for (const Case& c : setup.cases) {
    if (c.kind == "user" && FLAGS_input.empty()) {
      BadInput("--cases: user is the packing of --input, which is not given");
    }
    if (c.kind == "start" && !FLAGS_input.empty()) {
      BadInput("--cases: start is a random start and cannot go with --input");
    }
    all_fig2 = all_fig2 && c.kind == "fig2";
    any_near = any_near || c.kind == "near_jamming";
    if (c.kind == "fig2" && FLAGS_input.empty() && !IsGiven("phi")) {
      if (FLAGS_dimension != 2) BadInput("--cases: fig2 in 3D needs --phi");
      plan.phi_fig2 = kFig2Phi;
    }
  }
  if (IsGiven("steps") && !any_near) {
    BadInput("--steps is of the case near_jamming, which --cases lacks");
  }
  setup.steps = any_near ? FLAGS_steps : 1;
  for (const Case& c : setup.cases) {
    plan.runs +=
        static_cast<int>(SeedsOf(setup, c).size() * setup.methods.size()) *
        setup.repetitions * (c.kind == "near_jamming" ? setup.steps : 1);
  }
  if (all_fig2) plan.phi = plan.phi_fig2;

  plan.scene = MakeScene(plan.phi, setup.seeds[0]);
  const Packing& packing = plan.scene.packing;
  // A load that makes a packing impossible is found before any work.
  for (const Case& c : setup.cases) {
    Scene loaded;
    loaded.packing = packing;
    loaded.energy = plan.scene.energy;
    loaded.origin = plan.scene.origin + ", " + c.id;
    ApplyLoad(LoadOf(c), setup.seeds[0], &loaded.packing);
    CheckScene(loaded);
  }
  setup.what = FLAGS_input.empty()
                   ? Format("%d %s, phi = %s, alpha = %g",
                            packing.size(),
                            packing.dimension() == 2 ? "discs" : "spheres",
                            Neat(plan.phi).c_str(),
                            plan.scene.energy.alpha)
                   : Format("%s (%s), phi = %.6g, alpha = %g",
                            Describe(packing).c_str(),
                            FLAGS_input.c_str(),
                            packing.PackingFraction(),
                            plan.scene.energy.alpha);
  setup.conditions =
      "prepared by " + plan.prepare->name() +
      Format("; zero pressure %s", Neat(FLAGS_zero_pressure).c_str());
  if (FLAGS_max_seconds > 0.0) {
    setup.conditions +=
        Format("; at most %s s", Neat(FLAGS_max_seconds).c_str());
  }
  if (FLAGS_max_evaluations > 0) {
    setup.conditions += Format("; at most %lld evaluations",
                               static_cast<long long>(FLAGS_max_evaluations));
  }
  if (any_near && FLAGS_prepare_evaluations > 0) {
    setup.conditions +=
        Format("; steps prepared in at most %lld evaluations",
               static_cast<long long>(FLAGS_prepare_evaluations));
  }
  if (!setup.paper.empty()) AddAssumptions(&plan);
  return plan;
}

void PrintPlan(const Plan& plan) {
  const ComparisonSetup& setup = plan.setup;
  std::printf("compare   %s\n", setup.what.c_str());
  std::size_t width = 0;
  for (const Method& method : setup.methods) {
    width = std::max(width, method.label.size());
  }
  const char* head = "methods";
  for (const Method& method : setup.methods) {
    std::string line = method.label;
    if (method.label != method.spec) {
      line +=
          std::string(width - method.label.size(), ' ') + "  " + method.spec;
    }
    std::printf("%-9s %s%s\n",
                head,
                line.c_str(),
                method.label == setup.baseline ? "  (baseline)" : "");
    head = "";
  }
  const auto some = [](std::size_t count, const char* what) {
    return Format("%zu %s%s", count, what, count == 1 ? "" : "s");
  };
  std::printf(
      "runs      %d: %s x %s x %s%s x %s; a repetition\n"
      "          runs all methods on a packing before the next one and "
      "begins with another method\n",
      plan.runs,
      some(setup.methods.size(), "method").c_str(),
      some(setup.cases.size(), "case").c_str(),
      some(setup.seeds.size(), "seed").c_str(),
      setup.steps > 1 ? (" x " + some(setup.steps, "step")).c_str() : "",
      some(setup.repetitions, "repetition").c_str());
  std::fflush(stdout);
}

// ---------------------------------------------------------------- the binary

// False, with one line in `error`, if a state near jamming cannot be made.
bool MakeStarts(const Plan& plan,
                Preparation* preparation,
                Starts* starts,
                std::vector<StepRecord>* steps,
                std::string* error) {
  int expected = 0;
  for (const Case& c : plan.setup.cases) {
    if (c.kind != "near_jamming") continue;
    expected +=
        static_cast<int>(SeedsOf(plan.setup, c).size()) * plan.setup.steps;
  }
  preparation->ExpectSteps(expected);
  for (const std::uint64_t seed : plan.setup.seeds) {
    std::vector<Packing> near;
    for (const Case& c : plan.setup.cases) {
      const std::vector<std::uint64_t> seeds = SeedsOf(plan.setup, c);
      if (std::find(seeds.begin(), seeds.end(), seed) == seeds.end()) continue;
      Start start;
      if (c.kind == "near_jamming") {
        if (near.empty() &&
            !preparation->NearJamming(seed, plan.distances, &near, error)) {
          return false;
        }
        const auto at =
            std::find(plan.distances.begin(), plan.distances.end(), c.distance);
        const Packing& base = near[at - plan.distances.begin()];
        const double distance =
            base.PackingFraction() -
            std::strtod(base.attributes.at("phi_j").c_str(), nullptr);
        const std::string name =
            "near_jamming_" + Neat(c.distance) +
            (FLAGS_input.empty()
                 ? Format("_seed%llu", static_cast<unsigned long long>(seed))
                 : "") +
            "_shear_" + Neat(c.value) + (c.relative ? "x" : "");
        for (ShearStep& step : preparation->Shear(base,
                                                  name,
                                                  seed,
                                                  StrainOf(c),
                                                  plan.setup.steps,
                                                  FLAGS_prepare_evaluations)) {
          Start& one = (*starts)[{c.id, seed, step.record.step}];
          one.packing = step.start;
          one.distance = distance;
          step.record.case_id = c.id;
          steps->push_back(step.record);
          one.step = std::make_unique<ShearStep>(std::move(step));
          one.step->start = Packing();
        }
        continue;
      } else if (c.kind == "fig2") {
        start.packing = preparation->Compressed(seed, plan.phi_fig2);
      } else if (c.kind == "start") {
        start.packing = MakeScene(plan.phi, seed).packing;
      } else {
        start.packing = preparation->Relaxed(seed);
      }
      ApplyLoad(LoadOf(c), seed, &start.packing);
      (*starts)[{c.id, seed, 1}] = std::move(start);
    }
  }
  return true;
}

// Seconds that the runs from `done` on will take, from those before.
class Estimate {
 public:
  // `starts`: all that will be run.
  Estimate(const Plan& plan, const Starts& starts)
      : plan_(plan), starts_(starts) {}

  void Add(const Place& place, int method, double seconds) {
    known_[{place, method}] = seconds;
    auto& [sum, count] = by_method_[method];
    sum += seconds;
    ++count;
    total_ += seconds;
    ++done_;
  }

  double Left() const {
    const std::size_t instances = starts_.size() * plan_.solvers.size();
    if (known_.size() == instances) {
      return total_ / done_ * (Runs() - done_);
    }
    // The first repetition: a method is as slow in other cases as so far.
    double left = -total_;
    for (const auto& [place, start] : starts_) {
      for (int m = 0; m < static_cast<int>(plan_.solvers.size()); ++m) {
        const auto found = known_.find({place, m});
        const auto method = by_method_.find(m);
        left += plan_.setup.repetitions *
                (found != known_.end() ? found->second
                 : method != by_method_.end()
                     ? method->second.first / method->second.second
                     : total_ / done_);
      }
    }
    return left;
  }

  int done() const { return done_; }
  int Runs() const {
    return static_cast<int>(starts_.size() * plan_.solvers.size()) *
           plan_.setup.repetitions;
  }

 private:
  const Plan& plan_;
  const Starts& starts_;
  std::map<std::pair<Place, int>, double> known_;
  std::map<int, std::pair<double, int>> by_method_;
  double total_ = 0.0;
  int done_ = 0;
};

// Takes up what an interrupted comparison has left in `raw`: blocks (repetition
// and packing) in which every method has run. What else is there is run again.
void TakeUp(const Plan& plan, Raw raw, Records* records) {
  using Block = std::pair<Place, int>;
  std::map<Block, std::size_t> size;
  for (const RunRecord& run : raw.runs) {
    ++size[{PlaceOf(run.key), run.key.repetition}];
  }
  const auto complete = [&](const RunKey& key) {
    return size[{PlaceOf(key), key.repetition}] == plan.solvers.size();
  };
  for (Event& event : raw.events) {
    if (complete(event.key)) records->events.push_back(std::move(event));
  }
  for (RunRecord& run : raw.runs) {
    if (!complete(run.key)) continue;
    records->ends[{PlaceOf(run.key), run.key.label}] = {run.energy,
                                                        run.minimum};
    records->runs.push_back(std::move(run));
  }
  for (CurveRow& row : raw.curves) {
    if (size[{Place(row.case_id, row.seed, 1), 1}] == plan.solvers.size()) {
      records->curves.push_back(std::move(row));
    }
  }
}

void RunAll(const Plan& plan,
            const Starts& starts,
            Output* output,
            Records* records) {
  const ComparisonSetup& setup = plan.setup;
  Progress progress;
  Estimate estimate(plan, starts);
  const double began = WallSeconds();
  double written = began;
  // Runs last: what they name is in the other two files.
  const auto write = [&] {
    output->Write("events.csv", EventsCsv(records->events));
    output->Write("curves.csv", CurvesCsv(records->curves));
    output->Write("runs.csv", RunsCsv(records->runs));
  };
  std::set<std::pair<Place, int>> done;
  for (const RunRecord& run : records->runs) {
    done.insert({PlaceOf(run.key), run.key.repetition});
    for (int m = 0; m < static_cast<int>(plan.solvers.size()); ++m) {
      if (setup.methods[m].label == run.key.label) {
        estimate.Add(PlaceOf(run.key), m, run.seconds);
      }
    }
  }
  const auto run_block = [&](const Place& place, int r) {
    const auto& [id, seed, step] = place;
    int position = 0;
    for (const int m :
         MethodOrder(static_cast<int>(plan.solvers.size()), r + step - 1)) {
      const Method& method = setup.methods[m];
      const double run_began = WallSeconds();
      const std::string what =
          id + (setup.steps > 1 ? Format(", step %d", step) : "");
      const auto show = [&](const IterationState& state) {
        if (!progress.Due()) return;
        progress.Show(
            Format("run %d of %d, %.0f s gone%s | %s, %s, iteration %lld: "
                   "|g| / mean force %.1e",
                   estimate.done() + 1,
                   estimate.Runs(),
                   WallSeconds() - began,
                   estimate.done() > 0
                       ? Format(", about %.0f s left", estimate.Left()).c_str()
                       : "",
                   what.c_str(),
                   method.label.c_str(),
                   static_cast<long long>(state.counters.iterations),
                   state.scales.gradient > 0.0
                       ? state.max_gradient / state.scales.gradient
                       : 0.0));
      };
      RunOne({id, seed, r + 1, method.label, method.spec, step},
             ++position,
             starts.at(place),
             plan.scene.energy,
             *plan.solvers[m],
             setup,
             show,
             records);
      estimate.Add(place, m, WallSeconds() - run_began);
    }
  };
  for (int r = 0; r < setup.repetitions; ++r) {
    for (const Case& c : setup.cases) {
      for (const std::uint64_t seed : SeedsOf(setup, c)) {
        for (int step = 1; step <= setup.steps; ++step) {
          const Place place(c.id, seed, step);
          // A chain may end early, other cases have one step.
          if (starts.count(place) == 0 || done.count({place, r + 1}) > 0) {
            continue;
          }
          run_block(place, r);
          // What is on disk is never old, and of whole blocks.
          const double now = WallSeconds();
          if (now - written > 10.0) {
            write();
            written = now;
          }
        }
      }
    }
  }
  write();
}

Json SummaryJson(const Plan& plan,
                 const Preparation& preparation,
                 const Records& records,
                 const std::vector<Table>& tables) {
  const Scene& scene = plan.scene;
  std::size_t converged = 0;
  for (const RunRecord& run : records.runs) converged += run.converged ? 1 : 0;
  Json json;
  json["converged"] = converged == records.runs.size();
  json["runs"] = records.runs.size();
  json["runs_converged"] = converged;
  json["alpha"] = scene.energy.alpha;
  json["k"] = scene.energy.stiffness;
  json["precision"] = PrecisionName(scene.energy.precision);
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["prepare_solver"] = plan.prepare->name();
  json["prepared"] = preparation.json();
  json["tables"] = Json::array();
  for (const Table& table : tables) {
    Json one;
    one["case"] = table.table_case.id;
    one["absolute"] = table.level.absolute;
    one["level"] = table.level.value;
    one["rows"] = Json::array();
    for (const TableRow& row : table.rows) {
      // Infinite (never reached) is null in JSON.
      one["rows"].push_back({{"solver", row.method.label},
                             {"runs", row.runs},
                             {"reached", row.reached},
                             {"iterations", row.iterations.median},
                             {"evaluations", row.evaluations.median},
                             {"cpu_seconds", row.cpu_seconds.median},
                             {"ratio", row.ratio.median},
                             {"minima", row.minima},
                             {"end", row.end}});
    }
    json["tables"].push_back(one);
  }
  json["setup"] = Json::parse(FormatSetup(plan.setup));
  json["schema"] = "granopt/compare/1";
  json["provenance"] = Provenance();
  return json;
}

// What is in --out of an interrupted comparison; false if nothing. BadInput if
// it was another one.
bool ReadInterrupted(const Plan& plan, Raw* raw) {
  const std::string setup = FLAGS_out + "/setup.json";
  std::string text, error;
  if (!Exists(setup)) return false;
  if (!ReadFile(setup, &text, &error)) BadInput("--resume: " + error);
  if (text != FormatSetup(plan.setup)) {
    BadInput("--resume: " + setup +
             " is of a comparison with other flags; give the same ones, or "
             "another --out");
  }
  // Written in this order.
  if (!Exists(FLAGS_out + "/runs.csv")) return true;
  *raw = ReadRaw(FLAGS_out);
  const std::string curves = FLAGS_out + "/curves.csv";
  if (!ReadFile(curves, &text, &error) ||
      !ParseCurves(text, curves, &raw->curves, &error)) {
    BadInput("--resume: " + error);
  }
  return true;
}

int Main() {
  ListSolversIfAsked();
  if (IsGiven("replot")) {
    if (FLAGS_replot.empty()) BadInput("--replot= is empty");
    return Replot();
  }
  if (IsGiven("protocol")) return CompareProtocols();
  for (const char* flag : {"tolerances",
                           "phi_init",
                           "dphi",
                           "epsilon",
                           "strain",
                           "strain_steps"}) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag + " needs --protocol");
    }
  }
  const Plan plan = MakePlan();
  Raw before;
  const bool resumed = FLAGS_resume && ReadInterrupted(plan, &before);
  std::vector<std::string> names = ComparisonFiles(/*raw=*/!resumed);
  for (const std::string& name : ProtocolFiles(/*raw=*/!resumed)) {
    names.push_back(name);
  }
  Output output;
  output.Create(FLAGS_out, names);
  PrintPlan(plan);
  output.Write("setup.json", FormatSetup(plan.setup));

  Preparation preparation(plan.scene, *plan.prepare, plan.phi, &output);
  Starts starts;
  std::vector<StepRecord> steps;
  std::string error;
  if (!MakeStarts(plan, &preparation, &starts, &steps, &error)) {
    preparation.ClearProgress();
    std::fprintf(stderr, "compare: near_jamming: %s\n", error.c_str());
    return kNotConverged;
  }
  preparation.ClearProgress();
  const char* head = "prepared";
  for (const std::string& line : preparation.lines()) {
    std::printf("%-9s %s\n", head, line.c_str());
    head = "";
  }
  if (FLAGS_input.empty() || preparation.lines().size() > 1) {
    std::printf(
        "          (kept as prepared_<name>.xyz; used again by a later "
        "comparison in this folder)\n");
  }
  std::fflush(stdout);

  if (!steps.empty()) output.Write("steps.csv", StepsCsv(steps));
  Records records;
  if (FLAGS_resume) {
    TakeUp(plan, std::move(before), &records);
    std::printf("resumed   %zu runs were there\n", records.runs.size());
    std::fflush(stdout);
  }
  RunAll(plan, starts, &output, &records);
  const std::vector<Table> tables =
      Report(plan.setup, output.folder(), ReadRaw(output.folder()), &output);
  output.WriteJson("summary.json",
                   SummaryJson(plan, preparation, records, tables));
  output.PrintFiles();
  bool converged = true;
  for (const RunRecord& run : records.runs) {
    converged = converged && run.converged;
  }
  return converged ? kConverged : kNotConverged;
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "compare methods on the same packings: work, time and "
                      "where they end, with tables and figures");
  return granopt::Main();
}
