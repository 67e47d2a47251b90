#include "solvers/search/search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/search/noise.h"

namespace granopt {
namespace {

using Strings = std::vector<std::vector<double>>;
constexpr double kPi = 3.14159265358979323846;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double Sphere(const std::vector<double>& x) {
  double sum = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    sum += (x[k] - 0.3 * (k + 1)) * (x[k] - 0.3 * (k + 1));
  }
  return sum;
}

// Least value 0 at 0.5, 10^n local minima or so.
double Rastrigin(const std::vector<double>& x) {
  double sum = 0.0;
  for (const double v : x) {
    const double y = v - 0.5;
    sum += y * y + 10.0 * (1.0 - std::cos(2.0 * kPi * y));
  }
  return sum;
}

SearchProblem Problem(double (*f)(const std::vector<double>&),
                      int n,
                      double low,
                      double high,
                      Strings* seen = nullptr) {
  SearchProblem problem;
  problem.low.assign(n, low);
  problem.high.assign(n, high);
  problem.seed = 3;
  problem.objective = [=](const Strings& strings, std::vector<double>* values) {
    for (const auto& string : strings) {
      EXPECT_EQ(string.size(), static_cast<std::size_t>(n));
      for (const double v : string) {
        EXPECT_GE(v, low);
        EXPECT_LE(v, high);
      }
      values->push_back(f(string));
      if (seen != nullptr) seen->push_back(string);
    }
    return true;
  };
  return problem;
}

SearchResult Minimize(const std::string& spec, const SearchProblem& problem) {
  std::string error;
  const auto method = CreateSearch(spec, &error);
  EXPECT_NE(method, nullptr) << error;
  return method->Search(problem);
}

std::vector<std::string> Methods() {
  std::vector<std::string> methods;
  for (const char* name : {"genetic_algorithm",
                           "random_search",
                           "ceres_differences",
                           "nelder_mead",
                           "cma_es",
                           "differential_evolution"}) {
    if (HasSearch(name)) methods.push_back(name);
  }
  return methods;
}

TEST(Search, FindsTheMiddleOfASphere) {
  EXPECT_TRUE(HasSearch("genetic_algorithm"));
  EXPECT_TRUE(HasSearch("random_search"));
  EXPECT_TRUE(HasSearch("ceres_differences"));
  for (const std::string& name : Methods()) {
    SearchProblem problem = Problem(&Sphere, 3, -1.0, 2.0);
    problem.budget = 400;
    const SearchResult result = Minimize(name, problem);
    EXPECT_LE(result.strings, 400) << name;
    // 400 random strings in a box of volume 27: the best is at about
    // (27 / 400 * 3 / (4 pi))^(1/3) = 0.25.
    const double most = name == "random_search"            ? 0.3
                        : name == "genetic_algorithm"      ? 0.02
                        : name == "differential_evolution" ? 0.02
                                                           : 1e-3;
    EXPECT_LT(result.value, most) << name;
    EXPECT_EQ(result.value, Sphere(result.best)) << name;
  }
}

// It finds the basin of the least of the local minima.
TEST(Search, GeneticAlgorithmPassesLocalMinima) {
  const SearchProblem problem = Problem(&Rastrigin, 2, -3.0, 4.0);
  const SearchResult result = Minimize(
      "genetic_algorithm:population=40,parents=12,generations=60,shrink=0.6",
      problem);
  EXPECT_LT(result.value, 0.5);  // others have at least 0.99
  EXPECT_NEAR(result.best[0], 0.5, 0.1);
  EXPECT_NEAR(result.best[1], 0.5, 0.1);
}

// In a corner the simplex has its other vertices within the box.
TEST(Search, SimplexLeavesACorner) {
  if (!HasSearch("nelder_mead")) GTEST_SKIP() << "built without NLopt";
  for (const double corner : {-1.0, 2.0}) {
    Strings seen;
    SearchProblem problem = Problem(&Sphere, 2, -1.0, 2.0, &seen);
    problem.start = {corner, corner};
    problem.budget = 100;
    EXPECT_LT(Minimize("nelder_mead", problem).value, 1e-3) << corner;
    EXPECT_EQ(seen[0], problem.start);
    // 0.2 of the box.
    EXPECT_NEAR(std::fabs(seen[1][0] - corner), 0.6, 1e-12);
    // It ends in the nearest of many minima, and goes on elsewhere.
    problem = Problem(&Rastrigin, 2, -3.0, 4.0, &seen);
    problem.start = {corner < 0.0 ? -3.0 : 4.0, corner < 0.0 ? -3.0 : 4.0};
    problem.budget = 30;
    EXPECT_GT(Minimize("nelder_mead:step=0.05", problem).value, 0.9) << corner;
  }
}

// 20 + 18 (6 + 8) + 2 19, the paper's number.
TEST(Search, GeneticAlgorithmEvaluates310Strings) {
  Strings seen;
  const SearchResult result =
      Minimize("genetic_algorithm", Problem(&Rastrigin, 4, 0.0, 1.0, &seen));
  EXPECT_EQ(result.strings, 310);
  EXPECT_EQ(seen.size(), 310u);
  ASSERT_EQ(result.history.size(), 21u);
  EXPECT_EQ(result.history[0].strings, 20);
  EXPECT_EQ(result.history[9].strings, 20 + 9 * 14);
  EXPECT_EQ(result.history[10].strings, 20 + 9 * 14 + 19);
  // Parents are never evaluated again.
  std::sort(seen.begin(), seen.end());
  EXPECT_EQ(std::unique(seen.begin(), seen.end()), seen.end());
}

TEST(Search, BestNeverRises) {
  for (const std::string& name : Methods()) {
    SearchProblem problem = Problem(&Rastrigin, 3, -2.0, 2.5);
    problem.budget = 200;
    const SearchResult result = Minimize(name, problem);
    for (std::size_t k = 1; k < result.history.size(); ++k) {
      EXPECT_LE(result.history[k].best, result.history[k - 1].best) << name;
      EXPECT_GT(result.history[k].strings, result.history[k - 1].strings);
      EXPECT_EQ(result.history[k].best,
                Rastrigin(result.history[k].best_string));
    }
  }
}

// Offspring are convex combinations of neighbours in the ranking, component by
// component; restarts stay within the rescaled box.
TEST(Search, OffspringLieBetweenTheirParents) {
  Strings seen;
  const SearchProblem problem = Problem(&Sphere, 3, 0.0, 1.0, &seen);
  Minimize("genetic_algorithm:population=10,parents=4,generations=3,restart=3",
           problem);
  ASSERT_EQ(seen.size(), 10u + 2 * 6 + 9);
  Strings ranked(seen.begin(), seen.begin() + 10);
  const auto by_value = [](const auto& a, const auto& b) {
    return Sphere(a) < Sphere(b);
  };
  std::stable_sort(ranked.begin(), ranked.end(), by_value);
  for (int child = 0; child < 4; ++child) {
    const auto& a = ranked[child / 2 * 2];
    const auto& b = ranked[child / 2 * 2 + 1];
    double u[3];
    for (int k = 0; k < 3; ++k) {
      EXPECT_GE(seen[10 + child][k], std::min(a[k], b[k]) - 1e-15);
      EXPECT_LE(seen[10 + child][k], std::max(a[k], b[k]) + 1e-15);
      u[k] = (seen[10 + child][k] - b[k]) / (a[k] - b[k]);
    }
    // U is another one for each component.
    EXPECT_GT(std::fabs(u[0] - u[1]), 1e-6);
    EXPECT_GT(std::fabs(u[1] - u[2]), 1e-6);
  }
  const auto best =
      *std::min_element(seen.begin(), seen.begin() + 22, by_value);
  for (std::size_t s = 22; s < seen.size(); ++s) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_LE(std::fabs(seen[s][k] - best[k]), 0.25 + 1e-15);
    }
  }
}

// The same strings in the same order: a search that is answered from a record
// of its first ones goes on as if it had not been cut.
TEST(Search, SameSeedSameStrings) {
  for (const std::string& name : Methods()) {
    Strings first, second, other;
    SearchProblem problem = Problem(&Rastrigin, 3, -1.0, 2.0, &first);
    problem.budget = 100;
    Minimize(name, problem);
    problem = Problem(&Rastrigin, 3, -1.0, 2.0, &second);
    problem.budget = 100;
    Minimize(name, problem);
    EXPECT_EQ(first, second) << name;
    EXPECT_GT(first.size(), 20u) << name;
    problem = Problem(&Rastrigin, 3, -1.0, 2.0, &other);
    problem.budget = 100;
    problem.seed = 4;
    Minimize(name, problem);
    EXPECT_NE(first, other) << name;
  }
}

// An objective in other units gives the same strings, bit for bit. (pagmo's
// CMA-ES has an absolute tolerance.)
TEST(Search, UnitsDoNotMatter) {
  for (const std::string& name : Methods()) {
    if (name == "cma_es") continue;
    Strings first;
    for (const int exponent : {0, 60, -60}) {
      // Negative values, values about 0, and noise.
      Strings seen;
      SearchProblem problem = Problem(&Sphere, 3, -1.0, 2.0, &seen);
      problem.budget = 120;
      const ListObjective inner = problem.objective;
      problem.objective = [&](const Strings& s, std::vector<double>* values) {
        const bool goes_on = inner(s, values);
        for (std::size_t k = 0; k < s.size(); ++k) {
          const double noise = 0.1 * std::sin(1e4 * s[k][0] + 2e4 * s[k][1]);
          (*values)[k] = std::ldexp((*values)[k] - 0.4 + noise, exponent);
        }
        return goes_on;
      };
      Minimize(name, problem);
      if (exponent == 0) first = seen;
      EXPECT_GT(seen.size(), 20u) << name;
      EXPECT_EQ(seen, first) << name << " " << exponent;
    }
  }
}

TEST(Search, EndsWhenTold) {
  for (const std::string& name : Methods()) {
    int lists = 0;
    SearchProblem problem = Problem(&Sphere, 2, 0.0, 1.0);
    const ListObjective inner = problem.objective;
    problem.objective = [&](const Strings& s, std::vector<double>* values) {
      if (++lists > 2) return false;
      return inner(s, values);
    };
    const SearchResult result = Minimize(name, problem);
    EXPECT_EQ(lists, 3) << name;
    EXPECT_EQ(result.history.size(), 2u) << name;
  }
}

TEST(Search, AnObjectiveOfTooFewValuesEndsIt) {
  SearchProblem problem = Problem(&Sphere, 2, 0.0, 1.0);
  problem.objective = [](const Strings& strings, std::vector<double>* values) {
    values->assign(strings.size() - 1, 1.0);
    return true;
  };
  EXPECT_TRUE(Minimize("genetic_algorithm", problem).history.empty());
}

// Infinity and NaN are no values.
TEST(Search, StringsWithoutValueAreNoBest) {
  for (const std::string& name : Methods()) {
    SearchProblem problem = Problem(&Sphere, 2, 0.0, 1.0);
    problem.budget = 150;
    problem.start = {0.3, 0.55};
    problem.objective = [](const Strings& strings,
                           std::vector<double>* values) {
      for (const auto& s : strings) {
        values->push_back(s[1] > 0.8   ? kInfinity
                          : s[0] > 0.9 ? NAN
                                       : Sphere(s));
      }
      return true;
    };
    const SearchResult result = Minimize(name, problem);
    EXPECT_LT(result.value, 0.05) << name;
    EXPECT_LE(result.best[1], 0.8) << name;
  }
}

TEST(Search, RefusesInOneLine) {
  const struct {
    const char* spec;
    const char* words;
  } cases[] = {{"nothing", "unknown search 'nothing' (known: "},
               {"genetic_algorithm:parents=3", "parents=3 must be even"},
               {"genetic_algorithm:parents=12", "at most half"},
               {"genetic_algorithm:foo=1", "unknown option 'foo'"},
               {"genetic_algorithm:foo", "is not key=value"},
               {"random_search:list=0", "list=0 must be"},
               {"random_search:list=1,list=2", "given twice"}};
  for (const auto& c : cases) {
    std::string error;
    EXPECT_EQ(CreateSearch(c.spec, &error), nullptr);
    EXPECT_NE(error.find(c.words), std::string::npos) << error;
  }
}

TEST(Noise, IsMeasuredOnASmoothFunction) {
  UniformRandom random(5);
  double sum = 0.0;
  const int tries = 200;
  for (int t = 0; t < tries; ++t) {
    std::vector<double> values;
    for (int i = -4; i <= 4; ++i) {
      // Uniform noise of deviation 1e-3.
      values.push_back(std::exp(0.01 * i) +
                       std::sqrt(12.0) * 1e-3 * (random() - 0.5));
    }
    sum += EstimateNoise(values) / tries;
  }
  EXPECT_NEAR(sum, 1e-3, 3e-4);
}

// h = 8^(1/4) sqrt(noise / |f''|) of f = c (u - 1/2)^2: f'' = 2 c.
TEST(Noise, DifferenceStepsFollowTheCurvature) {
  UniformRandom random(7), noise(8);
  DifferenceSteps chosen;
  const auto f = [&](const Strings& strings, std::vector<double>* values) {
    values->clear();
    for (const auto& u : strings) {
      values->push_back(10.0 * (u[0] - 0.5) * (u[0] - 0.5) +
                        40.0 * (u[1] - 0.5) * (u[1] - 0.5) +
                        std::sqrt(12.0) * 1e-2 * (noise() - 0.5));
    }
    return true;
  };
  ASSERT_TRUE(ChooseDifferenceSteps({0.4, 0.6}, 1e-3, &random, f, &chosen));
  EXPECT_GT(chosen.noise, 3e-3);
  EXPECT_LT(chosen.noise, 3e-2);
  EXPECT_NEAR(
      chosen.steps[0] / (1.68 * std::sqrt(chosen.noise / 20.0)), 1.0, 0.2);
  EXPECT_NEAR(
      chosen.steps[1] / (1.68 * std::sqrt(chosen.noise / 80.0)), 1.0, 0.2);
}

TEST(Search, ReflectsIntoTheBox) {
  for (const double u : {-2.3, -0.3, 0.3, 1.7, 2.3, 3.7}) {
    EXPECT_NEAR(Reflect(u), 0.3, 1e-12) << u;
  }
  EXPECT_EQ(Reflect(1.0), 1.0);
  EXPECT_EQ(Reflect(0.0), 0.0);
}

}  // namespace
}  // namespace granopt
