// `tradeoff` as a user runs it.

#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Tradeoff = Binaries;

TEST_F(Tradeoff, OfFlowsNamesTheCheapestWay) {
  const std::string flags =
      "--flow --smoke --flow_scenes=smooth,many --out=out";
  const Outcome run = Do("tradeoff", flags + " --jobs=2");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_NE(run.out.find("for this accuracy use this"), std::string::npos);
  const auto json = Summary("out");
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

TEST_F(Tradeoff, RecommendsFlagsThatFlowTakes) {
  const std::string scene =
      "--alpha1=0.1 --alpha2=0.05 --contacts=none "
      "--domain=open --particles=20 --duration=0.1 ";
  const Outcome run = Do("tradeoff",
                         scene +
                             "--flow --recommend --smoke --seeds=1 "
                             "--accuracy=1e-3 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("out");
  const std::string flags = json.at("recommended");
  EXPECT_NE(run.out.find("use  " + flags), std::string::npos) << run.out;
  EXPECT_EQ(Do("flow", scene + flags + " --out=flow").status, 0);
}

// Nothing moves, so that nothing is relative to anything.
TEST_F(Tradeoff, OfFlowsTakesGrainsAtRest) {
  const Outcome run =
      Do("tradeoff",
         "--flow --smoke --seeds=1 --law=none --mean_velocity=0,0,0 "
         "--perturbation=0,0,0 --particles=4 --duration=0.02 "
         "--max_seconds=0.1 --out=out");
  EXPECT_EQ(run.status, 0) << run.out << run.err;
}

TEST_F(Tradeoff, OfFlowsRefusesInOneLine) {
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

TEST_F(Tradeoff, MeasuresErrorsThatFallWithTheTolerance) {
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
  const auto summary = Summary("good");
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

}  // namespace
}  // namespace granopt
