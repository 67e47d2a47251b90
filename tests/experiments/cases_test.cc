#include "experiments/cases.h"

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "experiments/tabular.h"
#include "gtest/gtest.h"

namespace granopt {
namespace {

TEST(Cases, NumbersAreWrittenAsPeopleWriteThem) {
  EXPECT_EQ(Neat(5e-5), "5e-5");
  EXPECT_EQ(Neat(1e-4), "1e-4");
  EXPECT_EQ(Neat(0.01), "1e-2");
  EXPECT_EQ(Neat(0.8438), "0.8438");
  EXPECT_EQ(Neat(1e-13), "1e-13");
  EXPECT_EQ(Neat(4096), "4096");
  for (const double value : {0.1 + 0.2, 1.0 / 3.0, 1e-300, 6.02e23, 1e6}) {
    EXPECT_EQ(std::stod(Neat(value)), value);
  }
}

TEST(Cases, MethodsAreSeparatedBySemicolonsAndMayHaveLabels) {
  std::vector<Method> methods;
  std::string error;
  ASSERT_TRUE(ParseMethods(
      "P-L-BFGS (A = 0)@lbfgs:memory=5,A=0; fire", &methods, &error));
  ASSERT_EQ(methods.size(), 2u);
  EXPECT_EQ(methods[0].label, "P-L-BFGS (A = 0)");
  EXPECT_EQ(methods[0].spec, "lbfgs:memory=5,A=0");
  EXPECT_EQ(methods[1].label, "fire");
  EXPECT_EQ(methods[1].spec, "fire");
  EXPECT_FALSE(ParseMethods("a;;b", &methods, &error));
  EXPECT_FALSE(ParseMethods("a@", &methods, &error));
  EXPECT_FALSE(ParseMethods("a;a", &methods, &error));
  EXPECT_NE(error.find("given twice"), std::string::npos);
}

TEST(Cases, CasesMayHaveValuesAndDistances) {
  std::vector<Case> cases;
  std::string error;
  ASSERT_TRUE(ParseCases("growth,random=2e-4,near_jamming,user",
                         {1e-2, 1e-3},
                         1e-6,
                         &cases,
                         &error))
      << error;
  ASSERT_EQ(cases.size(), 5u);
  EXPECT_EQ(cases[0].id, "growth=5e-5");
  EXPECT_EQ(cases[1].id, "random=2e-4");
  EXPECT_EQ(cases[1].value, 2e-4);
  EXPECT_EQ(cases[3].id, "near_jamming=1e-6 at 1e-3");
  EXPECT_EQ(cases[3].distance, 1e-3);
  EXPECT_EQ(cases[4].id, "user");
  ASSERT_TRUE(ParseCases(
      "near_jamming=1e-6,near_jamming=0.3x", {1e-4}, 1e-5, &cases, &error))
      << error;
  ASSERT_EQ(cases.size(), 2u);
  EXPECT_FALSE(cases[0].relative);
  EXPECT_EQ(StrainOf(cases[0]), 1e-6);
  EXPECT_EQ(cases[1].id, "near_jamming=0.3x at 1e-4");
  EXPECT_TRUE(cases[1].relative);
  EXPECT_DOUBLE_EQ(StrainOf(cases[1]), 3e-5);
  for (const char* bad : {"near_jamming=-1x",
                          "near_jamming=0x",
                          "near_jamming=x",
                          "near_jamming=0.3xx",
                          "near_jamming=infx",
                          "near_jamming=101x",
                          "growth=0.3x",
                          "magic",
                          "",
                          "growth=",
                          "growth=-1",
                          "growth=many",
                          "growth=nan",
                          "user=1",
                          "growth,growth=5e-5"}) {
    EXPECT_FALSE(ParseCases(bad, {1e-2}, 1e-6, &cases, &error)) << bad;
  }
}

TEST(Cases, SeedsAreNumbersAndRanges) {
  std::vector<std::uint64_t> seeds;
  std::string error;
  ASSERT_TRUE(ParseSeeds("1-3,7", &seeds, &error));
  EXPECT_EQ(seeds, (std::vector<std::uint64_t>{1, 2, 3, 7}));
  ASSERT_TRUE(
      ParseSeeds("9223372036854775806-9223372036854775807", &seeds, &error));
  EXPECT_EQ(
      seeds,
      (std::vector<std::uint64_t>{9223372036854775806u, 9223372036854775807u}));
  for (const char* bad : {"",
                          "1-",
                          "-1",
                          "3-1",
                          "a",
                          "1,1",
                          "1-99999999999",
                          "9223372036854775808"}) {
    EXPECT_FALSE(ParseSeeds(bad, &seeds, &error)) << bad;
  }
}

// Every repetition runs every method once; the first places differ, and so do
// the predecessors.
TEST(Cases, TheOrderIsRotatedAndReversed) {
  for (int n = 1; n <= 6; ++n) {
    std::set<int> first;
    for (int r = 0; r < n; ++r) {
      const std::vector<int> order = MethodOrder(n, r);
      EXPECT_EQ(std::set<int>(order.begin(), order.end()).size(),
                static_cast<std::size_t>(n));
      first.insert(order[0]);
    }
    EXPECT_EQ(first.size(), static_cast<std::size_t>(n));
  }
  EXPECT_EQ(MethodOrder(4, 0), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(MethodOrder(4, 1), (std::vector<int>{1, 0, 3, 2}));
  EXPECT_EQ(MethodOrder(4, 2), (std::vector<int>{2, 3, 0, 1}));
  EXPECT_EQ(MethodOrder(4, 6), MethodOrder(4, 2));
}

}  // namespace
}  // namespace granopt
