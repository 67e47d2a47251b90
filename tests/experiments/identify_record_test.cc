#include "experiments/identify_record.h"

#include <cstdlib>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace granopt::identify {
namespace {

// A record in a folder of its own, of strings whose value is a function of the
// string, its number and the run. It stops as asked after `most` strings.
class RecordTest : public testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/granopt_test_XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    folder_ = name;
    for (int k = 0; k < 20; ++k) strings_.push_back({0.1 * k, 1.0});
  }
  void TearDown() override {
    EXPECT_EQ(std::system(("rm -rf '" + folder_ + "'").c_str()), 0);
  }
  Checkpoint File() const { return {folder_ + "/checkpoint.cbor", Json()}; }
  EvaluateStrings Stopping(int most) {
    return [this, most](const std::string&,
                        const Task&,
                        const EnsembleRule& rule,
                        const std::vector<std::int64_t>& indices,
                        std::vector<Ensemble>* ensembles,
                        const std::function<void(int, int, int)>&) {
      for (std::size_t s = 0; s < indices.size(); ++s) {
        if (evaluated_ >= most) return false;
        ++evaluated_;
        Ensemble& e = (*ensembles)[s];
        EXPECT_TRUE(e.values.empty());
        while (!IsSettled(rule, e.values)) {
          e.values.push_back(e.string[0] + 1000.0 * indices[s] +
                             0.25 * e.values.size());
        }
      }
      return true;
    };
  }

  std::string folder_;
  Strings strings_;
  int evaluated_ = 0;
};

TEST_F(RecordTest, GoesOnInTheMiddleOfAList) {
  const Strings first(strings_.begin(), strings_.begin() + 3);
  const Strings second(strings_.begin() + 3, strings_.end());
  EnsembleRule rule;
  const Checkpoint file = File();
  std::vector<Ensemble> whole, ensembles;
  {
    Record record(&file, Stopping(1000), 8);
    ASSERT_TRUE(record.Evaluate("search", {}, rule, first, &whole));
    ASSERT_TRUE(record.Evaluate("search", {}, rule, second, &whole));
    EXPECT_EQ(evaluated_, 20);
  }
  // 3, a piece of 8, and 2 of the next.
  evaluated_ = 0;
  {
    Record record(&file, Stopping(13), 8);
    ASSERT_TRUE(record.Evaluate("search", {}, rule, first, &ensembles));
    EXPECT_FALSE(record.Evaluate("search", {}, rule, second, &ensembles));
    EXPECT_TRUE(record.halted());
    EXPECT_FALSE(record.Evaluate("other", {}, rule, first, &ensembles));
  }
  evaluated_ = 0;
  Json state;
  std::vector<std::string> faults;
  std::string error;
  ASSERT_EQ(file.Read(&state, &faults, &error), Checkpoint::Found::OK) << error;
  Record record(&file, Stopping(1000), 8);
  record.Load(state);
  ASSERT_TRUE(record.Evaluate("search", {}, rule, first, &ensembles));
  EXPECT_EQ(evaluated_, 0);
  ASSERT_TRUE(record.Evaluate("search", {}, rule, second, &ensembles));
  // No more than the piece that was cut is evaluated again.
  EXPECT_EQ(evaluated_, 9);
  ASSERT_EQ(ensembles.size(), whole.size());
  for (std::size_t s = 0; s < whole.size(); ++s) {
    EXPECT_EQ(ensembles[s].string, whole[s].string);
    EXPECT_EQ(ensembles[s].values, whole[s].values);
  }
}

}  // namespace
}  // namespace granopt::identify
