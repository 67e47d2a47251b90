// compare: methods against each other on the same packings, interleaved.
//
//   compare --solvers="label@spec;spec;..." --cases=growth,simple_shear,random
//           --input=F.xyz | --particles=N --phi=P --seeds=1-3
//           --repetitions=3 --tolerance=1e-10 | --paper=table1|fig2
//           --out=DIR
//   compare --replot=DIR
//
// Raw events first (events.csv, runs.csv, curves.csv), then tables and figures
// from these alone, which --replot makes again. Times are CPU seconds of
// Minimize() alone; preparing the packings and measuring the results is not in
// them.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "experiments/comparison.h"
#include "experiments/run.h"
#include "experiments/scene.h"
#include "granular/atomic_file.h"
#include "granular/jamming.h"
#include "granular/packing_io.h"
#include "granular/quad_residual.h"
#include "granular/relaxation.h"

DEFINE_string(solvers,
              "ceres_lbfgs:scaled=1,differences=1,restarts=10;"
              "ceres_ncg:beta=pr,scaled=1,differences=1,restarts=10",
              "methods, separated by semicolons, each as name:key=value,... or "
              "label@name:key=value,... (see --list_solvers)");
DEFINE_string(
    cases,
    "growth,simple_shear,random",
    "what is relaxed, separated by commas: growth, simple_shear, "
    "pure_shear, random, fig2, near_jamming, start, user; with a size "
    "as in growth=5e-5");
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
DEFINE_string(prepare_solver,
              granopt::kDefaultSolver,
              "the method that relaxes the packings before the loads");
DEFINE_string(baseline,
              "",
              "label of the method that times are divided by; default: the "
              "first");
DEFINE_string(paper,
              "",
              "the paper's parameters: table1 or fig2 (each can be changed by "
              "its flag)");
DEFINE_string(replot,
              "",
              "folder of an earlier comparison: make its tables and figures "
              "again, run nothing");

namespace granopt {
namespace {

constexpr double kPreparedTolerance = 1e-12;  // relative
constexpr double kGrowth = 1e-3;  // steps in phi of the compression for fig2
constexpr int kCurveBuckets = 95;
constexpr int kCasesPerFigure = 3;

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

double CpuSeconds() {
  std::timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) +
         1e-9 * static_cast<double>(now.tv_nsec);
}

double WallSeconds() {
  return std::chrono::duration<double>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

long long Wide(std::uint64_t seed) { return static_cast<long long>(seed); }

// ---------------------------------------------------------------- figures

std::vector<std::string> FigureNames(int cases) {
  std::vector<std::string> names;
  const int pages = (cases + kCasesPerFigure - 1) / kCasesPerFigure;
  for (const char* base : {"curves", "work"}) {
    for (int page = 1; page <= pages; ++page) {
      names.push_back(page == 1 ? base : Format("%s_%d", base, page));
    }
  }
  names.push_back("distances");
  return names;
}

// `data`: the folder of the raw files; figures go to the folder of `output`.
void Draw(const Setup& setup, const std::string& data, Output* output) {
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
  int near = 0;
  for (const Case& c : setup.cases) near += c.kind == "near_jamming";
  if (near > 1) {
    draw("distances",
         {"distances", output->Path("tables.csv"), output->Path("distances")});
  }
}

// Tables and figures from the raw files in `data`; prints the tables.
std::vector<Table> Report(const Setup& setup,
                          const std::string& data,
                          Output* output) {
  std::string text, error;
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  if (!ReadFile(data + "/events.csv", &text, &error) ||
      !ParseEvents(text, data + "/events.csv", &events, &error) ||
      !ReadFile(data + "/runs.csv", &text, &error) ||
      !ParseRuns(text, data + "/runs.csv", &runs, &error)) {
    BadInput(error);
  }
  const std::vector<Table> tables = Tabulate(setup, events, runs);
  output->Write("tables.csv", TablesCsv(tables));
  output->Write("tables.md", TablesText(setup, tables, runs, true));
  std::fputs(TablesText(setup, tables, runs, false).c_str(), stdout);
  Draw(setup, data, output);
  int converged = 0;
  for (const RunRecord& run : runs) converged += run.converged ? 1 : 0;
  std::printf("\n%d of %zu runs converged\n", converged, runs.size());
  output->PrintFiles();
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

void SetBaseline(Setup* setup) {
  if (!IsGiven("baseline")) {
    if (setup->baseline.empty()) setup->baseline = setup->methods[0].label;
    return;
  }
  std::string known;
  for (const Method& method : setup->methods) {
    if (method.label == FLAGS_baseline || method.spec == FLAGS_baseline) {
      setup->baseline = method.label;
      return;
    }
    known += (known.empty() ? "" : "; ") + method.label;
  }
  BadInput("--baseline: no method is labelled '" + FLAGS_baseline +
           "'; there are " + known);
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
                           "paper",
                           "prepare_solver",
                           "input",
                           "particles",
                           "dimension",
                           "alpha",
                           "smoke",
                           "zero_pressure"}) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag + " cannot go with --replot");
    }
  }
  std::string data = FLAGS_replot, text, error;
  while (data.size() > 1 && data.back() == '/') data.pop_back();
  Setup setup;
  if (!ReadFile(data + "/setup.json", &text, &error) ||
      !ParseSetup(text, data + "/setup.json", &setup, &error)) {
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
  SetBaseline(&setup);
  for (const char* name : {"/events.csv", "/runs.csv"}) {
    if (!ReadFile(data + name, &text, &error)) BadInput("--replot: " + error);
  }
  std::vector<std::string> names = {"tables.csv", "tables.md"};
  for (const std::string& name :
       FigureNames(static_cast<int>(setup.cases.size()))) {
    names.push_back(name + ".svg");
    names.push_back(name + ".png");
  }
  Output output;
  output.Create(IsGiven("out") ? FLAGS_out : data, names);
  std::printf("compare   tables and figures of %s again\n", data.c_str());
  Report(setup, data, &output);
  return kConverged;
}

// ---------------------------------------------------------------- packings

// Makes the states that loads are applied to, and keeps them as files.
class Preparation {
 public:
  Preparation(const Scene& scene, const Solver& solver, Output* output)
      : scene_(scene), solver_(solver), output_(output) {}

  // One line a state.
  const std::vector<std::string>& lines() const { return lines_; }
  const Json& json() const { return json_; }

  // The input, or a random start relaxed at --phi.
  Packing Relaxed(std::uint64_t seed) {
    if (!FLAGS_input.empty()) return scene_.packing;
    return Kept(Format("relaxed_seed%lld", Wide(seed)),
                GeneratedKey("relaxed", seed, FLAGS_phi),
                [&] {
                  return Relaxed(MakeScene(FLAGS_phi, seed).packing,
                                 kPreparedTolerance);
                });
  }

  // Compressed from 0.80 to `phi` in steps of kGrowth at fixed positions, each
  // relaxed, as Algorithm 1 of the paper does.
  Packing Compressed(std::uint64_t seed, double phi) {
    if (!FLAGS_input.empty()) return scene_.packing;
    const double first = std::min(0.80, phi);
    return Kept(
        Format("fig2_seed%lld", Wide(seed)),
        GeneratedKey(Format("compressed from %.17g", first), seed, phi),
        [&] {
          Packing packing = MakeScene(first, seed).packing;
          const int steps =
              std::max(1, static_cast<int>(std::ceil((phi - first) / kGrowth)));
          for (int step = 0; step <= steps; ++step) {
            stage_ = Format("compression, step %d of %d", step, steps);
            packing.SetPackingFraction(first + (phi - first) * step / steps);
            packing =
                Relaxed(packing, step == steps ? kPreparedTolerance : 1e-8);
          }
          stage_.clear();
          return packing;
        });
  }

  // States at phi_J + each of `distances`, increasing: from a jammed state down
  // its branch to phi_J, then compressed from distance to distance.
  std::vector<Packing> NearJamming(std::uint64_t seed,
                                   const std::vector<double>& distances) {
    std::string which;
    for (const double d : distances) which += "," + Neat(d);
    const std::string key =
        GeneratedKey("near jamming at" + which, seed, FLAGS_phi);
    std::vector<Packing> states(distances.size());
    const auto name = [&](std::size_t k) {
      return "near_jamming_" + Neat(distances[k]) +
             Format("_seed%lld", Wide(seed));
    };
    bool all = true;
    for (std::size_t k = 0; k < distances.size() && all; ++k) {
      all = Reuse(name(k), key, &states[k]);
    }
    if (all) return states;
    JammingResult jamming = Jam(seed, 0.1 * distances[0]);
    Packing packing = jamming.jammed.packing;
    for (std::size_t k = 0; k < distances.size(); ++k) {
      stage_ = "phi_J + " + Neat(distances[k]);
      packing.SetPackingFraction(jamming.phi_j + distances[k]);
      packing = Relaxed(packing, kPreparedTolerance);
      packing.attributes["phi_j"] = Format("%.17g", jamming.phi_j);
      Keep(name(k), key, packing);
      states[k] = packing;
    }
    stage_.clear();
    return states;
  }

 private:
  std::string GeneratedKey(const std::string& what,
                           std::uint64_t seed,
                           double phi) const {
    std::string start;
    if (FLAGS_input.empty()) {
      start = Format("%d grains in %dD, seed %lld, phi %.17g",
                     FLAGS_particles,
                     FLAGS_dimension,
                     Wide(seed),
                     phi);
    } else {
      // FNV-1a of the input.
      std::uint64_t hash = 14695981039346656037u;
      for (const char c : FormatPacking(scene_.packing)) {
        hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
      }
      start = Format("input %016llx", static_cast<unsigned long long>(hash));
    }
    return what + Format("; alpha %.17g; ", scene_.energy.alpha) + start +
           "; " + solver_.name();
  }

  template <typename Make>
  Packing Kept(const std::string& name, const std::string& key, Make make) {
    Packing packing;
    if (Reuse(name, key, &packing)) return packing;
    packing = make();
    Keep(name, key, packing);
    return packing;
  }

  std::string FileOf(const std::string& name) const {
    return "prepared_" + name + ".xyz";
  }

  bool Reuse(const std::string& name,
             const std::string& key,
             Packing* packing) {
    std::string error;
    if (!ReadPacking(output_->Path(FileOf(name)), packing, &error))
      return false;
    const auto found = packing->attributes.find("prepared");
    if (found == packing->attributes.end() || found->second != key)
      return false;
    Describe(name, *packing, " (reused)");
    return true;
  }

  void Keep(const std::string& name, const std::string& key, Packing packing) {
    packing.attributes["prepared"] = key;
    output_->WritePacking(FileOf(name), packing);
    Describe(name, packing, "");
  }

  void Describe(const std::string& name,
                const Packing& packing,
                const char* remark) {
    QuadResidual judge;
    std::string error;
    if (!EvaluateQuad(packing, scene_.energy, nullptr, &judge, &error)) {
      BadInput(error);
    }
    const auto attribute = [&](const char* key) {
      const auto found = packing.attributes.find(key);
      return found == packing.attributes.end()
                 ? 0.0
                 : std::strtod(found->second.c_str(), nullptr);
    };
    const double pressure = attribute("pressure");
    const double phi = packing.PackingFraction();
    const double phi_j = attribute("phi_j");
    lines_.push_back(
        name + ": " +
        (pressure > 0.0
             ? Format("phi = %.10g, p = %.3e, residual %.0e mean forces",
                      phi,
                      pressure,
                      judge.Relative())
             : Format("phi = %.10g, unjammed", phi)) +
        (phi_j > 0.0 ? Format(", phi - phi_J = %.3e", phi - phi_j) : "") +
        remark);
    json_.push_back({{"file", FileOf(name)},
                     {"phi", phi},
                     {"pressure", pressure},
                     {"energy", judge.energy},
                     {"quad_relative_residual", judge.Relative()}});
    if (phi_j > 0.0) json_.back()["phi_j"] = phi_j;
  }

  SolveOptions Options(double tolerance) {
    SolveOptions options = MakeSolveOptions();
    options.relative_tolerance = tolerance;
    options.callback = [this](const IterationState& state) {
      if (progress_.Due()) {
        progress_.Show(
            Format("preparing%s%s | iteration %lld: |g| / mean force %.1e",
                   stage_.empty() ? "" : ": ",
                   stage_.c_str(),
                   static_cast<long long>(state.counters.iterations),
                   state.scales.gradient > 0.0
                       ? state.max_gradient / state.scales.gradient
                       : 0.0));
      }
      return true;
    };
    return options;
  }

  Packing Relaxed(const Packing& start, double tolerance) {
    Relaxation result;
    std::string error;
    if (!Relax(start,
               scene_.energy,
               solver_,
               Options(tolerance),
               &result,
               &error)) {
      BadInput(scene_.origin + ": " + error);
    }
    last_jammed_ = result.summary.reason != StopReason::VANISHED;
    if (!last_jammed_) result.observables.pressure = 0.0;
    return Annotated(result, scene_.energy);
  }

  // A state at most `error_bar` above its jamming point.
  JammingResult Jam(std::uint64_t seed, double error_bar) {
    Packing start = Relaxed(seed);
    // What is unjammed at --phi is compressed until it jams.
    stage_ = "compressing until it jams";
    start = Relaxed(start, 1e-8);
    for (int step = 0; !last_jammed_ && step < 100; ++step) {
      start.SetPackingFraction(start.PackingFraction() + 5e-3);
      start = Relaxed(start, 1e-8);
    }
    JammingOptions options;
    options.energy = scene_.energy;
    options.solve = Options(1e-8);
    options.solve.vanishing_tolerance = 1e-3 * options.accuracy;
    options.error_bar = error_bar;
    stage_ = "down to phi_J";
    const auto observer = [this](const JammingStep& step) {
      stage_ = Format("%s to phi_J, phi = %.10f, p = %.1e",
                      JammingStageName(step.stage),
                      step.phi,
                      step.result->observables.pressure);
      return true;
    };
    JammingResult result;
    std::string error;
    const bool found =
        DecompressToJamming(start, options, solver_, observer, &result, &error);
    if (!found || !result.converged) {
      progress_.Clear();
      std::fprintf(
          stderr,
          "compare: near_jamming, %s: %s\n",
          scene_.origin.c_str(),
          found ? Format("the error bar of phi_J is only %.1e", result.distance)
                      .c_str()
                : error.c_str());
      std::exit(kNotConverged);
    }
    return result;
  }

  const Scene& scene_;
  const Solver& solver_;
  Output* output_;
  Progress progress_;
  std::string stage_;
  bool last_jammed_ = true;
  std::vector<std::string> lines_;
  Json json_ = Json::array();
};

// ---------------------------------------------------------------- runs

// A packing that methods start from.
struct Start {
  Packing packing;
  double distance = 0.0;
};

Load LoadOf(const Case& c) {
  Load load;
  if (c.kind == "growth" || c.kind == "fig2") {
    load.radius_factor = 1.0 + c.value;
  } else if (c.kind == "simple_shear" || c.kind == "near_jamming") {
    load.simple_shear = c.value;
  } else if (c.kind == "pure_shear") {
    load.pure_shear = c.value;
  } else if (c.kind == "random") {
    load.perturbation = c.value;
  }
  return load;
}

// The seeds of a case: with an input only random displacements depend on one.
std::vector<std::uint64_t> SeedsOf(const Setup& setup, const Case& c) {
  if (FLAGS_input.empty() || c.kind == "random") return setup.seeds;
  return {setup.seeds[0]};
}

struct Records {
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  std::vector<CurveRow> curves;
  // Of each case and seed.
  std::map<std::pair<std::string, std::uint64_t>, Minima> minima;
};

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
            const Setup& setup,
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
  // Repetitions differ by their times only.
  const bool curve = key.repetition == 1;
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
  run.minimum = records->minima[{key.case_id, key.seed}].Tag(
      o.energy,
      judge.Relative(),
      s.reason == StopReason::VANISHED,
      o.mean_overlap,
      displacements,
      o.is_rattler);
  run.distance = start.distance;
  run.list_builds = result.list_builds;
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

// ---------------------------------------------------------------- the binary

void AddAssumptions(const std::string& prepare_solver,
                    double alpha,
                    Setup* setup) {
  auto& rows = setup->assumptions;
  std::string methods;
  for (const Method& method : setup->methods) {
    methods += (methods.empty() ? "" : "; ") + method.spec;
  }
  const auto given = [](const char* flag, const char* otherwise) {
    return IsGiven(flag) ? std::string("given by --") + flag
                         : std::string(otherwise);
  };
  rows.emplace_back("exponent alpha",
                    Neat(alpha) + given("alpha", ", the harmonic law"));
  if (IsGiven("alpha")) rows.back().second = Neat(alpha) + ", given by --alpha";
  std::string levels;
  for (const Level& level : setup->levels) {
    levels += (levels.empty() ? "" : ", ") + Neat(level.value) +
              (level.absolute ? " absolute" : " mean forces");
  }
  rows.emplace_back(
      "tolerance",
      "max|g| <= " + levels +
          (setup->levels.size() > 1 ? "; all from the runs to the first" : ""));
  rows.emplace_back("units of an absolute tolerance",
                    "k = 1, L = V^(1/d) = 1: max|g| / (k L^(alpha-1))");
  rows.emplace_back("memory m of L-BFGS, line search, r_nn, mu",
                    "as in the methods' options: " + methods);
  rows.emplace_back("meaning of n_iter",
                    "accepted steps; evaluations of E and its gradient beside "
                    "them");
  const std::string origin =
      !FLAGS_input.empty()
          ? "the input " + FLAGS_input
          : "uniform random centres, radii 1 : 1.4 half and half";
  if (setup->paper == "fig2") {
    rows.emplace_back(
        "the unjammed state",
        FLAGS_input.empty()
            ? origin +
                  Format("; relaxed at phi = 0.80, compressed to phi by "
                         "radii in steps of %g, relaxed after each, by ",
                         kGrowth) +
                  prepare_solver
            : origin);
    rows.emplace_back("phi of the caption", "that before the radii grow");
  } else {
    rows.emplace_back("the over-jammed state",
                      FLAGS_input.empty()
                          ? origin +
                                Format("; relaxed at phi to %g mean forces by ",
                                       kPreparedTolerance) +
                                prepare_solver
                          : origin);
    rows.emplace_back("random perturbation O(1e-4)",
                      "each coordinate by a uniform number in +-1e-4 L");
    rows.emplace_back("shear strain",
                      "cell and centres deformed affinely, then relaxed in the "
                      "deformed periodic cell");
  }
  rows.emplace_back("time",
                    "CPU seconds of this machine, one thread; ratios to " +
                        setup->baseline + " compare");
}

int Main() {
  ListSolversIfAsked();
  if (IsGiven("replot")) {
    if (FLAGS_replot.empty()) BadInput("--replot= is empty");
    return Replot();
  }
  Setup setup;
  std::string error;
  setup.paper = FLAGS_paper;
  if (FLAGS_paper == "table1" || FLAGS_paper == "fig2") {
    const bool table = FLAGS_paper == "table1";
    if (!IsGiven("solvers"))
      FLAGS_solvers = table ? kTable1Solvers : kFig2Solvers;
    if (!IsGiven("cases"))
      FLAGS_cases = table ? "growth,simple_shear,random" : "fig2";
    if (!IsGiven("particles") && !FLAGS_smoke) FLAGS_particles = 4096;
    setup.levels = {{true, 1e-13}};
    if (table) setup.levels.push_back({true, 1e-10});
    if (table) setup.levels.push_back({false, 1e-6});
  } else if (!FLAGS_paper.empty()) {
    BadInput("--paper=" + FLAGS_paper + " must be table1 or fig2");
  }
  if (FLAGS_smoke) {
    if (!IsGiven("particles")) FLAGS_particles = 64;
    if (!IsGiven("repetitions")) FLAGS_repetitions = 2;
    if (!IsGiven("distances")) FLAGS_distances = "1e-2,1e-3,1e-4";
  }
  if (!FLAGS_input.empty() && IsGiven("phi")) {
    BadInput("--phi describes a random start and cannot go with --input");
  }
  CheckPositive("phi", FLAGS_phi);
  CheckRange("repetitions", FLAGS_repetitions, 1.0, 1e6);
  CheckRange("absolute_tolerance", FLAGS_absolute_tolerance, 0.0, 1e300);
  CheckRange("max_seconds", FLAGS_max_seconds, 0.0, 1e300);
  CheckRange("max_evaluations", FLAGS_max_evaluations, 0.0, 9e18);
  CheckPositive("shear", FLAGS_shear);
  CheckRange("shear", FLAGS_shear, 0.0, 1.0);
  setup.repetitions = FLAGS_repetitions;
  Level level;
  if (GivenLevel(&level) || setup.levels.empty()) setup.levels = {level};

  if (!ParseMethods(FLAGS_solvers, &setup.methods, &error)) {
    BadInput("--solvers: " + error);
  }
  std::vector<std::unique_ptr<Solver>> solvers;
  for (const Method& method : setup.methods) {
    solvers.push_back(MakeSolver("solvers", method.spec));
  }
  const std::unique_ptr<Solver> prepare =
      MakeSolver("prepare_solver", FLAGS_prepare_solver);
  std::vector<double> distances;
  if (!ParseNumbers(FLAGS_distances, &distances, &error)) {
    BadInput("--distances: " + error);
  }
  for (const double d : distances) {
    if (d > 0.5 || d < 1e-12) {
      BadInput("--distances: " + Neat(d) + " must be in [1e-12, 0.5]");
    }
  }
  if (!ParseCases(FLAGS_cases, distances, FLAGS_shear, &setup.cases, &error)) {
    BadInput("--cases: " + error);
  }
  if (IsGiven("seeds")) {
    if (!ParseSeeds(FLAGS_seeds, &setup.seeds, &error)) {
      BadInput("--seeds: " + error);
    }
  } else {
    setup.seeds = {FLAGS_seed};
  }
  double phi_fig2 = FLAGS_phi;
  for (const Case& c : setup.cases) {
    if (c.kind == "user" && FLAGS_input.empty()) {
      BadInput("--cases: user is the packing of --input, which is not given");
    }
    if (c.kind == "start" && !FLAGS_input.empty()) {
      BadInput("--cases: start is a random start and cannot go with --input");
    }
    if (c.kind == "fig2" && !IsGiven("phi")) {
      if (FLAGS_dimension != 2) BadInput("--cases: fig2 in 3D needs --phi");
      phi_fig2 = 0.8389;
    }
  }
  if (FLAGS_paper == "fig2" && !IsGiven("phi")) FLAGS_phi = phi_fig2;
  SetBaseline(&setup);

  const Scene scene = MakeScene(FLAGS_phi, setup.seeds[0]);
  // A load that makes a packing impossible is found before any work.
  for (const Case& c : setup.cases) {
    Scene loaded;
    loaded.packing = scene.packing;
    loaded.energy = scene.energy;
    loaded.origin = scene.origin + ", " + c.id;
    ApplyLoad(LoadOf(c), setup.seeds[0], &loaded.packing);
    CheckScene(loaded);
  }
  setup.what =
      FLAGS_input.empty()
          ? Format("%d %s, phi = %s, alpha = %g",
                   scene.packing.size(),
                   scene.packing.dimension() == 2 ? "discs" : "spheres",
                   Neat(FLAGS_phi).c_str(),
                   scene.energy.alpha)
          : Format("%s from %s, phi = %.6g, alpha = %g",
                   Describe(scene.packing).c_str(),
                   FLAGS_input.c_str(),
                   scene.packing.PackingFraction(),
                   scene.energy.alpha);
  if (!setup.paper.empty()) {
    AddAssumptions(prepare->name(), scene.energy.alpha, &setup);
  }

  std::vector<std::string> names = {"setup.json",
                                    "events.csv",
                                    "runs.csv",
                                    "curves.csv",
                                    "tables.csv",
                                    "tables.md",
                                    "summary.json"};
  for (const std::string& name : FigureNames(99)) {
    names.push_back(name + ".svg");
    names.push_back(name + ".png");
  }
  Output output;
  output.Create(FLAGS_out, names);
  int total = 0;
  for (const Case& c : setup.cases) {
    total += static_cast<int>(SeedsOf(setup, c).size() * setup.methods.size()) *
             setup.repetitions;
  }
  std::printf("compare   %s\n", setup.what.c_str());
  for (std::size_t m = 0; m < setup.methods.size(); ++m) {
    const Method& method = setup.methods[m];
    std::printf("%s%s%s%s%s\n",
                m == 0 ? "methods   " : "          ",
                method.label.c_str(),
                method.label == method.spec ? "" : "  =  ",
                method.label == method.spec ? "" : method.spec.c_str(),
                method.label == setup.baseline ? "  (baseline)" : "");
  }
  std::printf(
      "runs      %zu methods x %zu cases x %zu seeds x %d repetitions = "
      "%d; each repetition begins\n          with another method\n",
      setup.methods.size(),
      setup.cases.size(),
      setup.seeds.size(),
      setup.repetitions,
      total);
  std::fflush(stdout);
  output.Write("setup.json", FormatSetup(setup));

  // Starts, by case and seed.
  std::map<std::pair<std::string, std::uint64_t>, Start> starts;
  Json prepared;
  {
    Preparation preparation(scene, *prepare, &output);
    std::sort(distances.begin(), distances.end());
    for (const std::uint64_t seed : setup.seeds) {
      std::vector<Packing> near;
      for (const Case& c : setup.cases) {
        const std::vector<std::uint64_t> seeds = SeedsOf(setup, c);
        if (std::find(seeds.begin(), seeds.end(), seed) == seeds.end())
          continue;
        Start start;
        if (c.kind == "near_jamming") {
          if (near.empty()) near = preparation.NearJamming(seed, distances);
          const auto at =
              std::find(distances.begin(), distances.end(), c.distance);
          start.packing = near[at - distances.begin()];
          start.distance =
              start.packing.PackingFraction() -
              std::strtod(start.packing.attributes["phi_j"].c_str(), nullptr);
        } else if (c.kind == "fig2") {
          start.packing = preparation.Compressed(seed, phi_fig2);
        } else if (c.kind == "start") {
          start.packing = MakeScene(FLAGS_phi, seed).packing;
        } else {
          start.packing = preparation.Relaxed(seed);
        }
        ApplyLoad(LoadOf(c), seed, &start.packing);
        starts[{c.id, seed}] = std::move(start);
      }
    }
    for (std::size_t k = 0; k < preparation.lines().size(); ++k) {
      std::printf("%s%s\n",
                  k == 0 ? "prepared  " : "          ",
                  preparation.lines()[k].c_str());
    }
    std::fflush(stdout);
    prepared = preparation.json();
  }

  Records records;
  {
    Progress progress;
    const double began = WallSeconds();
    double written = began;
    int done = 0;
    // Wall seconds of each run so far, measuring included.
    std::map<std::tuple<std::string, std::uint64_t, int>, double> known;
    std::vector<std::pair<double, int>> by_method(setup.methods.size());
    const auto write = [&] {
      output.Write("events.csv", EventsCsv(records.events));
      output.Write("runs.csv", RunsCsv(records.runs));
      output.Write("curves.csv", CurvesCsv(records.curves));
    };
    // What the runs that are left will take, as far as can be known.
    const auto left = [&](int repetition) {
      double sum = 0.0, mean = 0.0;
      for (const auto& [key, seconds] : known) mean += seconds;
      mean /= std::max<std::size_t>(1, known.size());
      for (const Case& c : setup.cases) {
        for (const std::uint64_t seed : SeedsOf(setup, c)) {
          for (int m = 0; m < static_cast<int>(solvers.size()); ++m) {
            const auto found = known.find({c.id, seed, m});
            const int times =
                setup.repetitions - repetition - (found == known.end() ? 0 : 1);
            const double each = found != known.end() ? found->second
                                : by_method[m].second > 0
                                    ? by_method[m].first / by_method[m].second
                                    : mean;
            sum += each * times;
          }
        }
      }
      return sum;
    };
    for (int r = 0; r < setup.repetitions; ++r) {
      for (const Case& c : setup.cases) {
        for (const std::uint64_t seed : SeedsOf(setup, c)) {
          const Start& start = starts.at({c.id, seed});
          int position = 0;
          for (const int m : MethodOrder(static_cast<int>(solvers.size()), r)) {
            const Method& method = setup.methods[m];
            const double run_began = WallSeconds();
            const auto show = [&](const IterationState& state) {
              if (!progress.Due()) return;
              const double gone = WallSeconds() - began;
              std::string rest;
              if (done > 0) {
                const double estimate =
                    r == 0 ? left(0) : gone / done * (total - done);
                rest = Format(", about %.0f s left", estimate);
              }
              progress.Show(Format(
                  "run %d of %d, %.0f s%s | %s, %s, iteration %lld: |g| / mean "
                  "force %.1e",
                  done + 1,
                  total,
                  gone,
                  rest.c_str(),
                  c.id.c_str(),
                  method.label.c_str(),
                  static_cast<long long>(state.counters.iterations),
                  state.scales.gradient > 0.0
                      ? state.max_gradient / state.scales.gradient
                      : 0.0));
            };
            RunOne({c.id, seed, r + 1, method.label, method.spec},
                   ++position,
                   start,
                   scene.energy,
                   *solvers[m],
                   setup,
                   show,
                   &records);
            const double now = WallSeconds();
            known[{c.id, seed, m}] = now - run_began;
            by_method[m].first += now - run_began;
            ++by_method[m].second;
            ++done;
            // What is on disk is never old.
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
  std::vector<Table> tables = Report(setup, output.folder(), &output);

  bool converged = true;
  for (const RunRecord& run : records.runs) converged &= run.converged;
  Json json;
  json["converged"] = converged;
  json["runs"] = records.runs.size();
  json["alpha"] = scene.energy.alpha;
  json["k"] = scene.energy.stiffness;
  json["dimension"] = scene.packing.dimension();
  json["particles"] = scene.packing.size();
  json["prepare_solver"] = prepare->name();
  json["prepared"] = prepared;
  json["setup"] = Json::parse(FormatSetup(setup));
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
  json["schema"] = "granopt/compare/1";
  json["provenance"] = Provenance();
  output.WriteJson("summary.json", json);
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
