// experiments/methods.md lists every method and preconditioner as this build
// prints them.

#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "granular/contact_energy.h"  // whose preconditioners are in the list
#include "gtest/gtest.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

const char kRoot[] = GRANOPT_TEST_DATA "/../..";

std::string Page() {
  std::ifstream file(std::string(kRoot) + "/experiments/methods.md");
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

struct Block {
  std::string name, text;
};

// A line that begins at `indent` spaces, with the lines below it that begin
// further in.
std::vector<Block> Blocks(const std::string& text, std::size_t indent) {
  std::vector<Block> blocks;
  std::stringstream lines(text);
  bool is_open = false;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find_first_not_of(' ');
    if (first == indent) {
      blocks.push_back({line.substr(indent), line + "\n"});
      is_open = true;
    } else if (first != std::string::npos && first > indent && is_open) {
      blocks.back().text += line + "\n";
    } else {
      is_open = false;
    }
  }
  return blocks;
}

// As the page shows it.
std::string Indented(const std::string& text) {
  std::string result;
  std::stringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    result += (line.empty() ? "" : "    ") + line + "\n";
  }
  return result;
}

// Ends with where it is published.
bool IsEntry(const Block& block) {
  return block.text.size() > 2 &&
         block.text.compare(block.text.size() - 2, 2, "]\n") == 0 &&
         block.text.find("\n", block.text.find("\n") + 1) !=
             std::string::npos &&
         block.name.find_first_not_of(
             "abcdefghijklmnopqrstuvwxyz0123456789_") == std::string::npos;
}

// A program that makes energies has their preconditioners.
void RegisteredWithEnergies() {
  std::string error;
  EXPECT_EQ(ContactEnergy::Create(Packing(), {}, &error), nullptr);
}

// What needs an optional package is in a folder of its name.
bool NeedsAnOptionalPackage(const std::string& name) {
  for (const char* folder : {"/solvers/methods", "/solvers/preconditioners"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(
             std::string(kRoot) + folder)) {
      if (entry.path().stem() == name && entry.path().extension() == ".cc" &&
          entry.path().parent_path() != std::string(kRoot) + folder) {
        return true;
      }
    }
  }
  return false;
}

TEST(Readme, ListsTheMethodsAsTheyArePrinted) {
  RegisteredWithEnergies();
  const std::string page = Page();
  ASSERT_FALSE(page.empty());
  if (page.find("\n    lbfgs\n") == std::string::npos) {
    FAIL() << "methods.md has no list of methods";
  }
  std::set<std::string> known;
  for (const Block& block : Blocks(SolverTable(), 0)) {
    if (!IsEntry(block)) continue;
    known.insert(block.name);
    EXPECT_NE(page.find("\n" + Indented(block.text)), std::string::npos)
        << "methods.md lacks\n"
        << Indented(block.text);
  }
  EXPECT_EQ(known.size(), ListSolvers().size() + ListPreconditioners().size());
  for (const Block& block : Blocks(page, 4)) {
    if (!IsEntry(block) || known.count(block.name) != 0) continue;
    EXPECT_TRUE(NeedsAnOptionalPackage(block.name))
        << "methods.md lists " << block.name
        << ", which this build does not have";
  }
}

// The parts of the test above.
TEST(Readme, BlocksAreFound) {
  const auto blocks =
      Blocks("a\n    1\n    [x]\nb\n    2\n    [y]\n\nnot one\n", 0);
  ASSERT_EQ(blocks.size(), 3u);
  EXPECT_EQ(blocks[0].name, "a");
  EXPECT_EQ(blocks[0].text, "a\n    1\n    [x]\n");
  EXPECT_TRUE(IsEntry(blocks[1]));
  EXPECT_FALSE(IsEntry(blocks[2]));
  EXPECT_EQ(Blocks(Indented(blocks[1].text), 4)[0].name, "b");
  EXPECT_FALSE(NeedsAnOptionalPackage("lbfgs"));
  // Nothing is in the list twice, and preconditioners of grains are.
  std::set<std::string> names;
  for (const Block& block : Blocks(SolverTable(), 0)) {
    if (!IsEntry(block)) continue;
    EXPECT_TRUE(names.insert(block.name).second) << block.name;
  }
  EXPECT_EQ(names.count("lbfgs") + names.count("laplacian"), 2u);
}

}  // namespace
}  // namespace granopt
