#include "experiments/comparison.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <set>
#include <tuple>

#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

struct Kind {
  const char* name;
  double value;  // default; 0: the kind has none
  double largest;
};

// Values beyond these are no small loads but mistakes.
constexpr Kind kKinds[] = {{"growth", 5e-5, 1.0},
                           {"simple_shear", 1e-4, 1e3},
                           {"pure_shear", 1e-4, 1e3},
                           {"random", 1e-4, 1.0},
                           {"fig2", 5e-5, 1.0},
                           {"near_jamming", 1e-6, 1.0},
                           {"start", 0.0, 0.0},
                           {"user", 0.0, 0.0}};

// "growth=5e-5: radii x (1 + 5e-5), positions fixed".
std::string Meaning(const Case& c) {
  const std::string value = Neat(c.value);
  if (c.kind == "growth") return "radii x (1 + " + value + "), positions fixed";
  if (c.kind == "simple_shear") return "simple shear strain " + value;
  if (c.kind == "pure_shear") return "pure shear strain " + value;
  if (c.kind == "random") {
    return "each coordinate displaced by up to " + value + " of the box";
  }
  if (c.kind == "fig2") {
    return "radii x (1 + " + value + ") from a state compressed to phi";
  }
  if (c.kind == "near_jamming") {
    return "simple shear strain " +
           (c.relative ? value + " (phi - phi_J)" : value) +
           " at phi = phi_J + " + Neat(c.distance);
  }
  if (c.kind == "start") return "a random start, unrelaxed";
  return "the input as it is";
}

std::string Meaning(const Level& level) {
  return "max|g| <= " + Neat(level.value) +
         (level.absolute ? " (k = 1, box = 1)" : " mean forces");
}

// ---------------------------------------------------------------- CSV

std::string KeyFields(const RunKey& key) {
  return Field(key.case_id) + "," +
         Format("%llu,%d,%d,",
                static_cast<unsigned long long>(key.seed),
                key.step,
                key.repetition) +
         Field(key.label) + "," + Field(key.spec) + ",";
}
constexpr char kKeyColumns[] = "case,seed,step,repetition,solver,spec,";

void ReadKey(CsvReader* reader, RunKey* key) {
  reader->Read("case", &key->case_id);
  reader->Read("seed", &key->seed);
  // Files of comparisons without chains may lack it.
  if (reader->Has("step")) reader->Read("step", &key->step);
  reader->Read("repetition", &key->repetition);
  reader->Read("solver", &key->label);
  reader->Read("spec", &key->spec);
}

}  // namespace

std::string WorkFields(const Work& work) {
  return Number(work.iterations) + "," + Number(work.evaluations) + "," +
         Number(work.hessians) + "," + Number(work.factorizations) + "," +
         Number(work.solves) + "," + Number(work.linear_iterations) +
         Format(",%.9g,%.4f,%.4f",
                work.cpu_seconds,
                work.function_share,
                work.linear_share);
}
const char kWorkColumns[] =
    "iterations,evaluations,hessians,factorizations,solves,linear_iterations,"
    "cpu_seconds,function_share,linear_share";

void ReadWork(CsvReader* reader, Work* work) {
  reader->Read("iterations", &work->iterations);
  reader->Read("evaluations", &work->evaluations);
  reader->Read("hessians", &work->hessians);
  reader->Read("factorizations", &work->factorizations);
  reader->Read("solves", &work->solves);
  reader->Read("linear_iterations", &work->linear_iterations);
  reader->Read("cpu_seconds", &work->cpu_seconds);
  reader->Read("function_share", &work->function_share);
  reader->Read("linear_share", &work->linear_share);
}

std::string Spread(const Quantiles& q,
                   double spent,
                   const std::function<std::string(double)>& print) {
  if (std::isnan(q.median)) return "-";
  if (std::isinf(q.median)) {
    return std::isnan(spent) ? "-" : ">" + print(spent);
  }
  // Of work that no run did, the failed ones did none either.
  if (q.low == 0.0 && q.median == 0.0 && std::isinf(q.high)) return print(0.0);
  const std::string middle = print(q.median);
  const std::string low = print(q.low), high = print(q.high);
  if (low == middle && high == middle) return middle;
  return middle + " (" + low + "-" + high + ")";
}

std::string Tally(const std::vector<std::string>& words) {
  std::map<std::string, int> count;
  for (const std::string& word : words) ++count[word];
  if (count.empty()) return "not run";
  if (count.size() == 1) return count.begin()->first;
  std::string text;
  for (const auto& [word, n] : count) {
    text += (text.empty() ? "" : ", ") + word + " " + std::to_string(n);
  }
  return text;
}

namespace {

std::string EndOf(const RunRecord& run) {
  if (run.stop_reason == StopReasonName(StopReason::CONVERGED)) {
    return "converged";
  }
  if (run.stop_reason == StopReasonName(StopReason::VANISHED)) {
    return "unjammed";
  }
  return run.stop_reason;
}

// "1", "1-3", "1, 3".
std::string Numbers(const std::set<int>& numbers) {
  if (numbers.size() > 2 && *numbers.rbegin() - *numbers.begin() + 1 ==
                                static_cast<int>(numbers.size())) {
    return Format("%d-%d", *numbers.begin(), *numbers.rbegin());
  }
  std::string text;
  for (const int n : numbers) {
    text += (text.empty() ? "" : ", ") + std::to_string(n);
  }
  return text;
}

// Runs and events by what they are of.
class RunIndex {
 public:
  RunIndex(const std::vector<Event>& events,
           const std::vector<RunRecord>& runs) {
    for (const RunRecord& run : runs) runs_[PlaceOf(run.key)] = &run;
    for (const Event& event : events) {
      events_[{PlaceOf(event.key), event.level.absolute, event.level.value}] =
          &event;
    }
  }

  // Null if it was not run: an unfinished comparison.
  const RunRecord* Find(const std::string& case_id,
                        const std::string& label,
                        std::uint64_t seed,
                        int step,
                        int repetition) const {
    const auto found = runs_.find({case_id, label, seed, step, repetition});
    return found == runs_.end() ? nullptr : found->second;
  }

  // Work until the level, null if it was never reached. A run that ended at
  // E = 0 has reached every level.
  const Work* Reached(const RunRecord& run, const Level& level) const {
    const auto found =
        events_.find({PlaceOf(run.key), level.absolute, level.value});
    if (found != events_.end()) return &found->second->work;
    return run.stop_reason == StopReasonName(StopReason::VANISHED) ? &run.work
                                                                   : nullptr;
  }

 private:
  using Place = std::tuple<std::string, std::string, std::uint64_t, int, int>;
  static Place PlaceOf(const RunKey& key) {
    return {key.case_id, key.label, key.seed, key.step, key.repetition};
  }

  std::map<Place, const RunRecord*> runs_;
  std::map<std::tuple<Place, bool, double>, const Event*> events_;
};

int StepsOf(const ComparisonSetup& setup, const Case& c) {
  return c.kind == "near_jamming" ? setup.steps : 1;
}
bool IsChain(const ComparisonSetup& setup, const Case& c) {
  return StepsOf(setup, c) > 1;
}

// What a reader must know about the runs of a case beyond its tables.
std::vector<std::string> Notes(const ComparisonSetup& setup,
                               const Case& c,
                               const std::vector<RunRecord>& runs) {
  std::vector<std::string> notes;
  // Failures, equal ones of several repetitions together.
  std::vector<std::pair<std::string, std::set<int>>> failures;
  using Counts = std::pair<std::int64_t, std::int64_t>;
  std::map<std::tuple<std::uint64_t, int, std::string>, Counts> counts;
  std::set<std::string> differ;
  // Minima by seed and step: energy and methods.
  std::map<std::pair<std::uint64_t, int>,
           std::map<std::string, std::pair<double, std::vector<std::string>>>>
      minima;
  const bool chain = IsChain(setup, c);
  struct FailedSteps {
    std::set<std::pair<std::uint64_t, int>> steps;
    std::string first;
  };
  std::map<std::pair<std::string, std::string>, FailedSteps> failed_steps;
  const auto seed_and_step = [&](std::uint64_t seed, int step) {
    return Format("seed %llu", static_cast<unsigned long long>(seed)) +
           (chain ? Format(", step %d", step) : "");
  };
  for (const RunRecord& run : runs) {
    const RunKey& key = run.key;
    if (key.case_id != c.id) continue;
    if (!run.converged) {
      if (chain) {
        FailedSteps& failed = failed_steps[{key.label, run.stop_reason}];
        if (failed.steps.empty()) {
          failed.first = seed_and_step(key.seed, key.step) + ": " + run.message;
        }
        failed.steps.insert({key.seed, key.step});
      }
      const std::string line = key.label +
                               (setup.seeds.size() > 1 || chain
                                    ? ", " + seed_and_step(key.seed, key.step)
                                    : "") +
                               ": " + run.stop_reason + ", " + run.message;
      auto found = std::find_if(
          failures.begin(), failures.end(), [&](const auto& failure) {
            return failure.first == line;
          });
      if (found == failures.end()) {
        failures.push_back({line, {}});
        found = failures.end() - 1;
      }
      found->second.insert(key.repetition);
    }
    const Counts now = {run.work.iterations, run.work.evaluations};
    const auto first =
        counts.insert({{key.seed, key.step, key.label}, now}).first->second;
    if (first != now &&
        run.stop_reason != StopReasonName(StopReason::MAX_SECONDS)) {
      differ.insert(key.label);
    }
    auto& minimum = minima[{key.seed, key.step}][run.minimum];
    minimum.first = run.energy;
    if (std::find(minimum.second.begin(), minimum.second.end(), key.label) ==
        minimum.second.end()) {
      minimum.second.push_back(key.label);
    }
  }
  for (const auto& [line, repetitions] : failures) {
    if (chain) break;
    notes.push_back(
        "! " + line +
        (setup.repetitions > 1
             ? (repetitions.size() == 1 ? " (repetition " : " (repetitions ") +
                   Numbers(repetitions) + ")"
             : ""));
  }
  // Of a chain, those of one method and kind together.
  for (const auto& [end, failed] : failed_steps) {
    notes.push_back("! " + end.first + ": " + end.second +
                    Format(" in %zu of %zu steps, as ",
                           failed.steps.size(),
                           minima.size()) +
                    failed.first);
  }
  for (const std::string& label : differ) {
    notes.push_back("! " + label +
                    ": counts differ between repetitions, which they should "
                    "not");
  }
  // Seeds in which all runs agree are said together.
  std::map<std::string, std::set<int>> alike;
  std::map<std::string, int> alike_steps;
  // Of long chains the first ones; all are in runs.csv.
  constexpr int kMostLines = 6;
  int lines = 0, more = 0;
  for (const auto& [instance, tags] : minima) {
    if (tags.size() == 1 && tags.begin()->first != "-") {
      const std::string end = tags.begin()->first == "0"
                                  ? "unjammed (E = 0 or on the way there)"
                                  : "in one minimum";
      alike[end].insert(static_cast<int>(instance.first));
      ++alike_steps[end];
      continue;
    }
    if (chain && ++lines > kMostLines) {
      ++more;
      continue;
    }
    std::string line = seed_and_step(instance.first, instance.second) + ": ";
    bool first = true;
    for (const auto& [tag, minimum] : tags) {
      std::string labels;
      for (const std::string& label : minimum.second) {
        labels += (labels.empty() ? "" : ", ") + label;
      }
      line += (first ? "" : "; ") +
              (tag == "-"   ? "no minimum"
               : tag == "0" ? "E = 0"
                            : Format("minimum %s with E = %.10g",
                                     tag.c_str(),
                                     minimum.first)) +
              " (" + labels + ")";
      first = false;
    }
    notes.push_back(line);
  }
  if (more > 0) {
    notes.push_back(
        Format("and %d more steps whose runs do not end in one minimum "
               "(runs.csv)",
               more));
  }
  if (chain) {
    for (const auto& [end, count] : alike_steps) {
      notes.push_back(Format("%d of %zu steps: all runs end %s",
                             count,
                             minima.size(),
                             end.c_str()));
    }
    return notes;
  }
  for (const auto& [end, seeds] : alike) {
    notes.push_back((minima.size() == 1
                         ? std::string("all runs end ")
                         : (seeds.size() == 1 ? "seed " : "seeds ") +
                               Numbers(seeds) + ": all runs end ") +
                    end);
  }
  return notes;
}

}  // namespace

// ---------------------------------------------------------------- the plan

bool ParseMethods(const std::string& text,
                  std::vector<Method>* methods,
                  std::string* error) {
  methods->clear();
  std::set<std::string> labels;
  for (const std::string& entry : Split(text, ';')) {
    const std::size_t at = entry.find('@');
    Method method;
    method.spec =
        at == std::string::npos ? entry : Trimmed(entry.substr(at + 1));
    method.label =
        at == std::string::npos ? entry : Trimmed(entry.substr(0, at));
    if (method.label.empty() || method.spec.empty()) {
      return Fail("'" + text +
                      "' has an empty entry; expected "
                      "spec;label@spec;...",
                  error);
    }
    if (!labels.insert(method.label).second) {
      return Fail("'" + method.label + "' is given twice", error);
    }
    methods->push_back(method);
  }
  return true;
}

double StrainOf(const Case& c) {
  return c.relative ? c.value * c.distance : c.value;
}

bool ParseCases(const std::string& text,
                const std::vector<double>& distances,
                double shear,
                std::vector<Case>* cases,
                std::string* error) {
  cases->clear();
  std::set<std::string> ids;
  for (const std::string& entry : Split(text, ',')) {
    const std::size_t equals = entry.find('=');
    const std::string name = entry.substr(0, equals);
    const Kind* kind = nullptr;
    std::string known;
    for (const Kind& candidate : kKinds) {
      if (name == candidate.name) kind = &candidate;
      known += (known.empty() ? "" : ", ") + std::string(candidate.name);
    }
    if (kind == nullptr) {
      return Fail("unknown case '" + name + "'; known are " + known, error);
    }
    Case c;
    c.kind = name;
    c.value = name == "near_jamming" ? shear : kind->value;
    const bool near = name == "near_jamming";
    if (equals != std::string::npos) {
      if (kind->value == 0.0) {
        return Fail("the case " + name + " takes no value", error);
      }
      std::string value = entry.substr(equals + 1);
      c.relative = near && !value.empty() && value.back() == 'x';
      if (c.relative) value.pop_back();
      const bool number = ParseDouble(value, &c.value) && c.value > 0.0 &&
                          std::isfinite(c.value);
      if (!number || (!c.relative && c.value > kind->largest)) {
        return Fail(
            entry + ": the value must be in (0, " + Neat(kind->largest) + "]" +
                (near ? ", or a multiple of the distance as in 0.3x" : ""),
            error);
      }
    }
    c.id = kind->value == 0.0
               ? name
               : name + "=" + Neat(c.value) + (c.relative ? "x" : "");
    for (std::size_t k = 0; k < (near ? distances.size() : 1); ++k) {
      Case one = c;
      if (near) {
        one.distance = distances[k];
        one.id += " at " + Neat(distances[k]);
        if (StrainOf(one) > kind->largest) {
          return Fail(one.id + ": the strain must be in (0, " +
                          Neat(kind->largest) + "]",
                      error);
        }
      }
      if (!ids.insert(one.id).second) {
        return Fail("the case " + one.id + " is given twice", error);
      }
      cases->push_back(one);
    }
  }
  return true;
}

std::vector<int> MethodOrder(int methods, int repetition) {
  std::vector<int> order(methods);
  const int step = repetition % 2 == 0 ? 1 : methods - 1;
  int at = repetition % methods;
  for (int& index : order) {
    index = at;
    at = (at + step) % methods;
  }
  return order;
}

std::vector<Level> Ladder(const std::vector<Level>& more) {
  std::vector<Level> ladder;
  // Parsed, not computed: 1e-13 here is 1e-13 on the command line.
  for (int e = 1; e <= 15; ++e) {
    ladder.push_back({false, std::strtod(Format("1e-%d", e).c_str(), nullptr)});
  }
  for (int e = 4; e <= 16; ++e) {
    ladder.push_back({true, std::strtod(Format("1e-%d", e).c_str(), nullptr)});
  }
  for (const Level& level : more) {
    if (std::find(ladder.begin(), ladder.end(), level) == ladder.end()) {
      ladder.push_back(level);
    }
  }
  std::sort(ladder.begin(), ladder.end(), [](const Level& a, const Level& b) {
    if (a.absolute != b.absolute) return b.absolute;
    return a.value > b.value;
  });
  return ladder;
}

std::string FormatSetup(const ComparisonSetup& setup) {
  Json json;
  json["schema"] = "granopt/compare-setup/1";
  json["paper"] = setup.paper;
  json["what"] = setup.what;
  json["cases"] = Json::array();
  for (const Case& c : setup.cases) {
    json["cases"].push_back({{"id", c.id},
                             {"kind", c.kind},
                             {"value", c.value},
                             {"distance", c.distance},
                             {"relative", c.relative}});
  }
  json["solvers"] = Json::array();
  for (const Method& method : setup.methods) {
    json["solvers"].push_back({{"label", method.label}, {"spec", method.spec}});
  }
  json["seeds"] = setup.seeds;
  json["repetitions"] = setup.repetitions;
  json["steps"] = setup.steps;
  json["levels"] = Json::array();
  for (const Level& level : setup.levels) {
    json["levels"].push_back(
        {{"absolute", level.absolute}, {"value", level.value}});
  }
  json["baseline"] = setup.baseline;
  json["reference"] = setup.reference;
  json["conditions"] = setup.conditions;
  json["assumptions"] = Json::array();
  for (const auto& [open, assumed] : setup.assumptions) {
    json["assumptions"].push_back({{"open", open}, {"assumed", assumed}});
  }
  return json.dump(2) + "\n";
}

bool ParseSetup(const std::string& text,
                const std::string& name,
                ComparisonSetup* setup,
                std::string* error) {
  try {
    const Json json = Json::parse(text);
    ComparisonSetup result;
    result.paper = json.at("paper").get<std::string>();
    result.what = json.at("what").get<std::string>();
    for (const Json& c : json.at("cases")) {
      result.cases.push_back({c.at("id").get<std::string>(),
                              c.at("kind").get<std::string>(),
                              c.at("value").get<double>(),
                              c.at("distance").get<double>(),
                              c.value("relative", false)});
    }
    for (const Json& method : json.at("solvers")) {
      result.methods.push_back({method.at("label").get<std::string>(),
                                method.at("spec").get<std::string>()});
    }
    result.seeds = json.at("seeds").get<std::vector<std::uint64_t>>();
    result.repetitions = json.at("repetitions").get<int>();
    result.steps = json.value("steps", 1);
    for (const Json& level : json.at("levels")) {
      result.levels.push_back(
          {level.at("absolute").get<bool>(), level.at("value").get<double>()});
    }
    result.baseline = json.at("baseline").get<std::string>();
    result.reference = json.value("reference", "");
    result.conditions = json.value("conditions", "");
    for (const Json& row : json.at("assumptions")) {
      result.assumptions.emplace_back(row.at("open").get<std::string>(),
                                      row.at("assumed").get<std::string>());
    }
    if (result.cases.empty() || result.methods.empty() ||
        result.levels.empty()) {
      return Fail(name + ": no cases, solvers or levels", error);
    }
    *setup = std::move(result);
    return true;
  } catch (const Json::exception& e) {
    return Fail(name + ": " + e.what(), error);
  }
}

// ---------------------------------------------------------------- raw events

Work MakeWork(const Counters& counters,
              double cpu_seconds,
              double seconds,
              double function_seconds,
              double linear_seconds) {
  Work work;
  work.iterations = counters.iterations;
  work.evaluations = counters.evaluations;
  work.hessians = counters.hessians;
  work.factorizations = counters.factorizations;
  work.solves = counters.solves;
  work.linear_iterations = counters.linear_iterations;
  work.cpu_seconds = cpu_seconds;
  if (seconds > 0.0) {
    work.function_share = function_seconds / seconds;
    work.linear_share = linear_seconds / seconds;
  }
  return work;
}

std::string EventsCsv(const std::vector<Event>& events) {
  std::string csv =
      std::string(kKeyColumns) + "kind,level," + kWorkColumns + ",energy\n";
  for (const Event& event : events) {
    csv += KeyFields(event.key) +
           (event.level.absolute ? "absolute," : "relative,") +
           Neat(event.level.value) + "," + WorkFields(event.work) + "," +
           Number(event.energy) + "\n";
  }
  return csv;
}

bool ParseEvents(const std::string& text,
                 const std::string& name,
                 std::vector<Event>* events,
                 std::string* error) {
  events->clear();
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    Event event;
    ReadKey(&reader, &event.key);
    std::string kind;
    reader.Read("kind", &kind);
    if (kind != "absolute" && kind != "relative") {
      reader.Complain("kind '" + kind + "' is neither absolute nor relative");
    }
    event.level.absolute = kind == "absolute";
    reader.Read("level", &event.level.value);
    ReadWork(&reader, &event.work);
    reader.Read("energy", &event.energy);
    if (!reader.error().empty()) return Fail(reader.error(), error);
    events->push_back(event);
  }
  return true;
}

std::string RunsCsv(const std::vector<RunRecord>& runs) {
  std::string csv =
      std::string(kKeyColumns) +
      "position,converged,stop_reason,message,residual,quad_residual,"
      "quad_max_gradient,energy,pressure,phi,rattlers,minimum,distance,"
      "list_builds,restarts,recenters,rebases," +
      kWorkColumns + ",seconds\n";
  for (const RunRecord& run : runs) {
    csv += KeyFields(run.key) +
           Format("%d,%d,", run.position, run.converged ? 1 : 0) +
           run.stop_reason + "," + Field(run.message) + "," +
           Number(run.residual) + "," + Number(run.quad_residual) + "," +
           Number(run.quad_max_gradient) + "," + Number(run.energy) + "," +
           Number(run.pressure) + "," + Number(run.phi) +
           Format(",%d,", run.rattlers) + run.minimum + "," +
           Number(run.distance) + "," + Number(run.list_builds) + "," +
           Number(run.restarts) + "," + Number(run.recenters) + "," +
           Number(run.rebases) + "," + WorkFields(run.work) +
           Format(",%.9g\n", run.seconds);
  }
  return csv;
}

bool ParseRuns(const std::string& text,
               const std::string& name,
               std::vector<RunRecord>* runs,
               std::string* error) {
  runs->clear();
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    RunRecord run;
    ReadKey(&reader, &run.key);
    int converged = 0;
    reader.Read("position", &run.position);
    reader.Read("converged", &converged);
    run.converged = converged != 0;
    reader.Read("stop_reason", &run.stop_reason);
    reader.Read("message", &run.message);
    reader.Read("residual", &run.residual);
    reader.Read("quad_residual", &run.quad_residual);
    reader.Read("quad_max_gradient", &run.quad_max_gradient);
    reader.Read("energy", &run.energy);
    reader.Read("pressure", &run.pressure);
    reader.Read("phi", &run.phi);
    reader.Read("rattlers", &run.rattlers);
    reader.Read("minimum", &run.minimum);
    reader.Read("distance", &run.distance);
    reader.Read("list_builds", &run.list_builds);
    reader.Read("restarts", &run.restarts);
    reader.Read("recenters", &run.recenters);
    reader.Read("rebases", &run.rebases);
    ReadWork(&reader, &run.work);
    reader.Read("seconds", &run.seconds);
    if (!reader.error().empty()) return Fail(reader.error(), error);
    runs->push_back(run);
  }
  return true;
}

std::string StepsCsv(const std::vector<StepRecord>& steps) {
  std::string csv =
      "case,seed,step,strain,kind,apart,contacts,contacts_changed,energy,"
      "half_energy,residual,half_residual,pressure,minimum\n";
  for (const StepRecord& step : steps) {
    csv += Field(step.case_id) +
           Format(",%llu,%d,",
                  static_cast<unsigned long long>(step.seed),
                  step.step) +
           Number(step.strain) + "," + step.kind + "," + Number(step.apart) +
           Format(",%d,%d,", step.contacts, step.contacts_changed) +
           Number(step.energy) + "," + Number(step.half_energy) + "," +
           Number(step.residual) + "," + Number(step.half_residual) + "," +
           Number(step.pressure) + "," + step.minimum + "\n";
  }
  return csv;
}

bool ParseSteps(const std::string& text,
                const std::string& name,
                std::vector<StepRecord>* steps,
                std::string* error) {
  steps->clear();
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    StepRecord step;
    reader.Read("case", &step.case_id);
    reader.Read("seed", &step.seed);
    reader.Read("step", &step.step);
    reader.Read("strain", &step.strain);
    reader.Read("kind", &step.kind);
    reader.Read("apart", &step.apart);
    reader.Read("contacts", &step.contacts);
    reader.Read("contacts_changed", &step.contacts_changed);
    reader.Read("energy", &step.energy);
    reader.Read("half_energy", &step.half_energy);
    reader.Read("residual", &step.residual);
    reader.Read("half_residual", &step.half_residual);
    reader.Read("pressure", &step.pressure);
    reader.Read("minimum", &step.minimum);
    bool known = false;
    for (const char* kind :
         {kNonRearranging, kRearranging, kUnjammed, kUndecided}) {
      known = known || step.kind == kind;
    }
    if (!known) reader.Complain("kind '" + step.kind + "' is not known");
    if (!reader.error().empty()) return Fail(reader.error(), error);
    steps->push_back(step);
  }
  return true;
}

std::string CurvesCsv(const std::vector<CurveRow>& rows) {
  std::string csv =
      "case,seed,solver,iteration,evaluations,cpu_seconds,residual,"
      "max_gradient,energy\n";
  for (const CurveRow& row : rows) {
    csv += Field(row.case_id) + "," +
           Format("%llu,", static_cast<unsigned long long>(row.seed)) +
           Field(row.label) +
           Format(",%lld,%lld,%.7g,%.7g,%.7g,%.17g\n",
                  static_cast<long long>(row.iteration),
                  static_cast<long long>(row.evaluations),
                  row.cpu_seconds,
                  row.residual,
                  row.max_gradient,
                  row.energy);
  }
  return csv;
}

bool ParseCurves(const std::string& text,
                 const std::string& name,
                 std::vector<CurveRow>* rows,
                 std::string* error) {
  rows->clear();
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    CurveRow row;
    reader.Read("case", &row.case_id);
    reader.Read("seed", &row.seed);
    reader.Read("solver", &row.label);
    reader.Read("iteration", &row.iteration);
    reader.Read("evaluations", &row.evaluations);
    reader.Read("cpu_seconds", &row.cpu_seconds);
    reader.Read("residual", &row.residual);
    reader.Read("max_gradient", &row.max_gradient);
    reader.Read("energy", &row.energy);
    if (!reader.error().empty()) return Fail(reader.error(), error);
    rows->push_back(row);
  }
  return true;
}

Crossings::Crossings(const std::vector<Level>& ladder, double force_unit)
    : force_unit_(force_unit) {
  for (const Level& level : ladder) {
    (level.absolute ? absolute_ : relative_).push_back(level);
  }
  const auto smaller = [](const Level& a, const Level& b) {
    return a.value < b.value;
  };
  std::sort(relative_.begin(), relative_.end(), smaller);
  std::sort(absolute_.begin(), absolute_.end(), smaller);
}

bool Crossings::Due(double max_gradient, double force_scale) const {
  return (!relative_.empty() &&
          max_gradient <= Bound(relative_.back(), force_scale)) ||
         (!absolute_.empty() &&
          max_gradient <= Bound(absolute_.back(), force_scale));
}

void Crossings::Note(const RunKey& key,
                     double max_gradient,
                     double force_scale,
                     const Work& work,
                     double energy,
                     std::vector<Event>* events) {
  for (std::vector<Level>* levels : {&relative_, &absolute_}) {
    while (!levels->empty() &&
           max_gradient <= Bound(levels->back(), force_scale)) {
      events->push_back({key, levels->back(), work, energy});
      levels->pop_back();
    }
  }
}

std::vector<int> ThinTrace(const std::vector<double>& residuals, int buckets) {
  const int n = static_cast<int>(residuals.size());
  std::set<int> kept;
  if (n == 0) return {};
  kept.insert(0);
  kept.insert(n - 1);
  const auto keep = [&](int begin, int end) {
    if (begin >= end) return;
    const auto first = residuals.begin();
    kept.insert(
        static_cast<int>(std::min_element(first + begin, first + end) - first));
    kept.insert(
        static_cast<int>(std::max_element(first + begin, first + end) - first));
  };
  for (int b = 0; b < buckets; ++b) {
    keep(static_cast<int>(static_cast<std::int64_t>(n) * b / buckets),
         static_cast<int>(static_cast<std::int64_t>(n) * (b + 1) / buckets));
    keep(static_cast<int>(std::pow(n, static_cast<double>(b) / buckets)),
         static_cast<int>(std::pow(n, static_cast<double>(b + 1) / buckets)));
  }
  return {kept.begin(), kept.end()};
}

// ---------------------------------------------------------------- minima

double RigidDistance(const std::vector<double>& a,
                     const std::vector<bool>& is_rattler_a,
                     const std::vector<double>& b,
                     const std::vector<bool>& is_rattler_b) {
  const int grains = static_cast<int>(is_rattler_a.size());
  const int d = grains == 0 ? 0 : static_cast<int>(a.size()) / grains;
  double largest = 0.0;
  for (int k = 0; k < d; ++k) {
    const auto difference = [&](int i) { return a[d * i + k] - b[d * i + k]; };
    double mean = 0.0;
    int rigid = 0;
    for (int i = 0; i < grains; ++i) {
      if (is_rattler_a[i] || is_rattler_b[i]) continue;
      mean += difference(i);
      ++rigid;
    }
    if (rigid > 0) mean /= rigid;
    for (int i = 0; i < grains; ++i) {
      if (is_rattler_a[i] || is_rattler_b[i]) continue;
      largest = std::max(largest, std::abs(difference(i) - mean));
    }
  }
  return largest;
}

std::string Minima::Tag(double energy,
                        double residual,
                        double vanishing,
                        double mean_overlap,
                        const std::vector<double>& displacements,
                        const std::vector<bool>& is_rattler) {
  if (energy == 0.0) return "0";
  if (!(residual <= kResidualBound)) {
    return vanishing <= kVanishingBound ? "0" : "-";
  }
  for (const Minimum& other : minima_) {
    if (std::abs(energy - other.energy) >
        kEnergyBound * std::max(std::abs(energy), std::abs(other.energy))) {
      continue;
    }
    if (RigidDistance(
            displacements, is_rattler, other.displacements, other.is_rattler) <=
        kOverlapBound * mean_overlap) {
      return other.name;
    }
  }
  std::string name;
  for (int k = ++next_; k > 0; k = (k - 1) / 26) {
    name.insert(name.begin(), static_cast<char>('A' + (k - 1) % 26));
  }
  minima_.push_back({name, energy, displacements, is_rattler});
  return name;
}

// ---------------------------------------------------------------- tables

const PaperEntry* PaperTable1(const std::string& kind,
                              const std::string& label) {
  struct Row {
    const char* kind;
    const char* label;
    PaperEntry entry;
  };
  static constexpr Row kRows[] = {
      {"growth", "L-BFGS", {2003, 24.3}},
      {"growth", "P-L-BFGS (A = 0)", {705, 11.8}},
      {"growth", "P-L-BFGS (A = 3)", {813, 16.2}},
      {"growth", "FR-CG", {4574, 58.9}},
      {"growth", "P-FR-CG", {1101, 18.5}},
      {"simple_shear", "L-BFGS", {2749, 29.2}},
      {"simple_shear", "P-L-BFGS (A = 0)", {986, 15.8}},
      {"simple_shear", "P-L-BFGS (A = 3)", {1351, 27.1}},
      {"simple_shear", "FR-CG", {7306, 90.1}},
      {"simple_shear", "P-FR-CG", {2013, 33.5}},
      {"random", "L-BFGS", {602, 7.5}},
      {"random", "P-L-BFGS (A = 0)", {380, 6.8}},
      {"random", "P-L-BFGS (A = 3)", {432, 9.1}},
      {"random", "FR-CG", {940, 11.9}},
      {"random", "P-FR-CG", {528, 9.2}}};
  for (const Row& row : kRows) {
    if (kind == row.kind && label == row.label) return &row.entry;
  }
  return nullptr;
}

std::vector<Table> Tabulate(const ComparisonSetup& setup,
                            const std::vector<Event>& events,
                            const std::vector<RunRecord>& runs) {
  const RunIndex index(events, runs);
  std::vector<Table> tables;
  for (const Case& c : setup.cases) {
    for (const Level& level : setup.levels) {
      Table table;
      table.table_case = c;
      table.level = level;
      std::vector<double> distances;
      for (const Method& method : setup.methods) {
        TableRow row;
        row.method = method;
        if (setup.paper == "table1") {
          row.paper = PaperTable1(c.kind, method.label);
        }
        std::vector<double> iterations, evaluations, hessians, factorizations,
            solves, linear_iterations, seconds, ratios, function_shares,
            linear_shares, spent_iterations, spent_evaluations, spent_seconds;
        std::vector<double> residuals;
        std::vector<std::string> minima, ends;
        const auto add_run = [&](std::uint64_t seed, int step, int r) {
          const RunRecord* found =
              index.Find(c.id, method.label, seed, step, r);
          if (found == nullptr) return;
          const RunRecord& run = *found;
          const Work* work = index.Reached(run, level);
          ++row.runs;
          if (work != nullptr) ++row.reached;
          const auto add = [&](std::vector<double>* values, auto member) {
            values->push_back(work == nullptr
                                  ? kInfinity
                                  : static_cast<double>(work->*member));
          };
          add(&iterations, &Work::iterations);
          add(&evaluations, &Work::evaluations);
          add(&hessians, &Work::hessians);
          add(&factorizations, &Work::factorizations);
          add(&solves, &Work::solves);
          add(&linear_iterations, &Work::linear_iterations);
          add(&seconds, &Work::cpu_seconds);
          const Work& spent = work == nullptr ? run.work : *work;
          spent_iterations.push_back(static_cast<double>(spent.iterations));
          spent_evaluations.push_back(static_cast<double>(spent.evaluations));
          spent_seconds.push_back(spent.cpu_seconds);
          function_shares.push_back(spent.function_share);
          linear_shares.push_back(spent.linear_share);
          const RunRecord* base =
              index.Find(c.id, setup.baseline, seed, step, r);
          const Work* base_work =
              base == nullptr ? nullptr : index.Reached(*base, level);
          if (base_work != nullptr && base_work->cpu_seconds > 0.0) {
            ratios.push_back(seconds.back() / base_work->cpu_seconds);
          }
          // Relative to forces that fade, a residual says nothing.
          if (level.absolute || run.minimum != "0") {
            residuals.push_back(level.absolute ? run.quad_max_gradient
                                               : run.quad_residual);
          }
          minima.push_back(run.minimum);
          ends.push_back(EndOf(run));
          if (c.kind == "near_jamming") distances.push_back(run.distance);
        };
        for (const std::uint64_t seed : setup.seeds) {
          for (int step = 1; step <= StepsOf(setup, c); ++step) {
            for (int r = 1; r <= setup.repetitions; ++r) {
              add_run(seed, step, r);
            }
          }
        }
        row.iterations = QuantilesOf(iterations);
        row.evaluations = QuantilesOf(evaluations);
        row.hessians = QuantilesOf(hessians);
        row.factorizations = QuantilesOf(factorizations);
        row.solves = QuantilesOf(solves);
        row.linear_iterations = QuantilesOf(linear_iterations);
        row.cpu_seconds = QuantilesOf(seconds);
        row.ratio = QuantilesOf(ratios);
        row.function_share = MedianOf(function_shares);
        row.linear_share = MedianOf(linear_shares);
        row.spent_iterations = MedianOf(spent_iterations);
        row.spent_evaluations = MedianOf(spent_evaluations);
        row.spent_seconds = MedianOf(spent_seconds);
        row.residual = residuals.empty() ? kNan
                                         : *std::max_element(residuals.begin(),
                                                             residuals.end());
        row.minima = Tally(minima);
        row.end = Tally(ends);
        table.rows.push_back(row);
      }
      if (!distances.empty()) table.distance = MedianOf(distances);
      tables.push_back(table);
    }
  }
  return tables;
}

Problems CollectProblems(const ComparisonSetup& setup,
                         const std::vector<Event>& events,
                         const std::vector<RunRecord>& runs) {
  const RunIndex index(events, runs);
  Problems problems;
  problems.methods = setup.methods;
  for (const Case& c : setup.cases) {
    for (const std::uint64_t seed : setup.seeds) {
      for (int step = 1; step <= StepsOf(setup, c); ++step) {
        std::vector<double> evaluations, seconds, energies;
        std::vector<std::string> minima;
        for (const Method& method : setup.methods) {
          std::vector<double> counts, times;
          for (int r = 1; r <= setup.repetitions; ++r) {
            const RunRecord* run =
                index.Find(c.id, method.label, seed, step, r);
            if (run == nullptr) continue;
            const Work* work = index.Reached(*run, setup.levels[0]);
            counts.push_back(work == nullptr
                                 ? kInfinity
                                 : static_cast<double>(work->evaluations));
            times.push_back(work == nullptr ? kInfinity : work->cpu_seconds);
          }
          // Not run: such a problem is left out.
          if (counts.empty()) break;
          evaluations.push_back(MedianOf(counts));
          seconds.push_back(MedianOf(times));
          const RunRecord* first =
              index.Find(c.id, method.label, seed, step, 1);
          energies.push_back(first == nullptr ? kNan : first->energy);
          minima.push_back(first == nullptr ? "-" : first->minimum);
        }
        if (evaluations.size() < setup.methods.size()) continue;
        problems.evaluations.push_back(evaluations);
        problems.cpu_seconds.push_back(seconds);
        problems.energies.push_back(energies);
        problems.minima.push_back(minima);
      }
    }
  }
  return problems;
}

MedianWorst MedianAndWorst(const std::vector<double>& values) {
  if (values.empty()) return {kNan, kNan};
  return {MedianOf(values), *std::max_element(values.begin(), values.end())};
}

namespace {

using StepPlace = std::tuple<std::string, std::uint64_t, int>;

std::map<StepPlace, const StepRecord*> StepIndex(
    const std::vector<StepRecord>& steps) {
  std::map<StepPlace, const StepRecord*> index;
  for (const StepRecord& step : steps) {
    index[{step.case_id, step.seed, step.step}] = &step;
  }
  return index;
}

// A minimum to compare with, and its energy.
struct End {
  std::string minimum;
  double energy = 0.0;
};

// Of the reference in the given instance; false if there is none.
bool ReferenceEnd(const ComparisonSetup& setup,
                  const RunIndex& index,
                  const std::map<StepPlace, const StepRecord*>& steps,
                  const std::string& case_id,
                  std::uint64_t seed,
                  int step,
                  End* end) {
  if (setup.reference.empty()) {
    const auto found = steps.find({case_id, seed, step});
    if (found == steps.end()) return false;
    *end = {found->second->minimum, found->second->energy};
    return true;
  }
  const RunRecord* run = index.Find(case_id, setup.reference, seed, step, 1);
  if (run == nullptr) return false;
  *end = {run->minimum, run->energy};
  return true;
}

StepRow MakeStepRow(const ComparisonSetup& setup,
                    const RunIndex& index,
                    const std::map<StepPlace, const StepRecord*>& steps,
                    const std::vector<std::pair<std::uint64_t, int>>& chosen,
                    const Case& c,
                    const Level& level,
                    const Method& method) {
  StepRow row;
  row.method = method;
  row.difference = kNan;
  constexpr int kColumns = 12;
  std::vector<double> columns[kColumns];
  for (const auto& [seed, step] : chosen) {
    std::vector<double> values[kColumns];
    bool failed = false, unjammed = false;
    for (int r = 1; r <= setup.repetitions; ++r) {
      const RunRecord* run = index.Find(c.id, method.label, seed, step, r);
      if (run == nullptr) continue;
      const Work* work = index.Reached(*run, level);
      failed = failed || work == nullptr;
      unjammed = unjammed || run->minimum == "0";
      const auto cost = [work](auto member) {
        return work == nullptr ? kInfinity : static_cast<double>(work->*member);
      };
      const Work& spent = work == nullptr ? run->work : *work;
      const double all[kColumns] = {
          cost(&Work::iterations),
          cost(&Work::evaluations),
          cost(&Work::hessians),
          cost(&Work::factorizations),
          cost(&Work::linear_iterations),
          cost(&Work::cpu_seconds),
          static_cast<double>(spent.iterations),
          static_cast<double>(spent.evaluations),
          static_cast<double>(spent.hessians),
          static_cast<double>(spent.factorizations),
          static_cast<double>(spent.linear_iterations),
          spent.cpu_seconds};
      for (int k = 0; k < kColumns; ++k) values[k].push_back(all[k]);
    }
    if (values[0].empty()) continue;  // an unfinished comparison
    ++row.steps;
    row.failed += failed ? 1 : 0;
    row.unjammed += unjammed ? 1 : 0;
    for (int k = 0; k < kColumns; ++k) columns[k].push_back(MedianOf(values[k]));

    const RunRecord* run = index.Find(c.id, method.label, seed, step, 1);
    End reference;
    if (run == nullptr ||
        !ReferenceEnd(setup, index, steps, c.id, seed, step, &reference)) {
      continue;
    }
    if (run->minimum != "-" && reference.minimum != "-") {
      ++row.judged;
      row.same += run->minimum == reference.minimum ? 1 : 0;
    }
    if (reference.minimum == "-") continue;
    const double size = std::max(run->energy, reference.energy);
    if ((run->minimum == "0" && reference.minimum == "0") || !(size > 0.0)) {
      continue;
    }
    const double difference = (run->energy - reference.energy) / size;
    row.lower += difference < -kEnergyDifference ? 1 : 0;
    row.higher += difference > kEnergyDifference ? 1 : 0;
    if (!(std::abs(row.difference) >= std::abs(difference))) {
      row.difference = difference;
    }
  }
  MedianWorst* const fields[kColumns] = {&row.iterations,
                                         &row.evaluations,
                                         &row.hessians,
                                         &row.factorizations,
                                         &row.linear_iterations,
                                         &row.cpu_seconds,
                                         &row.spent_iterations,
                                         &row.spent_evaluations,
                                         &row.spent_hessians,
                                         &row.spent_factorizations,
                                         &row.spent_linear_iterations,
                                         &row.spent_seconds};
  for (int k = 0; k < kColumns; ++k) *fields[k] = MedianAndWorst(columns[k]);
  row.mean_iterations = MeanAndDeviation(columns[6]);
  row.mean_seconds = MeanAndDeviation(columns[11]);
  return row;
}

// "12", "12 (40)", "12 (never)"; ">500" if the median step never got there.
template <typename Print>
std::string WithWorst(const MedianWorst& value,
                      const MedianWorst& spent,
                      const Print& print) {
  if (std::isnan(value.median)) return "-";
  // Of work that no run did, the failed ones did none either.
  if (spent.worst == 0.0) return print(0.0);
  if (std::isinf(value.median)) return ">" + print(spent.median);
  const std::string median = print(value.median), worst = print(value.worst);
  return median == worst ? median : median + " (" + worst + ")";
}

}  // namespace

std::vector<StepTable> TabulateSteps(const ComparisonSetup& setup,
                                     const std::vector<Event>& events,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps) {
  const RunIndex index(events, runs);
  const auto step_at = StepIndex(steps);
  std::vector<StepTable> tables;
  for (const Case& c : setup.cases) {
    if (c.kind != "near_jamming") continue;
    std::vector<double> distances;
    for (const RunRecord& run : runs) {
      if (run.key.case_id == c.id) distances.push_back(run.distance);
    }
    // Of all steps, and of those that are known not to rearrange.
    std::vector<std::pair<std::uint64_t, int>> all, plain;
    for (const std::uint64_t seed : setup.seeds) {
      for (int step = 1; step <= setup.steps; ++step) {
        const bool run = std::any_of(
            setup.methods.begin(),
            setup.methods.end(),
            [&](const Method& method) {
              return index.Find(c.id, method.label, seed, step, 1) != nullptr;
            });
        if (!run) continue;
        all.emplace_back(seed, step);
        const auto found = step_at.find({c.id, seed, step});
        if (found != step_at.end() && found->second->kind == kNonRearranging) {
          plain.emplace_back(seed, step);
        }
      }
    }
    for (const Level& level : setup.levels) {
      for (const bool only_plain : {true, false}) {
        const auto& chosen = only_plain ? plain : all;
        if (chosen.empty()) continue;
        StepTable table;
        table.table_case = c;
        table.level = level;
        table.distance = distances.empty() ? 0.0 : MedianOf(distances);
        table.kind = only_plain ? kNonRearranging : "all";
        table.steps = static_cast<int>(chosen.size());
        for (const Method& method : setup.methods) {
          table.rows.push_back(
              MakeStepRow(setup, index, step_at, chosen, c, level, method));
        }
        tables.push_back(table);
      }
    }
  }
  return tables;
}

std::string StepTablesCsv(const std::vector<StepTable>& tables) {
  std::string csv =
      "case,strain,relative,asked_distance,distance,kind,level,steps_kind,"
      "solver,spec,steps,failed,unjammed,iterations,iterations_worst,"
      "evaluations,"
      "evaluations_worst,hessians,hessians_worst,factorizations,"
      "factorizations_worst,linear_iterations,linear_iterations_worst,"
      "cpu_seconds,cpu_seconds_worst,spent_iterations,spent_iterations_worst,"
      "spent_factorizations,spent_factorizations_worst,spent_seconds,"
      "spent_seconds_worst,iterations_mean,iterations_deviation,seconds_mean,"
      "seconds_deviation,same_minimum,judged,energy_difference,lower,higher\n";
  for (const StepTable& table : tables) {
    const Case& c = table.table_case;
    for (const StepRow& row : table.rows) {
      csv += Field(c.id) + "," + Neat(c.value) +
             Format(",%d,", c.relative ? 1 : 0) + Neat(c.distance) +
             Format(",%.9g,", table.distance) +
             (table.level.absolute ? "absolute," : "relative,") +
             Neat(table.level.value) + "," + table.kind + "," +
             Field(row.method.label) + "," + Field(row.method.spec) +
             Format(",%d,%d,%d,", row.steps, row.failed, row.unjammed);
      for (const MedianWorst* value : {&row.iterations,
                                       &row.evaluations,
                                       &row.hessians,
                                       &row.factorizations,
                                       &row.linear_iterations,
                                       &row.cpu_seconds,
                                       &row.spent_iterations,
                                       &row.spent_factorizations,
                                       &row.spent_seconds}) {
        csv += Format("%.9g,%.9g,", value->median, value->worst);
      }
      for (const MeanDeviation* value :
           {&row.mean_iterations, &row.mean_seconds}) {
        csv += Format("%.9g,%.9g,", value->mean, value->deviation);
      }
      csv += Format("%d,%d,%.4g,%d,%d\n",
                    row.same,
                    row.judged,
                    row.difference,
                    row.lower,
                    row.higher);
    }
  }
  return csv;
}

std::string StepTablesText(const ComparisonSetup& setup,
                           const std::vector<StepTable>& tables,
                           const std::vector<StepRecord>& steps,
                           bool markdown) {
  // One grid for each strain, level and kind of steps, in order of appearance.
  using Key = std::tuple<std::string, bool, double, std::string>;
  const auto family = [](const Case& c) {
    return c.id.substr(0, c.id.find(" at "));
  };
  std::vector<Key> keys;
  std::map<Key, std::vector<const StepTable*>> grids;
  for (const StepTable& table : tables) {
    const Key key(family(table.table_case),
                  table.level.absolute,
                  table.level.value,
                  table.kind);
    if (grids[key].empty()) keys.push_back(key);
    grids[key].push_back(&table);
  }
  std::string text;
  for (const Key& key : keys) {
    // After those that do not rearrange, all steps where there are others.
    std::vector<const StepTable*> parts = grids[key];
    const bool all = parts[0]->kind == "all";
    Key other = key;
    std::get<3>(other) = kNonRearranging;
    const bool first = !all || grids.count(other) == 0;
    if (!first) {
      const auto same = [&](const StepTable* part) {
        for (const StepTable* plain : grids[other]) {
          if (plain->table_case.id == part->table_case.id) {
            return plain->steps == part->steps;
          }
        }
        return false;
      };
      parts.erase(std::remove_if(parts.begin(), parts.end(), same),
                  parts.end());
      if (parts.empty()) continue;
    }
    const Case& c = parts[0]->table_case;
    const std::string strain =
        c.relative ? Neat(c.value) + " (phi - phi_J)" : Neat(c.value);
    int total = 0;
    for (const StepTable* part : parts) total += part->steps;
    bool any[3] = {false, false, false};
    constexpr const char* kOptional[3] = {"Hessians", "factors", "linear its"};
    const MedianWorst StepRow::*const optional[3] = {
        &StepRow::hessians,
        &StepRow::factorizations,
        &StepRow::linear_iterations};
    const MedianWorst StepRow::*const spent_optional[3] = {
        &StepRow::spent_hessians,
        &StepRow::spent_factorizations,
        &StepRow::spent_linear_iterations};
    bool reference = false;
    for (const StepTable* part : parts) {
      for (const StepRow& row : part->rows) {
        for (int k = 0; k < 3; ++k) {
          const double median = (row.*optional[k]).median;
          any[k] = any[k] || (std::isfinite(median) && median > 0.0);
        }
        reference = reference || row.judged > 0 || !std::isnan(row.difference);
      }
    }
    const std::string title =
        "shear steps of " + strain + ": " + Format("%d, ", total) +
        (!all    ? "those that do not rearrange"
         : first ? "rearranging or not"
                 : "all at the distances where some rearrange or unjam");
    text += (markdown ? "## " : "\n") + title + "\n" + (markdown ? "\n" : "");
    text += (markdown ? "" : "  ") + ("until " + Meaning(parts[0]->level)) +
            "; median, worst in brackets\n" + (markdown ? "\n" : "");
    std::vector<std::vector<std::string>> rows(1);
    rows[0] = {"phi - phi_J",
               "method",
               "steps",
               "failed",
               "iterations",
               "evaluations"};
    for (int k = 0; k < 3; ++k) {
      if (any[k]) rows[0].push_back(kOptional[k]);
    }
    rows[0].push_back("CPU s");
    if (reference) {
      for (const char* name :
           {"same minimum", "E - E_ref", "lower", "higher"}) {
        rows[0].push_back(name);
      }
    }
    for (const StepTable* part : parts) {
      for (const StepRow& row : part->rows) {
        std::vector<std::string> cells = {
            &row == &part->rows[0] ? Neat(part->table_case.distance) : "",
            row.method.label,
            std::to_string(row.steps),
            row.failed == 0 ? "-" : std::to_string(row.failed),
            WithWorst(row.iterations, row.spent_iterations, Count),
            WithWorst(row.evaluations, row.spent_evaluations, Count)};
        for (int k = 0; k < 3; ++k) {
          if (any[k]) {
            cells.push_back(
                WithWorst(row.*optional[k], row.*spent_optional[k], Count));
          }
        }
        cells.push_back(WithWorst(row.cpu_seconds, row.spent_seconds, Seconds));
        if (reference) {
          cells.push_back(Format("%d of %d", row.same, row.judged));
          cells.push_back(std::isnan(row.difference) ? "-"
                          : row.difference == 0.0
                              ? std::string("0")
                              : Format("%+.0e", row.difference));
          cells.push_back(row.lower == 0 ? "-" : std::to_string(row.lower));
          cells.push_back(row.higher == 0 ? "-" : std::to_string(row.higher));
        }
        rows.push_back(cells);
      }
    }
    text += Grid(rows, 0, markdown, 2) + (markdown ? "\n" : "");
  }
  if (text.empty()) return text;

  // What the steps are.
  if (!steps.empty()) {
    text += markdown ? "## The shear steps as prepared\n\n"
                     : "\nthe shear steps as prepared\n";
    std::vector<std::vector<std::string>> rows = {{"case",
                                                   "steps",
                                                   kNonRearranging,
                                                   kRearranging,
                                                   kUnjammed,
                                                   kUndecided,
                                                   "ends apart",
                                                   "contacts",
                                                   "changed",
                                                   "pressure (least, most)"}};
    for (const Case& c : setup.cases) {
      std::map<std::string, int> count;
      std::vector<double> apart, contacts, changed, pressure;
      for (const StepRecord& step : steps) {
        if (step.case_id != c.id) continue;
        ++count[step.kind];
        apart.push_back(step.apart);
        contacts.push_back(step.contacts);
        changed.push_back(step.contacts_changed);
        pressure.push_back(step.pressure);
      }
      if (apart.empty()) continue;
      rows.push_back({c.id, std::to_string(apart.size())});
      for (const char* kind :
           {kNonRearranging, kRearranging, kUnjammed, kUndecided}) {
        rows.back().push_back(count[kind] == 0 ? "-"
                                               : std::to_string(count[kind]));
      }
      rows.back().push_back(
          Format("%.0e (%.0e)", MedianOf(apart), MedianAndWorst(apart).worst));
      rows.back().push_back(Count(MedianOf(contacts)));
      rows.back().push_back(
          WithWorst(MedianAndWorst(changed), {kNan, kNan}, Count));
      rows.back().push_back(
          Format("%.1e (%.0e, %.0e)",
                 MedianOf(pressure),
                 *std::min_element(pressure.begin(), pressure.end()),
                 *std::max_element(pressure.begin(), pressure.end())));
    }
    text += Grid(rows, 0, markdown) + (markdown ? "\n" : "");
  }
  text +=
      markdown ? "## How to read the steps\n\n" : "\nhow to read the steps\n";
  const std::string whose =
      setup.reference.empty()
          ? "the state as prepared, from which the next step starts"
          : setup.reference + " in the same step";
  for (const std::string& line : std::vector<std::string>{
           "non-rearranging: the strain in one step and in two halves ends "
           "within 1e-3 mean overlaps (ends apart:",
           "the largest coordinate of rigid grains, median and worst); "
           "changed: "
           "contacts of rigid grains made or lost;",
           "failed: steps that never got there, infinitely expensive in "
           "medians (>N: what the median step had spent then);",
           "a step's time is the median of its repetitions; same minimum: as " +
               whose + ";",
           Format("E - E_ref: the largest, over the larger of the two; lower, "
                  "higher: how many by more than %s;",
                  Neat(kEnergyDifference).c_str()),
           "pressure: at the ends of the steps; where it spreads, a chain has "
           "left the distance at which it began."}) {
    text += (markdown ? "" : "  ") + line + "\n";
  }
  if (markdown) text += "\n";
  return text;
}

Interval Wilson(int count, int trials) {
  if (trials <= 0) return {};
  constexpr double kZ = 1.959963984540054;  // two-sided 95 % of a normal
  const double n = trials, p = count / n, z2 = kZ * kZ / n;
  const double centre = (p + 0.5 * z2) / (1.0 + z2);
  const double half =
      kZ / (1.0 + z2) * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / n);
  // Exact where the formula is so but for roundoff.
  return {count == 0 ? 0.0 : std::max(0.0, centre - half),
          count == trials ? 1.0 : std::min(1.0, centre + half)};
}

std::vector<BasinRow> TabulateBasins(const ComparisonSetup& setup,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps) {
  std::vector<BasinRow> rows;
  if (setup.reference.empty()) return rows;
  const RunIndex index({}, runs);
  const auto step_at = StepIndex(steps);
  const std::vector<std::string> kinds = {
      "all", kNonRearranging, kRearranging, kUnjammed, kUndecided};
  const auto known = [](const BasinRow& row) {
    return row.judged + row.nowhere + row.unknown > 0;
  };
  // By method and kind.
  std::vector<BasinRow> sums(setup.methods.size() * kinds.size());
  for (const Case& c : setup.cases) {
    for (std::size_t m = 0; m < setup.methods.size(); ++m) {
      const Method& method = setup.methods[m];
      if (method.label == setup.reference) continue;
      std::vector<BasinRow> by_kind(kinds.size());
      for (std::size_t k = 0; k < kinds.size(); ++k) {
        by_kind[k].case_id = c.id;
        by_kind[k].method = method;
        by_kind[k].kind = kinds[k];
      }
      for (const std::uint64_t seed : setup.seeds) {
        for (int step = 1; step <= StepsOf(setup, c); ++step) {
          const RunRecord* run = index.Find(c.id, method.label, seed, step, 1);
          const RunRecord* reference =
              index.Find(c.id, setup.reference, seed, step, 1);
          if (run == nullptr || reference == nullptr) continue;
          const auto found = step_at.find({c.id, seed, step});
          for (BasinRow& row : by_kind) {
            if (row.kind != "all" &&
                (found == step_at.end() || found->second->kind != row.kind)) {
              continue;
            }
            if (reference->minimum == "-") {
              ++row.unknown;
            } else if (run->minimum == "-") {
              ++row.nowhere;
            } else {
              ++row.judged;
              row.differ += run->minimum != reference->minimum ? 1 : 0;
            }
          }
        }
      }
      for (std::size_t k = 0; k < kinds.size(); ++k) {
        if (k == 0 || known(by_kind[k])) rows.push_back(by_kind[k]);
        BasinRow& sum = sums[m * kinds.size() + k];
        sum.method = method;
        sum.kind = kinds[k];
        sum.case_id = "all cases";
        sum.differ += by_kind[k].differ;
        sum.judged += by_kind[k].judged;
        sum.nowhere += by_kind[k].nowhere;
        sum.unknown += by_kind[k].unknown;
      }
    }
  }
  if (setup.cases.size() > 1) {
    for (const BasinRow& sum : sums) {
      if (known(sum)) rows.push_back(sum);
    }
  }
  return rows;
}

std::string BasinsCsv(const std::vector<BasinRow>& rows) {
  std::string csv =
      "case,solver,spec,steps_kind,differ,judged,low,high,no_minimum,"
      "reference_at_none\n";
  for (const BasinRow& row : rows) {
    const Interval interval = Wilson(row.differ, row.judged);
    csv += Field(row.case_id) + "," + Field(row.method.label) + "," +
           Field(row.method.spec) + "," + row.kind +
           Format(",%d,%d,%.6g,%.6g,%d,%d\n",
                  row.differ,
                  row.judged,
                  interval.low,
                  interval.high,
                  row.nowhere,
                  row.unknown);
  }
  return csv;
}

std::string BasinsText(const ComparisonSetup& setup,
                       const std::vector<BasinRow>& rows,
                       bool markdown) {
  if (rows.empty()) return "";
  std::string text = (markdown ? "## " : "\n") +
                     ("who leaves the basin of " + setup.reference) + "\n" +
                     (markdown ? "\n" : "");
  // Kinds as columns, those that occur.
  std::vector<std::string> kinds;
  bool nowhere = false, unknown = false;
  for (const char* kind :
       {"all", kNonRearranging, kRearranging, kUnjammed, kUndecided}) {
    for (const BasinRow& row : rows) {
      if (row.kind != kind) continue;
      kinds.push_back(kind);
      break;
    }
  }
  for (const BasinRow& row : rows) {
    nowhere = nowhere || row.nowhere > 0;
    unknown = unknown || row.unknown > 0;
  }
  // If no step rearranges, one column says it.
  const auto sum = [&rows](const std::string& kind) {
    int instances = 0;
    for (const BasinRow& row : rows) {
      if (row.kind == kind) instances += row.judged + row.nowhere + row.unknown;
    }
    return instances;
  };
  if (kinds.size() == 2 && sum(kinds[0]) == sum(kinds[1])) kinds.pop_back();
  std::vector<std::vector<std::string>> grid(1);
  grid[0] = {"case", "method"};
  grid[0].insert(grid[0].end(), kinds.begin(), kinds.end());
  if (nowhere) grid[0].push_back("no minimum");
  if (unknown) grid[0].push_back("reference at none");
  std::string last_case;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const BasinRow& row = rows[k];
    // Rows of one case and method begin with that of all steps.
    if (row.kind == "all") {
      grid.push_back(std::vector<std::string>(grid[0].size(), "-"));
      grid.back()[0] = row.case_id == last_case ? "" : row.case_id;
      grid.back()[1] = row.method.label;
      last_case = row.case_id;
      std::size_t at = 2 + kinds.size();
      if (nowhere) grid.back()[at++] = std::to_string(row.nowhere);
      if (unknown) grid.back()[at] = std::to_string(row.unknown);
    }
    const std::size_t column =
        std::find(kinds.begin(), kinds.end(), row.kind) - kinds.begin();
    if (row.judged > 0 && column < kinds.size()) {
      const Interval interval = Wilson(row.differ, row.judged);
      grid.back()[2 + column] = Format("%d of %d (%.0f-%.0f %%)",
                                       row.differ,
                                       row.judged,
                                       100.0 * interval.low,
                                       100.0 * interval.high);
    }
  }
  text += Grid(grid, 0, markdown, 2) + (markdown ? "\n" : "");
  for (const char* line :
       {"how many ended in another minimum than the reference, of those in "
        "which both are at one; in brackets",
        "Wilson's 95 % interval of the probability; unjammed ends count as one "
        "minimum; no minimum: the method ended",
        "above the residual that tells minima apart, the reference did not"}) {
    text += (markdown ? "" : "  ") + std::string(line) + "\n";
  }
  if (markdown) text += "\n";
  return text;
}

std::string TablesCsv(const std::vector<Table>& tables) {
  std::string csv =
      "case,distance,kind,level,solver,spec,runs,reached,iterations,"
      "iterations_q20,iterations_q80,evaluations,evaluations_q20,"
      "evaluations_q80,hessians,factorizations,solves,linear_iterations,"
      "cpu_seconds,cpu_seconds_q20,cpu_seconds_q80,ratio,ratio_q20,ratio_q80,"
      "function_share,linear_share,spent_iterations,spent_evaluations,"
      "spent_seconds,residual,minima,end,paper_iterations,paper_seconds\n";
  const auto three = [](const Quantiles& q) {
    return Format("%.9g,%.9g,%.9g,", q.median, q.low, q.high);
  };
  for (const Table& table : tables) {
    for (const TableRow& row : table.rows) {
      csv += Field(table.table_case.id) + Format(",%.9g,", table.distance) +
             (table.level.absolute ? "absolute," : "relative,") +
             Neat(table.level.value) + "," + Field(row.method.label) + "," +
             Field(row.method.spec) + Format(",%d,%d,", row.runs, row.reached) +
             three(row.iterations) + three(row.evaluations) +
             Format("%.9g,%.9g,%.9g,%.9g,",
                    row.hessians.median,
                    row.factorizations.median,
                    row.solves.median,
                    row.linear_iterations.median) +
             three(row.cpu_seconds) + three(row.ratio) +
             Format("%.4g,%.4g,%.9g,%.9g,%.9g,%.9g,",
                    row.function_share,
                    row.linear_share,
                    row.spent_iterations,
                    row.spent_evaluations,
                    row.spent_seconds,
                    row.residual) +
             Field(row.minima) + "," + Field(row.end) + ",";
      if (row.paper != nullptr) {
        csv += Format("%.9g,%.9g", row.paper->iterations, row.paper->seconds);
      } else {
        csv += ",";
      }
      csv += "\n";
    }
  }
  return csv;
}

std::string TablesText(const ComparisonSetup& setup,
                       const std::vector<Table>& tables,
                       const std::vector<RunRecord>& runs,
                       bool markdown) {
  std::string text;
  const auto paragraph = [&](const std::string& line) {
    text += (markdown ? "" : "  ") + line + "\n";
  };
  bool any_brief = false;
  if (markdown) {
    text += "# Comparison of methods\n\n" + setup.what + "; " +
            std::to_string(setup.repetitions) + " repetition" +
            (setup.repetitions == 1 ? "" : "s") + ", " +
            std::to_string(setup.seeds.size()) + " seed" +
            (setup.seeds.size() == 1 ? "" : "s") +
            (setup.conditions.empty() ? "" : "; " + setup.conditions) + ".\n\n";
    for (const Method& method : setup.methods) {
      if (method.label == method.spec) continue;
      text += "- " + method.label + ": `" + method.spec + "`\n";
    }
    text += "\n";
  }
  for (std::size_t t = 0; t < tables.size(); ++t) {
    const Table& table = tables[t];
    const Case& c = table.table_case;
    if (t == 0 || tables[t - 1].table_case.id != c.id) {
      text += (markdown ? "## " : "\n") + c.id + "\n" + (markdown ? "\n" : "");
      if (markdown || !IsChain(setup, c))
        paragraph(Meaning(c) +
                  (c.kind == "near_jamming"
                       ? Format(" (phi - phi_J = %.3g)", table.distance)
                       : ""));
    }
    // The tables of many steps say more on a terminal.
    const bool brief = !markdown && IsChain(setup, c);
    any_brief = any_brief || brief;
    if (!brief) {
      text += "\n";
      paragraph("until " + Meaning(table.level));
      if (markdown) text += "\n";
    }
    // Columns that are zero everywhere say nothing.
    bool any[4] = {false, false, false, false};
    bool paper = false;
    double paper_base = 0.0;
    const Quantiles TableRow::*const optional[4] = {
        &TableRow::hessians,
        &TableRow::factorizations,
        &TableRow::solves,
        &TableRow::linear_iterations};
    for (const TableRow& row : table.rows) {
      for (int k = 0; k < 4; ++k) {
        const double median = (row.*optional[k]).median;
        any[k] = any[k] || (std::isfinite(median) && median > 0.0);
      }
      paper = paper || row.paper != nullptr;
      if (row.paper != nullptr && row.method.label == setup.baseline) {
        paper_base = row.paper->seconds;
      }
    }
    constexpr const char* kOptional[4] = {
        "Hessians", "factors", "solves", "linear its"};
    std::vector<std::vector<std::string>> rows(1);
    rows[0] = {"method", "iterations", "evaluations"};
    for (int k = 0; k < 4; ++k) {
      if (any[k]) rows[0].push_back(kOptional[k]);
    }
    for (const char* name : {"CPU s", "ratio", "f/lin/rest %"}) {
      rows[0].push_back(name);
    }
    if (paper) {
      for (const char* name : {"paper its", "paper s", "paper ratio"}) {
        rows[0].push_back(name);
      }
    }
    // How runs end is said where they stop.
    const bool stop = table.level == setup.levels[0];
    if (stop) {
      for (const char* name : {"residual", "minimum", "end"}) {
        rows[0].push_back(name);
      }
    }
    for (const TableRow& row : table.rows) {
      std::vector<std::string> cells = {
          row.method.label,
          Spread(row.iterations, row.spent_iterations, Count),
          Spread(row.evaluations, row.spent_evaluations, Count)};
      for (int k = 0; k < 4; ++k) {
        if (any[k]) cells.push_back(Spread(row.*optional[k], kNan, Count));
      }
      cells.push_back(Spread(row.cpu_seconds, row.spent_seconds, Seconds));
      cells.push_back(Spread(row.ratio, kNan, Ratio));
      if (row.runs == 0) {
        cells.push_back("-");
      } else {
        const double f = 100.0 * row.function_share;
        const double l = 100.0 * row.linear_share;
        cells.push_back(
            Format("%.0f/%.0f/%.0f", f, l, std::max(0.0, 100.0 - f - l)));
      }
      if (paper) {
        if (row.paper == nullptr) {
          cells.insert(cells.end(), 3, "-");
        } else {
          cells.push_back(Count(row.paper->iterations));
          cells.push_back(Seconds(row.paper->seconds));
          cells.push_back(
              paper_base > 0.0 ? Ratio(row.paper->seconds / paper_base) : "-");
        }
      }
      if (stop) {
        cells.push_back(
            std::isnan(row.residual) ? "-" : Format("%.1e", row.residual));
        cells.push_back(row.minima);
        cells.push_back(
            row.end +
            (row.reached == row.runs
                 ? ""
                 : Format(" (%d of %d got there)", row.reached, row.runs)));
      }
      rows.push_back(cells);
    }
    if (!brief) text += Grid(rows, stop ? 2 : 0, markdown);
    if (t + 1 == tables.size() || tables[t + 1].table_case.id != c.id) {
      if (markdown) text += "\n";
      for (const std::string& note : Notes(setup, c, runs)) {
        text += (markdown ? "- " : "    ") + note + "\n";
      }
      if (markdown) text += "\n";
    }
  }
  if (!setup.assumptions.empty()) {
    text += markdown ? "## What the paper leaves open\n\n"
                     : "\nwhat the paper leaves open\n";
    std::vector<std::vector<std::string>> rows = {
        {"left open", "assumed here"}};
    for (const auto& [open, assumed] : setup.assumptions) {
      rows.push_back({open, assumed});
    }
    text += Grid(rows, 1, markdown);
    if (markdown) text += "\n";
  }
  text += markdown ? "## How to read this\n\n" : "\nhow to read this\n";
  const int repetitions = setup.repetitions;
  const std::size_t seeds = setup.seeds.size();
  for (const std::string& line : std::vector<std::string>{
           Format("numbers are medians over %zu seed%s and %d repetition%s, "
                  "20-80 %% quantiles in brackets where they differ;",
                  seeds,
                  seeds == 1 ? "" : "s",
                  repetitions,
                  repetitions == 1 ? "" : "s"),
           "a run that never got there counts as infinitely expensive: >N is "
           "what it had spent when it ended;",
           "CPU s: of Minimize() alone; ratio: to " + setup.baseline +
               " in the same repetition; counts are exact, times are of this "
               "machine;",
           std::string("residual: the largest at the end of a run, judged in "
                       "quadruple precision; minimum: runs of a seed ") +
               (setup.steps > 1 ? "and step " : "") + "with one letter",
           Format("ended within %g of the energy and %g mean overlaps of each "
                  "other; 0: E = 0 or on the way there; -: above %s mean",
                  Minima::kEnergyBound,
                  Minima::kOverlapBound,
                  Neat(Minima::kResidualBound).c_str()),
           "forces, too far from a minimum to say which."}) {
    paragraph(line);
  }
  if (any_brief) paragraph("Each case has its own table in tables.md.");
  return text;
}

}  // namespace granopt
