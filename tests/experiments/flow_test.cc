// `flow` as a user runs it.

#include <cmath>
#include <cstdlib>
#include <string>

#include "gtest/gtest.h"
#include "nlohmann/json.hpp"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Flow = Binaries;

TEST_F(Flow, RunsAndItsLedgerCloses) {
  const Outcome run = Do("flow", "--duration=0.3 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("out");
  EXPECT_EQ(json.at("schema"), "granopt/flow/1");
  const auto& ledger = json.at("ledger");
  double sum = -ledger.at("potential_change").get<double>();
  for (const char* key : {"boundary",
                          "impact",
                          "friction",
                          "external",
                          "damping",
                          "numerical",
                          "closure"}) {
    sum += ledger.at(key).get<double>();
  }
  EXPECT_NEAR(sum, ledger.at("kinetic_change").get<double>(), 1e-13);
  EXPECT_LE(std::fabs(ledger.at("closure").get<double>()), 1e-14);
  EXPECT_LE(ledger.at("momentum_drift").get<double>(), 1e-14);
  // 101 frames of 100 grains.
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/energy.csv")),
            1 + Lines(Slurp(folder_ + "/out/trajectory.xyz")) / 102);
  EXPECT_NE(Slurp(folder_ + "/out/trajectory.xyz").find("Time="),
            std::string::npos);
}

// What a flow has written is a start of another one: places and velocities.
TEST_F(Flow, GoesOnFromItsFrames) {
  ASSERT_EQ(Do("flow", "--duration=0.1 --out=first").status, 0);
  const Outcome again =
      Do("flow", "--input=first/start.xyz --duration=0.1 --out=again");
  ASSERT_EQ(again.status, 0) << again.err;
  for (const char* file : {"/start.xyz", "/final.xyz", "/energy.csv"}) {
    EXPECT_TRUE(Slurp(folder_ + "/first" + file) ==
                Slurp(folder_ + "/again" + file))
        << file;
  }
  // In the middle of impacts grains overlap.
  const Outcome run = Do("flow",
                         "--input=first/final.xyz --relax_overlaps "
                         "--duration=0.1 --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto last = Fields(Rows(Slurp(folder_ + "/first/energy.csv")).back());
  const auto first = Fields(Rows(Slurp(folder_ + "/out/energy.csv"))[1]);
  EXPECT_NEAR(std::stod(first[2]), std::stod(last[2]), 1e-14);
  // Other velocities, if asked for.
  const Outcome still = Do("flow",
                           "--input=first/start.xyz --duration=0.01 "
                           "--mean_velocity=0,0,0 --perturbation=0,0,0 "
                           "--out=still");
  ASSERT_EQ(still.status, 0) << still.err;
  EXPECT_EQ(std::stod(Fields(Rows(Slurp(folder_ + "/still/energy.csv"))[1])[2]),
            0.0);
}

TEST_F(Flow, ResumesToTheSameBits) {
  const std::string flags =
      "--alpha1=0.5 --alpha2=0.25 --checkpoint_every=20 --out=";
  ASSERT_EQ(Do("flow", "--duration=0.4 " + flags + "whole").status, 0);
  // A run that was cut off after its checkpoint at step 40.
  const std::string command =
      "cp -r whole cut && rm cut/summary.json cut/final.xyz cut/energy.csv && "
      "cp cut/checkpoint.cbor.previous cut/checkpoint.cbor";
  ASSERT_EQ(std::system(("cd '" + folder_ + "' && " + command).c_str()), 0);
  const Outcome rest = Do("flow", "--duration=0.4 --resume " + flags + "cut");
  ASSERT_EQ(rest.status, 0) << rest.err;
  EXPECT_NE(rest.out.find("resumed at t = "), std::string::npos) << rest.out;
  for (const char* file :
       {"final.xyz", "energy.csv", "rejections.csv", "trajectory.xyz"}) {
    EXPECT_EQ(Slurp(folder_ + "/cut/" + file),
              Slurp(folder_ + "/whole/" + file))
        << file;
  }
  // Another scene does not go on from there.
  const Outcome other =
      Do("flow", "--duration=0.4 --resume --mu_s=0.3 " + flags + "cut");
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("begun with mu_s"), std::string::npos) << other.err;
  const Outcome denser =
      Do("flow", "--duration=0.4 --resume --density=1000 " + flags + "cut");
  EXPECT_EQ(denser.status, 2);
  EXPECT_NE(denser.err.find("begun with density"), std::string::npos)
      << denser.err;
}

TEST_F(Flow, RefusesInOneLine) {
  const struct {
    const char* arguments;
    const char* words;
  } cases[] = {
      {"--restitution=1.2", "restitution e = 1.2 must be in [0, 1]"},
      {"--mu_d=0.3", "mu_d = 0.3 > mu_s = 0.2"},
      {"--length_ratio=0.6", "placement impossible: "},
      {"--attempts=0 --length_ratio=0.3", "overlapping start: "},
      {"--law=foo", "--law=foo must be powers"},
      {"--domain=foo", "--domain=foo must be"},
      {"--stepper=foo", "--stepper=foo must be"},
      {"--contacts=soft --mu_s=0.1", "--mu_s is of impacts"},
      {"--tolerance=1e-17", "below the roundoff of positions"},
      {"--mean_velocity=1,2", "must be three numbers"},
      {"--alpha1=-1", "alpha1 = -1"},
      {"--study=foo", "--study=foo must be"},
      {"--paper --alpha1=1", "--alpha1 cannot go with --paper"},
      {"--paper --field_accuracy=1e-2",
       "--field_accuracy cannot go with --paper"},
      {"--study=remark8 --dt=0.1", "--dt cannot go with --study=remark8"},
      {"--study=oscillator --seeds=3",
       "--seeds cannot go with --study=oscillator"},
      {"--force=1,0,0 --force_frequency=nan",
       "--force_frequency=nan must be finite"},
      {"--force_frequency=nan", "--force_frequency=nan must be finite"},
      {"--stepper=minimize --solver=nothing", "--solver: "},
      {"--stepper=minimize --solver=interior_point", "--solver: "},
      {"--input=missing.xyz", "--input: "},
      {"--particles=0", "--particles=0 must be in"}};
  for (const auto& c : cases) {
    ExpectRefused("flow", std::string(c.arguments) + " --out=out", c.words);
  }
}

TEST_F(Flow, SaysWhyItStopped) {
  const Outcome run =
      Do("flow", "--alpha1=5 --alpha2=0 --contacts=none --out=out");
  EXPECT_EQ(run.status, 1);
  EXPECT_EQ(run.err.find("flow: collapse at t = "), 0u) << run.err;
  EXPECT_EQ(Lines(run.err), 1) << run.err;
  // Those of the step that was the last one are in there, too.
  const int rows = Lines(Slurp(folder_ + "/out/rejections.csv")) - 1;
  EXPECT_GT(rows, 1);
  const auto json = Summary("out");
  EXPECT_EQ(json.at("counts").at("rejected_steps"), rows);
}

TEST_F(Flow, PaperAndStudies) {
  const Outcome run = Do("flow", "--paper --smoke --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto json = Summary("out");
  ASSERT_EQ(json.at("strengths").size(), 4u);
  for (const auto& row : json.at("strengths")) {
    for (const char* key :
         {"T0", "T1", "relative_fraction0", "relative_fraction1"}) {
      EXPECT_TRUE(row.at(key).is_number());
      EXPECT_TRUE(row.at(std::string(key) + "_sd").is_number());
    }
  }
  for (const char* study : {"oscillator", "remark8"}) {
    EXPECT_EQ(Do("flow", "--study=" + std::string(study) + " --smoke --out=out")
                  .status,
              0)
        << study;
  }
}

TEST_F(Flow, PaperResumesOnlyWithTheSameGroups) {
  const std::string flags = "--paper --smoke --sweep=groups --out=out";
  ASSERT_EQ(Do("flow", flags).status, 0);
  ASSERT_TRUE(Exists(folder_ + "/out/checkpoint.cbor"));
  const Outcome other = Do("flow", flags + " --groups=2 --resume");
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("begun with groups"), std::string::npos)
      << other.err;
}

// Runs that fail are told in the tables, and spoil no others.
TEST_F(Flow, PaperRecordsWhatFails) {
  // Ways of a thousandth: no step is short enough for ten iterations.
  const Outcome run =
      Do("flow", "--paper --smoke --relaxation=0.001 --out=out");
  EXPECT_EQ(run.status, 1) << run.out << run.err;
  EXPECT_NE(run.out.find("failed: constant_e, alpha1 = 0.5, seed "),
            std::string::npos)
      << run.out;
  const auto json = Summary("out");
  EXPECT_GT(json.at("failed").size(), 0u);
  EXPECT_NE(Slurp(folder_ + "/out/runs.csv").find("step floor"),
            std::string::npos);
}

TEST_F(Flow, ResumesWithTheSameCounts) {
  const std::string flags =
      "--stepper=verlet --dt=2e-3 --checkpoint_every=20 --duration=0.3 --out=";
  ASSERT_EQ(Do("flow", flags + "whole").status, 0);
  const std::string command =
      "cp -r whole cut && rm cut/summary.json && "
      "cp cut/checkpoint.cbor.previous cut/checkpoint.cbor";
  ASSERT_EQ(std::system(("cd '" + folder_ + "' && " + command).c_str()), 0);
  ASSERT_EQ(Do("flow", "--resume " + flags + "cut").status, 0);
  nlohmann::json counts[2];
  for (const int k : {0, 1}) {
    const std::string file =
        folder_ + (k == 0 ? "/whole" : "/cut") + "/summary.json";
    counts[k] = nlohmann::json::parse(Slurp(file)).at("counts");
  }
  EXPECT_EQ(counts[0], counts[1]);
}

TEST_F(Flow, StartsFromAFile) {
  // Two spheres that overlap: refused, then relaxed.
  const std::string file =
      File("two.xyz",
           "2\nLattice=\"1 0 0 0 1 0 0 0 1\" "
           "Properties=species:S:1:pos:R:3:radius:R:1 pbc=\"T T T\"\n"
           "A 0.5 0.5 0.5 0.05\nA 0.58 0.5 0.5 0.05\n");
  ExpectRefused(
      "flow", "--input=" + file + " --out=out", "overlapping start: 1 pairs");
  const Outcome run =
      Do("flow", "--relax_overlaps --input=" + file + " --out=out");
  EXPECT_EQ(run.status, 0) << run.err;
  EXPECT_NE(run.out.find("overlaps relaxed: "), std::string::npos) << run.out;
}

}  // namespace
}  // namespace granopt
