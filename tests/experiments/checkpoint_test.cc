// Checkpoints, at the moments at which a run may be killed.

#include "experiments/checkpoint.h"

#include <dirent.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace granopt {
namespace {

class CheckpointTest : public testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/granopt_checkpoint_XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    for (const std::string& file : Files()) unlink((folder_ + file).c_str());
    rmdir(folder_.c_str());
  }

  std::vector<std::string> Files() const {
    std::vector<std::string> files;
    DIR* directory = opendir(folder_.c_str());
    while (const dirent* entry = readdir(directory)) {
      const std::string file = entry->d_name;
      if (file != "." && file != "..") files.push_back("/" + file);
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

  std::string folder_;
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

}  // namespace
}  // namespace granopt
