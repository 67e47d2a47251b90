#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "experiments/profiles.h"
#include "experiments/protocol_profiles.h"
#include "experiments/protocol_tables.h"
#include "experiments/protocol_text.h"
#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

ProtocolSetup PlanOf(const std::string& protocol) {
  ProtocolSetup setup;
  setup.protocol = protocol;
  setup.what = "64 discs, alpha = 2";
  setup.methods = {{"a", "lbfgs"}, {"b|c, \"d\"", "fire:x=1"}};
  setup.tolerances = {1e-4, 1e-8};
  setup.seeds = {1, 7};
  setup.repetitions = 1;
  setup.baseline = setup.reference = "a";
  setup.conditions = "prepared by lbfgs";
  setup.epsilon = 1e-6;
  setup.strain = 0.02;
  setup.strain_steps = 3;
  return setup;
}

ProtocolRun MakeRun(const ProtocolSetup& setup,
                    int method,
                    double tolerance,
                    std::uint64_t seed) {
  ProtocolRun run;
  run.key = {tolerance,
             seed,
             1,
             setup.methods[method].label,
             setup.methods[method].spec};
  run.finished = true;
  run.branch = kFollowed;
  run.phi_cr = 0.84 + 1e-3 * method;
  run.phi_unjammed = run.phi_cr - 5e-7;
  run.phi_j = run.phi_cr - 2e-7;
  run.work.evaluations = 100 * (method + 1);
  run.work.cpu_seconds = 2.0 - method;
  run.relaxations = 20;
  return run;
}

std::vector<ProtocolRun> MakeRuns(const ProtocolSetup& setup) {
  std::vector<ProtocolRun> runs;
  for (const double tolerance : setup.tolerances) {
    for (const std::uint64_t seed : setup.seeds) {
      for (int m = 0; m < 2; ++m) {
        runs.push_back(MakeRun(setup, m, tolerance, seed));
      }
    }
  }
  return runs;
}

TEST(Protocols, SetupsAndRecordsAreReadAsTheyAreWritten) {
  const ProtocolSetup setup = PlanOf(kJammingProtocol);
  const std::string text = FormatProtocolSetup(setup);
  EXPECT_TRUE(IsProtocolSetup(text));
  EXPECT_FALSE(IsProtocolSetup(FormatSetup(ComparisonSetup())));
  EXPECT_FALSE(IsProtocolSetup("{"));
  ProtocolSetup again;
  std::string error;
  ASSERT_TRUE(ParseProtocolSetup(text, "setup.json", &again, &error)) << error;
  EXPECT_EQ(FormatProtocolSetup(again), text);
  EXPECT_FALSE(ParseProtocolSetup("{}", "setup.json", &again, &error));
  EXPECT_NE(error.find("setup.json"), std::string::npos);

  std::vector<ProtocolRun> runs = MakeRuns(setup), parsed;
  runs[1].finished = false;
  runs[1].message = "undecided, \"so\" it was";
  runs[1].phi_j = kNan;
  runs[1].branch = kUnknown;
  runs[2].distance = 1.0 / 3.0;
  runs[2].work.function_share = 0.25;
  const std::string csv = FormatCsv(runs);
  ASSERT_TRUE(ParseCsv(csv, "runs.csv", &parsed, &error)) << error;
  EXPECT_EQ(FormatCsv(parsed), csv);
  EXPECT_EQ(parsed[1].message, runs[1].message);
  EXPECT_EQ(parsed[1].key.label, runs[1].key.label);
  EXPECT_EQ(parsed[2].distance, 1.0 / 3.0);
  EXPECT_TRUE(std::isnan(parsed[1].phi_j));
  EXPECT_FALSE(
      ParseCsv("tolerance,seed\n1e-4,1\n", "runs.csv", &parsed, &error));
  EXPECT_EQ(error.rfind("runs.csv:1: no column repetition", 0), 0u) << error;

  ProtocolStep step;
  step.key = runs[1].key;
  step.step = 3;
  step.stage = "growth";
  step.verdict = "jammed";
  step.stop_reason = "CONVERGED";
  step.converged = true;
  step.strain = 0.1;
  step.energy = 1.0 / 7.0;
  step.deviatoric = 2.0;
  step.dissipated = -1e-20;
  step.work.evaluations = 12;
  std::vector<ProtocolStep> steps;
  const std::string rows = FormatCsv(std::vector<ProtocolStep>{step, step});
  ASSERT_TRUE(ParseCsv(rows, "steps.csv", &steps, &error)) << error;
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(FormatCsv(steps), rows);
  EXPECT_EQ(steps[1].energy, 1.0 / 7.0);
  EXPECT_EQ(steps[1].dissipated, -1e-20);
  EXPECT_TRUE(steps[1].converged);
}

TEST(Protocols, AProtocolThatDidNotEndIsInfinitelyExpensive) {
  const ProtocolSetup setup = PlanOf(kJammingProtocol);
  std::vector<ProtocolRun> runs = MakeRuns(setup);
  std::vector<ProtocolRow> rows = TabulateProtocols(setup, runs);
  ASSERT_EQ(rows.size(), 4u);
  EXPECT_EQ(rows[1].costs[kEvaluations].median, 200.0);
  EXPECT_EQ(rows[1].ratio.median, 0.5);
  EXPECT_EQ(rows[3].tolerance, 1e-8);
  for (ProtocolRun& run : runs) {
    if (run.key.label != "a" && run.key.tolerance == 1e-4) {
      run.finished = false;
      run.message = "undecided";
    }
  }
  rows = TabulateProtocols(setup, runs);
  EXPECT_EQ(rows[1].finished, 0);
  EXPECT_EQ(rows[1].costs[kEvaluations].median, kInfinity);
  EXPECT_EQ(rows[1].spent[kEvaluations], 200.0);
  EXPECT_EQ(rows[0].finished, 2);
  const std::string text = ProtocolText(setup, {}, runs, false);
  EXPECT_NE(text.find(">200"), std::string::npos) << text;
  EXPECT_NE(text.find("tolerance 1e-4, seed 1: undecided"), std::string::npos)
      << text;
}

TEST(Protocols, TheTableSaysHowAlgorithm1Misleads) {
  const ProtocolSetup setup = PlanOf(kJammingProtocol);
  std::vector<ProtocolRun> runs = MakeRuns(setup);
  // At 1e-4 the first method: seed 1 far above its branch's own jamming point,
  // seed 7 on a branch that is lost.
  runs[0].phi_j = runs[0].phi_cr - 4e-4;
  runs[0].contacts_excess = 30;
  runs[2].branch = kLost;
  runs[2].phi_j = runs[2].phi_cr - 1e-4;
  runs[1].branch = kSpurious;
  runs[1].phi_j = kNan;
  const std::vector<JammingRow> rows = TabulateJamming(setup, runs);
  ASSERT_EQ(rows.size(), 4u);
  EXPECT_EQ(rows[0].non_monotone, 2);
  EXPECT_EQ(rows[0].lost, 1);
  EXPECT_EQ(rows[0].most_contacts, 30);
  EXPECT_NEAR(rows[0].worst_excess, 4e-4, 1e-12);
  EXPECT_NEAR(rows[0].excess.median, 2.5e-4, 1e-12);
  EXPECT_EQ(rows[1].spurious, 1);
  EXPECT_EQ(rows[1].non_monotone, 0);
  EXPECT_NEAR(rows[1].apart, 1e-3, 1e-12);
  EXPECT_EQ(rows[2].non_monotone, 0);
  // Below the bracket by less than epsilon is rounding of the question.
  ProtocolRun run = runs[3];
  run.phi_j = run.phi_unjammed - 0.9e-6;
  EXPECT_FALSE(run.NonMonotone(setup.epsilon));
  run.phi_j = run.phi_unjammed - 1.1e-6;
  EXPECT_TRUE(run.NonMonotone(setup.epsilon));
  run.phi_j = kNan;
  EXPECT_FALSE(run.NonMonotone(setup.epsilon));

  runs[4].phi_cr += 1e-2;  // tolerance 1e-8, seed 1, first method
  const std::vector<SeedSpread> spreads = SpreadOfSeeds(setup, runs);
  ASSERT_EQ(spreads.size(), 2u);
  EXPECT_NEAR(spreads[0].by_tolerance, 1e-2, 1e-12);
  EXPECT_NEAR(spreads[0].by_method, 9e-3, 1e-12);
  EXPECT_NEAR(spreads[1].by_tolerance, 0.0, 1e-12);
  EXPECT_NEAR(spreads[1].by_method, 1e-3, 1e-12);

  // Four problems; excess in epsilon.
  const ComparisonProfiles profiles = MakeProtocolProfiles(setup, {}, runs);
  ASSERT_EQ(profiles.profiles.size(), 2u);
  EXPECT_EQ(profiles.profiles[0].count, 4);
  EXPECT_EQ(ValueAt(profiles.profiles[0].steps[0], 1.0), 1.0);
  EXPECT_EQ(ValueAt(profiles.profiles[1].steps[1], 1.0), 1.0);
  ASSERT_EQ(profiles.qualities.size(), 1u);
  EXPECT_EQ(profiles.qualities[0].measure, "excess");
  EXPECT_EQ(ValueAt(profiles.qualities[0].steps[0], 1.0), 0.25);
  EXPECT_EQ(ValueAt(profiles.qualities[0].steps[1], 1e9), 0.75);
  EXPECT_EQ(profiles.qualities[0].agree[1], 0);
}

// Two curves that part at step 2 and meet again.
TEST(Protocols, StepsAreProblemsWhileMethodsAreTogether) {
  ProtocolSetup setup = PlanOf(kShearProtocol);
  setup.tolerances = {1e-8};
  setup.seeds = {1};
  std::vector<ProtocolRun> runs = {MakeRun(setup, 0, 1e-8, 1),
                                   MakeRun(setup, 1, 1e-8, 1)};
  std::vector<ProtocolStep> steps;
  for (int m = 0; m < 2; ++m) {
    for (int k = 0; k <= 5; ++k) {
      ProtocolStep step;
      step.key = runs[m].key;
      step.step = k;
      step.strain = 0.01 * k;
      step.energy = 1.0 + (m == 1 && (k == 3 || k == 4) ? 0.25 : 0.0);
      step.deviatoric = 2.0 * k + (m == 1 && k == 3 ? 1.0 : 0.0);
      step.dissipated = k == 3 ? 0.5 : 0.0;
      step.converged = true;
      step.work.evaluations = 10 * (m + 1);
      step.work.cpu_seconds = 1.0;
      steps.push_back(step);
    }
  }
  const std::vector<ShearRow> rows = TabulateShear(setup, steps);
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0].first_difference, 0);
  EXPECT_EQ(rows[0].largest, 0.0);
  EXPECT_EQ(rows[1].first_difference, 3);
  EXPECT_DOUBLE_EQ(rows[1].strain, 0.03);
  EXPECT_DOUBLE_EQ(rows[1].largest, 0.1);
  EXPECT_DOUBLE_EQ(rows[1].rms, 0.1 / std::sqrt(6.0));
  EXPECT_DOUBLE_EQ(rows[1].dissipated, 0.5);
  EXPECT_EQ(rows[1].steps, 5);
  // Steps 1 to 3 begin from one state; one whole protocol is too little.
  const ComparisonProfiles profiles = MakeProtocolProfiles(setup, steps, runs);
  ASSERT_EQ(profiles.profiles.size(), 2u);
  EXPECT_EQ(profiles.profiles[0].count, 3);
  EXPECT_EQ(ValueAt(profiles.profiles[0].steps[1], 1.99), 0.0);
  EXPECT_EQ(ValueAt(profiles.profiles[0].steps[1], 2.0), 1.0);
  ASSERT_EQ(profiles.qualities.size(), 1u);
  EXPECT_EQ(profiles.qualities[0].count, 5);
  EXPECT_DOUBLE_EQ(ValueAt(profiles.qualities[0].steps[1], 0.0), 0.6);
  EXPECT_DOUBLE_EQ(ValueAt(profiles.qualities[0].steps[1], 0.2), 1.0);
  EXPECT_EQ(profiles.qualities[0].agree, (std::vector<int>{1, 0}));
  // Energies that differ by rounding are the same.
  steps[9].energy = steps[10].energy = 1.0 + 1e-9;
  EXPECT_EQ(TabulateShear(setup, steps)[1].first_difference, 0);
}

}  // namespace
}  // namespace granopt
