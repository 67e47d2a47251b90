// What all experiment binaries do alike: bad input, help, folders.

#include <string>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using EveryBinary = Binaries;

const char kHeader[] =
    "Lattice=\"1 0 0 0 1 0 0 0 1\" Properties=species:S:1:pos:R:3:radius:R:1 "
    "pbc=\"T T F\"\n";

TEST_F(EveryBinary, ModesWithoutACertificateAreRefused) {
  ExpectRefused("relax",
                "--particles=16 --modes=2 --nocertify --out=out",
                "--modes needs --certify");
  ExpectRefused("jamming",
                "--particles=16 --modes=-1 --out=out",
                "--modes=-1 must be in [0, 1000]");
}

TEST_F(EveryBinary, PrecisionIsOneOfThree) {
  for (const char* binary : {"relax", "compare", "jamming"}) {
    ExpectRefused(binary,
                  "--particles=16 --precision=half --out=out",
                  "--precision=half must be double, mixed or float");
  }
  EXPECT_EQ(Do("relax", "--smoke --precision=mixed --out=out").status, 0);
  EXPECT_EQ(Summary("out").at("precision"), "mixed");
}

TEST_F(EveryBinary, BadInputIsOneLineAndLeavesNothing) {
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

TEST_F(EveryBinary, ResultsOfTwoRunsAreNeverMixed) {
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

TEST_F(EveryBinary, HelpAndTheListOfSolversExitWithZero) {
  Outcome run = Do("relax", "--help");
  EXPECT_EQ(run.status, 0);
  EXPECT_NE(run.out.find("--absolute_tolerance"), std::string::npos);
  run = Do("jamming", "--list_solvers");
  EXPECT_EQ(run.status, 0);
  EXPECT_NE(run.out.find("ceres_ncg"), std::string::npos);
  EXPECT_FALSE(Exists(folder_ + "/out"));
}

}  // namespace
}  // namespace granopt
