// Every input of the corpus, those that once failed among them.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "granular/atomic_file.h"
#include "gtest/gtest.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data,
                                      std::size_t size);

namespace {

TEST(PackingIoFuzz, ReplaysTheCorpus) {
  std::vector<std::string> paths;
  for (const auto& entry :
       std::filesystem::directory_iterator(GRANOPT_FUZZ_CORPUS)) {
    paths.push_back(entry.path().string());
  }
  std::sort(paths.begin(), paths.end());
  EXPECT_GE(paths.size(), 12u);
  for (const std::string& path : paths) {
    SCOPED_TRACE(path);
    std::string content, error;
    ASSERT_TRUE(granopt::ReadFile(path, &content, &error)) << error;
    EXPECT_EQ(LLVMFuzzerTestOneInput(
                  reinterpret_cast<const std::uint8_t*>(content.data()),
                  content.size()),
              0);
  }
}

// Each seed cut short anywhere, and with each byte replaced by some that
// matter.
TEST(PackingIoFuzz, ReplaysNeighboursOfTheCorpus) {
  for (const auto& entry :
       std::filesystem::directory_iterator(GRANOPT_FUZZ_CORPUS)) {
    std::string content, error;
    ASSERT_TRUE(granopt::ReadFile(entry.path().string(), &content, &error));
    if (content.size() > 2000) continue;
    const auto run = [](const std::string& text) {
      LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(text.data()),
                             text.size());
    };
    for (std::size_t at = 0; at < content.size(); ++at) {
      run(content.substr(0, at));
      for (const char c : {'\0',
                           '\n',
                           '\r',
                           ' ',
                           '"',
                           '\\',
                           '=',
                           ':',
                           '-',
                           '.',
                           '0',
                           '9',
                           'e',
                           '\xff'}) {
        std::string changed = content;
        changed[at] = c;
        run(changed);
      }
    }
  }
}

}  // namespace
