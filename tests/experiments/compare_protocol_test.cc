// `compare --protocol` as a user runs it.

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using CompareProtocol = Binaries;

const char kShortJamming[] =
    "--protocol=jamming --smoke --particles=32 --seeds=1,2 "
    "--tolerances=1e-4,1e-6 --solvers='lb@lbfgs;fire' ";
const char kShortShear[] =
    "--protocol=shear --smoke --seeds=1-3 --strain=1e-2 --strain_steps=5 "
    "--solvers='lb@lbfgs;fire' ";

// Counts of protocol_runs.csv, without times.
std::string ProtocolCounts(const std::string& csv) {
  std::string text;
  const std::vector<std::string> rows = Rows(csv);
  const std::vector<std::string> names = Fields(rows[0]);
  for (const std::string& row : rows) {
    const std::vector<std::string> f = Fields(row);
    for (std::size_t c = 0; c < f.size() && c < names.size(); ++c) {
      if (names[c] == "cpu_seconds" || names[c] == "seconds" ||
          names[c] == "function_share" || names[c] == "linear_share") {
        continue;
      }
      text += f[c] + ",";
    }
    text += "\n";
  }
  return text;
}

TEST_F(CompareProtocol, RunsAlgorithm1WithEachMethod) {
  const std::string flags = std::string(kShortJamming) + "--out=out";
  const Outcome run = Do("compare", flags);
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const std::string runs = Slurp(folder_ + "/out/protocol_runs.csv");
  const std::vector<std::string> rows = Rows(runs);
  ASSERT_EQ(rows.size(), 1u + 8);
  const std::vector<std::string> names = Fields(rows[0]);
  const auto column = [&](const char* name) {
    return std::find(names.begin(), names.end(), name) - names.begin();
  };
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const std::vector<std::string> f = Fields(rows[k]);
    const double phi_cr = std::stod(f[column("phi_cr")]);
    const double unjammed = std::stod(f[column("phi_unjammed")]);
    EXPECT_EQ(f[column("finished")], "1") << rows[k];
    EXPECT_GT(phi_cr, unjammed);
    EXPECT_LE(phi_cr - unjammed, 1e-4);
    EXPECT_GT(std::stod(f[column("pressure")]), 0.0);
    if (f[column("branch")] == "followed") {
      EXPECT_LT(std::stod(f[column("phi_j")]), phi_cr);
      // The slope at the state knows its own jamming point.
      EXPECT_GT(std::stod(f[column("distance")]), 0.0);
    }
  }
  // The work is that of growth and bisection, step by step.
  const std::vector<std::string> steps =
      Rows(Slurp(folder_ + "/out/protocol_steps.csv"));
  const std::vector<std::string> step_names = Fields(steps[0]);
  const auto step_column = [&](const char* name) {
    return std::find(step_names.begin(), step_names.end(), name) -
           step_names.begin();
  };
  const std::vector<std::string> first = Fields(rows[1]);
  long long evaluations = 0;
  int relaxations = 0, down = 0;
  for (const std::string& row : steps) {
    const std::vector<std::string> f = Fields(row);
    if (f[0] != first[0] || f[1] != first[1] || f[3] != first[3]) continue;
    if (f[step_column("stage")] == "decompression") {
      ++down;
      continue;
    }
    ++relaxations;
    evaluations += std::stoll(f[step_column("evaluations")]);
  }
  EXPECT_EQ(std::to_string(evaluations), first[column("evaluations")]);
  EXPECT_EQ(std::to_string(relaxations), first[column("relaxations")]);
  EXPECT_GT(down, 0);
  for (const char* words :
       {"how far the published Algorithm 1 can be believed",
        "one start, many jamming points",
        "8 of 8 protocols finished",
        "performance profile, evaluations, 4 problems (whole protocols)",
        "quality profile, (phi_cr - phi_J) / epsilon"}) {
    EXPECT_NE(run.out.find(words), std::string::npos) << words;
  }
  const auto json = Summary("out");
  EXPECT_EQ(json.at("schema"), "granopt/compare_protocol/1");
  EXPECT_EQ(json.at("runs_finished"), 8);

  // Again from the raw files: the same bytes.
  ASSERT_EQ(Do("compare", "--replot=out --out=again").status, 0);
  for (const char* name : {"tables.md",
                           "protocol_tables.csv",
                           "jamming_table.csv",
                           "profile.csv",
                           "quality.csv"}) {
    EXPECT_FALSE(Slurp(folder_ + "/out/" + name).empty()) << name;
    EXPECT_EQ(Slurp(folder_ + "/again/" + name),
              Slurp(folder_ + "/out/" + name))
        << name;
  }
  // Interrupted before the last three: they are run again, to the same counts.
  std::string kept;
  for (std::size_t k = 0; k + 3 < rows.size(); ++k) kept += rows[k] + "\n";
  File("out/protocol_runs.csv", kept);
  const std::string table = Slurp(folder_ + "/out/jamming_table.csv");
  Outcome resumed = Do("compare", flags + " --resume");
  ASSERT_EQ(resumed.status, 0) << resumed.err;
  EXPECT_NE(resumed.out.find("resumed   5 protocols were there"),
            std::string::npos)
      << resumed.out;
  EXPECT_EQ(ProtocolCounts(Slurp(folder_ + "/out/protocol_runs.csv")),
            ProtocolCounts(runs));
  EXPECT_EQ(Slurp(folder_ + "/out/jamming_table.csv"), table);
  // Complete: nothing is run, no byte changes.
  const std::string md = Slurp(folder_ + "/out/tables.md");
  ASSERT_EQ(Do("compare", flags + " --resume").status, 0);
  EXPECT_EQ(Slurp(folder_ + "/out/tables.md"), md);
  // Another comparison is not mixed with it.
  resumed = Do("compare", flags + " --resume --epsilon=1e-5");
  EXPECT_EQ(resumed.status, 2);
  EXPECT_EQ(Lines(resumed.err), 1) << resumed.err;
  EXPECT_EQ(Slurp(folder_ + "/out/tables.md"), md);
  // An ordinary comparison leaves nothing of it.
  ASSERT_EQ(Do("compare",
               "--smoke --cases=growth --solvers=lbfgs --tolerance=1e-4 "
               "--repetitions=1 --out=out")
                .status,
            0);
  for (const char* name :
       {"protocol_runs.csv", "protocol_steps.csv", "jamming_table.csv"}) {
    EXPECT_FALSE(Exists(folder_ + "/out/" + name)) << name;
  }
}

TEST_F(CompareProtocol, ShearsOnePackingWithEachMethod) {
  const std::string flags = std::string(kShortShear) + "--out=out";
  const Outcome run = Do("compare", flags);
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const std::vector<std::string> steps =
      Rows(Slurp(folder_ + "/out/protocol_steps.csv"));
  // Start and five steps, of each method and seed.
  ASSERT_EQ(steps.size(), 1u + 6 * 2 * 3);
  const std::vector<std::string> names = Fields(steps[0]);
  const auto column = [&](const char* name) {
    return std::find(names.begin(), names.end(), name) - names.begin();
  };
  std::map<std::string, std::set<std::string>> starts;
  for (std::size_t k = 1; k < steps.size(); ++k) {
    const std::vector<std::string> f = Fields(steps[k]);
    const int step = std::stoi(f[column("step")]);
    EXPECT_DOUBLE_EQ(std::stod(f[column("strain")]), 1e-2 * step / 5);
    EXPECT_NEAR(std::stod(f[column("phi")]), 0.86, 1e-12);
    if (step == 0) {
      starts[f[1]].insert(f[column("energy")]);
      EXPECT_EQ(f[column("evaluations")], "0");
    } else {
      EXPECT_EQ(f[column("converged")], "1") << steps[k];
    }
  }
  // All methods begin with one state.
  ASSERT_EQ(starts.size(), 3u);
  for (const auto& [seed, energies] : starts) EXPECT_EQ(energies.size(), 1u);
  EXPECT_NE(run.out.find("the curves beside that of lb"), std::string::npos);
  EXPECT_NE(run.out.find("steps that all begin from one state"),
            std::string::npos);
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/shear_table.csv")), 1 + 2 * 3);
  EXPECT_TRUE(Exists(folder_ + "/out/prepared_relaxed_seed3.xyz"));
  ASSERT_EQ(Do("compare", "--replot=out --out=again --protocol=shear").status,
            0);
  for (const char* name : {"tables.md", "shear_table.csv", "profile.csv"}) {
    EXPECT_EQ(Slurp(folder_ + "/again/" + name),
              Slurp(folder_ + "/out/" + name))
        << name;
  }
  // Beside another method.
  ASSERT_EQ(Do("compare", "--replot=out --out=again --reference=fire").status,
            0);
  EXPECT_NE(Slurp(folder_ + "/again/tables.md")
                .find("## the curves beside that of fire"),
            std::string::npos);
  const std::string table = Slurp(folder_ + "/out/shear_table.csv");
  std::vector<std::string> runs =
      Rows(Slurp(folder_ + "/out/protocol_runs.csv"));
  ASSERT_EQ(runs.size(), 1u + 6);
  const std::string whole =
      ProtocolCounts(Slurp(folder_ + "/out/protocol_runs.csv"));
  File("out/protocol_runs.csv", runs[0] + "\n" + runs[1] + "\n");
  ASSERT_EQ(Do("compare", flags + " --resume").status, 0);
  EXPECT_EQ(ProtocolCounts(Slurp(folder_ + "/out/protocol_runs.csv")), whole);
  EXPECT_EQ(Slurp(folder_ + "/out/shear_table.csv"), table);
  EXPECT_EQ(Rows(Slurp(folder_ + "/out/protocol_steps.csv")).size(),
            steps.size());
}

TEST_F(CompareProtocol, ShowsAProtocolThatFails) {
  // No relaxation may do what it must: Algorithm 1 cannot go on.
  const Outcome run = Do(
      "compare", std::string(kShortJamming) + "--max_evaluations=2 --out=out");
  EXPECT_EQ(run.status, 1) << run.out;
  EXPECT_NE(run.out.find("0 of 8 protocols finished"), std::string::npos);
  EXPECT_NE(run.out.find("! lb, tolerance 1e-4, seed 1: undecided"),
            std::string::npos)
      << run.out;
  // A shear goes on, and says so.
  const Outcome shear =
      Do("compare", std::string(kShortShear) + "--max_evaluations=2 --out=out");
  EXPECT_EQ(shear.status, 1) << shear.out;
  EXPECT_NE(Slurp(folder_ + "/out/profile.csv")
                .find("whole protocols,evaluations,lb,lbfgs,3,0,inf,0"),
            std::string::npos);
}

TEST_F(CompareProtocol, RefusesBadInputOfProtocols) {
  const auto refused = [this](const std::string& flags,
                              const std::string& words) {
    ExpectRefused("compare", flags + " --out=out", words);
  };
  refused("--protocol=melting", "--protocol=melting must be jamming or shear");
  refused("--protocol=", "--protocol= must be jamming or shear");
  refused("--protocol=jamming --solvers=magic", "--solvers: unknown solver");
  refused("--protocol=jamming --prepare_solver=magic", "--prepare_solver");
  refused("--protocol=jamming --tolerances=1e-4,0", "--tolerances: '0'");
  refused("--protocol=jamming --tolerances=1e-4,1e-4", "given twice");
  refused("--protocol=jamming --tolerances=1e-4 --tolerance=1e-4",
          "--tolerance cannot go with --tolerances");
  refused("--protocol=jamming --epsilon=0", "--epsilon");
  refused("--protocol=jamming --dphi=-1", "--dphi");
  refused("--protocol=jamming --phi=0.9", "--phi is of --protocol=shear");
  refused("--protocol=jamming --strain=0.1", "--strain is of --protocol=shear");
  refused("--protocol=shear --epsilon=1e-4",
          "--epsilon is of --protocol=jamming");
  refused("--protocol=shear --strain=0", "--strain");
  refused("--protocol=shear --strain=nan", "--strain");
  refused("--protocol=shear --strain_steps=0", "--strain_steps");
  refused("--protocol=shear --cases=growth", "--cases cannot go");
  refused("--protocol=shear --seeds=3-1", "--seeds");
  refused("--protocol=shear --reference=x", "no method is labelled 'x'");
  refused("--protocol=shear --repetitions=0", "--repetitions");
  refused("--protocol=shear --phi=0.86 --particles=0", "particles");
  refused("--protocol=shear --input=none.xyz", "none.xyz");
  refused("--strain=0.1", "--strain needs --protocol");
  refused("--tolerances=1e-3", "--tolerances needs --protocol");
  // --replot of what is damaged.
  ASSERT_EQ(Do("compare", std::string(kShortShear) + "--out=good").status, 0);
  refused("--replot=good --protocol=jamming", "good is of --protocol=shear");
  refused("--replot=good --tolerance=1e-3", "--tolerance cannot go");
  refused("--replot=good --strain=0.1", "--strain cannot go");
  refused("--replot=good --baseline=x", "no method is labelled 'x'");
  File("good/protocol_runs.csv", "tolerance,seed\n1e-4,1\n");
  refused("--replot=good", "protocol_runs.csv:1: no column repetition");
}

}  // namespace
}  // namespace granopt
