// identify: the parameters that make a near-field flow behave as asked (Zohdi,
// Int. J. Solids Struct. 42 (2005) 539, sec. 8).
//
//   identify                    a search, its winners on fresh starts, what is
//                               determined and what is not
//   identify --paper            Fig. 7, Table 1, Fig. 8; other methods on the
//                               same budget; a profile; a recovery
//   identify --external ...     writes strings that others evaluate:
//   identify --worker ...       evaluates a share of them

#include <dirent.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
#include <numeric>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "experiments/checkpoint.h"
#include "experiments/flow_scene.h"
#include "experiments/identification.h"
#include "experiments/run.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"
#include "granular/packing_io.h"
#include "solvers/search/search.h"

// ---- what is searched
DEFINE_string(search,
              "alpha1:0:1,beta1:0:1,alpha2:0:1,beta2:1:2",
              "name:low:high of each parameter, any flag of a flow that is a "
              "number");
DEFINE_string(target,
              "",
              "CSV file with the columns time, T, T_b, T_r (s, J/kg)");
DEFINE_string(target_energies,
              "1,0.5,0.5",
              "T, T_b, T_r of a target that does not change, J/kg");
DEFINE_string(weights, "1,1,1", "w_E, w_Eb, w_Er of (8.5), for T, T_b, T_r");
DEFINE_string(recover,
              "",
              "values of the parameters: the target is what they do, on "
              "average over 20 starts; are they found again?");
// ---- how
DEFINE_string(method, "genetic_algorithm", "search (see --list_methods)");
DEFINE_bool(list_methods, false, "print the searches and exit");
DEFINE_int32(budget, 0, "most strings of the search; 0: the method's own end");
DEFINE_string(ensemble,
              "honest",
              "starts of a string: until two means in a row agree; paper: at "
              "least 2, honest: at least 5");
DEFINE_double(ensemble_tolerance, 0.01, "TOL of two means in a row");
DEFINE_int32(most_runs, 100, "starts of a string at most");
DEFINE_int32(most_steps,
             0,
             "time steps of a flow at most, 0: 100 duration / dt; where grains "
             "fall into each other steps shrink without end, and the string "
             "has no value");
DEFINE_int32(winners, 24, "strings that are tried again on fresh starts");
DEFINE_int32(fresh, 60, "those starts, the same for all of them");
DEFINE_bool(gradient, false, "go on from the best by Ceres (see README)");
DEFINE_int32(gradient_runs, 20, "starts of --gradient, the same for all");
DEFINE_int32(gradient_budget, 120, "strings of --gradient");
DEFINE_bool(profile,
            false,
            "the least P at fixed values of each parameter, others free");
DEFINE_int32(profile_points, 7, "values of each parameter in --profile");
DEFINE_int32(profile_budget, 30, "strings of each of them");
DEFINE_bool(alternatives, false, "other searches with as many runs");
DEFINE_int32(repeats, 2, "searches of each of --alternatives");
DEFINE_bool(recovery,
            false,
            "find the first string of Table 1 again from what it does");
DEFINE_bool(paper, false, "sec. 8.2: Fig. 7, Table 1, Fig. 8, and all above");
// ---- where
DEFINE_int32(threads,
             1,
             "results are the same bits on any number (--stepper=minimize: one "
             "flow at a time all the same)");
DEFINE_bool(resume,
            false,
            "go on with an interrupted run in --out; ends in the same bits");
DEFINE_bool(external,
            false,
            "evaluate nothing: write OUT/strings.csv for --worker, take "
            "OUT/values_*.csv, exit with 1 until all is there");
DEFINE_bool(worker,
            false,
            "evaluate a share of --strings, write OUT/values_LIST_k_of_n.csv; "
            "LIST is the CRC-32 of --strings: lists have files of their own");
DEFINE_string(strings, "", "strings.csv of --external");
DEFINE_string(share, "1/1", "k/n: of --strings the k-th of every n");

namespace granopt {
namespace {

using Strings = std::vector<std::vector<double>>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kGrid = 101;  // times of curves that are written
constexpr std::int64_t kUnlimited = std::numeric_limits<std::int64_t>::max();

// Streams of starts.
enum Stream { kSearch = 1, kFresh, kConfirm, kGradient, kProfile, kRecover };

// Table 1.
struct Published {
  double string[4];
  double value;
};
constexpr Published kTable1[] = {
    {{0.35935, 0.67398, 0.25659, 1.58766}, 0.065228},
    {{0.31214, 0.67816, 0.22113, 1.65054}, 0.065690},
    {{0.30032, 0.54474, 0.22240, 1.51649}, 0.070433},
    {{0.31143, 0.57278, 0.25503, 1.36696}, 0.073200},
    {{0.32872, 0.74653, 0.25560, 1.56315}, 0.078229},
    {{0.30580, 0.74276, 0.27228, 1.36962}, 0.090701}};

std::vector<double> ReadNumbers(const char* flag, const std::string& text) {
  std::vector<double> numbers;
  std::size_t at = 0;
  while (at <= text.size()) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    double value;
    if (!ParseDouble(text.substr(at, end - at), &value) ||
        !std::isfinite(value)) {
      BadInput(Format("--%s=%s: '%s' is not a number",
                      flag,
                      text.c_str(),
                      text.substr(at, end - at).c_str()));
    }
    numbers.push_back(value);
    at = end + 1;
  }
  return numbers;
}

std::string Values(const std::vector<double>& string) {
  std::string text;
  for (const double v : string) text += Format(",%.17g", v);
  return text;
}

// ---------------------------------------------------------------- one flow

struct Task {
  std::vector<SearchedFlag> flags;
  MisfitWeights weights;
  EnergyCurve target;
};

// Flags are global: one flow is composed at a time, and then runs beside
// others.
std::mutex compose_mutex;
// --seed, which is another one while a flow is composed.
std::uint64_t run_seed = 0;

// The flow of a string from a start; false with one line in `error` where there
// is none.
bool Compose(const Task& task,
             const std::vector<double>& string,
             std::uint64_t seed,
             FlowCase* flow,
             std::unique_ptr<Stepper>* stepper,
             std::string* error) {
  const std::lock_guard<std::mutex> lock(compose_mutex);
  for (std::size_t k = 0; k < string.size(); ++k) {
    gflags::SetCommandLineOption(task.flags[k].name.c_str(),
                                 Number(string[k]).c_str());
  }
  FLAGS_seed = seed;
  std::string relaxed;
  *stepper = MakeStepper();
  const bool made =
      MakeCase(flow, &relaxed, error) &&
      flow->scene->Begin((*stepper)->FirstStep(), &flow->state, error);
  FLAGS_seed = run_seed;
  return made;
}

// The energies of a run; false, and what there is of them, if it failed, had
// more than --most_steps or was asked to stop.
bool RunCurve(FlowCase* flow,
              Stepper* stepper,
              double duration,
              EnergyCurve* curve,
              std::string* error) {
  const FlowScene& scene = *flow->scene;
  const double m = scene.total_mass();
  const auto add = [&](const FlowState& state) {
    const KineticEnergy k = scene.Kinetic(state.v.data());
    curve->time.push_back(state.time);
    curve->total.push_back(k.total() / m);
    curve->bulk.push_back(k.bulk / m);
    curve->relative.push_back(k.relative / m);
  };
  add(flow->state);
  // Methods of other packages (PETSc, and Ceres' log) keep things of the whole
  // process.
  std::unique_lock<std::mutex> lock(compose_mutex, std::defer_lock);
  if (FLAGS_stepper == "minimize") lock.lock();
  const double most =
      FLAGS_most_steps > 0 ? FLAGS_most_steps : 100.0 * duration / FLAGS_dt;
  int steps = 0;
  bool cut = false;
  const bool ran = RunFlow(
      scene,
      duration,
      stepper,
      [&](const FlowState& state, const StepReport&) {
        add(state);
        cut = ++steps > most || StopRequested();
        return !cut;
      },
      &flow->state,
      error);
  return ran && !cut;
}

// P of one start; +infinity where the flow fails.
double RunMisfit(const Task& task,
                 const std::vector<double>& string,
                 std::uint64_t seed) {
  FlowCase flow;
  std::unique_ptr<Stepper> stepper;
  EnergyCurve curve;
  std::string error;
  if (!Compose(task, string, seed, &flow, &stepper, &error) ||
      !RunCurve(&flow, stepper.get(), FLAGS_duration, &curve, &error)) {
    return kInfinity;
  }
  return ComputeMisfit(curve, task.target, task.weights, FLAGS_duration).value;
}

// f(0) ... f(count - 1) on --threads threads, which take the next as they come.
// `show` is called from the first.
void Spread(int count,
            const std::function<void(int)>& f,
            const std::function<void(int)>& show) {
  std::atomic<int> next{0};
  const auto work = [&](bool is_first) {
    for (int k = next++; k < count && !StopRequested(); k = next++) {
      f(k);
      if (is_first) show(k);
    }
  };
  std::vector<std::thread> threads;
  for (int t = 1; t < std::min(FLAGS_threads, count); ++t) {
    threads.emplace_back(work, false);
  }
  work(true);
  for (std::thread& thread : threads) thread.join();
}

// Ensembles of the strings, which have the numbers `indices` in their stage.
// What they hold already is kept. False if the run was asked to stop.
bool RunEnsembles(const Task& task,
                  const std::vector<std::int64_t>& indices,
                  const EnsembleRule& rule,
                  std::vector<Ensemble>* ensembles,
                  const std::function<void(int, int, int)>& show) {
  // First what each string needs at least, then one run more of each that is
  // not settled: the same whatever the number of threads.
  const int at_once = std::min(std::max(2, rule.least), rule.most);
  for (;;) {
    struct Run {
      int string, number;
    };
    std::vector<Run> runs;
    for (std::size_t s = 0; s < ensembles->size(); ++s) {
      const std::vector<double>& values = (*ensembles)[s].values;
      if (IsSettled(rule, values)) continue;
      const int first = static_cast<int>(values.size());
      const int last = std::max(first + 1, at_once);
      for (int r = first; r < last; ++r) {
        runs.push_back({static_cast<int>(s), r});
      }
    }
    if (runs.empty()) return true;
    std::vector<double> values(runs.size());
    Spread(
        static_cast<int>(runs.size()),
        [&](int k) {
          values[k] = RunMisfit(
              task,
              (*ensembles)[runs[k].string].string,
              StartSeed(
                  run_seed, rule, indices[runs[k].string], runs[k].number));
        },
        [&](int k) {
          show(static_cast<int>(ensembles->size()),
               k + 1,
               static_cast<int>(runs.size()));
        });
    if (StopRequested()) return false;
    for (std::size_t k = 0; k < runs.size(); ++k) {
      std::vector<double>& of = (*ensembles)[runs[k].string].values;
      // What comes after a failure would depend on how much is run at once.
      if (of.empty() || std::isfinite(of.back())) of.push_back(values[k]);
    }
  }
}

// ---------------------------------------------------------------- the record

// Every ensemble of the run, by stages, in order. Searches are functions of the
// values they are given: a run that goes on asks for the same strings again and
// is answered from here.
class Record {
 public:
  Record(const Checkpoint* checkpoint, std::uint32_t setup)
      : checkpoint_(checkpoint), setup_(setup) {}

  struct Stage {
    std::vector<Ensemble> done;
    std::size_t next = 0;   // the first that has not been asked for
    std::int64_t runs = 0;  // of those before
  };

  void Load(const Json& state) {
    for (const auto& [name, list] : state.at("stages").items()) {
      for (const Json& row : list) {
        Ensemble e;
        row.at(0).get_to(e.string);
        row.at(1).get_to(e.values);
        stages_[name].done.push_back(std::move(e));
        loaded_ += stages_[name].done.back().values.size();
      }
    }
  }
  std::int64_t loaded() const { return loaded_; }

  // False once the run stops or waits for workers.
  bool Evaluate(const std::string& name,
                const Task& task,
                const EnsembleRule& rule,
                const Strings& strings,
                std::vector<Ensemble>* ensembles) {
    if (halted_) return false;
    Stage& stage = stages_[name];
    const std::size_t first = stage.next, end = first + strings.size();
    // In pieces, so that a stop loses no more than one. Workers are told all.
    const std::size_t piece =
        FLAGS_external ? strings.size()
                       : static_cast<std::size_t>(std::max(8, FLAGS_threads));
    while (stage.done.size() < end) {
      std::vector<Ensemble> more;
      std::vector<std::int64_t> indices;
      for (std::size_t s = stage.done.size(); s < end && more.size() < piece;
           ++s) {
        more.push_back({strings[s - first], {}});
        indices.push_back(static_cast<std::int64_t>(s));
      }
      const bool done =
          FLAGS_external ? Collect(name, task, rule, indices, &more)
                         : RunEnsembles(task,
                                        indices,
                                        rule,
                                        &more,
                                        [&](int strings, int run, int runs) {
                                          Show(name, stage, strings, run, runs);
                                        });
      if (!done) {
        halted_ = true;
        Save();
        return false;
      }
      for (Ensemble& e : more) {
        unsaved_ += e.values.size();
        stage.done.push_back(std::move(e));
      }
      if (unsaved_ >= 200) Save();
    }
    ensembles->clear();
    for (std::size_t s = first; s < end; ++s) {
      const Ensemble& e = stage.done[s];
      if (e.string != strings[s - first]) {
        BadInput(checkpoint_->path() + ": stage " + name +
                 " holds other strings: written by another version?");
      }
      stage.runs += e.values.size();
      best_[name] =
          std::min(best_.count(name) > 0 ? best_[name] : kInfinity, e.mean());
      ensembles->push_back(e);
    }
    stage.next = end;
    return true;
  }

  void Save() {
    Json stages = Json::object();
    for (const auto& [name, stage] : stages_) {
      Json list = Json::array();
      for (const Ensemble& e : stage.done) {
        list.push_back(Json::array({e.string, e.values}));
      }
      stages[name] = std::move(list);
    }
    std::string error;
    if (!checkpoint_->Write({{"stages", stages}}, &error)) BadInput(error);
    unsaved_ = 0;
  }

  bool halted() const { return halted_; }
  int waiting() const { return waiting_; }
  const Stage& stage(const std::string& name) { return stages_[name]; }
  const std::map<std::string, Stage>& stages() const { return stages_; }
  std::int64_t runs() const {
    std::int64_t sum = 0;
    for (const auto& [name, stage] : stages_) sum += stage.runs;
    return sum;
  }
  void Clear() { progress_.Clear(); }

 private:
  void Show(const std::string& name,
            const Stage& stage,
            int strings,
            int run,
            int runs) {
    if (!progress_.Due()) return;
    const double best = best_.count(name) > 0 ? best_[name] : kInfinity;
    progress_.Show(
        Format("%s: %zu strings and %lld runs done%s; run %d of %d for the "
               "next %d",
               name.c_str(),
               stage.done.size(),
               static_cast<long long>(stage.runs),
               std::isfinite(best) ? Format(", best P %.4f", best).c_str() : "",
               run,
               runs,
               strings));
  }

  // Values that workers have left in --out. Writes strings.csv for what is
  // missing.
  bool Collect(const std::string& name,
               const Task& task,
               const EnsembleRule& rule,
               const std::vector<std::int64_t>& indices,
               std::vector<Ensemble>* ensembles) {
    std::map<std::int64_t, std::map<int, double>> found;
    std::set<std::string> files;
    if (DIR* directory = opendir(FLAGS_out.c_str())) {
      while (const dirent* entry = readdir(directory)) {
        const std::string file = entry->d_name;
        if (file.rfind("values_", 0) == 0 && file.size() > 4 &&
            file.substr(file.size() - 4) == ".csv") {
          files.insert(FLAGS_out + "/" + file);
        }
      }
      closedir(directory);
    }
    for (const std::string& file : files) {
      std::string text, error;
      if (!ReadFile(file, &text, &error)) BadInput(error);
      CsvReader csv(text, file);
      if (!csv.Begin(&error)) BadInput(error);
      while (csv.Row() && csv.error().empty()) {
        std::string stage;
        std::int64_t setup = 0, index = 0;
        int run = 0;
        double value = 0.0;
        csv.Read("setup", &setup);
        csv.Read("stage", &stage);
        csv.Read("index", &index);
        csv.Read("run", &run);
        csv.Read("P", &value);
        if (setup == static_cast<std::int64_t>(setup_) && stage == name) {
          found[index][run] = value;
        }
      }
      if (!csv.error().empty()) BadInput(csv.error());
    }
    std::string asked = "setup,stage,index,least,most,tolerance,common,stream";
    for (const SearchedFlag& flag : task.flags) asked += "," + flag.name;
    asked += "\n";
    for (std::size_t s = 0; s < indices.size(); ++s) {
      std::vector<double>& values = (*ensembles)[s].values;
      const auto& runs = found[indices[s]];
      for (auto run = runs.find(0);
           run != runs.end() && !IsSettled(rule, values);
           run = runs.find(static_cast<int>(values.size()))) {
        values.push_back(run->second);
      }
      if (IsSettled(rule, values)) continue;
      ++waiting_;
      asked += Format("%u,%s,%lld,%d,%d,%.17g,%d,%llu",
                      setup_,
                      name.c_str(),
                      static_cast<long long>(indices[s]),
                      rule.least,
                      rule.most,
                      rule.tolerance,
                      rule.is_common ? 1 : 0,
                      static_cast<unsigned long long>(rule.stream)) +
               Values((*ensembles)[s].string) + "\n";
    }
    if (waiting_ == 0) return true;
    std::string error;
    if (!WriteFileAtomically(FLAGS_out + "/strings.csv", asked, &error)) {
      BadInput(error);
    }
    return false;
  }

  const Checkpoint* const checkpoint_;
  const std::uint32_t setup_;
  std::map<std::string, Stage> stages_;
  std::map<std::string, double> best_;
  std::int64_t loaded_ = 0;
  std::size_t unsaved_ = 0;
  int waiting_ = 0;
  bool halted_ = false;
  Progress progress_;
};

// ---------------------------------------------------------------- stages

struct SearchOutcome {
  SearchResult result;
  std::int64_t runs = 0;
};

// Lists are begun as long as there were fewer than `run_budget` runs.
SearchOutcome RunSearch(Record* record,
                        const std::string& stage,
                        const Task& task,
                        const std::string& spec,
                        const EnsembleRule& rule,
                        std::uint64_t seed,
                        int budget,
                        std::int64_t run_budget,
                        const std::vector<double>& start) {
  std::string error;
  const std::unique_ptr<SearchMethod> method = CreateSearch(spec, &error);
  if (method == nullptr) BadInput("--method: " + error);
  SearchProblem problem;
  for (const SearchedFlag& flag : task.flags) {
    problem.low.push_back(flag.low);
    problem.high.push_back(flag.high);
  }
  problem.start = start;
  problem.seed = seed;
  problem.budget = budget;
  problem.objective = [&](const Strings& strings, std::vector<double>* values) {
    if (record->stage(stage).runs >= run_budget) return false;
    std::vector<Ensemble> ensembles;
    if (!record->Evaluate(stage, task, rule, strings, &ensembles)) return false;
    values->clear();
    for (const Ensemble& e : ensembles) values->push_back(e.mean());
    return true;
  };
  SearchOutcome outcome;
  outcome.result = method->Search(problem);
  outcome.runs = record->stage(stage).runs;
  return outcome;
}

EnsembleRule Fixed(int runs, Stream stream) {
  EnsembleRule rule;
  rule.least = rule.most = runs;
  rule.is_common = true;
  rule.stream = stream;
  return rule;
}

EnsembleRule SearchRule(bool is_paper) {
  EnsembleRule rule;
  rule.least = is_paper ? 2 : 5;
  rule.most = FLAGS_most_runs;
  rule.tolerance = FLAGS_ensemble_tolerance;
  rule.stream = kSearch;
  return rule;
}

// A string that is tried on fresh starts.
struct Candidate {
  std::string origin;
  std::vector<double> string;
  double reported = NAN;  // P of the search, or of the paper
  Ensemble fresh;
  double difference = 0.0, difference_error = 0.0;  // to the best one
  bool is_equal = false;                            // not told from the best
};

struct Identification {
  SearchOutcome search;
  std::vector<Candidate> candidates;  // by fresh mean
  int best = -1;                      // of them, of the search's own
  Ensemble confirmed;                 // the best, on other starts again
  Valley valley;
  int equal = 0;
  double cpu = 0.0;
};

bool IsOwn(const Candidate& c) {
  return c.origin == "search" || c.origin == "gradient";
}

// Search, gradients, fresh starts, confirmation. False if halted.
bool Identify(Record* record,
              const std::string& prefix,
              const Task& task,
              const EnsembleRule& rule,
              bool with_gradient,
              std::vector<Candidate> others,
              Identification* id) {
  const double cpu = CpuSeconds();
  const std::string stage = prefix + "search";
  id->search = RunSearch(record,
                         stage,
                         task,
                         FLAGS_method,
                         rule,
                         FLAGS_seed,
                         FLAGS_budget,
                         kUnlimited,
                         {});
  if (record->halted()) return false;
  // The best strings, and those that were the best for a while.
  const std::vector<Ensemble>& done = record->stage(stage).done;
  std::vector<int> order(record->stage(stage).next);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return done[a].mean() < done[b].mean();
  });
  std::set<std::vector<double>> known;
  const auto add = [&](const std::string& origin,
                       const std::vector<double>& string,
                       double reported) {
    if (!std::isfinite(reported) || !known.insert(string).second) return;
    Candidate c;
    c.origin = origin;
    c.string = string;
    c.reported = reported;
    id->candidates.push_back(c);
  };
  for (std::size_t k = 0;
       k < order.size() && static_cast<int>(known.size()) < FLAGS_winners;
       ++k) {
    add("search", done[order[k]].string, done[order[k]].mean());
  }
  for (const SearchRow& row : id->search.result.history) {
    add("search", row.best_string, row.best);
  }
  if (id->candidates.empty()) {
    record->Clear();
    BadInput("no string of the search has a value: every flow failed");
  }
  if (with_gradient) {
    const SearchOutcome gradient =
        RunSearch(record,
                  prefix + "gradient",
                  task,
                  "ceres_differences",
                  Fixed(FLAGS_gradient_runs, kGradient),
                  FLAGS_seed,
                  FLAGS_gradient_budget,
                  kUnlimited,
                  id->search.result.best);
    if (record->halted()) return false;
    add("gradient", gradient.result.best, gradient.result.value);
  }
  for (const Candidate& c : others) id->candidates.push_back(c);
  Strings strings;
  for (const Candidate& c : id->candidates) strings.push_back(c.string);
  std::vector<Ensemble> fresh;
  if (!record->Evaluate(prefix + "fresh",
                        task,
                        Fixed(FLAGS_fresh, kFresh),
                        strings,
                        &fresh)) {
    return false;
  }
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    id->candidates[k].fresh = fresh[k];
  }
  std::stable_sort(id->candidates.begin(),
                   id->candidates.end(),
                   [](const Candidate& a, const Candidate& b) {
                     return a.fresh.mean() < b.fresh.mean();
                   });
  for (std::size_t k = 0; k < id->candidates.size() && id->best < 0; ++k) {
    if (IsOwn(id->candidates[k])) id->best = static_cast<int>(k);
  }
  const Candidate best = id->candidates[id->best];
  Strings equal;
  for (Candidate& c : id->candidates) {
    PairedDifference(
        c.fresh.values, best.fresh.values, &c.difference, &c.difference_error);
    c.is_equal = AreEqual(c.difference,
                          c.difference_error,
                          static_cast<int>(best.fresh.values.size()));
    if (c.is_equal && IsOwn(c)) equal.push_back(c.string);
  }
  id->equal = static_cast<int>(equal.size());
  id->valley = DescribeValley(equal, task.flags);
  std::vector<Ensemble> confirmed;
  if (!record->Evaluate(prefix + "confirm",
                        task,
                        Fixed(FLAGS_fresh, kConfirm),
                        {best.string},
                        &confirmed)) {
    return false;
  }
  id->confirmed = confirmed[0];
  id->cpu = CpuSeconds() - cpu;
  return true;
}

void PrintIdentification(const Task& task, const Identification& id, int rows) {
  const SearchResult& r = id.search.result;
  std::printf(
      "\n  %d strings, %lld runs (%.2f a string); the search reports P = %.4f\n"
      "  on %d fresh starts, the same for all:\n\n",
      r.strings,
      static_cast<long long>(id.search.runs),
      static_cast<double>(id.search.runs) / std::max(1, r.strings),
      r.value,
      FLAGS_fresh);
  std::vector<std::vector<std::string>> table(1);
  table[0].push_back("from");
  for (const SearchedFlag& flag : task.flags) table[0].push_back(flag.name);
  for (const char* name :
       {"P reported", "P, fresh", "+- 95 %", "above best", "+- 95 %"}) {
    table[0].push_back(name);
  }
  table[0].push_back("");
  int own = 0;
  for (const Candidate& c : id.candidates) {
    if (c.origin == "search" && ++own > rows) continue;
    const double factor =
        ConfidenceFactor(static_cast<int>(c.fresh.values.size()));
    std::vector<std::string> row = {c.origin};
    for (const double v : c.string) row.push_back(Format("%.4f", v));
    row.push_back(std::isfinite(c.reported) ? Format("%.4f", c.reported) : "");
    row.push_back(Format("%.4f", c.fresh.mean()));
    row.push_back(Format("%.4f", factor * c.fresh.error()));
    row.push_back(Format("%.4f", c.difference));
    row.push_back(Format("%.4f", factor * c.difference_error));
    row.push_back(c.is_equal ? "equal" : "");
    table.push_back(row);
  }
  std::fputs(Grid(table, 1, false).c_str(), stdout);
  const Candidate& best = id.candidates[id.best];
  std::printf(
      "\n  confirmed     P = %.4f +- %.4f (95 %%) on %zu other starts\n",
      id.confirmed.mean(),
      ConfidenceFactor(static_cast<int>(id.confirmed.values.size())) *
          id.confirmed.error(),
      id.confirmed.values.size());
  std::string text;
  for (std::size_t k = 0; k < task.flags.size(); ++k) {
    text += Format("%s%s %.3g (%.3g to %.3g)",
                   k == 0 ? "" : ", ",
                   task.flags[k].name.c_str(),
                   best.string[k],
                   id.valley.low[k],
                   id.valley.high[k]);
  }
  std::printf(
      "  parameters    %s\n"
      "                in brackets: over the %d strings that %d starts "
      "do not tell from the best\n",
      text.c_str(),
      id.equal,
      FLAGS_fresh);
  if (id.valley.axis.empty()) {
    std::printf("                too few of them to say what is determined\n");
    return;
  }
  std::printf(
      "  determined    deviations of those along their principal axes, "
      "of the box:\n");
  for (std::size_t a = 0; a < id.valley.axis.size(); ++a) {
    std::string axis;
    for (std::size_t k = 0; k < task.flags.size(); ++k) {
      axis +=
          Format(" %+.2f %s", id.valley.axis[a][k], task.flags[k].name.c_str());
    }
    std::printf(
        "                %.3f along%s\n", id.valley.deviation[a], axis.c_str());
  }
}

Json IdentificationJson(const Task& task, const Identification& id) {
  const auto named = [&](const std::vector<double>& values) {
    Json json = Json::object();
    for (std::size_t k = 0; k < task.flags.size(); ++k) {
      json[task.flags[k].name] = values[k];
    }
    return json;
  };
  const auto number = [](double v) {
    return std::isfinite(v) ? Json(v) : Json();
  };
  const Candidate& best = id.candidates[id.best];
  const SearchResult& r = id.search.result;
  Json json = {{"strings", r.strings},
               {"runs", id.search.runs},
               {"reported", number(r.value)},
               {"reported_string", named(r.best)},
               {"message", r.message}};
  json["best"] = {{"string", named(best.string)},
                  {"origin", best.origin},
                  {"fresh", number(best.fresh.mean())},
                  {"fresh_error", number(best.fresh.error())},
                  {"confirmed", number(id.confirmed.mean())},
                  {"confirmed_error", number(id.confirmed.error())},
                  {"starts", FLAGS_fresh}};
  json["equal_strings"] = id.equal;
  json["equal_low"] = named(id.valley.low);
  json["equal_high"] = named(id.valley.high);
  json["axes"] = Json::array();
  for (std::size_t a = 0; a < id.valley.axis.size(); ++a) {
    json["axes"].push_back({{"deviation", id.valley.deviation[a]},
                            {"direction", named(id.valley.axis[a])}});
  }
  json["candidates"] = Json::array();
  for (const Candidate& c : id.candidates) {
    if (c.origin == "search") continue;
    json["candidates"].push_back(
        {{"origin", c.origin},
         {"string", named(c.string)},
         {"reported", number(c.reported)},
         {"fresh", number(c.fresh.mean())},
         {"fresh_error", number(c.fresh.error())},
         {"above_best", number(c.difference)},
         {"above_best_error", number(c.difference_error)},
         {"equal", c.is_equal}});
  }
  json["cpu_seconds"] = id.cpu;
  return json;
}

// ---- the least P at fixed values of each parameter

struct ProfilePoint {
  int parameter;
  std::vector<double> string;
  Ensemble check;
};

bool RunProfile(Record* record,
                const Task& task,
                const Identification& id,
                std::vector<ProfilePoint>* points) {
  const std::string method = HasSearch("nelder_mead")
                                 ? "nelder_mead"
                                 : "genetic_algorithm:population=10,parents=2";
  const int n = static_cast<int>(task.flags.size());
  Strings strings;
  for (int k = 0; k < n; ++k) {
    for (int p = 0; p < FLAGS_profile_points; ++p) {
      const SearchedFlag& flag = task.flags[k];
      const double value = flag.low + (flag.high - flag.low) * p /
                                          std::max(1, FLAGS_profile_points - 1);
      // From the nearest of the good strings.
      const Candidate* nearest = &id.candidates[id.best];
      for (const Candidate& c : id.candidates) {
        if (c.is_equal && std::fabs(c.string[k] - value) <
                              std::fabs(nearest->string[k] - value)) {
          nearest = &c;
        }
      }
      std::vector<double> string = nearest->string;
      string[k] = value;
      if (n > 1) {
        const std::string stage = Format("profile_%s_%d", flag.name.c_str(), p);
        std::string error;
        const std::unique_ptr<SearchMethod> search =
            CreateSearch(method, &error);
        SearchProblem problem;
        for (int c = 0; c < n; ++c) {
          if (c == k) continue;
          problem.low.push_back(task.flags[c].low);
          problem.high.push_back(task.flags[c].high);
          problem.start.push_back(string[c]);
        }
        problem.seed = FLAGS_seed;
        problem.budget = FLAGS_profile_budget;
        problem.objective = [&](const Strings& some,
                                std::vector<double>* values) {
          Strings whole = some;
          for (auto& s : whole) s.insert(s.begin() + k, value);
          std::vector<Ensemble> ensembles;
          if (!record->Evaluate(
                  stage, task, Fixed(6, kProfile), whole, &ensembles)) {
            return false;
          }
          values->clear();
          for (const Ensemble& e : ensembles) values->push_back(e.mean());
          return true;
        };
        const SearchResult result = search->Search(problem);
        if (record->halted()) return false;
        string = result.best;
        string.insert(string.begin() + k, value);
      }
      points->push_back({k, string, {}});
      strings.push_back(string);
    }
  }
  std::vector<Ensemble> checks;
  if (!record->Evaluate("profile_check",
                        task,
                        Fixed(std::min(FLAGS_fresh, 20), kFresh),
                        strings,
                        &checks)) {
    return false;
  }
  for (std::size_t k = 0; k < checks.size(); ++k) {
    (*points)[k].check = checks[k];
  }
  return true;
}

// ---- other methods with as many runs

struct Alternative {
  const char* name;
  const char* spec;
  bool ends_with_gradient;
};
constexpr Alternative kAlternatives[] = {
    {"genetic, >= 5 runs", "genetic_algorithm", false},
    {"genetic, then gradients", "genetic_algorithm", true},
    {"random", "random_search:strings=1000000", false},
    {"Nelder-Mead", "nelder_mead:strings=1000000", false},
    {"differential evolution",
     "differential_evolution:generations=100000",
     false},
    {"CMA-ES", "cma_es:generations=100000", false}};

struct AlternativeRun {
  const Alternative* method;
  int repeat;
  int strings;
  std::int64_t runs;
  double reported;
  std::vector<double> best;
  Ensemble fresh;
};

bool RunAlternatives(Record* record,
                     const Task& task,
                     std::int64_t budget,
                     std::vector<AlternativeRun>* all) {
  Strings strings;
  for (const Alternative& method : kAlternatives) {
    const std::string spec = method.spec;
    if (!HasSearch(spec.substr(0, spec.find(':')))) continue;
    for (int r = 0; r < FLAGS_repeats; ++r) {
      const std::string stage = Format(
          "alternative_%d_%d", static_cast<int>(&method - kAlternatives), r);
      const std::uint64_t seed = FLAGS_seed + 1000u + r;
      EnsembleRule rule = SearchRule(false);
      // Repeats are searches of their own.
      rule.stream = 100u + 10u * (&method - kAlternatives) + r;
      const SearchOutcome outcome = RunSearch(
          record,
          stage,
          task,
          spec,
          rule,
          seed,
          0,
          method.ends_with_gradient ? std::max<std::int64_t>(1, budget * 6 / 10)
                                    : budget,
          {});
      if (record->halted()) return false;
      AlternativeRun run = {&method,
                            r,
                            outcome.result.strings,
                            outcome.runs,
                            outcome.result.value,
                            outcome.result.best,
                            {}};
      // Its last list may have used up what was left for gradients.
      if (method.ends_with_gradient && outcome.runs < budget) {
        EnsembleRule common = Fixed(FLAGS_gradient_runs, kGradient);
        common.stream = 200u + r;
        const SearchOutcome gradient = RunSearch(record,
                                                 stage + "_gradient",
                                                 task,
                                                 "ceres_differences",
                                                 common,
                                                 seed,
                                                 0,
                                                 budget - outcome.runs,
                                                 outcome.result.best);
        if (record->halted()) return false;
        run.strings += gradient.result.strings;
        run.runs += gradient.runs;
        if (std::isfinite(gradient.result.value)) {
          run.reported = gradient.result.value;
          run.best = gradient.result.best;
        }
      }
      strings.push_back(run.best);
      all->push_back(run);
    }
  }
  std::vector<Ensemble> fresh;
  if (!record->Evaluate("alternatives_fresh",
                        task,
                        Fixed(FLAGS_fresh, kFresh),
                        strings,
                        &fresh)) {
    return false;
  }
  for (std::size_t k = 0; k < fresh.size(); ++k) (*all)[k].fresh = fresh[k];
  return true;
}

// ---------------------------------------------------------------- curves

// Energies of a string on a grid of times, from `starts` starts.
struct Response {
  std::vector<double> time;
  std::vector<EnergyCurve> curves;
  int failed = 0;
};

Response RunResponse(const Task& task,
                     const std::vector<double>& string,
                     int starts,
                     Stream stream) {
  Response response;
  for (int t = 0; t < kGrid; ++t) {
    response.time.push_back(FLAGS_duration * t / (kGrid - 1));
  }
  const EnsembleRule rule = Fixed(starts, stream);
  std::vector<EnergyCurve> curves(starts);
  std::vector<char> done(starts, 0);
  Spread(
      starts,
      [&](int s) {
        FlowCase flow;
        std::unique_ptr<Stepper> stepper;
        EnergyCurve raw;
        std::string error;
        if (!Compose(task,
                     string,
                     StartSeed(run_seed, rule, 0, s),
                     &flow,
                     &stepper,
                     &error) ||
            !RunCurve(&flow, stepper.get(), FLAGS_duration, &raw, &error)) {
          return;
        }
        for (const double t : response.time) {
          curves[s].time.push_back(t);
          curves[s].total.push_back(Interpolate(raw.time, raw.total, t));
          curves[s].bulk.push_back(Interpolate(raw.time, raw.bulk, t));
          curves[s].relative.push_back(Interpolate(raw.time, raw.relative, t));
        }
        done[s] = 1;
      },
      [](int) {});
  for (int s = 0; s < starts; ++s) {
    if (done[s]) {
      response.curves.push_back(std::move(curves[s]));
    } else {
      ++response.failed;
    }
  }
  return response;
}

EnergyCurve MeanCurve(const Response& response) {
  EnergyCurve mean;
  mean.time = response.time;
  for (std::size_t t = 0; t < response.time.size(); ++t) {
    double sums[3] = {};
    for (const EnergyCurve& c : response.curves) {
      sums[0] += c.total[t];
      sums[1] += c.bulk[t];
      sums[2] += c.relative[t];
    }
    const double n = static_cast<double>(response.curves.size());
    mean.total.push_back(sums[0] / n);
    mean.bulk.push_back(sums[1] / n);
    mean.relative.push_back(sums[2] / n);
  }
  return mean;
}

std::string ResponseCsv(const Response& response, const EnergyCurve& target) {
  std::string csv =
      "time,T,T_deviation,T_first,T_target,T_b,T_b_deviation,T_b_first,"
      "T_b_target,T_r,T_r_deviation,T_r_first,T_r_target\n";
  for (std::size_t t = 0; t < response.time.size(); ++t) {
    csv += Number(response.time[t]);
    for (const auto part :
         {&EnergyCurve::total, &EnergyCurve::bulk, &EnergyCurve::relative}) {
      std::vector<double> values;
      for (const EnergyCurve& c : response.curves) {
        values.push_back((c.*part)[t]);
      }
      const MeanDeviation m = MeanAndDeviation(values);
      csv += Format(",%.17g,%.17g,%.17g,%.17g",
                    m.mean,
                    m.deviation,
                    values.empty() ? NAN : values[0],
                    Interpolate(target.time, target.*part, response.time[t]));
    }
    csv += "\n";
  }
  return csv;
}

// ---------------------------------------------------------------- set-up

// Every flag that a value depends on.
Json Setup(const Task& task) {
  const std::set<std::string> own = {"out",
                                     "resume",
                                     "threads",
                                     "pictures",
                                     "external",
                                     "worker",
                                     "strings",
                                     "share",
                                     "list_methods",
                                     // Stages of their own: --resume adds them
                                     // to a search that is done.
                                     "profile",
                                     "alternatives",
                                     "recovery",
                                     // Their text instead.
                                     "target",
                                     "input"};
  Json setup = Json::object();
  std::vector<gflags::CommandLineFlagInfo> all;
  gflags::GetAllFlags(&all);
  for (const auto& flag : all) {
    if (own.count(flag.name) == 0 &&
        flag.filename.find("experiments/") != std::string::npos) {
      setup[flag.name] = flag.current_value;
    }
  }
  setup["target"] = Crc32(FormatCurve(task.target));
  setup["input"] = nullptr;
  if (!FLAGS_input.empty()) {
    std::string text, error;
    if (!ReadFile(FLAGS_input, &text, &error)) BadInput("--input: " + error);
    setup["input"] = Crc32(text);
  }
  return setup;
}

Task MakeTask() {
  Task task;
  std::string error;
  if (!ParseSearched(FLAGS_search, &task.flags, &error)) {
    BadInput("--search: " + error);
  }
  std::vector<double> middle;
  for (const SearchedFlag& flag : task.flags) {
    gflags::CommandLineFlagInfo info;
    if (!gflags::GetCommandLineFlagInfo(flag.name.c_str(), &info) ||
        info.type != "double" ||
        info.filename.find("flow_scene") == std::string::npos) {
      BadInput("--search: '" + flag.name +
               "' is not a flag of a flow that is a number");
    }
    if (flag.name == "duration") {
      BadInput("--search: 'duration' is what energies are compared over");
    }
    if (!info.is_default) {
      BadInput("--" + flag.name +
               " is searched (--search) and cannot be given");
    }
    middle.push_back(0.5 * (flag.low + flag.high));
  }
  const std::vector<double> w = ReadNumbers("weights", FLAGS_weights);
  if (w.size() != 3 || *std::min_element(w.begin(), w.end()) < 0.0 ||
      !(w[0] + w[1] + w[2] > 0.0)) {
    BadInput("--weights=" + FLAGS_weights +
             " must be three numbers >= 0, not all 0");
  }
  task.weights = {w[0], w[1], w[2]};
  CheckPositive("duration", FLAGS_duration);
  if (!FLAGS_target.empty()) {
    if (IsGiven("target_energies")) {
      BadInput("--target and --target_energies exclude each other");
    }
    if (!ReadTarget(
            FLAGS_target, FLAGS_duration, task.weights, &task.target, &error)) {
      BadInput("--target: " + error);
    }
  } else {
    const std::vector<double> t =
        ReadNumbers("target_energies", FLAGS_target_energies);
    if (t.size() != 3 || *std::min_element(t.begin(), t.end()) < 0.0) {
      BadInput("--target_energies=" + FLAGS_target_energies +
               " must be three numbers >= 0");
    }
    for (int k = 0; k < 3; ++k) {
      if (w[k] > 0.0 && t[k] == 0.0) {
        BadInput("--target_energies=" + FLAGS_target_energies +
                 ": 0 cannot be divided by; its weight may be 0");
      }
    }
    task.target = ConstantTarget(t[0], t[1], t[2], FLAGS_duration);
  }
  // Flags that are wrong by themselves, and bounds that no flow can have, are
  // told now. What goes with what (beta2 > beta1, mu_d <= mu_s) is a matter of
  // strings.
  bool possible = false;
  for (std::size_t k = 0; k <= 2 * task.flags.size(); ++k) {
    std::vector<double> string = middle;
    if (k > 0) {
      const SearchedFlag& flag = task.flags[(k - 1) / 2];
      string[(k - 1) / 2] = k % 2 == 0 ? flag.high : flag.low;
    }
    FlowCase flow;
    std::unique_ptr<Stepper> stepper;
    possible =
        Compose(task, string, FLAGS_seed, &flow, &stepper, &error) || possible;
  }
  if (!possible) BadInput(error);
  return task;
}

void CheckFlags() {
  CheckRange("budget", FLAGS_budget, 0, 1e9);
  CheckRange("most_runs", FLAGS_most_runs, 2, 1e6);
  CheckRange("most_steps", FLAGS_most_steps, 0, 2e9);
  CheckRange("ensemble_tolerance", FLAGS_ensemble_tolerance, 0.0, 1.0);
  CheckRange("winners", FLAGS_winners, 1, 100000);
  CheckRange("fresh", FLAGS_fresh, 2, 1e6);
  CheckRange("gradient_runs", FLAGS_gradient_runs, 1, 1e6);
  CheckRange("gradient_budget", FLAGS_gradient_budget, 1, 1e9);
  CheckRange("profile_points", FLAGS_profile_points, 2, 1000);
  CheckRange("profile_budget", FLAGS_profile_budget, 1, 1e9);
  CheckRange("repeats", FLAGS_repeats, 1, 10);
  CheckRange("threads", FLAGS_threads, 1, 1024);
  if (FLAGS_ensemble != "paper" && FLAGS_ensemble != "honest") {
    BadInput("--ensemble=" + FLAGS_ensemble + " must be paper or honest");
  }
  std::string error;
  if (CreateSearch(FLAGS_method, &error) == nullptr) {
    BadInput("--method: " + error);
  }
  if (FLAGS_external && FLAGS_worker) {
    BadInput("--external and --worker exclude each other");
  }
  for (const char* flag : {"strings", "share"}) {
    if (IsGiven(flag) && !FLAGS_worker) {
      BadInput(std::string("--") + flag + " is of --worker");
    }
  }
  if (FLAGS_external && (FLAGS_paper || !FLAGS_recover.empty())) {
    BadInput(
        "--external cannot go with --paper or --recover, whose targets "
        "come from runs");
  }
  if (FLAGS_recovery && !FLAGS_paper) {
    BadInput(
        "--recovery is of --paper; --recover=VALUES is for any parameters");
  }
  if (FLAGS_paper) {
    for (const char* flag : {"search",
                             "target",
                             "target_energies",
                             "weights",
                             "recover",
                             "ensemble",
                             "method",
                             "budget"}) {
      if (IsGiven(flag)) {
        BadInput(std::string("--") + flag +
                 " cannot go with --paper, which sets what sec. 8.2 says");
      }
    }
    FLAGS_ensemble = "paper";
    if (!IsGiven("gradient")) FLAGS_gradient = true;
    if (!IsGiven("profile")) FLAGS_profile = true;
    if (!IsGiven("alternatives")) FLAGS_alternatives = true;
    if (!IsGiven("recovery")) FLAGS_recovery = true;
  }
  if (FLAGS_smoke) {
    const auto set = [](const char* flag, const char* value) {
      if (!IsGiven(flag)) {
        gflags::SetCommandLineOptionWithMode(
            flag, value, gflags::SET_FLAGS_DEFAULT);
      }
    };
    set("particles", "20");
    set("duration", "0.2");
    set("method",
        "genetic_algorithm:population=8,generations=4,parents=2,restart=3");
    set("most_runs", "6");
    set("winners", "6");
    set("fresh", "6");
    set("gradient_runs", "3");
    set("gradient_budget", "40");
    set("profile_points", "3");
    set("profile_budget", "6");
    set("repeats", "1");
  }
}

// ---------------------------------------------------------------- a worker

int RunWorker() {
  if (FLAGS_strings.empty()) BadInput("--worker needs --strings=FILE");
  int part = 0, parts = 0, used = 0;
  if (std::sscanf(FLAGS_share.c_str(), "%d/%d%n", &part, &parts, &used) != 2 ||
      used != static_cast<int>(FLAGS_share.size()) || parts < 1 || part < 1 ||
      part > parts) {
    BadInput("--share=" + FLAGS_share + " must be k/n with 1 <= k <= n");
  }
  const Task task = MakeTask();
  const std::uint32_t setup = Crc32(Setup(task).dump());
  std::string text, error;
  if (!ReadFile(FLAGS_strings, &text, &error)) BadInput("--strings: " + error);
  CsvReader csv(text, FLAGS_strings);
  if (!csv.Begin(&error)) BadInput("--strings: " + error);
  struct Row {
    std::string stage;
    std::int64_t index = 0;
    EnsembleRule rule;
    Ensemble ensemble;
  };
  std::vector<Row> rows;
  for (int number = 0; csv.Row() && csv.error().empty(); ++number) {
    Row row;
    std::int64_t asked = 0;
    csv.Read("setup", &asked);
    csv.Read("stage", &row.stage);
    csv.Read("index", &row.index);
    csv.Read("least", &row.rule.least);
    csv.Read("most", &row.rule.most);
    csv.Read("tolerance", &row.rule.tolerance);
    csv.Read("common", &row.rule.is_common);
    csv.Read("stream", &row.rule.stream);
    for (const SearchedFlag& flag : task.flags) {
      double value = 0.0;
      csv.Read(flag.name.c_str(), &value);
      row.ensemble.string.push_back(value);
    }
    if (csv.error().empty() && asked != static_cast<std::int64_t>(setup)) {
      csv.Complain("asked for with other flags than this worker's");
    }
    if (number % parts == part - 1) rows.push_back(row);
  }
  if (!csv.error().empty()) BadInput("--strings: " + csv.error());
  // Each list has files of its own: a share of this one must not take the place
  // of what others have found for those before.
  const std::string list = Format("%08x_%d_of_%d", Crc32(text), part, parts);
  const std::string name = "values_" + list + ".csv";
  const std::string about = "worker_" + list + ".json";
  Output output;
  output.Create(FLAGS_out, {name, about});
  CatchStopSignals();
  std::string values = "setup,stage,index,run,P\n";
  Progress progress;
  std::int64_t runs = 0;
  std::size_t done = 0;
  bool stopped = false;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    Row& row = rows[k];
    std::vector<Ensemble> one = {row.ensemble};
    if (!RunEnsembles(task, {row.index}, row.rule, &one, [&](int, int, int) {
          if (progress.Due()) {
            progress.Show(Format("string %zu of %zu", k + 1, rows.size()));
          }
        })) {
      stopped = true;
      break;
    }
    for (std::size_t r = 0; r < one[0].values.size(); ++r) {
      values += Format("%u,%s,%lld,%zu,%.17g\n",
                       setup,
                       row.stage.c_str(),
                       static_cast<long long>(row.index),
                       r,
                       one[0].values[r]);
    }
    runs += one[0].values.size();
    ++done;
  }
  progress.Clear();
  output.Write(name, values);
  output.WriteJson(about,
                   {{"schema", "granopt/identify_worker/1"},
                    {"strings", done},
                    {"runs", runs},
                    {"provenance", Provenance()}});
  if (stopped) {
    std::printf("stopped as asked, after %zu of %zu strings; they are in %s\n",
                done,
                rows.size(),
                output.Path(name).c_str());
    return kNotConverged;
  }
  std::printf("identify  share %d of %d: %zu strings, %lld runs, in %s\n",
              part,
              parts,
              rows.size(),
              static_cast<long long>(runs),
              output.Path(name).c_str());
  return kConverged;
}

// ---------------------------------------------------------------- main

std::string FreshCsv(const Task& task, const Identification& id) {
  std::string csv = "origin";
  for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
  csv += ",reported,fresh,fresh_error,above_best,above_best_error,equal\n";
  for (const Candidate& c : id.candidates) {
    csv += Field(c.origin) + Values(c.string) +
           Format(",%.17g,%.17g,%.17g,%.17g,%.17g,%d\n",
                  c.reported,
                  c.fresh.mean(),
                  c.fresh.error(),
                  c.difference,
                  c.difference_error,
                  c.is_equal ? 1 : 0);
  }
  return csv;
}

std::string HistoryCsv(const Identification& id) {
  std::string csv = "list,strings,best,list_mean,fresh,fresh_error\n";
  const std::vector<SearchRow>& history = id.search.result.history;
  for (std::size_t k = 0; k < history.size(); ++k) {
    const SearchRow& row = history[k];
    double fresh = NAN, error = NAN;
    for (const Candidate& c : id.candidates) {
      if (c.string == row.best_string) {
        fresh = c.fresh.mean();
        error = c.fresh.error();
      }
    }
    csv += Format("%zu,%d,%.17g,%.17g,%.17g,%.17g\n",
                  k,
                  row.strings,
                  row.best,
                  row.list_mean,
                  fresh,
                  error);
  }
  return csv;
}

std::string StringsCsv(const Task& task, const Record& record) {
  std::string csv = "stage,index";
  for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
  csv += ",runs,mean,error\n";
  for (const auto& [name, stage] : record.stages()) {
    for (std::size_t k = 0; k < stage.next; ++k) {
      const Ensemble& e = stage.done[k];
      csv += Format("%s,%zu", name.c_str(), k) + Values(e.string) +
             Format(",%zu,%.17g,%.17g\n", e.values.size(), e.mean(), e.error());
    }
  }
  return csv;
}

int Leave(Record* record) {
  record->Clear();
  if (record->waiting() > 0) {
    std::printf(
        "\n%d strings wait in %s/strings.csv: evaluate them by --worker and "
        "give the same command again\n",
        record->waiting(),
        FLAGS_out.c_str());
  } else {
    std::printf(
        "\nstopped as asked, after %lld runs: the same command with "
        "--resume goes on\n",
        static_cast<long long>(record->runs()));
  }
  return kNotConverged;
}

int RunIdentify() {
  Task task = MakeTask();
  std::vector<double> known;
  if (!FLAGS_recover.empty()) {
    if (IsGiven("target") || IsGiven("target_energies")) {
      BadInput("--recover makes its target itself: no --target");
    }
    known = ReadNumbers("recover", FLAGS_recover);
    if (known.size() != task.flags.size()) {
      BadInput(Format("--recover=%s: %zu values for %zu parameters",
                      FLAGS_recover.c_str(),
                      known.size(),
                      task.flags.size()));
    }
  }
  CatchStopSignals();
  const auto make_known_target = [&](const std::vector<double>& values) {
    const Response response =
        RunResponse(task, values, FLAGS_smoke ? 5 : 20, kRecover);
    if (response.failed > 0 && !StopRequested()) {
      BadInput(Format("the parameters to recover fail on %d of %zu starts",
                      response.failed,
                      response.failed + response.curves.size()));
    }
    return StopRequested() ? EnergyCurve() : MeanCurve(response);
  };
  std::string searched;
  for (const SearchedFlag& flag : task.flags) {
    searched += Format("%s%s in [%g, %g]",
                       searched.empty() ? "" : ", ",
                       flag.name.c_str(),
                       flag.low,
                       flag.high);
  }
  std::printf("identify  %s\n", searched.c_str());
  if (!known.empty()) {
    std::printf("          target: what %s do on average\n",
                FLAGS_recover.c_str());
  } else if (!FLAGS_target.empty()) {
    std::printf("          target: %s, %zu times\n",
                FLAGS_target.c_str(),
                task.target.time.size());
  } else {
    std::printf("          target: T, T_b, T_r = %s J/kg at all times\n",
                FLAGS_target_energies.c_str());
  }
  std::fflush(stdout);
  // The known values are in the set-up themselves.
  const Json setup = Setup(task);
  if (!known.empty()) task.target = make_known_target(known);
  const Checkpoint checkpoint(CheckpointPath(), setup);
  Record record(&checkpoint, Crc32(setup.dump()));
  if (StopRequested()) return Leave(&record);
  const EnsembleRule rule = SearchRule(FLAGS_ensemble == "paper");
  std::printf(
      "          %s; at least %d starts a string, until two means in a "
      "row agree to %g\n",
      FLAGS_method.c_str(),
      rule.least,
      rule.tolerance);
  Json written;
  if ((FLAGS_resume || FLAGS_external) && Resume(checkpoint, &written)) {
    try {
      record.Load(written);
    } catch (const Json::exception& exception) {
      RefuseState(checkpoint, exception);
    }
    std::printf("          resumed after %lld runs\n",
                static_cast<long long>(record.loaded()));
  }
  std::fflush(stdout);
  std::vector<std::string> names = {"summary.json",
                                    "strings_evaluated.csv",
                                    "history.csv",
                                    "fresh.csv",
                                    "response.csv",
                                    "target.csv",
                                    "profile.csv",
                                    "alternatives.csv",
                                    "recovery.csv",
                                    "best_start.xyz",
                                    "best_final.xyz",
                                    "strings.csv"};
  for (const char* figure :
       {"convergence", "response", "valley", "profile", "alternatives"}) {
    names.push_back(std::string(figure) + ".svg");
    names.push_back(std::string(figure) + ".png");
  }
  const std::vector<std::string> kept = CheckpointFiles();
  const bool goes_on = FLAGS_resume || FLAGS_external;
  if (!goes_on) names.insert(names.end(), kept.begin(), kept.end());
  Output output;
  output.Create(FLAGS_out, names, kept);
  const double cpu = CpuSeconds();

  std::vector<Candidate> others;
  if (FLAGS_paper) {
    for (std::size_t k = 0; k < std::size(kTable1); ++k) {
      Candidate c;
      c.origin = Format("Table 1, %zu", k + 1);
      c.string.assign(kTable1[k].string, kTable1[k].string + 4);
      c.reported = kTable1[k].value;
      others.push_back(c);
    }
  }
  if (!known.empty()) {
    Candidate c;
    c.origin = "known";
    c.string = known;
    others.push_back(c);
  }
  Identification id;
  if (!Identify(&record, "", task, rule, FLAGS_gradient, others, &id)) {
    return Leave(&record);
  }
  std::vector<ProfilePoint> profile;
  if (FLAGS_profile && !RunProfile(&record, task, id, &profile)) {
    return Leave(&record);
  }
  // The flow that the paper's best string makes, found again.
  Identification recovery;
  Task recovery_task = task;
  const std::vector<double> first(kTable1[0].string, kTable1[0].string + 4);
  if (FLAGS_recovery) {
    recovery_task.target = make_known_target(first);
    if (StopRequested()) {
      record.Save();
      return Leave(&record);
    }
    Candidate c;
    c.origin = "known";
    c.string = first;
    if (!Identify(&record,
                  "recovery_",
                  recovery_task,
                  SearchRule(false),
                  false,
                  {c},
                  &recovery)) {
      return Leave(&record);
    }
  }
  std::vector<AlternativeRun> alternatives;
  if (FLAGS_alternatives &&
      !RunAlternatives(&record, task, id.search.runs, &alternatives)) {
    return Leave(&record);
  }
  record.Save();
  record.Clear();
  const Candidate& best = id.candidates[id.best];
  const Response response = RunResponse(task, best.string, 20, kFresh);
  if (StopRequested()) return Leave(&record);

  PrintIdentification(task, id, 6);
  Json json = IdentificationJson(task, id);
  json["parameters"] = Json::array();
  for (const SearchedFlag& flag : task.flags) {
    json["parameters"].push_back(
        {{"name", flag.name}, {"low", flag.low}, {"high", flag.high}});
  }
  json["method"] = FLAGS_method;
  json["ensemble"] = FLAGS_ensemble;
  json["ensemble_tolerance"] = FLAGS_ensemble_tolerance;
  output.Write("history.csv", HistoryCsv(id));
  output.Write("fresh.csv", FreshCsv(task, id));
  output.Write("strings_evaluated.csv", StringsCsv(task, record));
  output.Write("target.csv", FormatCurve(task.target));
  output.Write("response.csv", ResponseCsv(response, task.target));
  {
    FlowCase flow;
    std::unique_ptr<Stepper> stepper;
    EnergyCurve curve;
    std::string error;
    if (Compose(task,
                best.string,
                StartSeed(run_seed, Fixed(1, kFresh), 0, 0),
                &flow,
                &stepper,
                &error)) {
      output.Write("best_start.xyz", Frame(*flow.scene, flow.state, 17));
      RunCurve(&flow, stepper.get(), FLAGS_duration, &curve, &error);
      output.Write("best_final.xyz", Frame(*flow.scene, flow.state, 17));
    }
  }
  if (!profile.empty()) {
    std::string csv = "parameter,value";
    for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
    csv += ",P,error,best,best_error\n";
    // The best one on as many of the same starts.
    Ensemble base = best.fresh;
    base.values.resize(
        std::min<std::size_t>(base.values.size(), std::min(FLAGS_fresh, 20)));
    std::printf(
        "\n  profile: the least P with one parameter fixed, %zu "
        "starts; in brackets 95 %% in the last digit; the best: %.3f\n",
        base.values.size(),
        base.mean());
    const double factor =
        ConfidenceFactor(static_cast<int>(base.values.size()));
    for (std::size_t k = 0; k < profile.size(); ++k) {
      const ProfilePoint& p = profile[k];
      const SearchedFlag& flag = task.flags[p.parameter];
      csv += flag.name + Format(",%.17g", p.string[p.parameter]) +
             Values(p.string) +
             Format(",%.17g,%.17g,%.17g,%.17g\n",
                    p.check.mean(),
                    p.check.error(),
                    base.mean(),
                    base.error());
      if (k == 0 || profile[k - 1].parameter != p.parameter) {
        std::printf("%s    %-8s", k == 0 ? "" : "\n", flag.name.c_str());
      }
      std::printf(" %.3g: %.3f(%.0f)",
                  p.string[p.parameter],
                  p.check.mean(),
                  std::ceil(1e3 * factor * p.check.error()));
    }
    std::printf("\n");
    output.Write("profile.csv", csv);
  }
  if (!alternatives.empty()) {
    std::string csv = "method,repeat,strings,runs,reported,fresh,fresh_error";
    for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
    csv += "\n";
    std::vector<std::vector<std::string>> table = {{"method",
                                                    "strings",
                                                    "runs",
                                                    "P reported",
                                                    "P, fresh",
                                                    "+- 95 %",
                                                    "too good by"}};
    json["alternatives"] = Json::array();
    for (std::size_t k = 0; k < alternatives.size(); k += FLAGS_repeats) {
      std::vector<double> strings, runs, reported, fresh;
      double error = 0.0;
      for (int r = 0; r < FLAGS_repeats; ++r) {
        const AlternativeRun& a = alternatives[k + r];
        csv += Field(a.method->name) +
               Format(",%d,%d,%lld,%.17g,%.17g,%.17g",
                      r,
                      a.strings,
                      static_cast<long long>(a.runs),
                      a.reported,
                      a.fresh.mean(),
                      a.fresh.error()) +
               Values(a.best) + "\n";
        strings.push_back(a.strings);
        runs.push_back(static_cast<double>(a.runs));
        reported.push_back(a.reported);
        fresh.push_back(a.fresh.mean());
        error += a.fresh.error() / FLAGS_repeats;
      }
      const double f = MeanAndDeviation(fresh).mean,
                   p = MeanAndDeviation(reported).mean;
      table.push_back({alternatives[k].method->name,
                       Format("%.0f", MeanAndDeviation(strings).mean),
                       Format("%.0f", MeanAndDeviation(runs).mean),
                       Format("%.4f", p),
                       Format("%.4f", f),
                       Format("%.4f", ConfidenceFactor(FLAGS_fresh) * error),
                       Format("%.0f %%", 100.0 * (1.0 - p / f))});
      json["alternatives"].push_back(
          {{"method", alternatives[k].method->name},
           {"strings", MeanAndDeviation(strings).mean},
           {"runs", MeanAndDeviation(runs).mean},
           {"reported", p},
           {"fresh", f}});
    }
    std::printf(
        "\n  other searches with as many runs, means of %d; their best "
        "on the same %d fresh starts\n\n",
        FLAGS_repeats,
        FLAGS_fresh);
    std::fputs(Grid(table, 0, false).c_str(), stdout);
    output.Write("alternatives.csv", csv);
  }
  if (FLAGS_recovery) {
    std::printf(
        "\n  recovery of the first string of Table 1 from what it does "
        "on average over %d starts\n",
        FLAGS_smoke ? 5 : 20);
    PrintIdentification(recovery_task, recovery, 3);
    json["recovery"] = IdentificationJson(recovery_task, recovery);
    output.Write("recovery.csv", FreshCsv(recovery_task, recovery));
  }
  json["cpu_seconds"] = CpuSeconds() - cpu;
  json["all_runs"] = record.runs();
  json["schema"] = "granopt/identify/1";
  json["provenance"] = Provenance();
  json["provenance"]["threads"] = FLAGS_threads;
  output.Plot({"identify_convergence",
               output.Path("history.csv"),
               output.Path("convergence")},
              {"convergence.svg", "convergence.png"});
  output.Plot({"identify_response",
               output.Path("response.csv"),
               output.Path("response")},
              {"response.svg", "response.png"});
  output.Plot({"identify_valley",
               output.Path("fresh.csv"),
               output.Path("strings_evaluated.csv"),
               output.Path("valley")},
              {"valley.svg", "valley.png"});
  if (!profile.empty()) {
    output.Plot({"identify_profile",
                 output.Path("profile.csv"),
                 output.Path("profile")},
                {"profile.svg", "profile.png"});
  }
  if (!alternatives.empty()) {
    output.Plot({"identify_alternatives",
                 output.Path("alternatives.csv"),
                 output.Path("alternatives")},
                {"alternatives.svg", "alternatives.png"});
  }
  output.WriteJson("summary.json", json);
  std::printf("\n  %lld runs in all; %.3g CPU seconds of this run\n",
              static_cast<long long>(record.runs()),
              json["cpu_seconds"].get<double>());
  output.PrintFiles();
  return kConverged;
}

int Main() {
  if (FLAGS_list_methods) {
    std::fputs(SearchTable().c_str(), stdout);
    return kConverged;
  }
  run_seed = FLAGS_seed;
  CheckFlags();
  return FLAGS_worker ? RunWorker() : RunIdentify();
}

}  // namespace
}  // namespace granopt

int main(int argc, char** argv) {
  granopt::ParseFlags(&argc,
                      &argv,
                      "parameters of a near-field flow from its energies "
                      "(--paper: sec. 8.2 of Zohdi 2005)");
  return granopt::Main();
}
