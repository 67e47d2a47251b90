// `jamming` as a user runs it.

#include <sstream>
#include <string>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Jamming = Binaries;

// The error bar decides how far the decompression goes, nothing before it.
TEST_F(Jamming, GrowthAndBisectionDoNotDependOnTheErrorBar) {
  const auto path = [&](const std::string& flags) {
    Do("jamming", "--smoke --seed=7 --overcompression=0 --out=out " + flags);
    const std::string csv = Slurp(folder_ + "/out/path.csv");
    const std::string head = csv.substr(0, csv.find("decompression"));
    // Without the column of seconds.
    std::string rows;
    std::stringstream lines(head);
    for (std::string line; std::getline(lines, line);) {
      rows += line.substr(0, line.rfind(',')) + "\n";
    }
    return rows;
  };
  const std::string published = path("--error_bar=0");
  EXPECT_GT(Lines(published), 5);
  EXPECT_EQ(path("--error_bar=1e-6"), published);
  EXPECT_EQ(path("--error_bar=1e-8"), published);
}

TEST_F(Jamming, SmokeRunFindsAnIsostaticState) {
  const Outcome run = Do("jamming", "--smoke --seed=2 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("out");
  EXPECT_TRUE(json["converged"].get<bool>());
  EXPECT_NEAR(json["phi_j"].get<double>(), 0.83, 0.03);
  EXPECT_LE(json["phi_j_error"].get<double>(), 1e-6);
  const auto& state = json["state"];
  EXPECT_GE(state["rigid_contacts"].get<int>(),
            state["isostatic_contacts"].get<int>());
  for (const char* name : {"packing.xyz",
                           "contacts.csv",
                           "path.csv",
                           "stage_initial.xyz",
                           "stage_unjammed.xyz"}) {
    EXPECT_TRUE(Exists(folder_ + "/out/" + name)) << name;
  }
}

TEST_F(Jamming, OfAJammedStartSaysSo) {
  const Outcome run =
      Do("jamming", "--paper --particles=64 --phi_init=0.9 --out=out");
  EXPECT_EQ(run.status, 1);
  EXPECT_NE(run.err.find("jammed already at phi_init = 0.9"), std::string::npos)
      << run.err;
}

// A quench above jamming is followed down at once.
TEST_F(Jamming, FollowsAJammedStartDown) {
  ASSERT_EQ(Do("jamming", "--smoke --phi_init=0.9 --out=out").status, 0);
  const std::string path = Slurp(folder_ + "/out/path.csv");
  EXPECT_EQ(path.find("growth"), std::string::npos);
  const auto json = Summary("out");
  EXPECT_EQ(json["cycles"], 0);
  // Its result is a start again, taken as it is.
  ASSERT_EQ(Do("jamming",
               "--smoke --input=" + folder_ + "/out/packing.xyz --out=again")
                .status,
            0);
  const auto again = Summary("again");
  EXPECT_NEAR(again["phi_j"].get<double>(),
              json["phi_j"].get<double>(),
              json["phi_j_error"].get<double>());
}

// In units of the radius the cell shrinks as the radii would grow.
TEST_F(Jamming, BothRoutesLeadToTheSamePacking) {
  const auto run = [&](const std::string& flags) {
    EXPECT_EQ(Do("jamming", "--smoke --seed=4 --out=out " + flags).status, 0);
    return Summary("out");
  };
  const auto radii = run("--phi_init=0.86");
  const auto cell = run("--phi_init=0.86 --route=cell");
  EXPECT_NEAR(radii["phi_j"].get<double>(), cell["phi_j"].get<double>(), 1e-12);
  EXPECT_EQ(radii["state"]["contacts"], cell["state"]["contacts"]);
  const std::string packing = Slurp(folder_ + "/out/packing.xyz");
  EXPECT_NE(packing.find("Lattice=\"1.0"), std::string::npos)
      << packing.substr(0, 100);
}

}  // namespace
}  // namespace granopt
