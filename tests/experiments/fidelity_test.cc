// `fidelity` and `extremes` as a user runs them.

#include <string>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

using Fidelity = Binaries;

// No method claims what is not so, whatever the extreme.
TEST_F(Fidelity, ExtremesClaimNothingWrong) {
  for (const char* kind : {"", "--flow "}) {
    const Outcome run =
        Do("extremes", std::string(kind) + "--smoke --jobs=2 --out=good");
    EXPECT_EQ(run.status, 0) << run.out << run.err;
    const auto summary = Summary("good");
    EXPECT_EQ(summary.at("cells").at("wrong"), 0) << run.out;
    EXPECT_EQ(summary.at("cells").at("lost"), 0) << run.out;
    EXPECT_GT(summary.at("cells").at("passed"), 5) << run.out;
    EXPECT_GT(summary.at("cells").at("refused"), 2) << run.out;
  }
  ExpectRefused("extremes", "--only=nothing", "unknown extreme");
  ExpectRefused("extremes", "--extreme=overflow --solver=fire", "other units");
}

TEST_F(Fidelity, ComparesModelsOnTheSameStarts) {
  const Outcome run = Do("fidelity", "--smoke --scene=powder --out=good");
  ASSERT_EQ(run.status, 0) << run.out << run.err;
  const auto summary = Summary("good");
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
