// Runs the experiment binaries the way a user does: good input, bad input, exit
// statuses, files.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "granular/packing_io.h"
#include "gtest/gtest.h"
#include "nlohmann/json.hpp"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

int Lines(const std::string& text) {
  int count = 0;
  for (const char c : text) count += c == '\n';
  return count;
}

class Cli : public Binaries {
 protected:
  void ExpectRefused(const std::string& binary,
                     const std::string& arguments,
                     const std::string& words) {
    const Outcome run = Do(binary, arguments);
    EXPECT_EQ(run.status, 2) << binary << " " << arguments;
    EXPECT_EQ(Lines(run.err), 1) << run.err;
    EXPECT_NE(run.err.find(words), std::string::npos)
        << binary << " " << arguments << "\n got: " << run.err;
    EXPECT_FALSE(Exists(folder_ + "/out")) << arguments;
  }

  std::string File(const std::string& name, const std::string& content) {
    std::ofstream(folder_ + "/" + name) << content;
    return name;
  }
};

const char kHeader[] =
    "Lattice=\"1 0 0 0 1 0 0 0 1\" Properties=species:S:1:pos:R:3:radius:R:1 "
    "pbc=\"T T F\"\n";

TEST_F(Cli, ResultsAreCertified) {
  const std::string input =
      "--input=" GRANOPT_TEST_DATA "/n256_phi0.8438_a2_relaxed.xyz";
  const Outcome run = Do("relax", input + " --modes=3 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_NE(run.out.find("\n  certificate   strict minimum: lowest eigenvalue"),
            std::string::npos)
      << run.out;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  const auto& certificate = json.at("certificate");
  EXPECT_EQ(certificate.at("verdict"), "strict minimum");
  EXPECT_EQ(certificate.at("strict_minimum"), true);
  EXPECT_GT(certificate.at("lowest_eigenvalue"), 1e-4);
  EXPECT_EQ(Lines(Slurp(folder_ + "/out/modes.csv")), 4);
  // The packing, with columns that a reader of packings skips.
  Packing packing, modes;
  std::string error;
  ASSERT_TRUE(ReadPacking(folder_ + "/out/packing.xyz", &packing, &error))
      << error;
  ASSERT_TRUE(ReadPacking(folder_ + "/out/modes.xyz", &modes, &error)) << error;
  EXPECT_EQ(packing.positions, modes.positions);
  EXPECT_NE(Slurp(folder_ + "/out/modes.xyz").find(":mode_3:R:3"),
            std::string::npos);
  // Not asked for, no files; an earlier run's are gone.
  const Outcome plain = Do("relax", input + " --certify=false --out=out");
  EXPECT_EQ(plain.out.find("certificate"), std::string::npos);
  EXPECT_FALSE(Exists(folder_ + "/out/modes.csv"));
  EXPECT_FALSE(nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"))
                   .contains("certificate"));
  // A saddle is called one; the method did converge.
  std::string square = "4\n";
  square += kHeader;
  for (const char* x : {"0 0", "0.5 0", "0 0.5", "0.5 0.5"}) {
    square += std::string("A ") + x + " 0 0.26\n";
  }
  const Outcome saddle =
      Do("relax", "--input=" + File("square.xyz", square) + " --out=out");
  EXPECT_EQ(saddle.status, 0);
  EXPECT_NE(saddle.out.find("certificate   stationary, not a minimum"),
            std::string::npos)
      << saddle.out;
  const Outcome jamming = Do("jamming", "--smoke --out=out");
  EXPECT_EQ(jamming.status, 0);
  EXPECT_NE(jamming.out.find("certificate   strict minimum"), std::string::npos)
      << jamming.out;
  EXPECT_EQ(nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"))
                .at("certificate")
                .at("strict_minimum"),
            true);
}

TEST_F(Cli, ModesWithoutACertificateAreRefused) {
  ExpectRefused("relax",
                "--particles=16 --modes=2 --nocertify --out=out",
                "--modes needs --certify");
  ExpectRefused("jamming",
                "--particles=16 --modes=-1 --out=out",
                "--modes=-1 must be in [0, 1000]");
}

TEST_F(Cli, PrecisionIsOneOfThree) {
  for (const char* binary : {"relax", "compare", "jamming"}) {
    ExpectRefused(binary,
                  "--particles=16 --precision=half --out=out",
                  "--precision=half must be double, mixed or float");
  }
  EXPECT_EQ(Do("relax", "--smoke --precision=mixed --out=out").status, 0);
  EXPECT_EQ(nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"))
                .at("precision"),
            "mixed");
}

TEST_F(Cli, RelaxFollowsItsInterface) {
  const Outcome run =
      Do("relax",
         "--input=" GRANOPT_TEST_DATA
         "/n256_phi0.8438_a2_relaxed.xyz --perturb=1e-5 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  for (const char* key : {"solver",
                          "converged",
                          "stop_reason",
                          "iterations",
                          "evaluations",
                          "hessians",
                          "factorizations",
                          "seconds",
                          "energy",
                          "max_gradient",
                          "mean_force",
                          "pressure",
                          "shear_stress",
                          "coordination",
                          "contacts",
                          "rattlers",
                          "phi",
                          "schema"}) {
    EXPECT_TRUE(json.contains(key)) << key;
  }
  EXPECT_TRUE(json["converged"].get<bool>());
  // The state that the independent program found: 3.25091e-06, 1.57304e-3.
  EXPECT_NEAR(json["energy"].get<double>(), 3.25091e-06, 0.5e-11);
  EXPECT_NEAR(json["pressure"].get<double>(), 1.57304e-3, 0.5e-8);
  EXPECT_EQ(json["rattlers"].get<int>(), 2);
  EXPECT_LE(json["quad_relative_residual"].get<double>(), 2e-10);
  EXPECT_LE(json["force_error"].get<double>(), 1e-14);
  // The packing written is the packing reported.
  Packing packing;
  std::string error;
  ASSERT_TRUE(ReadPacking(folder_ + "/out/packing.xyz", &packing, &error))
      << error;
  EXPECT_EQ(packing.size(), 256);
  EXPECT_EQ(packing.PackingFraction(), json["phi"].get<double>());
  EXPECT_FALSE(json["provenance"]["compiler"].get<std::string>().empty());
  const std::string trace = Slurp(folder_ + "/out/trace.csv");
  EXPECT_GT(Lines(trace), 3);
  // The default method names those that it took its steps with.
  EXPECT_NE(trace.find(",interior_point,"), std::string::npos) << trace;
}

TEST_F(Cli, RelaxIsDeterministicAndReadsItsOwnOutputExactly) {
  ASSERT_EQ(Do("relax", "--particles=64 --phi=0.86 --seed=4 --out=a").status,
            0);
  ASSERT_EQ(Do("relax", "--particles=64 --phi=0.86 --seed=4 --out=b").status,
            0);
  EXPECT_EQ(Slurp(folder_ + "/a/packing.xyz"),
            Slurp(folder_ + "/b/packing.xyz"));
  // What was written, low parts included, is still converged when read.
  const Outcome run = Do("relax", "--input=a/packing.xyz --out=c");
  ASSERT_EQ(run.status, 0) << run.out;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/c/summary.json"));
  EXPECT_EQ(json["iterations"].get<int>(), 0);
}

TEST_F(Cli, RelaxReportsFailureWithResultsWritten) {
  const Outcome run =
      Do("relax", "--particles=64 --phi=0.9 --max_evaluations=5 --out=out");
  EXPECT_EQ(run.status, 1);
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_FALSE(json["converged"].get<bool>());
  EXPECT_EQ(json["stop_reason"].get<std::string>(), "MAX_EVALUATIONS");
  EXPECT_TRUE(Exists(folder_ + "/out/packing.xyz"));
}

TEST_F(Cli, RelaxAppliesItsLoads) {
  const std::string input =
      "--input=" GRANOPT_TEST_DATA "/n256_phi0.8438_a2_relaxed.xyz ";
  const auto phi = [&](const std::string& load) {
    EXPECT_EQ(
        Do("relax", input + load + " --max_evaluations=1 --out=out").status, 1);
    return nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  };
  EXPECT_NEAR(phi("--radius_factor=1.01")["phi"].get<double>(),
              0.8438 * 1.01 * 1.01,
              1e-12);
  EXPECT_NEAR(phi("--simple_shear=0.01")["phi"].get<double>(), 0.8438, 1e-12);
  const auto sheared = phi("--pure_shear=0.01");
  EXPECT_NEAR(sheared["phi"].get<double>(), 0.8438, 1e-12);
  EXPECT_GT(sheared["deviatoric_stress"].get<double>(), 1e-3);
}

TEST_F(Cli, AbsoluteToleranceIsInUnitsOfTheBox) {
  ASSERT_EQ(Do("relax",
               "--particles=64 --phi=0.86 --absolute_tolerance=1e-9 --out=out")
                .status,
            0);
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_LE(json["max_gradient"].get<double>(), 1e-9);
}

TEST_F(Cli, BadInputIsOneLineAndLeavesNothing) {
  File("count.xyz", std::string("two\n") + kHeader);
  File("short.xyz", std::string("2\n") + kHeader + "A 0.1 0.1 0 0.1\n");
  File("nan.xyz", std::string("1\n") + kHeader + "A nan 0.1 0 0.1\n");
  File("radius.xyz", std::string("1\n") + kHeader + "A 0.1 0.1 0 -0.1\n");
  File("zero.xyz", std::string("0\n") + kHeader);
  File("absurd.xyz", std::string("999999999999\n") + kHeader);
  File("huge.xyz", std::string("1\n") + kHeader + "A 0.1 0.1 0 100\n");
  File("cell.xyz",
       "1\nLattice=\"1 0 0 1 0 0 0 0 1\" "
       "Properties=species:S:1:pos:R:3:radius:R:1 pbc=\"T T F\"\n"
       "A 0.1 0.1 0 0.1\n");
  for (const char* binary : {"relax", "jamming"}) {
    const std::string b = binary;
    ExpectRefused(b, "--input=none.xyz --out=out", "none.xyz: cannot read");
    ExpectRefused(b, "--input=count.xyz --out=out", "count.xyz:1:");
    ExpectRefused(b, "--input=short.xyz --out=out", "short.xyz:3:");
    ExpectRefused(b, "--input=nan.xyz --out=out", "nan.xyz:3: pos = 'nan'");
    ExpectRefused(b, "--input=radius.xyz --out=out", "radius = '-0.1'");
    ExpectRefused(b, "--input=zero.xyz --out=out", "zero.xyz:1:");
    ExpectRefused(b, "--input=absurd.xyz --out=out", "999999999999");
    ExpectRefused(b, "--input=huge.xyz --out=out", "images");
    ExpectRefused(b, "--input=cell.xyz --out=out", "cell.xyz:2:");
    ExpectRefused(b, "--alpha=1.5 --out=out", "--alpha=1.5");
    ExpectRefused(b, "--particles=0 --out=out", "particles");
    ExpectRefused(b, "--dimension=4 --out=out", "dimension");
    ExpectRefused(b, "--solver=magic --out=out", "unknown solver 'magic'");
    ExpectRefused(
        b, "--solver=ceres_lbfgs:m=3 --out=out", "unknown option 'm'");
    ExpectRefused(b, "--tolerance=0 --out=out", "--tolerance=0");
    ExpectRefused(b, "--tolerance=nan --out=out", "--tolerance");
    ExpectRefused(b, "--particles=many --out=out", "many");
    ExpectRefused(b, "--nonsense=1 --out=out", "nonsense");
    ExpectRefused(b, "stray --out=out", "stray");
    File("occupied", "a file where a folder should be\n");
    ExpectRefused(b, "--particles=8 --out=occupied", "occupied");
    ExpectRefused(b, "--particles=8 --out=occupied/deeper", "occupied");
    ExpectRefused(b, "--particles=8 --input=nan.xyz --out=out", "--particles");
  }
  // A load that makes the packing impossible, a radius that is hardly one, two
  // grains at one place, an empty name, more grains than there is memory for.
  ExpectRefused("relax", "--particles=20 --pure_shear=500 --out=out", "images");
  ExpectRefused(
      "relax", "--particles=20 --radius_factor=1e300 --out=out", "grain");
  File("ratio.xyz",
       std::string("2\n") + kHeader + "A 0.1 0.1 0 5e-324\nA 0.5 0.5 0 0.1\n");
  File("same.xyz",
       std::string("2\n") + kHeader + "A 0.25 0.25 0 0.1\nA 1.25 0.25 0 0.1\n");
  for (const char* binary : {"relax", "jamming"}) {
    ExpectRefused(binary, "--input=ratio.xyz --out=out", "1e9 times smaller");
    ExpectRefused(binary, "--input= --out=out", "--input= is empty");
    ExpectRefused(binary, "--particles=2000000000 --out=out", "must be in [1,");
    ExpectRefused(binary, "--out=", "--out= is empty");
  }
  ExpectRefused("relax",
                "--input=same.xyz --out=out",
                "grains 0 and 1 are at the same place");
  ExpectRefused("relax", "--phi=0 --out=out", "phi");
  ExpectRefused("relax", "--phi=-1 --out=out", "phi");
  ExpectRefused("relax", "--radius_factor=0 --out=out", "--radius_factor=0");
  ExpectRefused("relax", "--pure_shear=-1 --out=out", "--pure_shear=-1");
  ExpectRefused("relax", "--perturb=nan --out=out", "--perturb");
  ExpectRefused("jamming", "--phi_init=-0.5 --out=out", "phi_init");
  ExpectRefused("jamming", "--dphi=0 --out=out", "--dphi=0");
  ExpectRefused("jamming", "--epsilon=0 --out=out", "--epsilon=0");
  ExpectRefused("jamming", "--route=walls --out=out", "--route=walls");
  ExpectRefused("jamming", "--paper --error_bar=1e-9 --out=out", "--error_bar");
}

TEST_F(Cli, ResultsOfTwoRunsAreNeverMixed) {
  ASSERT_EQ(Do("jamming", "--smoke --out=out").status, 0);
  ASSERT_TRUE(Exists(folder_ + "/out/packing.xyz"));
  // Fails, so it has no packing to write; the old one must not stand beside it.
  EXPECT_EQ(Do("jamming", "--smoke --paper --phi_init=1 --out=out").status, 1);
  EXPECT_FALSE(Exists(folder_ + "/out/packing.xyz"));
  EXPECT_TRUE(Exists(folder_ + "/out/summary.json"));
  // Something else in the place of a result is found before the work.
  ASSERT_EQ(mkdir((folder_ + "/blocked").c_str(), 0755), 0);
  ASSERT_EQ(mkdir((folder_ + "/blocked/summary.json").c_str(), 0755), 0);
  const Outcome run = Do("relax", "--particles=16 --phi=0.5 --out=blocked");
  EXPECT_EQ(run.status, 2);
  EXPECT_EQ(Lines(run.err), 1) << run.err;
  EXPECT_FALSE(Exists(folder_ + "/blocked/packing.xyz"));
}

// The error bar decides how far the decompression goes, nothing before it.
TEST_F(Cli, GrowthAndBisectionDoNotDependOnTheErrorBar) {
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

TEST_F(Cli, HelpAndTheListOfSolversExitWithZero) {
  Outcome run = Do("relax", "--help");
  EXPECT_EQ(run.status, 0);
  EXPECT_NE(run.out.find("--absolute_tolerance"), std::string::npos);
  run = Do("jamming", "--list_solvers");
  EXPECT_EQ(run.status, 0);
  EXPECT_NE(run.out.find("ceres_ncg"), std::string::npos);
  EXPECT_FALSE(Exists(folder_ + "/out"));
}

TEST_F(Cli, JammingSmokeRunFindsAnIsostaticState) {
  const Outcome run = Do("jamming", "--smoke --seed=2 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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

TEST_F(Cli, JammingOfAJammedStartSaysSo) {
  const Outcome run =
      Do("jamming", "--paper --particles=64 --phi_init=0.9 --out=out");
  EXPECT_EQ(run.status, 1);
  EXPECT_NE(run.err.find("jammed already at phi_init = 0.9"), std::string::npos)
      << run.err;
}

// A quench above jamming is followed down at once.
TEST_F(Cli, JammingFollowsAJammedStartDown) {
  ASSERT_EQ(Do("jamming", "--smoke --phi_init=0.9 --out=out").status, 0);
  const std::string path = Slurp(folder_ + "/out/path.csv");
  EXPECT_EQ(path.find("growth"), std::string::npos);
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_EQ(json["cycles"], 0);
  // Its result is a start again, taken as it is.
  ASSERT_EQ(Do("jamming",
               "--smoke --input=" + folder_ + "/out/packing.xyz --out=again")
                .status,
            0);
  const auto again =
      nlohmann::json::parse(Slurp(folder_ + "/again/summary.json"));
  EXPECT_NEAR(again["phi_j"].get<double>(),
              json["phi_j"].get<double>(),
              json["phi_j_error"].get<double>());
}

// In units of the radius the cell shrinks as the radii would grow.
TEST_F(Cli, BothRoutesLeadToTheSamePacking) {
  const auto run = [&](const std::string& flags) {
    EXPECT_EQ(Do("jamming", "--smoke --seed=4 --out=out " + flags).status, 0);
    return nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  };
  const auto radii = run("--phi_init=0.86");
  const auto cell = run("--phi_init=0.86 --route=cell");
  EXPECT_NEAR(radii["phi_j"].get<double>(), cell["phi_j"].get<double>(), 1e-12);
  EXPECT_EQ(radii["state"]["contacts"], cell["state"]["contacts"]);
  const std::string packing = Slurp(folder_ + "/out/packing.xyz");
  EXPECT_NE(packing.find("Lattice=\"1.0"), std::string::npos)
      << packing.substr(0, 100);
}

// ---------------------------------------------------------------- compare

std::vector<std::string> Rows(const std::string& csv) {
  std::vector<std::string> rows;
  std::stringstream lines(csv);
  for (std::string line; std::getline(lines, line);) rows.push_back(line);
  return rows;
}

// Fields of a row without quoted ones.
std::vector<std::string> Fields(const std::string& row) {
  std::vector<std::string> fields;
  std::stringstream words(row);
  for (std::string word; std::getline(words, word, ',');)
    fields.push_back(word);
  return fields;
}

const char kTwoMethods[] =
    "--solvers='lb@ceres_lbfgs:scaled=1,differences=1,restarts=10;"
    "cg@ceres_ncg:scaled=1' ";

TEST_F(Cli, CompareWritesEventsRunsAndTables) {
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
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_TRUE(json["converged"].get<bool>());
  EXPECT_EQ(json["runs"].get<int>(), 16);
  EXPECT_FALSE(json["provenance"]["compiler"].get<std::string>().empty());
  EXPECT_NE(run.out.find("16 of 16 runs converged"), std::string::npos);
}

// Of one run: a smaller residual never costs less.
TEST_F(Cli, CompareEventsAreMonotoneInTheLevel) {
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

TEST_F(Cli, CompareCountsAreDeterministicAndPreparedStatesAreUsedAgain) {
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
  run = Do("compare", flags + " --alpha=2.5");
  EXPECT_EQ(run.out.find("(used again)"), std::string::npos) << run.out;
}

TEST_F(Cli, CompareReplotMakesTheSameTables) {
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
  refused("--baseline=x", "no method is labelled 'x'");
  refused("--replot=none", "none/setup.json");
  File("out/events.csv", "case,seed\nx,1\n");
  refused("", "events.csv:1: no column repetition");
}

// Chains of shear steps: 2 distances x 2 strains x 2 steps of one packing.
const char kChain[] =
    "--particles=64 --cases=near_jamming=1e-6,near_jamming=0.3x --steps=2 "
    "--distances=1e-2,1e-3 --repetitions=2 --tolerance=1e-6 "
    "--solvers='lb@lbfgs;fire' ";

TEST_F(Cli, CompareFollowsChainsOfShearSteps) {
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
TEST_F(Cli, CompareResumes) {
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

TEST_F(Cli, CompareNamesWhoLeavesTheBasinInAnyCase) {
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

TEST_F(Cli, CompareShowsAMethodThatFails) {
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
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_FALSE(json["converged"].get<bool>());
  EXPECT_EQ(json["runs_converged"].get<int>(), 2);
}

TEST_F(Cli, CompareStartsFromAnInput) {
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

TEST_F(Cli, ComparePresetsHaveTheLevelsOfThePaper) {
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

TEST_F(Cli, CompareRefusesBadInput) {
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

// ---------------------------------------------------------------- protocols

TEST_F(Cli, CompareWritesProfilesOfThreeProblemsAndMore) {
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

TEST_F(Cli, CompareRunsAlgorithm1WithEachMethod) {
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
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_EQ(json.at("schema"), "granopt/compare-protocol/1");
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

TEST_F(Cli, CompareShearsOnePackingWithEachMethod) {
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

TEST_F(Cli, CompareShowsAProtocolThatFails) {
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

TEST_F(Cli, CompareRefusesBadInputOfProtocols) {
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

TEST_F(Cli, ConditioningSmokeRunAndReplot) {
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
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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

TEST_F(Cli, ConditioningRefusesBadInput) {
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

// Over eight packings the exponents of pressure, bulk modulus, shear modulus
// and coordination are those of the paper (or of the theory, for B).
TEST_F(Cli, ScalingFindsThePapersExponents) {
  const Outcome run = Do("scaling",
                         "--seeds=1-8 --particles=256 --jobs=2 --spectra=1e-2 "
                         "--distances=1e-3,3e-3,1e-2,3e-2 --most_distance=3e-2 "
                         "--out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto summary =
      nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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

TEST_F(Cli, ModuliOfAFileAreReported) {
  const Outcome run = Do("relax",
                         "--input=" GRANOPT_TEST_DATA
                         "/n256_phi0.8438_a2_relaxed.xyz --moduli --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto moduli =
      nlohmann::json::parse(Slurp(folder_ + "/out/summary.json")).at("moduli");
  EXPECT_TRUE(moduli.at("found"));
  EXPECT_NE(run.out.find("G = "), std::string::npos);
  EXPECT_EQ(moduli.at("elastic_tensor").size(), 3u);
  // alpha = d: both bulk moduli are the same.
  EXPECT_NEAR(moduli.at("bulk_growth").get<double>(),
              moduli.at("bulk_box").get<double>(),
              1e-9);
}

TEST_F(Cli, ScalingRefusesBadInput) {
  ExpectRefused("scaling", "--distances=1e-2,x", "--distances");
  ExpectRefused("scaling", "--distances=1e-2,2", "[1e-12, 0.5]");
  ExpectRefused("scaling", "--spectra=1e-5 --distances=1e-2", "--spectra");
  ExpectRefused("scaling", "--seeds=1-2 --alpha=2", "--alphas");
  ExpectRefused("scaling", "--seeds=1-2 --alphas=1", "[2, 100]");
  ExpectRefused("scaling", "--jobs=2", "--seeds");
  ExpectRefused("scaling", "--solver=nonsense", "--solver");
  EXPECT_FALSE(Exists(folder_ + "/out"));
}

TEST_F(Cli, FlowRunsAndItsLedgerCloses) {
  const Outcome run = Do("flow", "--duration=0.3 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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
TEST_F(Cli, FlowGoesOnFromItsFrames) {
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

TEST_F(Cli, FlowResumesToTheSameBits) {
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

TEST_F(Cli, FlowRefusesInOneLine) {
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

TEST_F(Cli, FlowSaysWhyItStopped) {
  const Outcome run =
      Do("flow", "--alpha1=5 --alpha2=0 --contacts=none --out=out");
  EXPECT_EQ(run.status, 1);
  EXPECT_EQ(run.err.find("flow: collapse at t = "), 0u) << run.err;
  EXPECT_EQ(Lines(run.err), 1) << run.err;
  // Those of the step that was the last one are in there, too.
  const int rows = Lines(Slurp(folder_ + "/out/rejections.csv")) - 1;
  EXPECT_GT(rows, 1);
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_EQ(json.at("counts").at("rejected_steps"), rows);
}

TEST_F(Cli, FlowPaperAndStudies) {
  const Outcome run = Do("flow", "--paper --smoke --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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

TEST_F(Cli, FlowPaperResumesOnlyWithTheSameGroups) {
  const std::string flags = "--paper --smoke --sweep=groups --out=out";
  ASSERT_EQ(Do("flow", flags).status, 0);
  ASSERT_TRUE(Exists(folder_ + "/out/checkpoint.cbor"));
  const Outcome other = Do("flow", flags + " --groups=2 --resume");
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("begun with groups"), std::string::npos)
      << other.err;
}

// Runs that fail are told in the tables, and spoil no others.
TEST_F(Cli, FlowPaperRecordsWhatFails) {
  // Ways of a thousandth: no step is short enough for ten iterations.
  const Outcome run =
      Do("flow", "--paper --smoke --relaxation=0.001 --out=out");
  EXPECT_EQ(run.status, 1) << run.out << run.err;
  EXPECT_NE(run.out.find("failed: constant_e, alpha1 = 0.5, seed "),
            std::string::npos)
      << run.out;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_GT(json.at("failed").size(), 0u);
  EXPECT_NE(Slurp(folder_ + "/out/runs.csv").find("step floor"),
            std::string::npos);
}

TEST_F(Cli, FlowResumesWithTheSameCounts) {
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

TEST_F(Cli, FlowStartsFromAFile) {
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

TEST_F(Cli, TradeoffOfFlowsNamesTheCheapestWay) {
  const std::string flags =
      "--flow --smoke --flow_scenes=smooth,many --out=out";
  const Outcome run = Do("tradeoff", flags + " --jobs=2");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_NE(run.out.find("for this accuracy use this"), std::string::npos);
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_EQ(json.at("schema"), "granopt/tradeoff_flow/1");
  int verlet = 0, found = 0;
  for (const auto& best : json.at("recommendations")) {
    EXPECT_LE(best.at("error").get<double>(),
              best.at("accuracy").get<double>());
    if (best.at("scene") != "smooth") continue;
    ++found;
    verlet +=
        best.at("flags").get<std::string>().find("verlet") != std::string::npos;
  }
  EXPECT_GT(found, 10);
  EXPECT_EQ(verlet, found);
  // Steps half as long have smaller errors, until the exact flow is not known
  // any better.
  const std::vector<std::string> rows =
      Rows(Slurp(folder_ + "/out/tradeoff_flow.csv"));
  EXPECT_EQ(rows.size(), 1u + 66 + 14);
  // All of it is there: nothing is run again, and numbers stay what they are.
  const std::string csv = Slurp(folder_ + "/out/tradeoff_flow.csv");
  const Outcome again = Do("tradeoff", flags + " --resume");
  ASSERT_EQ(again.status, 0) << again.out << again.err;
  EXPECT_NE(again.out.find("3 of them complete, not run again"),
            std::string::npos)
      << again.out;
  EXPECT_EQ(Slurp(folder_ + "/out/tradeoff_flow.csv"), csv);
}

TEST_F(Cli, TradeoffRecommendsFlagsThatFlowTakes) {
  const std::string scene =
      "--alpha1=0.1 --alpha2=0.05 --contacts=none "
      "--domain=open --particles=20 --duration=0.1 ";
  const Outcome run = Do("tradeoff",
                         scene +
                             "--flow --recommend --smoke --seeds=1 "
                             "--accuracy=1e-3 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
  const std::string flags = json.at("recommended");
  EXPECT_NE(run.out.find("use  " + flags), std::string::npos) << run.out;
  EXPECT_EQ(Do("flow", scene + flags + " --out=flow").status, 0);
}

// Nothing moves, so that nothing is relative to anything.
TEST_F(Cli, TradeoffOfFlowsTakesGrainsAtRest) {
  const Outcome run =
      Do("tradeoff",
         "--flow --smoke --seeds=1 --law=none --mean_velocity=0,0,0 "
         "--perturbation=0,0,0 --particles=4 --duration=0.02 "
         "--max_seconds=0.1 --out=out");
  EXPECT_EQ(run.status, 0) << run.out << run.err;
}

TEST_F(Cli, TradeoffOfFlowsRefusesInOneLine) {
  const struct {
    const char* arguments;
    const char* words;
  } cases[] = {{"--alpha1=0.1", "--alpha1 describes a flow: give --flow, too"},
               {"--jobs=2", "--jobs needs --flow"},
               {"--flow --phi=0.9", "--phi cannot go with --flow"},
               {"--flow --dt=0.1", "--dt is what --flow varies"},
               {"--flow --observable=pressure", "is none of kinetic"},
               {"--flow --flow_scenes=sand", "'sand' is none of smooth"},
               {"--flow --flow_scenes=paper --alpha1=0.1",
                "--flow_scenes does not name"},
               {"--flow --recommend --mu_d=0.3", "mu_d = 0.3 > mu_s = 0.2"}};
  for (const auto& c : cases) {
    ExpectRefused("tradeoff", std::string(c.arguments) + " --out=out", c.words);
  }
}

// ---- shear

TEST_F(Cli, ShearDrawsTheCurvesOfFigure8) {
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
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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

TEST_F(Cli, ShearLocatesPlasticEvents) {
  const Outcome run =
      Do("shear", "--particles=256 --seed=1 --strain=0.01 --events --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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
TEST_F(Cli, ShearResumes) {
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
TEST_F(Cli, OtherShearsResume) {
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
TEST_F(Cli, ShearByStressFindsTheYieldStress) {
  const Outcome run = Do("shear",
                         "--particles=64 --phi=0.9 --mode=stress "
                         "--shear_stress=0.1 --stress_steps=8 --out=sheared");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json =
      nlohmann::json::parse(Slurp(folder_ + "/sheared/summary.json"));
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

TEST_F(Cli, ShearAveragesOverSeeds) {
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

TEST_F(Cli, ShearServesAnyStrainPressuresCyclesAndWalls) {
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
    const auto json =
        nlohmann::json::parse(Slurp(folder_ + "/wall/summary.json"));
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
TEST_F(Cli, ShearComparesMotionWithMinimization) {
  const Outcome run =
      Do("shear",
         "--dynamics --particles=64 --strain=1e-5 --increments=1e-6 "
         "--tolerance=1e-6 --seeds=1,2 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
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

TEST_F(Cli, ShearRefusesBadInput) {
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

// No method claims what is not so, whatever the extreme.
TEST_F(Cli, ExtremesClaimNothingWrong) {
  for (const char* kind : {"", "--flow "}) {
    const Outcome run =
        Do("extremes", std::string(kind) + "--smoke --jobs=2 --out=good");
    EXPECT_EQ(run.status, 0) << run.out << run.err;
    const auto summary =
        nlohmann::json::parse(Slurp(folder_ + "/good/summary.json"));
    EXPECT_EQ(summary.at("cells").at("wrong"), 0) << run.out;
    EXPECT_EQ(summary.at("cells").at("lost"), 0) << run.out;
    EXPECT_GT(summary.at("cells").at("passed"), 5) << run.out;
    EXPECT_GT(summary.at("cells").at("refused"), 2) << run.out;
  }
  ExpectRefused("extremes", "--only=nothing", "unknown extreme");
  ExpectRefused("extremes", "--extreme=overflow --solver=fire", "other units");
}

TEST_F(Cli, TradeoffMeasuresErrorsThatFallWithTheTolerance) {
  const Outcome run = Do("tradeoff",
                         "--smoke --particles=128 --solvers=\"lbfgs;newton\" "
                         "--precisions=double --out=good");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  std::istringstream csv(Slurp(folder_ + "/good/tradeoff.csv"));
  std::string line;
  std::getline(csv, line);
  std::map<std::string, double> last;
  int rows = 0;
  while (std::getline(csv, line)) {
    std::vector<std::string> fields;
    std::istringstream parts(line);
    for (std::string field; std::getline(parts, field, ',');) {
      fields.push_back(field);
    }
    ASSERT_EQ(fields.size(), 16u) << line;
    if (fields[6] != "1") continue;
    const std::string run_of = fields[0] + fields[2];
    const double error = std::stod(fields[11]);  // of the pressure
    if (last.count(run_of) > 0) {
      EXPECT_LE(error, last[run_of]) << line;
    }
    last[run_of] = error;
    ++rows;
  }
  EXPECT_GE(rows, 40);
  for (const auto& [name, error] : last) EXPECT_LE(error, 1e-12) << name;

  const Outcome advice =
      Do("tradeoff",
         "--input=" GRANOPT_TEST_DATA
         "/n256_phi0.8438_a2_relaxed.xyz --case=simple_shear=1e-4 "
         "--recommend --accuracy=1e-6 --solvers=\"lbfgs;newton\" --out=good");
  ASSERT_EQ(advice.status, 0) << advice.out << advice.err;
  const auto summary =
      nlohmann::json::parse(Slurp(folder_ + "/good/summary.json"));
  // The flags are those of relax.
  const Outcome relax =
      Do("relax",
         "--input=" GRANOPT_TEST_DATA
         "/n256_phi0.8438_a2_relaxed.xyz --simple_shear=1e-4 --out=relaxed " +
             summary.at("recommended").get<std::string>());
  EXPECT_EQ(relax.status, 0) << relax.err;
  ExpectRefused("tradeoff", "--case=random=1e-4", "--input");
  ExpectRefused("tradeoff", "--observable=colour", "--observable");
  ExpectRefused("tradeoff", "--precisions=half", "--precisions");
}

TEST_F(Cli, FidelityComparesModelsOnTheSameStarts) {
  const Outcome run = Do("fidelity", "--smoke --scene=powder --out=good");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto summary =
      nlohmann::json::parse(Slurp(folder_ + "/good/summary.json"));
  ASSERT_EQ(summary.at("models").size(), 11u);
  // Nothing that is there costs less than nothing, and grains that do not touch
  // dissipate nothing.
  const auto& free_flight = summary.at("models")[0];
  EXPECT_EQ(free_flight.at("dissipated").at("mean"), 0.0);
  EXPECT_EQ(summary.at("models")[5].at("T").at("difference"), 0.0);
  ASSERT_EQ(Do("fidelity", "--smoke --scene=packing --out=good").status, 0);
  ExpectRefused("fidelity", "--scene=soup", "--scene");
  ExpectRefused("fidelity", "--observables=taste", "--observables");
}

}  // namespace
}  // namespace granopt
