// The binary `identify` as a user runs it.

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

#include "gtest/gtest.h"
#include "nlohmann/json.hpp"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Json = nlohmann::json;

class Identify : public Binaries {
 protected:
  Outcome Do(const std::string& arguments) {
    return Binaries::Do("identify", "--smoke " + arguments);
  }
  Json Summary(const std::string& folder) {
    return Json::parse(Slurp(folder_ + "/" + folder + "/summary.json"));
  }
  void ExpectSame(const std::string& a, const std::string& b) {
    for (const char* file : {"strings_evaluated.csv",
                             "history.csv",
                             "fresh.csv",
                             "response.csv",
                             "best_final.xyz"}) {
      EXPECT_FALSE(Slurp(folder_ + "/" + a + "/" + file).empty()) << file;
      EXPECT_EQ(Slurp(folder_ + "/" + a + "/" + file),
                Slurp(folder_ + "/" + b + "/" + file))
          << file;
    }
  }
};

TEST_F(Identify, ThreadsDoNotMatter) {
  ASSERT_EQ(Do("--out=one").status, 0);
  const Outcome run = Do("--threads=3 --out=three");
  ASSERT_EQ(run.status, 0) << run.err;
  ExpectSame("one", "three");
  const Json json = Summary("one");
  EXPECT_EQ(json.at("schema"), "granopt/identify/1");
  // 8 + 2 (2 + 4) + 7 + 6 of the smoke size.
  EXPECT_EQ(json.at("strings"), 33);
  EXPECT_GE(json.at("runs").get<int>(), 5 * 33);
}

TEST_F(Identify, ResumesToTheSameBits) {
  ASSERT_EQ(Do("--out=whole").status, 0);
  ASSERT_EQ(Interrupt("identify", "--smoke", "cut"), 1);
  EXPECT_FALSE(Exists(folder_ + "/cut/summary.json"));
  const Outcome run = Do("--resume --out=cut");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_NE(run.out.find("resumed after "), std::string::npos) << run.out;
  ExpectSame("whole", "cut");
  // A search that is done gets a profile without running again.
  const Outcome more = Do("--resume --profile --out=cut");
  ASSERT_EQ(more.status, 0) << more.err;
  EXPECT_NE(more.out.find("resumed after "), std::string::npos) << more.out;
  EXPECT_TRUE(Exists(folder_ + "/cut/profile.csv"));
  const Outcome other = Do("--resume --mu_s=0.3 --out=cut");
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("begun with mu_s"), std::string::npos) << other.err;
}

// Two processes evaluate what a third asks for: the same bits as one.
TEST_F(Identify, WorkersGiveTheSameBits) {
  ASSERT_EQ(Do("--out=one").status, 0);
  int rounds = 0;
  Outcome run;
  while ((run = Do("--external --out=many")).status == 1 && rounds < 10) {
    ++rounds;
    ASSERT_TRUE(Exists(folder_ + "/many/strings.csv")) << run.err;
    const std::string both =
        "cd '" + folder_ +
        "' && for k in 1 2; do " GRANOPT_BINARIES
        "/identify --nopictures --smoke --worker --strings=many/strings.csv "
        "--share=$k/2 --out=many > worker$k.txt 2>&1 & done; wait";
    ASSERT_EQ(std::system(both.c_str()), 0);
    EXPECT_NE(Slurp(folder_ + "/worker2.txt").find("share 2 of 2"),
              std::string::npos)
        << Slurp(folder_ + "/worker2.txt");
  }
  ASSERT_EQ(run.status, 0) << run.err;
  // A population, four generations, fresh starts, confirmation.
  EXPECT_EQ(rounds, 7);
  ExpectSame("one", "many");
  EXPECT_FALSE(Exists(folder_ + "/many/strings.csv"));
  // Strings that were asked for with other flags.
  Do("--external --mu_s=0.3 --out=other");
  const Outcome worker = Do("--worker --strings=other/strings.csv --out=other");
  EXPECT_EQ(worker.status, 2);
  EXPECT_NE(worker.err.find("asked for with other flags"), std::string::npos)
      << worker.err;
}

// A share that does not come (a machine that failed) is asked for again, and
// what the other one found is kept.
TEST_F(Identify, SharesMayBeMissing) {
  ASSERT_EQ(Do("--out=one").status, 0);
  int rounds = 0;
  Outcome run;
  while ((run = Do("--external --out=many")).status == 1 && rounds < 20) {
    const std::string worker =
        "--worker --strings=many/strings.csv --out=many --share=";
    ASSERT_EQ(Do(worker + "1/2").status, 0);
    // The third list's second share is lost, and that of what is left of it.
    if (rounds != 2 && rounds != 3) {
      ASSERT_EQ(Do(worker + "2/2").status, 0);
    }
    ++rounds;
  }
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_EQ(rounds, 9);
  ExpectSame("one", "many");
}

// Methods of other packages keep things of the whole process.
TEST_F(Identify, ThreadsMinimizeOneByOne) {
  if (Execute(GRANOPT_BINARIES "/relax --list_solvers | grep -q ^tao_lmvm") !=
      0) {
    GTEST_SKIP() << "built without PETSc";
  }
  const std::string arguments =
      "--stepper=minimize --solver=tao_lmvm --particles=8 --duration=0.05 "
      "--method=random_search:strings=8 --fresh=4 --out=";
  ASSERT_EQ(Do(arguments + "one").status, 0);
  const Outcome run = Do("--threads=4 " + arguments + "four");
  ASSERT_EQ(run.status, 0) << run.err;
  ExpectSame("one", "four");
}

// The genetic algorithm's one list has more runs than all that gradients were
// to share with it: none is left for them.
TEST_F(Identify, GradientsHaveABudget) {
  const Outcome run = Do("--alternatives --budget=2 --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const std::string strings = Slurp(folder_ + "/out/strings_evaluated.csv");
  EXPECT_NE(strings.find("\nalternative_1_0,"), std::string::npos);
  EXPECT_EQ(strings.find("_gradient,"), std::string::npos);
}

// Interrupted while the target of a recovery is made.
TEST_F(Identify, AStopIsNoFailureOfTheKnown) {
  const std::string command =
      "{ exec " GRANOPT_BINARIES
      "/identify --nopictures --recover=0.3,0.7,0.25,1.6 --particles=100 "
      "--duration=3 --out=out > out.txt 2> err.txt; } & pid=$!; while ! grep "
      "-q 'target: what' out.txt && kill -0 $pid; do sleep 0.01; done; kill "
      "-INT $pid; wait $pid";
  EXPECT_EQ(Execute(command), 1);
  EXPECT_EQ(Slurp(folder_ + "/err.txt"), "");
  EXPECT_NE(Slurp(folder_ + "/out.txt").find("stopped as asked"),
            std::string::npos);
}

// Another file under the same name is another flow.
TEST_F(Identify, StartsOfAFileAreItsText) {
  const auto write = [&](const std::string& radius) {
    std::ofstream(folder_ + "/start.xyz")
        << "2\nLattice=\"1 0 0 0 1 0 0 0 1\" "
           "Properties=species:S:1:pos:R:3:radius:R:1 pbc=\"T T T\"\n"
           "A 0.3 0.5 0.5 0.1\nA 0.7 0.5 0.5 "
        << radius << "\n";
  };
  write("0.1");
  const std::string asks = "--input=start.xyz --external --out=more";
  ASSERT_EQ(Do(asks).status, 1);
  ASSERT_EQ(Do(asks).status, 1);
  write("0.11");
  Outcome run = Do(asks);
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.err.find("begun with input = "), std::string::npos) << run.err;
  run =
      Do("--input=start.xyz --worker --strings=more/strings.csv --out=worker");
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.err.find("asked for with other flags"), std::string::npos)
      << run.err;
}

// A flow that takes too many steps has no value.
TEST_F(Identify, StepsOfAFlowHaveALimit) {
  const Outcome run =
      Do("--most_steps=3 --method=random_search:strings=2 --out=out");
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.err.find("every flow failed"), std::string::npos) << run.err;
}

// A target with errors: only their ratios matter, and the distance from it is
// told in them.
TEST_F(Identify, TargetsMayHaveErrors) {
  const std::string signal =
      "time,T,T_b,T_r,T_error,T_b_error,T_r_error\n0,1,0.5,0.5,";
  std::ofstream(folder_ + "/one.csv")
      << signal << "0.1,0.1,0.1\n0.2,1,0.5,0.5,0.1,0.05,0.2\n";
  std::ofstream(folder_ + "/two.csv")
      << signal << "0.2,0.2,0.2\n0.2,1,0.5,0.5,0.2,0.1,0.4\n";
  std::ofstream(folder_ + "/none.csv")
      << "time,T,T_b,T_r\n0,1,0.5,0.5\n0.2,1,0.5,0.5\n";
  for (const char* name : {"one", "two", "none"}) {
    const Outcome run =
        Do("--method=random_search:strings=8 --target=" + std::string(name) +
           ".csv --out=" + name);
    ASSERT_EQ(run.status, 0) << run.err;
    EXPECT_EQ(run.out.find("in its errors") != std::string::npos,
              name != std::string("none"));
  }
  ExpectSame("one", "two");
  EXPECT_NE(Slurp(folder_ + "/one/fresh.csv"),
            Slurp(folder_ + "/none/fresh.csv"));
  const Json one = Summary("one").at("best").at("errors_of_target");
  const Json two = Summary("two").at("best").at("errors_of_target");
  for (const char* energy : {"T", "T_b", "T_r"}) {
    EXPECT_GT(one.at(energy).get<double>(), 0.0);
    EXPECT_EQ(one.at(energy).get<double>(), 2.0 * two.at(energy).get<double>());
  }
  EXPECT_FALSE(Summary("none").at("best").contains("errors_of_target"));
}

// The first value that a profile holds is no flow (mu_s < mu_d); the best is
// compared on as many starts as if it were.
TEST_F(Identify, ProfilesMayBeginWithAFailure) {
  const Outcome run = Do("--search=mu_s:0.05:0.5 --profile --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_NE(run.out.find("one parameter fixed, 6 starts"), std::string::npos)
      << run.out;
}

// The strength that made a flow is found again. The known one has a misfit,
// too: starts scatter about their mean.
TEST_F(Identify, RecoversAKnownParameter) {
  const Outcome run =
      Do("--search=alpha1:0:1 --beta1=1 --alpha2=0.25 --beta2=2 --recover=0.3 "
         "--particles=40 --duration=0.4 --fresh=20 --out=out "
         "--method=genetic_algorithm:population=12,generations=10,restart=4,"
         "parents=4");
  ASSERT_EQ(run.status, 0) << run.err;
  const Json json = Summary("out");
  EXPECT_NEAR(
      json.at("best").at("string").at("alpha1").get<double>(), 0.3, 0.1);
  double known = -1.0;
  for (const Json& c : json.at("candidates")) {
    if (c.at("origin") == "known") known = c.at("fresh");
  }
  ASSERT_GT(known, 0.0);
  EXPECT_LT(json.at("best").at("fresh").get<double>(), 1.5 * known);
}

TEST_F(Identify, RefusesInOneLine) {
  std::ofstream(folder_ + "/bad.csv") << "time,T,T_b,T_r\n0,1,1,1\n1,1,x,1\n";
  const struct {
    const char* arguments;
    const char* words;
  } cases[] = {
      {"--search=alpha1", "--search: 'alpha1' is not name:low:high"},
      {"--search=foo:0:1", "'foo' is not a flag of a flow"},
      {"--search=particles:1:5", "'particles' is not a flag of a flow"},
      {"--search=duration:0.1:1", "'duration'"},
      {"--alpha1=0.3", "--alpha1 is searched"},
      {"--method=foo", "--method: unknown search 'foo'"},
      {"--ensemble=foo", "--ensemble=foo must be"},
      {"--weights=1,2", "--weights=1,2 must be three numbers"},
      {"--target_energies=1,0,1", "0 cannot be divided by"},
      {"--target=missing.csv", "--target: "},
      {"--target=bad.csv", "bad.csv:3: T_b: 'x' is not a number"},
      {"--recover=1,2", "2 values for 4 parameters"},
      {"--worker", "--worker needs --strings"},
      {"--worker --strings=bad.csv", "no column setup"},
      {"--share=1/2", "--share is of --worker"},
      {"--worker --strings=bad.csv --share=3/2", "--share=3/2 must be"},
      {"--external --recover=1,1,1,1", "--external cannot go with"},
      {"--paper --search=alpha1:0:1", "--search cannot go with --paper"},
      {"--restitution=2", "restitution e = 2 must be in"},
      {"--threads=0", "--threads=0 must be in"}};
  for (const auto& c : cases) {
    const Outcome run = Do(std::string(c.arguments) + " --out=out");
    EXPECT_EQ(run.status, 2) << c.arguments;
    EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
    EXPECT_NE(run.err.find(c.words), std::string::npos)
        << c.arguments << "\n got: " << run.err;
    EXPECT_FALSE(Exists(folder_ + "/out")) << c.arguments;
  }
}

TEST_F(Identify, PaperAtSmokeSize) {
  const Outcome run = Do("--paper --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const Json json = Summary("out");
  int table = 0;
  for (const Json& c : json.at("candidates")) {
    table += c.at("origin").get<std::string>().rfind("Table 1", 0) == 0;
  }
  EXPECT_EQ(table, 6);
  EXPECT_GE(json.at("alternatives").size(), 3u);
  EXPECT_TRUE(json.at("recovery").at("best").at("fresh").is_number());
  for (const char* file : {"profile.csv", "alternatives.csv", "recovery.csv"}) {
    EXPECT_TRUE(Exists(folder_ + "/out/" + file)) << file;
  }
}

}  // namespace
}  // namespace granopt
