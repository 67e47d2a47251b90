// `conditioning` as a user runs it.

#include <string>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Conditioning = Binaries;

TEST_F(Conditioning, SmokeRunAndReplot) {
  const std::string few =
      "--smoke --distances=1e-2,1e-4 --preconditioners=\"none;near@"
      "contact:shift=1e-8;hessian:shift=1e-9\" ";
  const Outcome run = Do("conditioning", few + "--out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  // A header; two states with three P, fresh and lagged by two shears.
  const std::string csv = Slurp(folder_ + "/out/conditioning.csv");
  EXPECT_EQ(Lines(csv), 1 + 2 * 3 * 3) << csv;
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/contact_changes.csv")), 1 + 2 * 2);
  EXPECT_NE(run.out.find("How to read it: "), std::string::npos) << run.out;
  const auto json = Summary("out");
  EXPECT_EQ(json.at("schema"), "granopt/conditioning/1");
  EXPECT_EQ(json.at("spectra"), 18);
  EXPECT_EQ(json.at("spectra_found"), 18);
  for (const auto& one : json.at("condition_numbers")) {
    if (one.at("shear") != "-") continue;
    const double number = one.at("median");
    if (one.at("preconditioner") == "none") {
      EXPECT_GT(number, 100.0);
    }
    if (one.at("preconditioner") == "near") {
      EXPECT_LT(number, 20.0);
    }
    if (one.at("preconditioner") == "hessian:shift=1e-9") {
      EXPECT_NEAR(number, 1.0, 1e-3);
    }
  }
  // States are used again, and the same numbers come out.
  const Outcome again = Do("conditioning", few + "--out=out");
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(Slurp(folder_ + "/out/conditioning.csv"), csv);
  // Tables from the files alone.
  const std::string tables = Slurp(folder_ + "/out/tables.txt");
  const Outcome replot = Do("conditioning", "--replot=out --out=again");
  ASSERT_EQ(replot.status, 0) << replot.err;
  EXPECT_EQ(Slurp(folder_ + "/again/tables.txt"), tables);
}

TEST_F(Conditioning, RefusesBadInput) {
  ExpectRefused("conditioning",
                "--preconditioners=foo --out=out",
                "unknown preconditioner 'foo' (known: ");
  ExpectRefused("conditioning",
                "--preconditioners=contact:shift=no --out=out",
                "option shift=no must be a number");
  ExpectRefused("conditioning",
                "--preconditioners=contact:length=1 --out=out",
                "unknown option 'length'");
  ExpectRefused("conditioning",
                "--preconditioners=\"none;none\" --out=out",
                "--preconditioners");
  ExpectRefused("conditioning", "--shear=much --out=out", "--shear: ");
  ExpectRefused("conditioning", "--shear= --out=out", "--shear= is empty");
  ExpectRefused("conditioning", "--distances=0 --out=out", "--distances: ");
  ExpectRefused("conditioning", "--distances=0.6 --out=out", "--distances: ");
  ExpectRefused("conditioning", "--seeds=x --out=out", "--seeds: ");
  ExpectRefused("conditioning", "--input=none.xyz --out=out", "none.xyz");
  ExpectRefused("conditioning", "--replot=none --out=out", "none");
  ExpectRefused(
      "conditioning", "--replot=none --alpha=3 --out=out", "--alpha cannot go");
  mkdir((folder_ + "/bad").c_str(), 0755);
  File("bad/conditioning.csv", "seed\n1\n");
  ExpectRefused(
      "conditioning", "--replot=bad --out=out", "conditioning.csv:1:");
}

}  // namespace
}  // namespace granopt
