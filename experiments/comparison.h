// granopt: comparisons of methods: what is run in which order, the raw events,
// and the tables made from them. No packing and no clock in here.
//
// While a method runs, the first crossing of each level of a ladder of
// residuals is written down as an Event with the work done until then; each run
// ends as a RunRecord. Everything that is reported is computed from those two
// files and a ComparisonSetup, so that it can be computed again.

#ifndef GRANOPT_EXPERIMENTS_COMPARISON_H_
#define GRANOPT_EXPERIMENTS_COMPARISON_H_

#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "nlohmann/json.hpp"
#include "solvers/solver.h"

namespace granopt {

// ---------------------------------------------------------------- the plan

struct Method {
  std::string label;
  std::string spec;  // for CreateSolver()
};

// "spec;label@spec;...". False, with one line in `error`, for an empty entry or
// a label given twice.
bool ParseMethods(const std::string& text,
                  std::vector<Method>* methods,
                  std::string* error);

struct Case {
  // "growth=5e-5", "near_jamming=1e-6 at 1e-3": unique, and what files say.
  std::string id;
  // growth, simple_shear, pure_shear, random, fig2, near_jamming, start, user.
  std::string kind;
  double value = 0.0;
  double distance = 0.0;  // near_jamming: asked for
  // near_jamming=0.3x: the strain is `value` times the distance.
  bool relative = false;
};
// Shear strain of the case near_jamming.
double StrainOf(const Case& c);

// "growth,random=1e-4,near_jamming=1e-6,near_jamming=0.3x"; near_jamming
// becomes one case for each of `distances`, in their order, its strain a number
// or, with an x, a multiple of the distance. A kind without its value gets the
// default one, `shear` for near_jamming.
bool ParseCases(const std::string& text,
                const std::vector<double>& distances,
                double shear,
                std::vector<Case>* cases,
                std::string* error);

// The order of the methods in each block of the given repetition (from 0):
// starts at method `repetition` mod n, forwards in even and backwards in odd
// repetitions, so that neither the first place nor the predecessor is always
// the same.
std::vector<int> MethodOrder(int methods, int repetition);

// A residual: max|g| / mean contact force, or max|g| in units k = 1, box = 1.
struct Level {
  bool absolute = false;
  double value = 0.0;

  friend bool operator==(const Level& a, const Level& b) {
    return a.absolute == b.absolute && a.value == b.value;
  }
};

// Decades 1e-1 ... 1e-15 relative, 1e-4 ... 1e-16 absolute, and `more`, each
// kind from large to small.
std::vector<Level> Ladder(const std::vector<Level>& more);

// What a comparison consists of; kept beside the events.
struct ComparisonSetup {
  std::string paper;  // "", "table1" or "fig2"
  std::string what;   // "4096 discs, phi = 0.8438, alpha = 2"
  std::vector<Case> cases;
  std::vector<Method> methods;
  std::vector<std::uint64_t> seeds;
  int repetitions = 0;
  int steps = 1;  // of each chain of the case near_jamming
  // The first is where runs stop; the others are reported from the same runs.
  std::vector<Level> levels;
  std::string baseline;  // a label
  // The label of the method whose minima the others' are compared with; "": in
  // the case near_jamming with the states as prepared.
  std::string reference;
  // What else decides about counts: "prepared by lbfgs; ..."
  std::string conditions;
  // What the paper leaves open, and what was assumed.
  std::vector<std::pair<std::string, std::string>> assumptions;
};
std::string FormatSetup(const ComparisonSetup& setup);
bool ParseSetup(const std::string& text,
                const std::string& name,
                ComparisonSetup* setup,
                std::string* error);

// ---------------------------------------------------------------- raw events

struct RunKey {
  std::string case_id;
  std::uint64_t seed = 0;
  int repetition = 0;  // from 1
  std::string label;
  std::string spec;
  // Of the chain, from 1; 1 in cases without one.
  int step = 1;
};

// Work until some moment of a run.
struct Work {
  std::int64_t iterations = 0;
  std::int64_t evaluations = 0;
  std::int64_t hessians = 0;
  std::int64_t factorizations = 0;
  std::int64_t solves = 0;
  std::int64_t linear_iterations = 0;
  double cpu_seconds = 0.0;
  double function_share = 0.0;  // of the time, in the function
  double linear_share = 0.0;    // in matrices, factors and solves
};
Work MakeWork(const Counters& counters,
              double cpu_seconds,
              double seconds,
              double function_seconds,
              double linear_seconds);
// Columns of CSV files.
extern const char kWorkColumns[];
std::string WorkFields(const Work& work);
void ReadWork(CsvReader* reader, Work* work);

struct Event {
  RunKey key;
  Level level;
  Work work;
  double energy = 0.0;
};

struct RunRecord {
  RunKey key;
  int position = 0;  // in the block, from 1
  bool converged = false;
  std::string stop_reason;
  std::string message;
  double residual = 0.0;           // max|g| / mean force, as the method saw it
  double quad_residual = 0.0;      // judged in quadruple precision
  double quad_max_gradient = 0.0;  // units k = 1, box = 1
  double energy = 0.0;
  double pressure = 0.0;
  double phi = 0.0;
  int rattlers = 0;
  std::string minimum;    // "A", "B", ...; "0": E = 0; "-": at no minimum
  double distance = 0.0;  // near_jamming: phi - phi_J of the state; else 0
  std::int64_t list_builds = 0, restarts = 0, recenters = 0, rebases = 0;
  Work work;
  double seconds = 0.0;  // wall
};

// One point of a curve, of the first step of a chain.
struct CurveRow {
  std::string case_id;
  std::uint64_t seed = 0;
  std::string label;
  std::int64_t iteration = 0;
  std::int64_t evaluations = 0;
  double cpu_seconds = 0.0;
  double residual = 0.0;      // max|g| / mean force
  double max_gradient = 0.0;  // units k = 1, box = 1
  double energy = 0.0;
};

// One shear step of a chain, as its preparation found it. A step is called
// non-rearranging if its strain in one step and in two halves end at one place.
struct StepRecord {
  std::string case_id;
  std::uint64_t seed = 0;
  int step = 0;         // from 1
  double strain = 0.0;  // of this step
  // "non-rearranging", "rearranging", "unjammed" (both ends), "undecided" (an
  // end that was not relaxed tightly).
  std::string kind;
  // RigidDistance() of the two ends, in mean overlaps; infinite if one of them
  // is unjammed.
  double apart = 0.0;
  // Contacts between rigid grains: after the step, and how many of those before
  // or after are not in both.
  int contacts = 0;
  int contacts_changed = 0;
  // At the end of the one step, and of the two halves. Residuals in mean
  // forces, judged in quadruple precision.
  double energy = 0.0, half_energy = 0.0;
  double residual = 0.0, half_residual = 0.0;
  double pressure = 0.0;
  std::string minimum;  // of the end of the one step, as RunRecord::minimum
};
constexpr char kNonRearranging[] = "non-rearranging";
constexpr char kRearranging[] = "rearranging";
constexpr char kUnjammed[] = "unjammed";
constexpr char kUndecided[] = "undecided";

std::string StepsCsv(const std::vector<StepRecord>& steps);
bool ParseSteps(const std::string& text,
                const std::string& name,
                std::vector<StepRecord>* steps,
                std::string* error);

std::string EventsCsv(const std::vector<Event>& events);
std::string RunsCsv(const std::vector<RunRecord>& runs);
std::string CurvesCsv(const std::vector<CurveRow>& rows);
// `name` is for error lines, "name:line: what".
bool ParseEvents(const std::string& text,
                 const std::string& name,
                 std::vector<Event>* events,
                 std::string* error);
bool ParseRuns(const std::string& text,
               const std::string& name,
               std::vector<RunRecord>* runs,
               std::string* error);
bool ParseCurves(const std::string& text,
                 const std::string& name,
                 std::vector<CurveRow>* rows,
                 std::string* error);

// Writes down first crossings.
class Crossings {
 public:
  // `force_unit`: the force that is 1 in units k = 1, box = 1.
  Crossings(const std::vector<Level>& ladder, double force_unit);
  // True if Note() would add something: the clock is read only then.
  bool Due(double max_gradient, double force_scale) const;
  // Appends an event for each level that is crossed for the first time.
  void Note(const RunKey& key,
            double max_gradient,
            double force_scale,
            const Work& work,
            double energy,
            std::vector<Event>* events);

 private:
  double Bound(const Level& level, double force_scale) const {
    return level.value * (level.absolute ? force_unit_ : force_scale);
  }

  const double force_unit_;
  std::vector<Level> relative_, absolute_;  // not crossed yet, smallest first
};

// The rows (indices) of a trace that a curve keeps: first and last, and the
// least and the largest residual of each of `buckets` equal parts and of each
// of `buckets` parts that are equal in the logarithm of the row. Increasing.
std::vector<int> ThinTrace(const std::vector<double>& residuals, int buckets);

// ---------------------------------------------------------------- minima

// The largest difference of a coordinate of a grain that is rigid in both,
// after the mean difference of those (a translation) has been removed. `a` and
// `b`: d N entries, grain by grain.
double RigidDistance(const std::vector<double>& a,
                     const std::vector<bool>& is_rattler_a,
                     const std::vector<double>& b,
                     const std::vector<bool>& is_rattler_b);

// Tells minima of one case, seed and step apart.
class Minima {
 public:
  // Two runs are in one minimum if their energies agree to kEnergyBound of the
  // energy and their RigidDistance() is at most kOverlapBound mean overlaps.
  static constexpr double kEnergyBound = 1e-6;
  static constexpr double kOverlapBound = 0.1;
  // A run that ends with more than this, in mean forces, is at no minimum.
  static constexpr double kResidualBound = 1e-6;
  // Unless Scales::vanishing is at most this: forces that fade unbalanced.
  static constexpr double kVanishingBound = 1e-9;

  // `displacements`: d N entries, grain by grain, from the common start.
  // Returns "A" for the first minimum seen, "B" for the next one, ..., "0" at E
  // = 0 or on the way there (Scales::vanishing), "-" if the residual is too
  // large.
  std::string Tag(double energy,
                  double residual,
                  double vanishing,
                  double mean_overlap,
                  const std::vector<double>& displacements,
                  const std::vector<bool>& is_rattler);
  // The first `letters` names are taken by minima that are not known here.
  void Reserve(int letters) { next_ = std::max(next_, letters); }

 private:
  struct Minimum {
    std::string name;
    double energy;
    std::vector<double> displacements;
    std::vector<bool> is_rattler;
  };
  std::vector<Minimum> minima_;
  int next_ = 0;
};

// ---------------------------------------------------------------- tables

// "2015", "2015 (1980-2100)"; ">5000" (spent) if the median run never got
// there.
std::string Spread(const Quantiles& q,
                   double spent,
                   const std::function<std::string(double)>& print);
// "A", or "A 2, B 1" with the number of runs.
std::string Tally(const std::vector<std::string>& words);

// The paper's Table 1.
struct PaperEntry {
  double iterations = 0.0;
  double seconds = 0.0;
};
// Null if the table has no such entry.
const PaperEntry* PaperTable1(const std::string& kind,
                              const std::string& label);

// One method in one case at one level. Runs that never reached it count as
// infinitely expensive.
struct TableRow {
  Method method;
  int runs = 0;
  int reached = 0;
  Quantiles iterations, evaluations, hessians, factorizations, solves,
      linear_iterations, cpu_seconds;
  // To the baseline in the same case, seed and repetition.
  Quantiles ratio;
  double function_share = 0.0, linear_share = 0.0;  // medians
  // Medians of what was spent, reached or not.
  double spent_iterations = 0.0, spent_evaluations = 0.0, spent_seconds = 0.0;
  double residual =
      0.0;  // the largest at the end, of the level's kind; NaN if E = 0
  std::string minima;  // "A", "A 2, B 1"
  std::string end;     // "converged", "NO_PROGRESS 1, converged 2"
  const PaperEntry* paper = nullptr;
};

struct Table {
  Case table_case;
  Level level;
  double distance = 0.0;  // near_jamming: median phi - phi_J
  std::vector<TableRow> rows;
};

// Every case at every level of the setup; rows in the order of the methods.
std::vector<Table> Tabulate(const ComparisonSetup& setup,
                            const std::vector<Event>& events,
                            const std::vector<RunRecord>& runs);

// What profiles are made of: each case, seed and step in which every method was
// run is a problem; [problem][method], methods in the order of the setup. Costs
// are those of the first level, medians over repetitions, infinite if it was
// not reached; energies and minima those at the end of the first repetition.
struct Problems {
  std::vector<Method> methods;
  std::vector<std::vector<double>> evaluations, cpu_seconds, energies;
  std::vector<std::vector<std::string>> minima;
};
Problems CollectProblems(const ComparisonSetup& setup,
                         const std::vector<Event>& events,
                         const std::vector<RunRecord>& runs);

// Shear steps of one method in one case at one level. A step's number is the
// median of its repetitions; one that never got there is infinitely expensive.
struct MedianWorst {
  double median = 0.0, worst = 0.0;  // NaN without values
};
MedianWorst MedianAndWorst(const std::vector<double>& values);

struct StepRow {
  Method method;
  int steps = 0;
  int failed = 0;    // steps of which a repetition did not get there
  int unjammed = 0;  // steps of which one ended at E = 0 or on the way there
  MedianWorst iterations, evaluations, hessians, factorizations,
      linear_iterations, cpu_seconds;
  // What was spent, reached or not.
  MedianWorst spent_iterations, spent_evaluations, spent_hessians,
      spent_factorizations, spent_linear_iterations, spent_seconds;
  // Of the same, as in the paper's Fig. 7.
  MeanDeviation mean_iterations, mean_seconds;
  // Steps whose minimum is the reference's, of those in which both are known.
  int same = 0, judged = 0;
  // (E - E_ref) / max(E, E_ref) at the end of runs, of those with one of the
  // two above 0: the largest, and how many are beyond kEnergyDifference.
  double difference = 0.0;  // with its sign; NaN without values
  int lower = 0, higher = 0;
};
constexpr double kEnergyDifference = 1e-9;

struct StepTable {
  Case table_case;
  Level level;
  double distance = 0.0;  // median phi - phi_J
  // kNonRearranging or "all".
  std::string kind;
  int steps = 0;
  std::vector<StepRow> rows;
};

// The cases near_jamming at every level of the setup: over all steps, and
// before that over the non-rearranging ones where `steps` knows any.
std::vector<StepTable> TabulateSteps(const ComparisonSetup& setup,
                                     const std::vector<Event>& events,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps);
std::string StepTablesCsv(const std::vector<StepTable>& tables);
std::string StepTablesText(const ComparisonSetup& setup,
                           const std::vector<StepTable>& tables,
                           const std::vector<StepRecord>& steps,
                           bool markdown);

// Wilson's 95 % interval of a probability of which `count` of `trials` were
// seen; (0, 1) without trials.
struct Interval {
  double low = 0.0, high = 1.0;
};
Interval Wilson(int count, int trials);

// How often one method ends in another minimum than the reference.
struct BasinRow {
  std::string case_id;  // or "all cases"
  Method method;
  std::string kind;  // "all", or that of the steps
  int differ = 0;
  int judged = 0;   // instances (case, seed, step) in which both are known
  int nowhere = 0;  // the method ended at no minimum, the reference did
  int unknown = 0;  // the reference ended at none
};

// Who leaves the basin of setup.reference; empty without one. Repetitions count
// once.
std::vector<BasinRow> TabulateBasins(const ComparisonSetup& setup,
                                     const std::vector<RunRecord>& runs,
                                     const std::vector<StepRecord>& steps);
std::string BasinsCsv(const std::vector<BasinRow>& rows);
std::string BasinsText(const ComparisonSetup& setup,
                       const std::vector<BasinRow>& rows,
                       bool markdown);

std::string TablesCsv(const std::vector<Table>& tables);
// For the terminal, or as Markdown.
std::string TablesText(const ComparisonSetup& setup,
                       const std::vector<Table>& tables,
                       const std::vector<RunRecord>& runs,
                       bool markdown);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARISON_H_
