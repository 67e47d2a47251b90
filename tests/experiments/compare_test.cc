// `compare` as a user runs it.

#include <cstdio>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Compare = Binaries;

const char kTwoMethods[] =
    "--solvers='lb@ceres_lbfgs:scaled=1,differences=1,restarts=10;"
    "cg@ceres_ncg:scaled=1' ";

// Chains of shear steps: 2 distances x 2 strains x 2 steps of one packing.
const char kChain[] =
    "--particles=64 --cases=near_jamming=1e-6,near_jamming=0.3x --steps=2 "
    "--distances=1e-2,1e-3 --repetitions=2 --tolerance=1e-6 "
    "--solvers='lb@lbfgs;fire' ";

TEST_F(Compare, WritesEventsRunsAndTables) {
  const Outcome run =
      Do("compare",
         "--smoke --cases=growth,random --seeds=1,3 --tolerance=1e-4 "
         "--solvers='lb@ceres_lbfgs:scaled=1;cg@ceres_ncg:scaled=1' --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  for (const char* name : {"setup.json",
                           "events.csv",
                           "runs.csv",
                           "curves.csv",
                           "tables.csv",
                           "tables.md",
                           "summary.json",
                           "prepared_relaxed_seed1.xyz",
                           "prepared_relaxed_seed3.xyz"}) {
    EXPECT_TRUE(Exists(folder_ + "/out/" + name)) << name;
  }
  // 2 methods x 2 cases x 2 seeds x 2 repetitions, interleaved.
  const std::vector<std::string> runs = Rows(Slurp(folder_ + "/out/runs.csv"));
  ASSERT_EQ(runs.size(), 1u + 16);
  const char* expected[] = {"growth=5e-5,1,1,1,lb",
                            "growth=5e-5,1,1,1,cg",
                            "growth=5e-5,3,1,1,lb",
                            "growth=5e-5,3,1,1,cg",
                            "random=1e-4,1,1,1,lb",
                            "random=1e-4,1,1,1,cg",
                            "random=1e-4,3,1,1,lb",
                            "random=1e-4,3,1,1,cg",
                            "growth=5e-5,1,1,2,cg",
                            "growth=5e-5,1,1,2,lb"};
  for (int k = 0; k < 10; ++k) {
    EXPECT_EQ(runs[1 + k].rfind(std::string(expected[k]) + ",", 0), 0u)
        << runs[1 + k];
  }
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/tables.csv")), 1 + 4);
  const auto json = Summary("out");
  EXPECT_TRUE(json["converged"].get<bool>());
  EXPECT_EQ(json["runs"].get<int>(), 16);
  EXPECT_FALSE(json["provenance"]["compiler"].get<std::string>().empty());
  EXPECT_NE(run.out.find("16 of 16 runs converged"), std::string::npos);
}

// Of one run: a smaller residual never costs less.
TEST_F(Compare, EventsAreMonotoneInTheLevel) {
  ASSERT_EQ(Do("compare",
               "--smoke --cases=growth --solvers=ceres_lbfgs:scaled=1 "
               "--tolerance=1e-5 --out=out")
                .status,
            0);
  std::vector<std::string> last(9);
  int count = 0;
  for (const std::string& row : Rows(Slurp(folder_ + "/out/events.csv"))) {
    const std::vector<std::string> now = Fields(row);
    if (now[0] == "case" || now[6] != "relative") continue;
    ASSERT_EQ(now.size(), 18u) << row;
    if (now[3] == last[3]) {
      EXPECT_LT(std::stod(now[7]), std::stod(last[7]));
      for (int column : {8, 9, 14}) {  // iterations, evaluations, seconds
        EXPECT_GE(std::stod(now[column]), std::stod(last[column])) << row;
      }
      ++count;
    }
    last = now;
  }
  EXPECT_EQ(count, 2 * 4);
}

TEST_F(Compare, CountsAreDeterministicAndPreparedStatesAreUsedAgain) {
  const auto counts = [this] {
    std::string text;
    for (const std::string& row : Rows(Slurp(folder_ + "/out/events.csv"))) {
      const std::vector<std::string> f = Fields(row);
      for (const int column : {0, 1, 2, 3, 4, 6, 7, 8, 9, 17}) {
        text += f[column] + ",";
      }
      text += "\n";
    }
    return text;
  };
  const std::string flags =
      "--smoke --cases=growth,near_jamming,fig2 --repetitions=1 "
      "--solvers=ceres_lbfgs:scaled=1 --tolerance=1e-4 --out=out";
  Outcome run = Do("compare", flags);
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_EQ(run.out.find("(used again)"), std::string::npos) << run.out;
  const std::string first = counts();
  run = Do("compare", flags);
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_NE(run.out.find("(used again)"), std::string::npos) << run.out;
  EXPECT_EQ(counts(), first);
  EXPECT_NE(first.find("near_jamming=1e-6 at 1e-4"), std::string::npos);
  // Another recipe, another state.
  for (const char* other : {"alpha=2.5", "size_ratio=1.2", "precision=mixed"}) {
    run = Do("compare", flags + " --" + other);
    EXPECT_EQ(run.out.find("(used again)"), std::string::npos) << run.out;
  }
}

TEST_F(Compare, ReplotMakesTheSameTables) {
  const Outcome run =
      Do("compare",
         std::string(kTwoMethods) + "--smoke --tolerance=1e-12 --out=out");
  ASSERT_NE(run.status, 2) << run.err;
  const std::string md = Slurp(folder_ + "/out/tables.md");
  const std::string csv = Slurp(folder_ + "/out/tables.csv");
  ASSERT_FALSE(md.empty());
  ASSERT_EQ(Do("compare", "--replot=out --out=again").status, 0);
  EXPECT_EQ(Slurp(folder_ + "/again/tables.md"), md);
  EXPECT_EQ(Slurp(folder_ + "/again/tables.csv"), csv);
  // In place, unless told otherwise.
  ASSERT_EQ(std::remove((folder_ + "/out/tables.md").c_str()), 0);
  ASSERT_EQ(Do("compare", "--replot=out/").status, 0);
  EXPECT_EQ(Slurp(folder_ + "/out/tables.md"), md);
  // At another level, against another baseline.
  const Outcome loose =
      Do("compare", "--replot=out --tolerance=1e-3 --baseline=cg --out=again");
  ASSERT_EQ(loose.status, 0) << loose.err;
  EXPECT_NE(loose.out.find("until max|g| <= 1e-3 mean forces"),
            std::string::npos)
      << loose.out;
  const auto refused = [&](const std::string& flags, const std::string& words) {
    const Outcome bad = Do("compare", "--replot=out --out=new " + flags);
    EXPECT_EQ(bad.status, 2) << flags;
    EXPECT_EQ(Lines(bad.err), 1) << bad.err;
    EXPECT_NE(bad.err.find(words), std::string::npos) << bad.err;
    EXPECT_FALSE(Exists(folder_ + "/new"));
  };
  refused("--tolerance=1e-13", "stopped at 1e-12");
  refused("--tolerance=3e-3", "none of the recorded levels");
  refused("--cases=growth", "--cases cannot go with --replot");
  refused("--precision=mixed", "--precision cannot go with --replot");
  refused("--baseline=x", "no method is labelled 'x'");
  refused("--replot=none", "none/setup.json");
  File("out/events.csv", "case,seed\nx,1\n");
  refused("", "events.csv:1: no column repetition");
}

TEST_F(Compare, FollowsChainsOfShearSteps) {
  const Outcome run =
      Do("compare", std::string(kChain) + "--reference=lb --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const std::vector<std::string> steps =
      Rows(Slurp(folder_ + "/out/steps.csv"));
  ASSERT_EQ(steps.size(), 1u + 8);
  EXPECT_EQ(Fields(steps[0]).size(), 14u);
  const double strains[] = {1e-6, 1e-6, 3e-3, 3e-4};
  for (int k = 0; k < 8; ++k) {
    const std::vector<std::string> f = Fields(steps[1 + k]);
    EXPECT_EQ(f[1], "1");
    EXPECT_EQ(f[2], std::to_string(1 + k % 2));
    EXPECT_NEAR(std::stod(f[3]), strains[k / 2], 1e-12);
    // The kind is what the other columns say.
    ASSERT_LE(std::stod(f[10]), 1e-9) << steps[1 + k];
    ASSERT_LE(std::stod(f[11]), 1e-9) << steps[1 + k];
    EXPECT_EQ(f[4],
              std::stod(f[5]) <= 1e-3 ? "non-rearranging" : "rearranging");
    if (f[4] == "non-rearranging") {
      EXPECT_NEAR(std::stod(f[8]), std::stod(f[9]), 1e-9 * std::stod(f[8]));
    }
    EXPECT_EQ(f[13], "A");
  }
  EXPECT_EQ(Fields(steps[5])[0], "near_jamming=0.3x at 1e-2");
  // Every method once a step and repetition.
  const std::string runs = Slurp(folder_ + "/out/runs.csv");
  EXPECT_EQ(Lines(runs), 1 + 2 * 2 * 8);
  EXPECT_NE(runs.find("near_jamming=0.3x at 1e-3,1,2,2,fire,"),
            std::string::npos);
  EXPECT_NE(run.out.find("who leaves the basin of lb"), std::string::npos);
  // A tiny strain far from jamming does not rearrange: the method that prepared
  // the states ends where they do.
  const std::string tables = Slurp(folder_ + "/out/step_tables.csv");
  EXPECT_NE(tables.find("near_jamming=1e-6 at 1e-2,1e-6,0,1e-2,"),
            std::string::npos)
      << tables;
  // Made again from the raw files: the same bytes.
  ASSERT_EQ(Do("compare", "--replot=out --out=again").status, 0);
  for (const char* name :
       {"tables.md", "tables.csv", "step_tables.csv", "basins.csv"}) {
    EXPECT_EQ(Slurp(folder_ + "/again/" + name),
              Slurp(folder_ + "/out/" + name))
        << name;
    EXPECT_FALSE(Slurp(folder_ + "/out/" + name).empty()) << name;
  }
  // Steps as they are used again, to the byte; another strain is made anew.
  const std::string first = Slurp(folder_ + "/out/steps.csv");
  ASSERT_EQ(Do("compare", std::string(kChain) + "--out=out").status, 0);
  EXPECT_EQ(Slurp(folder_ + "/out/steps.csv"), first);
  EXPECT_NE(Slurp(folder_ + "/stdout.txt").find("_shear_0.3x: "),
            std::string::npos);
  EXPECT_FALSE(Exists(folder_ + "/out/basins.csv"));
}

// A comparison that lost its last block goes on to the same counts and minima.
TEST_F(Compare, Resumes) {
  const std::string flags = std::string(kChain) + "--resume --out=out";
  // Nothing there: begins.
  ASSERT_EQ(Do("compare", flags).status, 0);
  const auto counts = [this] {
    std::string text;
    for (const std::string& row : Rows(Slurp(folder_ + "/out/runs.csv"))) {
      const std::vector<std::string> f = Fields(row);
      for (int column = 0; column < 6; ++column) text += f[column] + ",";
      text += f[13] + "," + f[17] + "," + f[23] + "," + f[24] + "\n";
    }
    return text;
  };
  const std::string expected = counts();
  ASSERT_EQ(expected.substr(0, expected.find('\n')),
            "case,seed,step,repetition,solver,spec,energy,minimum,iterations,"
            "evaluations");
  const std::string md = Slurp(folder_ + "/out/tables.md");
  // Half of a block is run again with its other half.
  const std::vector<std::string> rows = Rows(Slurp(folder_ + "/out/runs.csv"));
  std::string kept;
  for (std::size_t k = 0; k + 5 < rows.size(); ++k) kept += rows[k] + "\n";
  File("out/runs.csv", kept);
  Outcome run = Do("compare", flags);
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_EQ(counts(), expected);
  EXPECT_NE(run.out.find("resumed   26 runs were there"), std::string::npos)
      << run.out;
  // Complete: nothing is run, nothing changes.
  const std::string complete = Slurp(folder_ + "/out/runs.csv");
  run = Do("compare", flags);
  ASSERT_EQ(run.status, 0);
  EXPECT_EQ(Slurp(folder_ + "/out/runs.csv"), complete);
  // Another comparison is not mixed with it.
  run = Do("compare", flags + " --max_evaluations=5000");
  EXPECT_EQ(run.status, 2);
  EXPECT_EQ(Lines(run.err), 1) << run.err;
  EXPECT_NE(run.err.find("--resume: out/setup.json is of a comparison with "
                         "other flags"),
            std::string::npos)
      << run.err;
  EXPECT_EQ(Slurp(folder_ + "/out/runs.csv"), complete);
}

TEST_F(Compare, NamesWhoLeavesTheBasinInAnyCase) {
  const Outcome run =
      Do("compare",
         "--smoke --cases=growth,random --reference=ceres_lbfgs:scaled=1 "
         "--solvers='lb@ceres_lbfgs:scaled=1;fire' --tolerance=1e-4 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/out/basins.csv"));
  ASSERT_EQ(rows.size(), 1u + 3);
  EXPECT_EQ(rows[1].rfind("growth=5e-5,fire,fire,all,", 0), 0u) << rows[1];
  EXPECT_EQ(rows[3].rfind("all cases,fire,fire,all,", 0), 0u) << rows[3];
  EXPECT_FALSE(Exists(folder_ + "/out/steps.csv"));
  EXPECT_FALSE(Exists(folder_ + "/out/step_tables.csv"));
}

TEST_F(Compare, ShowsAMethodThatFails) {
  const Outcome run = Do("compare",
                         std::string(kTwoMethods) +
                             "--smoke --cases=growth --tolerance=1e-12 "
                             "--out=out");
  EXPECT_EQ(run.status, 1) << run.out;
  EXPECT_NE(run.out.find("NO_PROGRESS (0 of 2 got there)"), std::string::npos)
      << run.out;
  EXPECT_NE(run.out.find("! cg: NO_PROGRESS, |g| = "), std::string::npos);
  EXPECT_NE(run.out.find("2 of 4 runs converged"), std::string::npos);
  const std::string runs = Slurp(folder_ + "/out/runs.csv");
  EXPECT_EQ(Lines(runs), 1 + 4);
  EXPECT_NE(Slurp(folder_ + "/out/tables.csv").find(",NO_PROGRESS,"),
            std::string::npos);
  const auto json = Summary("out");
  EXPECT_FALSE(json["converged"].get<bool>());
  EXPECT_EQ(json["runs_converged"].get<int>(), 2);
}

TEST_F(Compare, StartsFromAnInput) {
  const Outcome run =
      Do("compare",
         "--input=" GRANOPT_TEST_DATA
         "/n256_phi0.8438_a2_relaxed.xyz --cases=user,simple_shear "
         "--tolerance=1e-8 --repetitions=1 --out=out " +
             std::string(
                 "--solvers=ceres_lbfgs:scaled=1,differences=1,restarts=10"));
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/runs.csv")), 1 + 2);
  EXPECT_FALSE(Exists(folder_ + "/out/prepared_relaxed_seed1.xyz"));
}

TEST_F(Compare, PresetsHaveTheLevelsOfThePaper) {
  const Outcome run =
      Do("compare",
         "--paper=table1 --smoke --repetitions=1 --max_evaluations=3000 "
         "--solvers='L-BFGS@ceres_lbfgs:scaled=1,differences=1,restarts=10' "
         "--out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  for (const char* words : {"until max|g| <= 1e-13 (k = 1, box = 1)",
                            "until max|g| <= 1e-10 (k = 1, box = 1)",
                            "until max|g| <= 1e-6 mean forces",
                            "paper its",
                            " 2003 ",
                            "what the paper leaves open"}) {
    EXPECT_NE(run.out.find(words), std::string::npos) << words;
  }
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/tables.csv")), 1 + 9);
}

TEST_F(Compare, RefusesBadInput) {
  const auto refused = [this](const std::string& flags,
                              const std::string& words) {
    ExpectRefused("compare", flags + " --out=out", words);
  };
  refused("--solvers=magic", "--solvers: unknown solver 'magic'");
  refused("--solvers='a@ceres_lbfgs:m=3'", "unknown option 'm'");
  refused("--solvers=", "empty entry");
  refused("--solvers='ceres_lbfgs;ceres_lbfgs'", "given twice");
  refused("--prepare_solver=magic", "--prepare_solver: unknown solver");
  refused("--cases=magic", "--cases: unknown case 'magic'");
  refused("--cases=growth=-1", "--cases: growth=-1");
  refused("--cases=user", "--input, which is not given");
  refused("--cases=pure_shear=900 --particles=20", "images");
  refused("--seeds=1-", "--seeds: '1-'");
  refused("--repetitions=0", "--repetitions=0");
  refused("--tolerance=0", "--tolerance=0");
  refused("--tolerance=nan", "--tolerance");
  refused("--absolute_tolerance=-1", "--absolute_tolerance=-1");
  refused("--max_seconds=-1", "--max_seconds=-1");
  refused("--distances=1e-2,no", "--distances: 'no'");
  refused("--distances=3", "--distances: 3");
  refused("--shear=0", "--shear=0");
  refused("--cases=near_jamming --steps=0", "--steps=0 must be in [1,");
  refused("--cases=growth --steps=3", "--steps is of the case near_jamming");
  refused("--cases=near_jamming=-1x",
          "--cases: near_jamming=-1x: the value must be in (0, 1], or a "
          "multiple of the distance as in 0.3x");
  refused("--cases=near_jamming=x", "--cases: near_jamming=x: ");
  refused("--cases=near_jamming=200x", "the strain must be in (0, 1]");
  refused("--cases=growth=0.3x", "--cases: growth=0.3x");
  refused("--reference=x", "--reference: no method is labelled 'x'");
  refused("--baseline=x", "no method is labelled 'x'");
  refused("--paper=table2", "--paper=table2");
  refused("--phi=0", "--phi=0");
  refused("--alpha=1.5", "--alpha=1.5");
  refused("--particles=0", "particles");
  refused("--input=none.xyz", "none.xyz: cannot read");
  refused("--input=none.xyz --phi=0.9", "--phi describes a random start");
  refused("--input=none.xyz --cases=start", "cannot go with --input");
  refused("--dimension=3 --cases=fig2", "fig2 in 3D needs --phi");
  refused("--replot=", "--replot= is empty");
  refused("stray", "stray");
}

TEST_F(Compare, WritesProfilesOfThreeProblemsAndMore) {
  const std::string flags =
      "--smoke --cases=growth --repetitions=1 --tolerance=1e-4 "
      "--solvers='lb@lbfgs;fire' ";
  ASSERT_EQ(Do("compare", flags + "--seeds=1-3 --out=out").status, 0);
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/out/profile.csv"));
  ASSERT_GT(rows.size(), 4u);
  EXPECT_EQ(rows[0],
            "problems,measure,solver,spec,count,solved,ratio,fraction");
  EXPECT_EQ(rows[1].rfind("\"case, seed, step\",evaluations,lb,lbfgs,3,3,", 0),
            0u)
      << rows[1];
  EXPECT_NE(Slurp(folder_ + "/out/quality.csv").find(",minimum,lb,"),
            std::string::npos);
  EXPECT_NE(Slurp(folder_ + "/out/tables.md")
                .find("## performance profile, evaluations, 3 problems"),
            std::string::npos);
  // Two problems are too few, and nothing is left of the three.
  ASSERT_EQ(Do("compare", flags + "--seeds=1,2 --out=out").status, 0);
  EXPECT_FALSE(Exists(folder_ + "/out/profile.csv"));
  EXPECT_FALSE(Exists(folder_ + "/out/quality.csv"));
}

}  // namespace
}  // namespace granopt
