// What experiments do with flags that make no sense, and with those that do.

#include <string>

#include "gtest/gtest.h"
#include "nlohmann/json.hpp"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

class Flags : public Binaries {
 protected:
  void ExpectRefused(const std::string& binary,
                     const std::string& arguments,
                     const std::string& words) {
    const Outcome run = Do(binary, arguments + " --out=refused");
    EXPECT_EQ(run.status, 2) << arguments;
    EXPECT_NE(run.err.find(words), std::string::npos) << run.err;
    EXPECT_FALSE(Exists(folder_ + "/refused")) << arguments;
  }
};

TEST_F(Flags, ThatWouldChangeNothingAreRefused) {
  ExpectRefused("fidelity",
                "--scene=packing --smoke --alpha=2.5",
                "--alpha cannot go with --scene=packing");
  ExpectRefused("fidelity",
                "--scene=packing --smoke --duration=2",
                "--duration cannot go with --scene=packing");
  ExpectRefused("fidelity",
                "--scene=sand --smoke --particles=64",
                "--particles cannot go with --scene=sand");
}

TEST_F(Flags, AreCheckedForASingleExtreme) {
  const std::string cell = "--extreme=grains_3 --solver=fire ";
  ExpectRefused("extremes", cell + "--max_seconds=-1", "--max_seconds=-1");
  ExpectRefused("extremes", cell + "--max_seconds=1e30", "--max_seconds=1e+30");
  ExpectRefused("extremes", cell + "--tolerance=0", "--tolerance=0");
  ExpectRefused(
      "extremes", cell + "--max_evaluations=0", "--max_evaluations=0");
}

// All that decides about a state is part of what --resume compares.
TEST_F(Flags, ThatChangeStatesCannotChangeOnTheWay) {
  for (const char* mode : {"pure", "wall"}) {
    const std::string flags =
        "--smoke --strain=0.004 --out=out --mode=" + std::string(mode);
    ASSERT_EQ(Do("shear", flags).status, 0);
    const Outcome run = Do("shear", flags + " --resume --zero_pressure=1e-9");
    EXPECT_EQ(run.status, 2) << mode;
    EXPECT_NE(run.err.find("zero_pressure = 1e-13, now 1e-09"),
              std::string::npos)
        << run.err;
  }
}

TEST_F(Flags, OfThreadsAreInTheProvenance) {
  for (const int threads : {1, 2}) {
    const Outcome run =
        Do("relax", "--smoke --out=out --threads=" + std::to_string(threads));
    if (run.err.find("without OpenMP") != std::string::npos) GTEST_SKIP();
    ASSERT_EQ(run.status, 0) << run.err;
    const auto json =
        nlohmann::json::parse(Slurp(folder_ + "/out/summary.json"));
    EXPECT_EQ(json.at("provenance").at("threads"), threads);
  }
}

}  // namespace
}  // namespace granopt
