// Checkpoints, at the moments at which a run may be killed.

#include "experiments/checkpoint.h"

#include <dirent.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/experiments/binaries.h"

namespace granopt {
namespace {

class CheckpointTest : public Binaries {
 protected:
  std::vector<std::string> Files() const {
    std::vector<std::string> files;
    DIR* directory = opendir(folder_.c_str());
    while (const dirent* entry = readdir(directory)) {
      const std::string file = entry->d_name;
      if (file != "." && file != "..") files.push_back(file);
    }
    closedir(directory);
    return files;
  }

  // The state on the disk; `faults` lines beside.
  int Read(const Checkpoint& checkpoint, std::size_t faults = 0) const {
    Json state;
    std::vector<std::string> lines;
    std::string error;
    EXPECT_EQ(checkpoint.Read(&state, &lines, &error), Checkpoint::Found::OK);
    EXPECT_EQ(lines.size(), faults);
    return state.value("number", -1);
  }

  void Write(const Checkpoint& checkpoint, int number) const {
    std::string error;
    EXPECT_TRUE(checkpoint.Write({{"number", number}}, &error)) << error;
  }
};

TEST_F(CheckpointTest, TheNewestIsReadAndTheOneBeforeKept) {
  const Checkpoint checkpoint(folder_ + "/c", {{"seed", 1}});
  for (int number = 1; number <= 3; ++number) {
    Write(checkpoint, number);
    EXPECT_EQ(Read(checkpoint), number);
  }
  EXPECT_EQ(Files().size(), 2u);
  ASSERT_EQ(truncate(checkpoint.path().c_str(), 30), 0);
  EXPECT_EQ(Read(checkpoint, 1), 2);
}

// Killed between its two renames a run leaves one file of two names, and
// what it was about to rename.
TEST_F(CheckpointTest, AfterAKillBetweenRenamesNothingIsLeftBehind) {
  const Checkpoint checkpoint(folder_ + "/c", {{"seed", 1}});
  Write(checkpoint, 1);
  ASSERT_EQ(link(checkpoint.path().c_str(), checkpoint.previous().c_str()), 0);
  Write(checkpoint, 2);
  EXPECT_EQ(Read(checkpoint), 2);
  EXPECT_EQ(Files().size(), 2u) << "the link that was not renamed";
}

TEST_F(CheckpointTest, AnotherSetupIsNamed) {
  Write(Checkpoint(folder_ + "/c", {{"seed", 1}, {"alpha", 2.0}}), 1);
  Json state;
  std::vector<std::string> lines;
  std::string error;
  EXPECT_EQ(Checkpoint(folder_ + "/c", {{"seed", 1}, {"alpha", 2.5}})
                .Read(&state, &lines, &error),
            Checkpoint::Found::OTHER_SETUP);
  EXPECT_NE(error.find("begun with alpha = 2.0, now 2.5"), std::string::npos)
      << error;
  EXPECT_EQ(Checkpoint(folder_ + "/none", {}).Read(&state, &lines, &error),
            Checkpoint::Found::NONE);
}

// Every field, to the last bit.
TEST_F(CheckpointTest, StatesComeBackAsTheyWere) {
  StressShearState state;
  state.shear.step = 7;
  state.shear.strain = 1.0 / 3.0;
  state.shear.packing.box = Box::Cube(2, 3.0);
  state.shear.packing.positions = Eigen::MatrixXd::Random(2, 5);
  state.shear.packing.positions_low = 1e-17 * Eigen::MatrixXd::Random(2, 5);
  state.shear.packing.radii = Eigen::VectorXd::Random(5);
  state.shear.packing.species = {"A", "B", "A", "B", "A"};
  state.shear.packing.attributes["key"] = "a value";
  state.shear.energy = 0.1;
  state.shear.stress << 1.0 / 7.0, 2.0, 3.0, 4.0;
  state.shear.relaxations = 9;
  state.shear.gave_up = 2;
  state.shear.counters.evaluations = std::int64_t{1} << 60;
  state.shear.seconds = 0.3;
  state.summary.solver = "lbfgs";
  state.summary.reason = StopReason::MAX_EVALUATIONS;
  state.summary.message = "|g| = 1 > 0.1";
  state.summary.counters.iterations = 4;
  state.list_builds = 3;
  state.reached = 0.7;
  state.halvings = 2;
  state.refused = 0.9;
  state.why = "no minimum";
  const Checkpoint checkpoint(folder_ + "/c", {});
  std::string error;
  ASSERT_TRUE(checkpoint.Write(ToJson(state), &error)) << error;
  Json json;
  std::vector<std::string> faults;
  ASSERT_EQ(checkpoint.Read(&json, &faults, &error), Checkpoint::Found::OK);
  const StressShearState read = StressShearStateOf(json);
  EXPECT_EQ(read.shear.step, 7);
  EXPECT_EQ(read.shear.strain, 1.0 / 3.0);
  EXPECT_EQ(read.shear.packing.box.edges(), state.shear.packing.box.edges());
  EXPECT_EQ(read.shear.packing.positions, state.shear.packing.positions);
  EXPECT_EQ(read.shear.packing.positions_low,
            state.shear.packing.positions_low);
  EXPECT_EQ(read.shear.packing.radii, state.shear.packing.radii);
  EXPECT_EQ(read.shear.packing.species, state.shear.packing.species);
  EXPECT_EQ(read.shear.packing.attributes, state.shear.packing.attributes);
  EXPECT_EQ(read.shear.energy, 0.1);
  EXPECT_EQ(read.shear.stress, state.shear.stress);
  EXPECT_EQ(read.shear.relaxations, 9);
  EXPECT_EQ(read.shear.gave_up, 2);
  EXPECT_EQ(read.shear.counters.evaluations, std::int64_t{1} << 60);
  EXPECT_EQ(read.shear.seconds, 0.3);
  EXPECT_EQ(read.summary.solver, "lbfgs");
  EXPECT_EQ(read.summary.reason, StopReason::MAX_EVALUATIONS);
  EXPECT_EQ(read.summary.message, "|g| = 1 > 0.1");
  EXPECT_EQ(read.summary.counters.iterations, 4);
  EXPECT_EQ(read.list_builds, 3);
  EXPECT_EQ(read.reached, 0.7);
  EXPECT_EQ(read.halvings, 2);
  EXPECT_EQ(read.refused, 0.9);
  EXPECT_EQ(read.why, "no minimum");
  // What is missing or of another form is an exception, not a number.
  json.erase("halvings");
  EXPECT_THROW(StressShearStateOf(json), Json::exception);
  EXPECT_THROW(StressShearStateOf({{"shear", 1}}), Json::exception);
}

// A state that grows with the steps is written in linear time, and never
// waits for long.
TEST(CheckpointSteps, AreAllAtFirstAndThenFewer) {
  std::size_t last = 0, written = 0;
  for (std::size_t step = 1; step <= 1000000; ++step) {
    if (!IsCheckpointStep(step)) continue;
    EXPECT_LE(step - last, 1 + step / 256);
    if (step <= 512) EXPECT_EQ(step, last + 1);
    written += step;
    last = step;
  }
  EXPECT_LT(written, 1024u * 1000000u);
}

}  // namespace
}  // namespace granopt
