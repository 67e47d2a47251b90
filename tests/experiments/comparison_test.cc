#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "experiments/basins.h"
#include "experiments/comparison_text.h"
#include "experiments/crossings.h"
#include "experiments/step_tables.h"
#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Comparison, CrossingsAreNotedOnce) {
  Crossings crossings({{false, 1e-1}, {false, 1e-2}, {true, 1e-3}}, 2.0);
  std::vector<Event> events;
  // Relative bounds 1 and 0.1 at a mean force of 10, absolute 2e-3.
  EXPECT_FALSE(crossings.Due(5.0, 10.0));
  EXPECT_TRUE(crossings.Due(1.0, 10.0));
  crossings.Note({}, 1.0, 10.0, {}, 0.0, &events);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].level.value, 1e-1);
  EXPECT_FALSE(crossings.Due(0.5, 10.0));
  crossings.Note({}, 1e-3, 10.0, {}, 0.0, &events);
  ASSERT_EQ(events.size(), 3u);
  EXPECT_FALSE(crossings.Due(0.0, 10.0));
}

TEST(Comparison, ThinnedTraceKeepsEndsAndExtremes) {
  std::vector<double> residuals;
  for (int i = 0; i < 10000; ++i) residuals.push_back(1.0 / (1 + i));
  residuals[4321] = 1e-9;
  residuals[7000] = 50.0;
  const std::vector<int> kept = ThinTrace(residuals, 95);
  EXPECT_LE(kept.size(), 400u);
  EXPECT_EQ(kept.front(), 0);
  EXPECT_EQ(kept.back(), 9999);
  EXPECT_NE(std::find(kept.begin(), kept.end(), 4321), kept.end());
  EXPECT_NE(std::find(kept.begin(), kept.end(), 7000), kept.end());
  EXPECT_EQ(ThinTrace({1.0}, 95), std::vector<int>{0});
  EXPECT_TRUE(ThinTrace({}, 95).empty());
}

// Two methods, one case, three repetitions; the second method fails once at the
// tight level.
class HandMade : public testing::Test {
 protected:
  HandMade() {
    setup_.what = "hand-made";
    setup_.cases = {{"growth=5e-5", "growth", 5e-5, 0.0}};
    setup_.methods = {{"L-BFGS", "a:b=1,c=2"}, {"FR-CG", "d"}};
    setup_.seeds = {1};
    setup_.repetitions = 3;
    setup_.levels = {{false, 1e-10}, {false, 1e-5}};
    setup_.baseline = "L-BFGS";
    for (int r = 1; r <= 3; ++r) {
      Add("L-BFGS", r, 100, 1.0 * r, true);
      Add("FR-CG", r, 300, 4.0 * r, r < 3);
    }
  }

  void Add(const std::string& label,
           int repetition,
           std::int64_t iterations,
           double seconds,
           bool converged) {
    RunRecord run;
    run.key = {"growth=5e-5", 1, repetition, label, "spec, \"quoted\""};
    run.converged = converged;
    run.stop_reason = converged ? "CONVERGED" : "NO_PROGRESS";
    run.message = converged ? "fine" : "gave up, \"really\"";
    run.minimum = label == "L-BFGS" ? "A" : "B";
    run.energy = 0.1;
    run.quad_residual = converged ? 1e-11 : 1e-7;
    run.work.iterations = iterations;
    run.work.evaluations = iterations + 1;
    run.work.cpu_seconds = seconds;
    run.work.function_share = 0.25;
    run.work.linear_share = 0.5;
    runs_.push_back(run);
    Event event{run.key, {false, 1e-5}, run.work, 0.1};
    event.work.iterations /= 2;
    event.work.cpu_seconds /= 2;
    events_.push_back(event);
    if (converged) events_.push_back({run.key, {false, 1e-10}, run.work, 0.1});
  }

  ComparisonSetup setup_;
  std::vector<Event> events_;
  std::vector<RunRecord> runs_;
};

TEST_F(HandMade, MediansQuantilesAndRatios) {
  const std::vector<Table> tables = Tabulate(setup_, events_, runs_);
  ASSERT_EQ(tables.size(), 2u);
  const TableRow& base = tables[0].rows[0];
  EXPECT_EQ(base.runs, 3);
  EXPECT_EQ(base.reached, 3);
  EXPECT_EQ(base.costs[kIterations].median, 100);
  EXPECT_DOUBLE_EQ(base.costs[kCpuSeconds].low, 1.4);
  EXPECT_DOUBLE_EQ(base.costs[kCpuSeconds].median, 2.0);
  EXPECT_DOUBLE_EQ(base.costs[kCpuSeconds].high, 2.6);
  EXPECT_EQ(base.ratio.median, 1.0);
  const TableRow& other = tables[0].rows[1];
  EXPECT_EQ(other.reached, 2);
  EXPECT_DOUBLE_EQ(other.costs[kCpuSeconds].median, 8.0);
  EXPECT_TRUE(std::isinf(other.costs[kCpuSeconds].high));
  EXPECT_DOUBLE_EQ(other.ratio.low, 4.0);
  EXPECT_DOUBLE_EQ(other.ratio.median, 4.0);
  EXPECT_EQ(other.end, "NO_PROGRESS 1, converged 2");
  EXPECT_EQ(other.minima, "B");
  EXPECT_EQ(other.residual, 1e-7);
  const TableRow& loose = tables[1].rows[1];
  EXPECT_EQ(loose.reached, 3);
  EXPECT_EQ(loose.costs[kIterations].median, 150);
  EXPECT_DOUBLE_EQ(loose.costs[kCpuSeconds].high, 5.2);
  EXPECT_EQ(loose.function_share, 0.25);
  EXPECT_EQ(loose.paper, nullptr);
}

TEST_F(HandMade, ThePaperStandsBesideItsOwnLabels) {
  setup_.paper = "table1";
  const std::vector<Table> tables = Tabulate(setup_, events_, runs_);
  ASSERT_NE(tables[0].rows[0].paper, nullptr);
  EXPECT_EQ(tables[0].rows[0].paper->iterations, 2003);
  EXPECT_EQ(tables[0].rows[1].paper->seconds, 58.9);
  EXPECT_EQ(PaperTable1("random", "P-L-BFGS (A = 3)")->iterations, 432);
  EXPECT_EQ(PaperTable1("start", "L-BFGS"), nullptr);
}

TEST_F(HandMade, FailuresAreSaid) {
  const std::vector<Table> tables = Tabulate(setup_, events_, runs_);
  for (const bool markdown : {false, true}) {
    const std::string text = TablesText(setup_, tables, runs_, markdown);
    EXPECT_NE(text.find("(2 of 3 got there)"), std::string::npos) << text;
    EXPECT_NE(text.find("! FR-CG: NO_PROGRESS, gave up, \"really\" (repetition "
                        "3)"),
              std::string::npos)
        << text;
    EXPECT_NE(text.find("seed 1: minimum A with E = 0.1 (L-BFGS); minimum B "
                        "with E = 0.1 (FR-CG)"),
              std::string::npos)
        << text;
  }
}

TEST_F(HandMade, VanishedRunsHaveReachedEveryLevel) {
  for (RunRecord& run : runs_) run.stop_reason = "VANISHED";
  const std::vector<Table> tables = Tabulate(setup_, {}, runs_);
  EXPECT_EQ(tables[0].rows[1].reached, 3);
  EXPECT_EQ(tables[0].rows[1].costs[kIterations].median, 300);
}

TEST_F(HandMade, UnequalCountsAreSaid) {
  runs_[0].work.evaluations += 1;
  const std::string text =
      TablesText(setup_, Tabulate(setup_, events_, runs_), runs_, false);
  EXPECT_NE(text.find("! L-BFGS: counts differ"), std::string::npos) << text;
}

// A run that the clock ended says nothing about counts.
TEST_F(HandMade, CountsOfRunsOutOfTimeMayDiffer) {
  runs_[0].work.evaluations += 1;
  runs_[0].stop_reason = "MAX_SECONDS";
  const std::string text =
      TablesText(setup_, Tabulate(setup_, events_, runs_), runs_, false);
  EXPECT_EQ(text.find("counts differ"), std::string::npos) << text;
}

TEST_F(HandMade, LargeSeedsAreNamed) {
  setup_.seeds = {1, 5000000000};
  const std::size_t count = runs_.size();
  for (std::size_t k = 0; k < count; ++k) {
    runs_[k].minimum = "A";
    runs_.push_back(runs_[k]);
    runs_.back().key.seed = 5000000000;
  }
  const std::string text =
      TablesText(setup_, Tabulate(setup_, events_, runs_), runs_, false);
  EXPECT_NE(text.find("seeds 1, 5000000000: all runs end in one minimum"),
            std::string::npos)
      << text;
}

// Three steps of two seeds; the last step of seed 2 rearranges. "good" costs
// 10 x step iterations with repetitions of different times, "bad" never gets
// there in the first steps and ends elsewhere in the one that rearranges.
class Steps : public testing::Test {
 protected:
  static constexpr char kCase[] = "near_jamming=0.3x at 1e-4";

  Steps() {
    setup_.cases = {{kCase, "near_jamming", 0.3, 1e-4, true}};
    setup_.methods = {{"good", "g"}, {"bad", "b"}};
    setup_.seeds = {1, 2};
    setup_.repetitions = 3;
    setup_.steps = 3;
    setup_.levels = {{false, 1e-7}};
    setup_.baseline = "good";
    for (int seed = 1; seed <= 2; ++seed) {
      for (int step = 1; step <= 3; ++step) {
        const bool rearranges = seed == 2 && step == 3;
        StepRecord record;
        record.case_id = kCase;
        record.seed = seed;
        record.step = step;
        record.strain = 3e-5;
        record.kind = rearranges ? kRearranging : kNonRearranging;
        record.energy = 1.0;
        record.minimum = "A";
        steps_.push_back(record);
        for (int r = 1; r <= 3; ++r) {
          // The second repetition is the slow one.
          const double seconds = step * (r == 2 ? 9.0 : 1.0);
          Add("good", seed, step, r, 10 * step, seconds, true, "A", 1.0);
          Add("bad",
              seed,
              step,
              r,
              100,
              5.0,
              step > 1,
              rearranges  ? "B"
              : step == 1 ? "-"
                          : "A",
              rearranges  ? 0.5
              : seed == 1 ? 1.0 + 1e-12
                          : 1.0 - 1e-12);
        }
      }
    }
  }

  void Add(const std::string& label,
           int seed,
           int step,
           int repetition,
           std::int64_t iterations,
           double seconds,
           bool reached,
           const std::string& minimum,
           double energy) {
    RunRecord run;
    run.key = {kCase,
               static_cast<std::uint64_t>(seed),
               repetition,
               label,
               "spec",
               step};
    run.converged = reached;
    run.stop_reason = reached ? "CONVERGED" : "MAX_EVALUATIONS";
    run.minimum = minimum;
    run.energy = energy;
    run.distance = 1e-4;
    run.work.iterations = iterations;
    run.work.cpu_seconds = seconds;
    runs_.push_back(run);
    if (reached) events_.push_back({run.key, {false, 1e-7}, run.work, energy});
  }

  ComparisonSetup setup_;
  std::vector<Event> events_;
  std::vector<RunRecord> runs_;
  std::vector<StepRecord> steps_;
};

TEST_F(Steps, MedianWorstAndFailures) {
  const std::vector<StepTable> tables =
      TabulateSteps(setup_, events_, runs_, steps_);
  ASSERT_EQ(tables.size(), 2u);
  EXPECT_EQ(tables[0].kind, kNonRearranging);
  EXPECT_EQ(tables[0].steps, 5);
  EXPECT_EQ(tables[1].kind, "all");
  EXPECT_EQ(tables[1].steps, 6);
  EXPECT_EQ(tables[1].distance, 1e-4);
  // Steps 1 1 2 2 3, and 1 1 2 2 3 3; times are medians of repetitions.
  const StepRow& plain = tables[0].rows[0];
  EXPECT_EQ(plain.steps, 5);
  EXPECT_EQ(plain.failed, 0);
  EXPECT_EQ(plain.costs[kIterations].median, 20.0);
  EXPECT_EQ(plain.costs[kIterations].worst, 30.0);
  EXPECT_EQ(plain.costs[kCpuSeconds].median, 2.0);
  EXPECT_EQ(plain.costs[kCpuSeconds].worst, 3.0);
  EXPECT_EQ(plain.same, 5);
  EXPECT_EQ(plain.judged, 5);
  EXPECT_EQ(plain.difference, 0.0);
  // Two of five, two of six failed.
  const StepRow& bad = tables[0].rows[1];
  EXPECT_EQ(bad.failed, 2);
  EXPECT_EQ(bad.costs[kIterations].median, 100.0);
  EXPECT_TRUE(std::isinf(bad.costs[kIterations].worst));
  EXPECT_EQ(bad.spent[kIterations].worst, 100.0);
  EXPECT_EQ(bad.judged, 3);
  EXPECT_EQ(bad.same, 3);
  EXPECT_EQ(bad.lower + bad.higher, 0);
  const StepRow& all = tables[1].rows[1];
  EXPECT_EQ(all.failed, 2);
  EXPECT_EQ(all.judged, 4);
  EXPECT_EQ(all.same, 3);
  EXPECT_EQ(all.lower, 1);
  EXPECT_EQ(all.higher, 0);
  EXPECT_DOUBLE_EQ(all.difference, -0.5);
  EXPECT_EQ(all.unjammed, 0);
  // A step that is unjammed in one repetition is; one that fails in one failed.
  runs_[1].minimum = "0";
  EXPECT_EQ(TabulateSteps(setup_, events_, runs_, steps_)[1].rows[1].unjammed,
            1);
  runs_[0].stop_reason = "MAX_SECONDS";
  events_.erase(events_.begin());
  EXPECT_EQ(TabulateSteps(setup_, events_, runs_, steps_)[0].rows[0].failed, 1);
  // Without knowledge of the steps, over all of them; half of a comparison.
  runs_.resize(6);
  const std::vector<StepTable> unknown =
      TabulateSteps(setup_, events_, runs_, {});
  ASSERT_EQ(unknown.size(), 1u);
  EXPECT_EQ(unknown[0].kind, "all");
  EXPECT_EQ(unknown[0].steps, 1);
  EXPECT_EQ(unknown[0].rows[0].judged, 0);
  EXPECT_TRUE(std::isnan(unknown[0].rows[0].difference));
}

TEST_F(Steps, TheReferenceMayBeAMethod) {
  EXPECT_TRUE(TabulateBasins(setup_, runs_, steps_).empty());
  setup_.reference = "bad";
  const std::vector<StepTable> tables =
      TabulateSteps(setup_, events_, runs_, steps_);
  EXPECT_EQ(tables[1].rows[0].judged, 4);
  EXPECT_EQ(tables[1].rows[0].same, 3);
  EXPECT_EQ(tables[1].rows[0].higher, 1);
  std::vector<BasinRow> rows = TabulateBasins(setup_, runs_, steps_);
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_EQ(rows[0].kind, "all");
  EXPECT_EQ(rows[0].differ, 1);
  EXPECT_EQ(rows[0].judged, 4);
  EXPECT_EQ(rows[0].unknown, 2);
  EXPECT_EQ(rows[1].kind, kNonRearranging);
  EXPECT_EQ(rows[1].differ, 0);
  EXPECT_EQ(rows[1].judged, 3);
  EXPECT_EQ(rows[2].kind, kRearranging);
  EXPECT_EQ(rows[2].differ, 1);
  EXPECT_EQ(rows[2].judged, 1);
  setup_.reference = "good";
  rows = TabulateBasins(setup_, runs_, steps_);
  EXPECT_EQ(rows[0].judged, 4);
  EXPECT_EQ(rows[0].nowhere, 2);
  EXPECT_EQ(rows[0].unknown, 0);
  const std::string text = BasinsText(setup_, rows, false);
  EXPECT_NE(text.find("1 of 4 (5-70 %)"), std::string::npos) << text;
}

TEST_F(Steps, FilesAreReadBackAsTheyWere) {
  steps_[0].apart = kInfinity;
  std::string error;
  std::vector<StepRecord> steps;
  ASSERT_TRUE(ParseCsv(FormatCsv(steps_), "s", &steps, &error)) << error;
  EXPECT_EQ(FormatCsv(steps), FormatCsv(steps_));
  std::string broken = FormatCsv(steps_);
  broken.replace(broken.find("non-re"), 3, "");
  broken.replace(broken.find("rearr"), 5, "Rearr");
  EXPECT_FALSE(ParseCsv(broken, "s.csv", &steps, &error));
  EXPECT_EQ(error.substr(0, 8), "s.csv:2:");
  std::vector<RunRecord> runs;
  ASSERT_TRUE(ParseCsv(FormatCsv(runs_), "r", &runs, &error)) << error;
  EXPECT_EQ(runs.back().key.step, 3);
  ComparisonSetup setup;
  setup_.reference = "bad";
  setup_.conditions = "prepared by good";
  ASSERT_TRUE(ParseSetup(FormatSetup(setup_), "s", &setup, &error)) << error;
  EXPECT_EQ(FormatSetup(setup), FormatSetup(setup_));
  EXPECT_TRUE(setup.cases[0].relative);
  EXPECT_EQ(setup.steps, 3);
}

TEST_F(HandMade, FilesOfEarlierComparisonsHaveNoSteps) {
  std::string text = FormatCsv(runs_), error;
  text.replace(text.find(",step,"), 6, ",other,");
  std::vector<RunRecord> runs;
  ASSERT_TRUE(ParseCsv(text, "r", &runs, &error)) << error;
  EXPECT_EQ(runs[0].key.step, 1);
}

TEST_F(HandMade, FilesAreReadBackAsTheyWere) {
  std::string error;
  std::vector<Event> events;
  ASSERT_TRUE(ParseCsv(FormatCsv(events_), "e", &events, &error)) << error;
  EXPECT_EQ(FormatCsv(events), FormatCsv(events_));
  EXPECT_EQ(events[0].key.spec, "spec, \"quoted\"");
  std::vector<RunRecord> runs;
  ASSERT_TRUE(ParseCsv(FormatCsv(runs_), "r", &runs, &error)) << error;
  EXPECT_EQ(FormatCsv(runs), FormatCsv(runs_));
  EXPECT_EQ(runs[5].message, "gave up, \"really\"");
  setup_.assumptions = {{"a", "b"}};
  ComparisonSetup setup;
  ASSERT_TRUE(ParseSetup(FormatSetup(setup_), "s", &setup, &error)) << error;
  EXPECT_EQ(FormatSetup(setup), FormatSetup(setup_));

  EXPECT_FALSE(ParseCsv("", "e", &events, &error));
  EXPECT_FALSE(ParseCsv("case,seed\nx,1\n", "e.csv", &events, &error));
  EXPECT_EQ(error, "e.csv:1: no column repetition");
  std::string broken = FormatCsv(events_);
  broken.replace(broken.find("relative"), 8, "relation");
  EXPECT_FALSE(ParseCsv(broken, "e.csv", &events, &error));
  EXPECT_EQ(error.substr(0, 8), "e.csv:2:");
  EXPECT_FALSE(ParseSetup("{}", "setup.json", &setup, &error));
  EXPECT_FALSE(ParseSetup("not json", "setup.json", &setup, &error));
}

}  // namespace
}  // namespace granopt
