// `scaling` as a user runs it.

#include <map>
#include <string>
#include <utility>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Scaling = Binaries;

// Over eight packings the exponents of pressure, bulk modulus, shear modulus
// and coordination are those of the paper (or of the theory, for B).
TEST_F(Scaling, FindsThePapersExponents) {
  const Outcome run = Do("scaling",
                         "--seeds=1-8 --particles=256 --jobs=2 --spectra=1e-2 "
                         "--distances=1e-3,3e-3,1e-2,3e-2 --most_distance=3e-2 "
                         "--out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto summary = Summary("out");
  std::map<std::pair<std::string, double>, double> exponent;
  for (const auto& e : summary.at("exponents")) {
    exponent[{e.at("quantity"), e.at("alpha")}] = e.at("exponent");
    if (e.at("quantity") == "shear" || e.at("quantity") == "shear_mean") {
      // Of so few small packings it is not sharp.
      EXPECT_LE(e.at("low").get<double>() - 0.1, e.at("claim"));
      EXPECT_GE(e.at("high").get<double>() + 0.1, e.at("claim"));
    }
    EXPECT_LE(e.at("low").get<double>(), e.at("high").get<double>());
    EXPECT_EQ(e.at("packings"), 8);
  }
  EXPECT_EQ(exponent.size(), 10u);
  for (const double alpha : {2.0, 2.5}) {
    const double p = exponent[{"pressure", alpha}];
    const double b = exponent[{"bulk", alpha}];
    const double g = exponent[{"shear_mean", alpha}];
    const double z = exponent[{"excess", alpha}];
    EXPECT_NEAR(p, alpha - 1.0, 0.07);
    EXPECT_NEAR(b, alpha - 2.0, 0.12);
    EXPECT_NEAR(g, alpha - 1.5, 0.3);
    EXPECT_NEAR(z, 0.5, 0.15);
  }
  // 8 x 2 packings, every mode of each.
  EXPECT_GT(Lines(Slurp(folder_ + "/out/spectrum.csv")), 16 * 450);
  for (const char* file : {"states.csv", "exponents.csv"}) {
    EXPECT_TRUE(Exists(folder_ + "/out/" + file)) << file;
  }

  // Nothing is run again, and nothing changes.
  const std::string states = Slurp(folder_ + "/out/states.csv");
  const Outcome again = Do("scaling",
                           "--seeds=1-8 --particles=256 --jobs=2 "
                           "--spectra=1e-2 --distances=1e-3,3e-3,1e-2,3e-2 "
                           "--most_distance=3e-2 --resume --out=out");
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_NE(again.out.find("16 of them complete"), std::string::npos)
      << again.out;
  EXPECT_TRUE(Slurp(folder_ + "/out/states.csv") == states);
}

TEST_F(Scaling, RefusesBadInput) {
  ExpectRefused("scaling", "--distances=1e-2,x", "--distances");
  ExpectRefused("scaling", "--distances=1e-2,2", "[1e-12, 0.5]");
  ExpectRefused("scaling", "--spectra=1e-5 --distances=1e-2", "--spectra");
  ExpectRefused("scaling", "--seeds=1-2 --alpha=2", "--alphas");
  ExpectRefused("scaling", "--seeds=1-2 --alphas=1", "[2, 100]");
  ExpectRefused("scaling", "--jobs=2", "--seeds");
  ExpectRefused("scaling", "--solver=nonsense", "--solver");
  EXPECT_FALSE(Exists(folder_ + "/out"));
}

}  // namespace
}  // namespace granopt
