// `relax` as a user runs it: good input, bad input, exit statuses, files.

#include <string>

#include "granular/packing_io.h"
#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Relax = Binaries;

const char kHeader[] =
    "Lattice=\"1 0 0 0 1 0 0 0 1\" Properties=species:S:1:pos:R:3:radius:R:1 "
    "pbc=\"T T F\"\n";

TEST_F(Relax, ResultsAreCertified) {
  const std::string input =
      "--input=" GRANOPT_TEST_DATA "/n256_phi0.8438_a2_relaxed.xyz";
  const Outcome run = Do("relax", input + " --modes=3 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  EXPECT_NE(run.out.find("\n  certificate   strict minimum: lowest eigenvalue"),
            std::string::npos)
      << run.out;
  const auto json = Summary("out");
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
  EXPECT_FALSE(Summary("out").contains("certificate"));
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
  EXPECT_EQ(Summary("out").at("certificate").at("strict_minimum"), true);
}

TEST_F(Relax, FollowsItsInterface) {
  const Outcome run =
      Do("relax",
         "--input=" GRANOPT_TEST_DATA
         "/n256_phi0.8438_a2_relaxed.xyz --perturb=1e-5 --out=out");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto json = Summary("out");
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

TEST_F(Relax, IsDeterministicAndReadsItsOwnOutputExactly) {
  ASSERT_EQ(Do("relax", "--particles=64 --phi=0.86 --seed=4 --out=a").status,
            0);
  ASSERT_EQ(Do("relax", "--particles=64 --phi=0.86 --seed=4 --out=b").status,
            0);
  EXPECT_EQ(Slurp(folder_ + "/a/packing.xyz"),
            Slurp(folder_ + "/b/packing.xyz"));
  // What was written, low parts included, is still converged when read.
  const Outcome run = Do("relax", "--input=a/packing.xyz --out=c");
  ASSERT_EQ(run.status, 0) << run.out;
  const auto json = Summary("c");
  EXPECT_EQ(json["iterations"].get<int>(), 0);
}

TEST_F(Relax, ReportsFailureWithResultsWritten) {
  const Outcome run =
      Do("relax", "--particles=64 --phi=0.9 --max_evaluations=5 --out=out");
  EXPECT_EQ(run.status, 1);
  const auto json = Summary("out");
  EXPECT_FALSE(json["converged"].get<bool>());
  EXPECT_EQ(json["stop_reason"].get<std::string>(), "MAX_EVALUATIONS");
  EXPECT_TRUE(Exists(folder_ + "/out/packing.xyz"));
}

TEST_F(Relax, AppliesItsLoads) {
  const std::string input =
      "--input=" GRANOPT_TEST_DATA "/n256_phi0.8438_a2_relaxed.xyz ";
  const auto phi = [&](const std::string& load) {
    EXPECT_EQ(
        Do("relax", input + load + " --max_evaluations=1 --out=out").status, 1);
    return Summary("out");
  };
  EXPECT_NEAR(phi("--radius_factor=1.01")["phi"].get<double>(),
              0.8438 * 1.01 * 1.01,
              1e-12);
  EXPECT_NEAR(phi("--simple_shear=0.01")["phi"].get<double>(), 0.8438, 1e-12);
  const auto sheared = phi("--pure_shear=0.01");
  EXPECT_NEAR(sheared["phi"].get<double>(), 0.8438, 1e-12);
  EXPECT_GT(sheared["deviatoric_stress"].get<double>(), 1e-3);
}

TEST_F(Relax, AbsoluteToleranceIsInUnitsOfTheBox) {
  ASSERT_EQ(Do("relax",
               "--particles=64 --phi=0.86 --absolute_tolerance=1e-9 --out=out")
                .status,
            0);
  const auto json = Summary("out");
  EXPECT_LE(json["max_gradient"].get<double>(), 1e-9);
}

TEST_F(Relax, ModuliOfAFileAreReported) {
  const Outcome run = Do("relax",
                         "--input=" GRANOPT_TEST_DATA
                         "/n256_phi0.8438_a2_relaxed.xyz --moduli --out=out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto moduli = Summary("out").at("moduli");
  EXPECT_TRUE(moduli.at("found"));
  EXPECT_NE(run.out.find("G = "), std::string::npos);
  EXPECT_EQ(moduli.at("elastic_tensor").size(), 3u);
  // alpha = d: both bulk moduli are the same.
  EXPECT_NEAR(moduli.at("bulk_growth").get<double>(),
              moduli.at("bulk_box").get<double>(),
              1e-9);
}

}  // namespace
}  // namespace granopt
