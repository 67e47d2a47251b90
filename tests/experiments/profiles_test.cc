#include "experiments/profiles.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The first method is always the cheapest one, the second takes twice as much,
// the third solves half of the problems, for nothing more.
TEST(Profiles, AreThoseOfDolanAndMore) {
  const std::vector<std::vector<double>> costs = {
      {1.0, 2.0, kInfinity},
      {10.0, 20.0, 10.0},
      {5.0, 10.0, 5.0},
      {kInfinity, kInfinity, kInfinity}};
  const auto ratios = PerformanceRatios(costs);
  EXPECT_EQ(ratios[0], (std::vector<double>{1.0, 2.0, kInfinity}));
  EXPECT_EQ(ratios[1], (std::vector<double>{1.0, 2.0, 1.0}));
  EXPECT_EQ(ratios[3], costs[3]);
  const std::vector<Method> methods = {{"a", "x"}, {"b", "y"}, {"c", "z"}};
  const Profile profile = MakeProfile("all", "evaluations", methods, costs);
  // The problem that nobody solved counts.
  EXPECT_EQ(profile.count, 4);
  EXPECT_EQ(profile.solved, (std::vector<int>{3, 3, 2}));
  EXPECT_EQ(ValueAt(profile.steps[0], 1.0), 0.75);
  EXPECT_EQ(ValueAt(profile.steps[1], 1.0), 0.0);
  EXPECT_EQ(ValueAt(profile.steps[1], 1.999), 0.0);
  EXPECT_EQ(ValueAt(profile.steps[1], 2.0), 0.75);
  EXPECT_EQ(ValueAt(profile.steps[2], 1.0), 0.5);
  EXPECT_EQ(ValueAt(profile.steps[2], 1e300), 0.5);
  EXPECT_EQ(profile.steps[1].size(), 1u);
  EXPECT_EQ(ProfilesCsv({profile}),
            "problems,measure,solver,spec,count,solved,ratio,fraction\n"
            "all,evaluations,a,x,4,3,1,0.75\n"
            "all,evaluations,b,y,4,3,2,0.75\n"
            "all,evaluations,c,z,4,2,1,0.5\n");
  // Without costs all are equal; with none where another has some, never.
  EXPECT_EQ(PerformanceRatios({{0.0, 0.0, 3.0}})[0],
            (std::vector<double>{1.0, 1.0, kInfinity}));
}

// Costs c k of problem k and method: ratios are the same on every problem, so
// that units of a problem do not matter.
TEST(Profiles, DoNotDependOnTheUnitsOfAProblem) {
  std::vector<std::vector<double>> costs;
  for (int k = 0; k < 10; ++k) {
    const double unit = std::ldexp(1.0, 7 * k - 30);
    costs.push_back({3.0 * unit, 1.0 * unit * (1 + k % 2), 1.5 * unit});
  }
  const Profile profile = MakeProfile(
      "all", "cpu_seconds", {{"a", "a"}, {"b", "b"}, {"c", "c"}}, costs);
  // 3 : 1 : 1.5 and 3 : 2 : 1.5, half and half.
  EXPECT_EQ(ValueAt(profile.steps[0], 2.0), 0.5);
  EXPECT_EQ(ValueAt(profile.steps[0], 3.0), 1.0);
  EXPECT_EQ(ValueAt(profile.steps[1], 1.0), 0.5);
  EXPECT_EQ(ValueAt(profile.steps[1], 1.34), 1.0);
  EXPECT_EQ(ValueAt(profile.steps[2], 1.0), 0.5);
  EXPECT_EQ(ValueAt(profile.steps[2], 1.5), 1.0);
}

TEST(Profiles, EnergiesAreComparedWithTheLeastOrTheReference) {
  const std::vector<std::vector<double>> energies = {
      {1.0, 2.0, kNan}, {0.0, 0.0, 4.0}, {4.0, 1.0, 1.0}};
  const auto best = EnergyDifferences(energies, -1);
  EXPECT_EQ(best[0], (std::vector<double>{0.0, 0.5, kInfinity}));
  EXPECT_EQ(best[1], (std::vector<double>{0.0, 0.0, 1.0}));
  EXPECT_EQ(best[2], (std::vector<double>{0.75, 0.0, 0.0}));
  const auto first = EnergyDifferences(energies, 0);
  EXPECT_EQ(first[2], (std::vector<double>{0.0, 0.75, 0.75}));
}

TEST(Profiles, AgreementIsThatOfMinima) {
  Problems problems;
  problems.methods = {{"a", "a"}, {"b", "b"}};
  problems.energies = {{1.0, 1.0}, {1.0, 2.0}, {2.0, 1.0}, {1.0, 1.0}};
  problems.minima = {{"A", "A"}, {"A", "B"}, {"-", "A"}, {"A", "-"}};
  const Quality quality = MakeQuality(problems, "a");
  EXPECT_EQ(quality.judged, (std::vector<int>{3, 3}));
  EXPECT_EQ(quality.agree, (std::vector<int>{3, 1}));
  EXPECT_EQ(ValueAt(quality.steps[0], 0.0), 0.75);
  EXPECT_EQ(ValueAt(quality.steps[1], 0.49), 0.75);
  EXPECT_EQ(ValueAt(quality.steps[1], 0.5), 1.0);
  const std::string csv = QualitiesCsv({quality});
  EXPECT_NE(csv.find("\"case, seed, step\",energy,b,b,4,0.5,1,minimum,a,1,3,"),
            std::string::npos)
      << csv;
}

// Of an ordinary comparison: what never reached the level is infinite, what was
// not run by all is left out.
TEST(Profiles, ProblemsAreCasesSeedsAndSteps) {
  ComparisonSetup setup;
  setup.cases = {{"growth=5e-5", "growth", 5e-5}};
  setup.methods = {{"a", "a"}, {"b", "b"}};
  setup.seeds = {1, 2, 3, 4};
  setup.repetitions = 2;
  setup.levels = {{false, 1e-6}};
  setup.baseline = "a";
  std::vector<Event> events;
  std::vector<RunRecord> runs;
  for (const std::uint64_t seed : setup.seeds) {
    for (int r = 1; r <= 2; ++r) {
      for (const Method& method : setup.methods) {
        if (seed == 4 && method.label == "b") continue;
        RunRecord run;
        run.key = {"growth=5e-5", seed, r, method.label, method.spec, 1};
        run.energy = method.label == "a" ? 1.0 : 1.0 + 0.25 * (seed == 2);
        run.minimum = seed == 2 && method.label == "b" ? "B" : "A";
        run.stop_reason = "CONVERGED";
        runs.push_back(run);
        if (seed == 3 && method.label == "a") continue;
        Event event;
        event.key = run.key;
        event.level = setup.levels[0];
        event.work.evaluations = method.label == "a" ? 10 * r : 60;
        event.work.cpu_seconds = method.label == "a" ? 4.0 : 1.0 * r;
        events.push_back(event);
      }
    }
  }
  const Problems problems = CollectProblems(setup, events, runs);
  ASSERT_EQ(problems.evaluations.size(), 3u);
  EXPECT_EQ(problems.evaluations[0], (std::vector<double>{15.0, 60.0}));
  EXPECT_EQ(problems.cpu_seconds[1], (std::vector<double>{4.0, 1.5}));
  EXPECT_EQ(problems.evaluations[2], (std::vector<double>{kInfinity, 60.0}));
  ComparisonProfiles profiles = MakeComparisonProfiles(setup, events, runs);
  ASSERT_EQ(profiles.profiles.size(), 2u);
  EXPECT_EQ(profiles.profiles[0].solved, (std::vector<int>{2, 3}));
  EXPECT_DOUBLE_EQ(ValueAt(profiles.profiles[0].steps[1], 1.0), 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(ValueAt(profiles.profiles[0].steps[1], 4.0), 1.0);
  EXPECT_DOUBLE_EQ(ValueAt(profiles.profiles[1].steps[0], 2.7), 2.0 / 3.0);
  ASSERT_EQ(profiles.qualities.size(), 1u);
  EXPECT_EQ(profiles.qualities[0].reference, "a");
  EXPECT_EQ(profiles.qualities[0].agree, (std::vector<int>{3, 2}));
  // Too little says nothing.
  setup.seeds = {1, 2};
  EXPECT_TRUE(MakeComparisonProfiles(setup, events, runs).profiles.empty());
  setup.seeds = {1, 2, 3};
  setup.methods.pop_back();
  EXPECT_TRUE(MakeComparisonProfiles(setup, events, runs).qualities.empty());
}

}  // namespace
}  // namespace granopt
