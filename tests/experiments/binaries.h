// Fixture of tests that run the experiment binaries as a user does, in a folder
// of their own that is gone afterwards.

#ifndef GRANOPT_TESTS_EXPERIMENTS_BINARIES_H_
#define GRANOPT_TESTS_EXPERIMENTS_BINARIES_H_

#include <sys/stat.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "nlohmann/json.hpp"

namespace granopt {

inline std::string Slurp(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

inline bool Exists(const std::string& path) {
  struct stat status;
  return stat(path.c_str(), &status) == 0;
}

inline int Lines(const std::string& text) {
  int count = 0;
  for (const char c : text) count += c == '\n';
  return count;
}

inline std::vector<std::string> Rows(const std::string& csv) {
  std::vector<std::string> rows;
  std::stringstream lines(csv);
  for (std::string line; std::getline(lines, line);) rows.push_back(line);
  return rows;
}

// Fields of a row without quoted ones.
inline std::vector<std::string> Fields(const std::string& row) {
  std::vector<std::string> fields;
  std::stringstream words(row);
  for (std::string word; std::getline(words, word, ',');)
    fields.push_back(word);
  return fields;
}

struct Outcome {
  int status = -1;  // of the exit; -1: killed
  std::string out, err;
};

class Binaries : public testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/granopt_test_XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    EXPECT_EQ(std::system(("rm -rf '" + folder_ + "'").c_str()), 0);
  }

  // Runs a binary in folder_; results go to folder_/out unless the arguments
  // say other.
  Outcome Do(const std::string& binary, const std::string& arguments) {
    Outcome run;
    run.status = Execute(Command(binary, arguments) +
                         " > stdout.txt 2> stderr.txt < /dev/null");
    run.out = Slurp(folder_ + "/stdout.txt");
    run.err = Slurp(folder_ + "/stderr.txt");
    return run;
  }

  // The same, interrupted (SIGINT) as soon as it has written out's first
  // checkpoint, however slow the machine is. Its exit status: 1, or 0 if it was
  // done before.
  int Interrupt(const std::string& binary,
                const std::string& arguments,
                const std::string& out) {
    return Execute("{ exec " + Command(binary, arguments) + " --out=" + out +
                   " > /dev/null 2>&1; } & pid=$!; while [ ! -e " + out +
                   "/checkpoint.cbor ] && kill -0 $pid 2> /dev/null; do sleep "
                   "0.01; done; kill -INT $pid 2> /dev/null; wait $pid");
  }

  // One line that says `words`, exit status 2, nothing written.
  void ExpectRefused(const std::string& binary,
                     const std::string& arguments,
                     const std::string& words) {
    const Outcome run = Do(binary, arguments);
    EXPECT_EQ(run.status, 2) << binary << " " << arguments;
    EXPECT_EQ(Lines(run.err), 1) << run.err;
    EXPECT_NE(run.err.find(words), std::string::npos)
        << binary << " " << arguments << "\n got: " << run.err;
    EXPECT_FALSE(Exists(folder_ + "/out")) << arguments;
  }

  std::string File(const std::string& name, const std::string& content) {
    std::ofstream(folder_ + "/" + name) << content;
    return name;
  }

  nlohmann::json Summary(const std::string& out) const {
    return nlohmann::json::parse(Slurp(folder_ + "/" + out + "/summary.json"));
  }

  int Execute(const std::string& command) {
    const int status =
        std::system(("cd '" + folder_ + "' && { " + command + "; }").c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  std::string folder_;

 private:
  static std::string Command(const std::string& binary,
                             const std::string& arguments) {
    return GRANOPT_BINARIES "/" + binary + " --nopictures " + arguments;
  }
};

}  // namespace granopt

#endif  // GRANOPT_TESTS_EXPERIMENTS_BINARIES_H_
