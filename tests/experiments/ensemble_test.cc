// Ensembles: their statistics, their processes, and `jamming --seeds` as a user
// runs it.

#include "experiments/ensemble.h"

#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <string>
#include <vector>

#include "experiments/distributions.h"
#include "experiments/jobs.h"
#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

class Folder : public Binaries {};

// ---- statistics

Member MakeMember(int particles, double phi_j, int excess, bool converged) {
  Member m;
  m.particles = particles;
  m.complete = true;
  m.converged = converged;
  m.phi_j = phi_j;
  m.error = 1e-9 * phi_j;
  m.excess_contacts = excess;
  m.rattlers = particles / 8;
  m.certificate = converged ? "strict minimum" : "not stationary";
  m.seconds = phi_j;
  return m;
}

TEST(Ensemble, StatisticsAreThoseOfTheClosedForm) {
  std::vector<Member> members = {MakeMember(64, 0.83, 0, true),
                                 MakeMember(64, 0.84, 1, true),
                                 MakeMember(64, 0.86, 0, false),
                                 MakeMember(128, 0.5, 0, true)};
  Member failed;
  failed.particles = 64;
  members.push_back(failed);
  const SizeStatistics s = Summarize(members, 64);
  EXPECT_EQ(s.asked, 4);
  EXPECT_EQ(s.complete, 3);
  EXPECT_EQ(s.converged, 2);
  EXPECT_EQ(s.isostatic, 2);
  EXPECT_EQ(s.certified, 2);
  const double mean = 2.53 / 3.0;
  EXPECT_NEAR(s.mean, mean, 1e-15);
  const double deviation =
      std::sqrt((std::pow(0.83 - mean, 2) + std::pow(0.84 - mean, 2) +
                 std::pow(0.86 - mean, 2)) /
                2.0);
  EXPECT_NEAR(s.deviation, deviation, 1e-15);
  EXPECT_NEAR(s.standard_error, deviation / std::sqrt(3.0), 1e-15);
  EXPECT_EQ(s.least, 0.83);
  EXPECT_EQ(s.most, 0.86);
  EXPECT_EQ(s.largest_error, 1e-9 * 0.86);
  EXPECT_EQ(s.rattlers, 0.125);
  EXPECT_EQ(s.median_seconds, 0.84);
  // One has no deviation, none has nothing.
  EXPECT_EQ(Summarize(members, 128).deviation, 0.0);
  EXPECT_EQ(Summarize(members, 256).complete, 0);
  EXPECT_EQ(Summarize(members, 256).mean, 0.0);
}

TEST(Ensemble, TheFiniteSizeFitFindsItsOwnLaw) {
  std::vector<SizeStatistics> sizes;
  for (const int n : {64, 128, 256, 1024}) {
    SizeStatistics s;
    s.particles = n;
    s.complete = 20;
    s.mean = 0.8418 - 0.3 * std::pow(n, -0.7);
    s.standard_error = 1e-4 * std::sqrt(64.0 / n);
    sizes.push_back(s);
  }
  // Without a standard error, it does not count.
  SizeStatistics single;
  single.particles = 32;
  single.complete = 1;
  single.mean = 0.1;
  sizes.push_back(single);
  const LineFit fit = FitFiniteSize(sizes, 0.7);
  EXPECT_EQ(fit.n, 4);
  EXPECT_NEAR(fit.a, 0.8418, 1e-13);
  EXPECT_NEAR(fit.b, -0.3, 1e-11);
  EXPECT_GT(fit.a_error, 1e-5);
  EXPECT_LT(fit.a_error, 1e-4);
  EXPECT_EQ(FitFiniteSize({sizes[0], single}, 0.7).n, 0);
}

TEST(Ensemble, FitsOfPackingsTogetherAreThoseOfTheirSamples) {
  PackingSamples one, two;
  one.particles = 2000;
  two.particles = 1000;
  for (int i = 0; i < 400; ++i) {
    const double u = (i + 0.5) / 400;
    auto& p = i % 2 == 0 ? one : two;
    p.samples.localized.push_back(std::pow(u, 1.0 / 1.2));
    p.samples.extended.push_back(std::pow(u, 1.0 / 1.4));
    p.samples.gaps.push_back(0.1 * std::pow(u, 1.0 / 0.6));
  }
  one.samples.mean_overlap = 1e-9;
  const DistributionFits fits = FitDistributions({one, two});
  EXPECT_EQ(fits.packings, 2);
  EXPECT_NEAR(fits.localized.exponent, 0.2, 0.06);
  EXPECT_NEAR(fits.extended.exponent, 0.4, 0.06);
  EXPECT_NEAR(fits.gaps.exponent, -0.4, 0.03);
  // The least of 1000 samples, unless the overlaps blur more than that.
  EXPECT_DOUBLE_EQ(fits.gaps.low, std::pow(1000.0, -1.0 / (1.0 - kGamma)));
  EXPECT_DOUBLE_EQ(fits.localized.low,
                   std::pow(1000.0, -1.0 / (1.0 + kThetaLocalized)));
  one.samples.mean_overlap = 1e-5;
  EXPECT_DOUBLE_EQ(FitDistributions({one, two}).gaps.low, 1e-3);
  EXPECT_NEAR(FitsJson(fits).at("gamma").at("exponent"), 0.4, 0.03);
  // Nothing to fit is null, not a number.
  EXPECT_TRUE(FitsJson(FitDistributions({})).at("gamma").is_null());
}

// ---- processes

using Jobs = Folder;

Job Shell(const std::string& command, const std::string& log) {
  Job job;
  job.name = command;
  job.program = "/bin/sh";
  job.arguments = {"sh", "-c", command};
  job.log = log;
  return job;
}

TEST_F(Jobs, EachHasItsOutcomeAndItsLog) {
  std::vector<Job> jobs = {
      Shell("echo out; echo err >&2; exit 3", folder_ + "/a"),
      Shell("kill -9 $$", folder_ + "/b"),
      Shell("cat; echo end", folder_ + "/c"),
      Shell("exit 0", folder_ + "/none/d"),
      Shell("exit 0", folder_ + "/e")};
  jobs[4].program = folder_ + "/none";
  for (const int at_once : {1, 2, 9}) {
    bool interrupted = true;
    int calls = 0;
    const std::vector<JobOutcome> outcomes = RunJobs(
        jobs,
        at_once,
        [&](const JobProgress& p) {
          ++calls;
          EXPECT_LE(p.running, at_once);
          EXPECT_EQ(p.total, 5);
        },
        &interrupted);
    EXPECT_FALSE(interrupted);
    EXPECT_GT(calls, 0);
    ASSERT_EQ(outcomes.size(), 5u);
    EXPECT_EQ(Describe(outcomes[0]), "exit status 3");
    EXPECT_EQ(Describe(outcomes[1]), "killed by signal 9");
    EXPECT_EQ(Describe(outcomes[2]), "exit status 0");
    EXPECT_EQ(Describe(outcomes[3]),
              "cannot be started: No such file or directory");
    EXPECT_EQ(Describe(outcomes[4]),
              "cannot be started: No such file or directory");
    EXPECT_EQ(Slurp(folder_ + "/a"), "out\nerr\n");
    EXPECT_EQ(Slurp(folder_ + "/c"), "end\n");
  }
  bool interrupted;
  EXPECT_TRUE(RunJobs({}, 1, nullptr, &interrupted).empty());
}

TEST_F(Jobs, AnInterruptReachesThemAndStartsNoMore) {
  // The first one cleans up and ends as it likes, the second one dies.
  const std::string trap =
      "trap 'echo cleaned; exit 7' INT; touch ready; while :; do sleep 0.1; "
      "done";
  std::vector<Job> jobs = {
      Shell("cd '" + folder_ + "'; " + trap, folder_ + "/a"),
      Shell("exec sleep 100", folder_ + "/b"),
      Shell("echo never", folder_ + "/c")};
  bool interrupted = false, sent = false;
  const std::vector<JobOutcome> outcomes = RunJobs(
      jobs,
      2,
      [&](const JobProgress&) {
        if (sent || !Exists(folder_ + "/ready")) return;
        sent = true;
        kill(getpid(), SIGINT);
      },
      &interrupted);
  EXPECT_TRUE(interrupted);
  EXPECT_EQ(Describe(outcomes[0]), "exit status 7");
  EXPECT_EQ(Describe(outcomes[1]), "killed by signal 2");
  EXPECT_EQ(Describe(outcomes[2]), "not started");
  EXPECT_EQ(Slurp(folder_ + "/a"), "cleaned\n");
  EXPECT_FALSE(Exists(folder_ + "/c"));
}

// ---- jamming --seeds

class EnsembleCli : public Folder {
 protected:
  int Do(const std::string& arguments) {
    const Outcome run = Binaries::Do("jamming", arguments);
    out_ = run.out;
    err_ = run.err;
    return run.status;
  }

  void ExpectRefused(const std::string& arguments, const std::string& line) {
    EXPECT_EQ(Do(arguments + " --out=out"), 2) << arguments;
    EXPECT_EQ(err_, "jamming: " + line + "\n") << arguments;
    EXPECT_FALSE(Exists(folder_ + "/out")) << arguments;
  }

  // ensemble.csv without its last column, seconds.
  std::string Table(const std::string& out) {
    std::istringstream lines(Slurp(folder_ + "/" + out + "/ensemble.csv"));
    std::string text;
    for (std::string line; std::getline(lines, line);) {
      text += line.substr(0, line.rfind(',')) + "\n";
    }
    return text;
  }

  std::string out_, err_;
};

TEST_F(EnsembleCli, HowManyAtATimeChangesNothing) {
  const std::string arguments = "--seeds=1-3 --sizes=32,48 --smoke ";
  ASSERT_EQ(Do(arguments + "--jobs=1 --out=a"), 0) << err_;
  ASSERT_EQ(Do(arguments + "--jobs=3 --out=b"), 0) << err_;
  EXPECT_EQ(Table("a"), Table("b"));
  EXPECT_NE(Table("a").find("\n48,3,0."), std::string::npos) << Table("a");
  for (const char* file :
       {"sizes.csv", "forces.csv", "gaps.csv", "distributions.csv"}) {
    const std::string path = std::string("/") + file;
    EXPECT_EQ(Slurp(folder_ + "/a" + path), Slurp(folder_ + "/b" + path))
        << file;
    EXPECT_FALSE(Slurp(folder_ + "/a" + path).empty()) << file;
  }
  // A run by itself is the same run.
  ASSERT_EQ(Do("--seed=2 --particles=48 --smoke --out=c"), 0) << err_;
  EXPECT_EQ(Slurp(folder_ + "/c/packing.xyz"),
            Slurp(folder_ + "/a/n48_seed2/packing.xyz"));
  const Json json = Json::parse(Slurp(folder_ + "/a/summary.json"));
  EXPECT_EQ(json.at("schema"), "granopt/jamming_ensemble/1");
  EXPECT_EQ(json.at("sizes").size(), 2u);
  EXPECT_EQ(json.at("sizes")[0].at("converged"), 3);
  EXPECT_TRUE(json.at("failures").empty());
  EXPECT_GT(json.at("finite_size").at("phi_infinity"), 0.8);
  EXPECT_TRUE(Exists(folder_ + "/a/n32_seed1/log.txt"));
}

TEST_F(EnsembleCli, ASizeMayTakeTheFirstSeedsOnly) {
  ASSERT_EQ(Do("--smoke --out=out --seeds=4-6 --sizes=32,40x1"), 0) << err_;
  const std::string csv = Slurp(folder_ + "/out/ensemble.csv");
  EXPECT_NE(csv.find("\n32,6,"), std::string::npos) << csv;
  EXPECT_NE(csv.find("\n40,4,"), std::string::npos) << csv;
  EXPECT_EQ(csv.find("\n40,5,"), std::string::npos) << csv;
}

TEST_F(EnsembleCli, ResumeRunsWhatIsMissing) {
  const std::string arguments = "--smoke --particles=32 --out=out ";
  ASSERT_EQ(Do(arguments + "--seeds=1,2"), 0) << err_;
  const std::string first = Slurp(folder_ + "/out/ensemble.csv");
  ASSERT_EQ(Do(arguments + "--seeds=1-3 --resume"), 0) << err_;
  EXPECT_NE(out_.find("2 of them complete, not run again"), std::string::npos)
      << out_;
  const std::string second = Slurp(folder_ + "/out/ensemble.csv");
  // Seconds included.
  EXPECT_EQ(second.substr(0, first.size()), first);
  EXPECT_NE(second.find("\n32,3,"), std::string::npos);
  // With another flag all are others.
  ASSERT_EQ(Do(arguments + "--seeds=1-3 --resume --dphi=4e-3"), 0) << err_;
  EXPECT_EQ(out_.find("not run again"), std::string::npos) << out_;
}

TEST_F(EnsembleCli, APackingThatCannotBeReadIsNamed) {
  const std::string arguments = "--smoke --particles=32 --seeds=1,2 --out=out ";
  ASSERT_EQ(Do(arguments), 0) << err_;
  ASSERT_EQ(
      Execute("truncate -s 100 '" + folder_ + "/out/n32_seed2/packing.xyz'"),
      0);
  ASSERT_EQ(Do(arguments + "--resume"), 0) << err_;
  const Json json = Json::parse(Slurp(folder_ + "/out/summary.json"));
  EXPECT_EQ(json.at("sizes")[0].at("complete"), 2);
  EXPECT_EQ(json.at("sizes")[0].at("distributions").at("packings"), 1);
  ASSERT_EQ(json.at("failures").size(), 1u);
  EXPECT_EQ(json.at("failures")[0].at("run"), "n32_seed2");
}

TEST_F(EnsembleCli, AFailureIsNamedAndStopsNoOther) {
  ASSERT_EQ(
      std::system(
          ("mkdir -p '" + folder_ + "/out/n32_seed2/packing.xyz'").c_str()),
      0);
  EXPECT_EQ(Do("--smoke --particles=32 --seeds=1-3 --jobs=2 --out=out"), 1);
  EXPECT_EQ(
      err_.rfind("jamming: n32_seed2: exit status 2: jamming: --out: ", 0), 0u)
      << err_;
  EXPECT_NE(Table("out").find("\n32,1,"), std::string::npos);
  EXPECT_EQ(Table("out").find("\n32,2,"), std::string::npos);
  EXPECT_NE(Table("out").find("\n32,3,"), std::string::npos);
  const Json json = Json::parse(Slurp(folder_ + "/out/summary.json"));
  ASSERT_EQ(json.at("failures").size(), 1u);
  EXPECT_EQ(json.at("failures")[0].at("run"), "n32_seed2");
}

TEST_F(EnsembleCli, BadInputIsOneLineAndLeavesNothing) {
  ExpectRefused("--seeds=3-1",
                "--seeds: '3-1' is no seed and no range of seeds like 1-3");
  ExpectRefused("--seeds=",
                "--seeds: '' is no seed and no range of seeds like "
                "1-3");
  ExpectRefused("--seeds=1-3 --seed=2",
                "--seed and --seeds exclude each other");
  ExpectRefused("--seeds=1-3 --jobs=0", "--jobs=0 must be in [1, 1024]");
  ExpectRefused("--sizes=32", "--sizes needs --seeds");
  ExpectRefused("--jobs=2", "--jobs needs --seeds");
  ExpectRefused("--seeds=1-3 --sizes=32 --particles=32",
                "--particles and --sizes exclude each other");
  ExpectRefused("--seeds=1-3 --sizes=32x4",
                "--sizes: 32x4: after the x belongs how many of the 3 seeds");
  ExpectRefused("--seeds=1-3 --sizes=32x",
                "--sizes: 32x: after the x belongs how many of the 3 seeds");
  ExpectRefused("--seeds=1-3 --sizes=32.5",
                "--sizes: 32.5 is no number of grains in [1, 10000000]");
  ExpectRefused("--seeds=1-3 --input=x.xyz",
                "--seeds describes random starts and cannot go with --input");
  // What children would refuse, too.
  ExpectRefused("--seeds=1-3 --dphi=0", "--dphi=0 must be positive");
  ExpectRefused("--seeds=1-3 --particles=0",
                "--particles = 0 must be in [1, 33554431]");
}

}  // namespace
}  // namespace granopt
