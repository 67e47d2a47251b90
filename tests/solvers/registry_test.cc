#include "solvers/registry.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "solvers/preconditioner.h"

namespace granopt {
namespace {

// The one line of error for a spec that must be refused.
std::string ErrorOf(const std::string& spec) {
  std::string error;
  if (CreateSolver(spec, &error) != nullptr) return "no error";
  EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  return error;
}

// "a, b, c"
std::string Joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) {
    text += (text.empty() ? "" : ", ") + name;
  }
  return text;
}

std::vector<std::string> Names() {
  std::vector<std::string> names;
  for (const SolverInfo& info : ListSolvers()) names.push_back(info.name);
  return names;
}

SolverInfo Info(const std::string& name) {
  for (const SolverInfo& info : ListSolvers()) {
    if (info.name == name) return info;
  }
  ADD_FAILURE() << name << " is not registered";
  return {};
}

std::vector<std::string> OptionKeys(const std::string& name) {
  std::vector<std::string> keys;
  for (const auto& option : Info(name).options) keys.push_back(option.key);
  return keys;
}

// Files in a subfolder need an optional package, and may be absent.
TEST(Registry, HasOneMethodForEachFile) {
  const std::string folder =
      std::string(GRANOPT_TEST_DATA) + "/../../solvers/methods";
  std::set<std::string> required, all;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".cc") continue;
    const std::string name = entry.path().stem().string();
    EXPECT_TRUE(all.insert(name).second) << name << " is there twice";
    if (entry.path().parent_path() == folder) required.insert(name);
  }
  const std::vector<std::string> names = Names();
  EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
  EXPECT_TRUE(std::includes(
      names.begin(), names.end(), required.begin(), required.end()));
  EXPECT_TRUE(
      std::includes(all.begin(), all.end(), names.begin(), names.end()));
}

// Whoever is asked for first, methods or preconditioners.
TEST(Registry, EverythingIsRegisteredOnce) {
  ListPreconditioners();
  std::set<std::string> names;
  for (const std::string& name : Names()) {
    EXPECT_TRUE(names.insert(name).second) << name;
  }
  for (const SolverInfo& info : ListPreconditioners()) {
    EXPECT_TRUE(names.insert(info.name).second) << info.name;
  }
}

TEST(Registry, EveryMethodSaysWhatItIs) {
  for (const SolverInfo& info : ListSolvers()) {
    SCOPED_TRACE(info.name);
    EXPECT_FALSE(info.summary.empty());
    EXPECT_EQ(info.summary.find('\n'), std::string::npos);
    // A paper, or a program and its version.
    EXPECT_NE(info.citation.find_first_of("0123456789"), std::string::npos)
        << info.citation;
    std::set<std::string> keys;
    for (const Parameters::Spec& option : info.options) {
      SCOPED_TRACE(option.key);
      EXPECT_TRUE(keys.insert(option.key).second) << "read twice";
      EXPECT_FALSE(option.key.empty());
      EXPECT_FALSE(option.default_value.empty());
      EXPECT_FALSE(option.choices.empty());
      EXPECT_FALSE(option.help.empty());
    }
  }
}

TEST(Registry, CeresMethodsHaveTheirOptions) {
  const auto has = [](const char* name, const char* key) {
    const std::vector<std::string> keys = OptionKeys(name);
    return std::find(keys.begin(), keys.end(), key) != keys.end();
  };
  for (const char* name : {"ceres_lbfgs", "ceres_ncg"}) {
    EXPECT_TRUE(has(name, "scaled"));
    EXPECT_TRUE(has(name, "restarts"));
  }
  EXPECT_TRUE(has("ceres_lbfgs", "memory"));
  EXPECT_TRUE(has("ceres_ncg", "beta"));
  EXPECT_TRUE(has("ceres_ncg", "line_search"));
}

TEST(Registry, AcceptsNamesAlone) {
  for (const std::string& name : Names()) {
    std::string error;
    const auto solver = CreateSolver(name, &error);
    ASSERT_NE(solver, nullptr) << error;
    EXPECT_EQ(solver->name(), name);
  }
}

// What is printed as the default can be given back.
TEST(Registry, AcceptsEveryDefault) {
  for (const SolverInfo& info : ListSolvers()) {
    std::string all;
    for (const Parameters::Spec& option : info.options) {
      const std::string item = option.key + "=" + option.default_value;
      all += (all.empty() ? ":" : ",") + item;
      EXPECT_NE(ErrorOf(info.name + ":" + item), "") << item;
      EXPECT_EQ(ErrorOf(info.name + ":" + item), "no error") << item;
    }
    std::string error;
    const auto solver = CreateSolver(info.name + all, &error);
    ASSERT_NE(solver, nullptr) << error;
    EXPECT_EQ(solver->name(), info.name + all);
  }
}

TEST(Registry, AcceptsOptionsInAnyOrder) {
  EXPECT_EQ(ErrorOf("ceres_lbfgs:memory=5,scaled=1"), "no error");
  EXPECT_EQ(ErrorOf("ceres_lbfgs:scaled=1,memory=5"), "no error");
  for (const char* beta : {"fr", "pr", "hs"}) {
    for (const char* search : {"wolfe", "armijo"}) {
      EXPECT_EQ(ErrorOf(std::string("ceres_ncg:beta=") + beta +
                        ",line_search=" + search),
                "no error");
    }
  }
}

TEST(Registry, UnknownSolverListsTheKnown) {
  const std::string known = " (known: " + Joined(Names()) + ")";
  EXPECT_EQ(ErrorOf("ceres_bfgs"), "unknown solver 'ceres_bfgs'" + known);
  EXPECT_EQ(ErrorOf("Ceres_lbfgs:scaled=1"),
            "unknown solver 'Ceres_lbfgs'" + known);
  EXPECT_EQ(ErrorOf(""), "unknown solver ''" + known);
  EXPECT_EQ(ErrorOf(":scaled=1"), "unknown solver ''" + known);
  EXPECT_EQ(ErrorOf("ceres_lbfgs "), "unknown solver 'ceres_lbfgs '" + known);
}

TEST(Registry, UnknownOptionListsTheOptions) {
  EXPECT_EQ(ErrorOf("ceres_lbfgs:memry=5"),
            "solver 'ceres_lbfgs': unknown option 'memry' (it has " +
                Joined(OptionKeys("ceres_lbfgs")) + ")");
  EXPECT_EQ(ErrorOf("ceres_ncg:scaled=1,memory=5"),
            "solver 'ceres_ncg': unknown option 'memory' (it has " +
                Joined(OptionKeys("ceres_ncg")) + ")");
}

TEST(Registry, BadValueNamesTheChoices) {
  const std::string lbfgs = "solver 'ceres_lbfgs': option ";
  const std::string integer = " must be an integer in [1, 1000000000]";
  for (const char* value :
       {"", "0", "-1", "5x", "1.5", "1e3", "five", "99999999999999999999"}) {
    EXPECT_EQ(ErrorOf(std::string("ceres_lbfgs:memory=") + value),
              lbfgs + "memory=" + value + integer);
  }
  for (const char* value : {"", "2", "true", "yes", "01", "0|1"}) {
    EXPECT_EQ(ErrorOf(std::string("ceres_lbfgs:scaled=") + value),
              lbfgs + "scaled=" + value + " must be one of 0|1");
  }
  EXPECT_EQ(ErrorOf("ceres_lbfgs:restarts=-1"),
            lbfgs + "restarts=-1 must be an integer in [0, 1000000000]");
  EXPECT_EQ(ErrorOf("ceres_ncg:beta=dy"),
            "solver 'ceres_ncg': option beta=dy must be one of fr|pr|hs");
  EXPECT_EQ(ErrorOf("ceres_ncg:line_search=Wolfe"),
            "solver 'ceres_ncg': option line_search=Wolfe must be one of "
            "wolfe|armijo");
  // A value may hold an equals sign; this one is just not a number.
  EXPECT_EQ(ErrorOf("ceres_lbfgs:memory=5=5"), lbfgs + "memory=5=5" + integer);
}

TEST(Registry, DuplicateKey) {
  EXPECT_EQ(ErrorOf("ceres_lbfgs:memory=5,scaled=1,memory=5"),
            "solver 'ceres_lbfgs:memory=5,scaled=1,memory=5': option 'memory' "
            "is given twice");
}

TEST(Registry, NotKeyValue) {
  const auto expected = [](const std::string& spec, const std::string& item) {
    return "solver '" + spec + "': '" + item + "' is not key=value";
  };
  for (const char* item : {"memory", "=5", "memory:5", " "}) {
    const std::string spec = std::string("ceres_lbfgs:") + item;
    EXPECT_EQ(ErrorOf(spec), expected(spec, item));
  }
  for (const char* spec : {"ceres_lbfgs:,memory=5",
                           "ceres_lbfgs:memory=5,,scaled=1",
                           "ceres_lbfgs:memory=5,",
                           "ceres_lbfgs:"}) {
    EXPECT_EQ(ErrorOf(spec), expected(spec, ""));
  }
}

// By themselves, preconditioners are read as methods are.
TEST(Registry, PreconditionersBySpec) {
  const auto error_of = [](const std::string& spec) {
    std::string error;
    return CreatePreconditioner(spec, &error) != nullptr ? "no error" : error;
  };
  EXPECT_EQ(error_of("barrier"), "no error");
  EXPECT_EQ(error_of("barrier:length=0.2,every=5"), "no error");
  EXPECT_EQ(error_of("barrier:"),
            "preconditioner 'barrier:': '' is not key=value");
  EXPECT_EQ(error_of("barrier:every=5,every=5"),
            "preconditioner 'barrier:every=5,every=5': option 'every' is given "
            "twice");
  EXPECT_EQ(error_of("barrier:every=0"),
            "preconditioner 'barrier': option every=0 must be an integer in "
            "[1, 1000000000]");
  EXPECT_EQ(
      error_of("hessian:length=1")
          .find("preconditioner 'hessian': unknown option 'length' (it has "),
      0u);
  EXPECT_EQ(error_of("barier").find("unknown preconditioner 'barier' (known: "),
            0u);
}

TEST(Registry, TableHasEverything) {
  const std::string table = SolverTable();
  for (const SolverInfo& info : ListSolvers()) {
    EXPECT_NE(table.find(info.name + "\n"), std::string::npos);
    EXPECT_NE(table.find(info.summary), std::string::npos);
    EXPECT_NE(table.find("[" + info.citation + "]"), std::string::npos);
    for (const Parameters::Spec& option : info.options) {
      EXPECT_NE(table.find(option.key + "=" + option.default_value + "  (" +
                           option.choices + ")  " + option.help + "\n"),
                std::string::npos);
    }
  }
}

}  // namespace
}  // namespace granopt
