// `shear` as a user runs it.

#include <cmath>
#include <string>
#include <vector>

#include "granular/packing_io.h"
#include "gtest/gtest.h"
#include "nlohmann/json.hpp"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Shear = Binaries;

TEST_F(Shear, DrawsTheCurvesOfFigure8) {
  const Outcome run = Do("shear", "--smoke --paper --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  // Increments 4e-3, 2e-3, 1e-3 to 2 %, the start included.
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/out/curves.csv"));
  ASSERT_EQ(rows.size(), 1u + 6 + 11 + 21);
  EXPECT_EQ(Fields(rows[0])[0], "increment");
  const std::vector<std::string> last = Fields(rows.back());
  EXPECT_EQ(std::stod(last[0]), 1e-3);
  EXPECT_NEAR(std::stod(last[2]), 0.02, 1e-15);
  const auto json = Summary("out");
  EXPECT_EQ(json.at("schema"), "granopt/shear/1");
  EXPECT_EQ(json.at("converged"), true);
  ASSERT_EQ(json.at("agreement").size(), 2u);
  // The paper: the same curve at small strain, whatever the increment.
  for (const auto& one : json.at("agreement")) {
    EXPECT_LT(one.at("small_strain").get<double>(), 1e-6);
  }
  EXPECT_NE(run.out.find("assumed here"), std::string::npos);
  // The relaxed start is a packing that can be sheared again.
  const Outcome again = Do("shear",
                           "--input=out/start.xyz --increments=4e-3 "
                           "--out=again");
  ASSERT_EQ(again.status, 0) << again.err;
  const std::vector<std::string> same =
      Rows(Slurp(folder_ + "/again/curves.csv"));
  ASSERT_EQ(same.size(), 7u);
  EXPECT_NEAR(std::stod(Fields(same[6])[3]),
              std::stod(Fields(rows[6])[3]),
              1e-9 * std::stod(Fields(rows[6])[3]));
}

TEST_F(Shear, LocatesPlasticEvents) {
  const Outcome run =
      Do("shear", "--particles=256 --seed=1 --strain=0.01 --events --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("out");
  const auto& events = json.at("events");
  const int found = events.at("found").get<int>();
  ASSERT_GE(found, 1) << run.out;
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/out/events.csv"));
  ASSERT_EQ(static_cast<int>(rows.size()), 1 + found);
  int reversible = 0;
  for (int k = 1; k <= found; ++k) {
    const std::vector<std::string> f = Fields(rows[k]);
    EXPECT_LE(std::stod(f[1]) - std::stod(f[0]), 1e-10);
    EXPECT_GT(std::stod(f[3]), 0.0);
    reversible += std::stod(f[9]) < 1e-8;
  }
  EXPECT_EQ(events.at("reversible_branches"), reversible);
  EXPECT_GE(2 * reversible, found);
  const auto& largest = events.at("largest");
  EXPECT_LE(largest.at("width").get<double>(), 1e-10);
  EXPECT_GT(Lines(Slurp(folder_ + "/out/event_branch.csv")), 5);
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/event_landscape.csv")), 202);
  EXPECT_NE(Slurp(folder_ + "/out/event.xyz").find(":displacement:R:3"),
            std::string::npos);
  Packing packing;
  std::string error;
  EXPECT_TRUE(ReadPacking(folder_ + "/out/event.xyz", &packing, &error))
      << error;
}

// Interrupted, it goes on to the same bytes.
TEST_F(Shear, Resumes) {
  const std::string flags =
      "--particles=128 --strain=0.01 --increments=2e-4,1e-4 --mode=simple "
      "--events ";
  ASSERT_EQ(Do("shear", flags + "--out=whole").status, 0);
  ASSERT_EQ(Interrupt("shear", flags, "out"), 1);
  EXPECT_FALSE(Exists(folder_ + "/out/summary.json"));
  const Outcome rest = Do("shear", flags + "--resume --out=out");
  ASSERT_EQ(rest.status, 0) << rest.err;
  EXPECT_NE(rest.out.find("resumed at strain"), std::string::npos) << rest.out;
  const auto expect_same = [&] {
    for (const char* name :
         {"curves.csv", "events.csv", "packing.xyz", "contacts.csv"}) {
      EXPECT_FALSE(Slurp(folder_ + "/whole/" + name).empty()) << name;
      EXPECT_TRUE(Slurp(folder_ + "/whole/" + name) ==
                  Slurp(folder_ + "/out/" + name))
          << name;
    }
    // All but times and flags.
    const auto read = [&](const std::string& out) {
      auto json =
          nlohmann::json::parse(Slurp(folder_ + "/" + out + "/summary.json"))
              .flatten();
      for (auto entry = json.begin(); entry != json.end();) {
        const bool times = entry.key().find("seconds") != std::string::npos ||
                           entry.key().find("provenance") != std::string::npos;
        entry = times ? json.erase(entry) : std::next(entry);
      }
      return json;
    };
    EXPECT_EQ(read("whole"), read("out"));
  };
  expect_same();
  // And again, with nothing left to do.
  const Outcome done = Do("shear", flags + "--resume --out=out");
  EXPECT_EQ(done.status, 0) << done.err;
  expect_same();
  const Outcome other = Do("shear", "--particles=128 --resume --out=out");
  EXPECT_EQ(other.status, 2);
  EXPECT_EQ(Lines(other.err), 1) << other.err;
}

// The same of walls, of a given stress and of damped motion.
TEST_F(Shear, OtherShearsResume) {
  const struct {
    std::string flags, words;
    std::vector<const char*> files;
  } runs[] = {{"--particles=128 --mode=wall --strain=0.01 --increments=1e-4",
               "resumed at strain",
               {"walls.csv", "profile.csv", "packing.xyz"}},
              {"--particles=64 --phi=0.9 --mode=stress --shear_stress=1e-3 "
               "--stress_steps=50",
               "resumed at shear stress",
               {"stress.csv", "packing.xyz"}},
              {"--particles=48 --dynamics --seeds=1-3 --tolerance=1e-4",
               "resumed after",
               {"dynamics.csv"}}};
  int number = 0;
  for (const auto& run : runs) {
    const std::string whole = "whole" + std::to_string(++number);
    const std::string cut = "cut" + std::to_string(number);
    const Outcome all = Do("shear", run.flags + " --out=" + whole);
    ASSERT_EQ(all.status, 0) << all.out << all.err;
    ASSERT_EQ(Interrupt("shear", run.flags, cut), 1) << run.flags;
    const Outcome rest = Do("shear", run.flags + " --resume --out=" + cut);
    ASSERT_EQ(rest.status, 0) << rest.err;
    EXPECT_NE(rest.out.find(run.words), std::string::npos) << rest.out;
    for (const char* name : run.files) {
      EXPECT_FALSE(Slurp(folder_ + "/" + whole + "/" + name).empty()) << name;
      EXPECT_TRUE(Slurp(folder_ + "/" + whole + "/" + name) ==
                  Slurp(folder_ + "/" + cut + "/" + name))
          << run.flags << ": " << name;
    }
  }
}

// A frictionless packing bears some of its pressure as shear stress, not all.
TEST_F(Shear, ByStressFindsTheYieldStress) {
  const Outcome run = Do("shear",
                         "--particles=64 --phi=0.9 --mode=stress "
                         "--shear_stress=0.1 --stress_steps=8 --out=sheared");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("sheared");
  EXPECT_EQ(json.at("yields"), true);
  const double reached = json.at("reached"), refused = json.at("refused");
  EXPECT_NEAR(refused - reached, 0.1 / 8 / 64, 1e-12);
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/sheared/stress.csv"));
  const std::vector<std::string> last = Fields(rows.back());
  EXPECT_NEAR(std::stod(last[2]), reached, 1e-9);
  EXPECT_LT(reached, 0.5 * std::stod(last[3]));
  EXPECT_GT(reached, 0.0);
  ExpectRefused("shear", "--mode=stress", "--shear_stress=0 must be");
  ExpectRefused("shear", "--shear_stress=1", "needs --mode=stress");
  ExpectRefused("shear",
                "--mode=stress --shear_stress=1e-3 --cycles=2",
                "--cycles cannot go with");
}

TEST_F(Shear, AveragesOverSeeds) {
  const std::string flags =
      "--seeds=1-3 --jobs=2 --particles=64 --increments=2e-3,1e-3 ";
  const Outcome run = Do("shear", flags + "--out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const std::vector<std::string> rows = Rows(Slurp(folder_ + "/out/bands.csv"));
  ASSERT_EQ(rows.size(), 1u + 11 + 21);
  const std::vector<std::string> head = Fields(rows[0]);
  const std::vector<std::string> f = Fields(rows[5]);
  ASSERT_EQ(head.size(), f.size());
  EXPECT_EQ(f[3], "3");
  // Mean of the members' own curves, inside their quantiles' reach.
  double sum = 0.0;
  for (const char* seed : {"1", "2", "3"}) {
    const std::vector<std::string> member =
        Rows(Slurp(folder_ + "/out/seed" + std::string(seed) + "/curves.csv"));
    sum += std::stod(Fields(member[5])[6]);
  }
  EXPECT_EQ(head[4], "stress_iso");
  EXPECT_NEAR(std::stod(f[4]), sum / 3.0, 1e-12 * sum);
  EXPECT_LE(std::stod(f[6]), std::stod(f[4]));
  EXPECT_GE(std::stod(f[7]), std::stod(f[4]));
  const Outcome again = Do("shear", flags + "--resume --out=out");
  EXPECT_EQ(again.status, 0);
  EXPECT_NE(again.out.find("3 of them complete"), std::string::npos)
      << again.out;
  EXPECT_TRUE(Rows(Slurp(folder_ + "/out/bands.csv")) == rows);
}

TEST_F(Shear, ServesAnyStrainPressuresCyclesAndWalls) {
  // Folded thrice.
  const Outcome simple = Do("shear",
                            "--smoke --mode=simple --strain=3 "
                            "--increments=0.05 --out=simple");
  ASSERT_EQ(simple.status, 0) << simple.err;
  Packing packing;
  std::string error;
  ASSERT_TRUE(ReadPacking(folder_ + "/simple/packing.xyz", &packing, &error));
  EXPECT_LE(std::abs(packing.box.edges()(0, 1)), 0.5 + 1e-9);
  // The pressure stays.
  const Outcome pressed = Do("shear",
                             "--smoke --pressure=1e-3 --stabilize "
                             "--increments=2e-3 --out=pressed");
  ASSERT_EQ(pressed.status, 0) << pressed.err;
  for (const std::string& row : Rows(Slurp(folder_ + "/pressed/curves.csv"))) {
    if (row[0] == 'i') continue;
    EXPECT_NEAR(std::stod(Fields(row)[11]), 1e-3, 1e-11);
  }
  // Down and up again: the volume is what it was.
  const Outcome bulk = Do("shear",
                          "--smoke --mode=bulk --strain=-0.01 --cycles=2 "
                          "--increments=1e-3 --out=bulk");
  ASSERT_EQ(bulk.status, 0) << bulk.err;
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/bulk/curves.csv"));
  ASSERT_EQ(rows.size(), 1u + 41);
  EXPECT_NEAR(
      std::stod(Fields(rows[1])[13]), std::stod(Fields(rows[41])[13]), 1e-14);
  EXPECT_GT(std::stod(Fields(rows[11])[13]),
            1.009 * std::stod(Fields(rows[1])[13]));
  for (const char* wall : {"rough", "flat"}) {
    const Outcome run =
        Do("shear",
           std::string("--particles=256 --mode=wall --strain=0.01 "
                       "--increments=1e-3 --out=wall --wall=") +
               wall);
    ASSERT_EQ(run.status, 0) << run.err;
    const auto json = Summary("wall");
    EXPECT_LT(json.at("worst_imbalance").get<double>(), 1e-8);
    EXPECT_EQ(Lines(Slurp(folder_ + "/wall/walls.csv")), 12);
    const double shear = json.at("most_shear_stress").get<double>() /
                         json.at("last_normal_stress").get<double>();
    // Rough walls take the grains along, flat ones slide.
    if (std::string(wall) == "rough") {
      EXPECT_GT(shear, 0.03);
    } else {
      EXPECT_LT(shear, 0.03);
    }
  }
  const Outcome spheres = Do("shear",
                             "--smoke --dimension=3 --strain=0.004 "
                             "--out=spheres");
  EXPECT_EQ(spheres.status, 0) << spheres.err;
}

// Remark 1.1, a small load: the same state, by motion or by minimization.
TEST_F(Shear, ComparesMotionWithMinimization) {
  const Outcome run =
      Do("shear",
         "--dynamics --particles=64 --strain=1e-5 --increments=1e-6 "
         "--tolerance=1e-6 --seeds=1,2 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("out");
  int checked = 0;
  for (const auto& group : json.at("groups")) {
    if (group.at("load") == "random start") continue;
    EXPECT_EQ(group.at("same_state"), 2) << group.dump();
    EXPECT_NEAR(group.at("energy").at("ratio").get<double>(), 1.0, 1e-6);
    ++checked;
  }
  EXPECT_EQ(checked, 8);
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/dynamics.csv")), 1 + 2 * 3 * 4);
}

TEST_F(Shear, RefusesBadInput) {
  ExpectRefused("shear", "--mode=round", "bulk, wall or stress");
  ExpectRefused("shear", "--strain=0", "--strain=0");
  ExpectRefused("shear", "--strain=-2", "above -1");
  ExpectRefused("shear", "--increments=3e-3", "does not divide");
  ExpectRefused("shear", "--increments=1,x", "--increments");
  ExpectRefused("shear", "--paper --strain=0.1", "--strain cannot go with");
  ExpectRefused("shear", "--mode=bulk --pressure=1", "--mode=bulk");
  ExpectRefused("shear", "--events --pressure=1", "--events");
  ExpectRefused("shear", "--stabilize", "--pressure");
  ExpectRefused("shear", "--mode=wall --wall=soft", "rough or flat");
  ExpectRefused("shear", "--wall=flat", "--mode=wall");
  ExpectRefused("shear", "--seeds=1-2 --sizes=64", "--sizes");
  ExpectRefused("shear", "--cycles=-1", "--cycles");
  ExpectRefused("shear", "--solver=nonsense", "--solver");
  ExpectRefused("shear", "--size_ratio=0", "--size_ratio");
}

}  // namespace
}  // namespace granopt
