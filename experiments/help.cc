#include "experiments/help.h"

#include <cstdlib>
#include <sstream>

#include "experiments/run.h"

namespace granopt {
namespace {

constexpr std::size_t kWidth = 96;
constexpr std::size_t kColumn = 27;  // where descriptions begin

// Files whose flags several experiments share, and what these are about. All
// other flags are an experiment's own.
struct Group {
  const char* file;
  const char* title;
};
constexpr Group kShared[] = {
    {"flow_flags.cc", "The flow"},
    {"flow_scene.cc", "The flow"},
    {"scene.cc", "The packing, and how far it is relaxed"},
    {"method.cc", "The method"},
    {"ensemble.cc", "Many packings"},
    {"certificate.cc", "What is measured at the end"},
    {"moduli.cc", "What is measured at the end"},
    {"run.cc", "Every experiment"},
};

// Runs of seconds, which a test runs as they are.
struct Example {
  const char* binary;
  const char* flags;
};
constexpr Example kExamples[] = {
    {"relax", "--particles=1024 --phi=0.86"},
    {"relax", "--input=packing.xyz --simple_shear=1e-4 --tolerance=1e-12"},
    {"relax", "--input=packing.xyz --solver=lbfgs:preconditioner=contact"},
    {"jamming", "--particles=256 --seed=7"},
    {"jamming", "--seeds=1-4 --sizes=64,128 --jobs=2"},
    {"compare",
     "--input=packing.xyz --cases=user,growth=5e-5 --solvers=auto;lbfgs;fire"},
    {"compare", "--replot=out/compare --tolerance=1e-4"},
    {"conditioning", "--smoke"},
    {"scaling", "--particles=128 --seed=1 --spectra=1e-4"},
    {"scaling", "--smoke --jobs=2"},
    {"shear", "--particles=256 --increments=4e-4,2e-4,1e-4"},
    {"shear", "--particles=256 --mode=simple --strain=2 --increments=0.02"},
    {"shear", "--particles=64 --mode=stress --shear_stress=1e-3"},
    {"shear", "--smoke --seeds=1-4 --jobs=2 --events"},
    {"tradeoff",
     "--recommend --accuracy=1e-6 --observable=pressure --input=packing.xyz"},
    {"tradeoff", "--smoke"},
    {"extremes", "--extreme=distance_1e-14 --solver=fire"},
    {"extremes", "--flow --smoke"},
    {"fidelity", "--scene=sand --smoke"},
    {"flow", "--alpha1=0.5 --alpha2=0.25"},
    {"flow", "--paper --smoke"},
    {"flow", "--study=oscillator --smoke"},
    {"identify", "--smoke --threads=2"},
    {"identify", "--smoke --search=alpha1:0:1,mu_s:0.1:0.5"},
};

const Group* SharedGroup(const gflags::CommandLineFlagInfo& flag) {
  const std::string file =
      flag.filename.substr(flag.filename.find_last_of('/') + 1);
  for (const Group& group : kShared) {
    if (file == group.file) return &group;
  }
  return nullptr;
}

// "  --name=default  description", the latter in lines of its own width.
std::string Entry(const gflags::CommandLineFlagInfo& flag) {
  std::string line = "  --" + flag.name;
  if (flag.type == "double") {
    line += Format("=%g", std::strtod(flag.default_value.c_str(), nullptr));
  } else if (flag.type != "bool") {
    line += "=" + flag.default_value;
  }
  std::string text;
  // A long default has a line of its own.
  if (line.size() + 2 > kColumn) {
    text = line + "\n";
    line.clear();
  }
  line.resize(kColumn, ' ');
  std::istringstream words(flag.description);
  bool begun = false;
  for (std::string word; words >> word;) {
    if (begun && line.size() + 1 + word.size() > kWidth) {
      text += line + "\n";
      line.assign(kColumn, ' ');
      begun = false;
    }
    line += (begun ? " " : "") + word;
    begun = true;
  }
  return text + line + "\n";
}

}  // namespace

std::vector<gflags::CommandLineFlagInfo> OwnFlags() {
  std::vector<gflags::CommandLineFlagInfo> all, own;
  gflags::GetAllFlags(&all);
  for (const auto& flag : all) {
    if (flag.filename.find("experiments/") != std::string::npos) {
      own.push_back(flag);
    }
  }
  return own;
}

std::string HelpText(const std::string& binary, const std::string& purpose) {
  const std::vector<gflags::CommandLineFlagInfo> flags = OwnFlags();
  std::string text = binary + ": " + purpose + "\n";
  std::string own;
  for (const auto& flag : flags) {
    if (SharedGroup(flag) == nullptr) own += Entry(flag);
  }
  if (!own.empty()) text += "\nThis experiment\n" + own;
  std::string title;
  for (const Group& group : kShared) {
    std::string entries;
    for (const auto& flag : flags) {
      if (SharedGroup(flag) == &group) entries += Entry(flag);
    }
    if (entries.empty()) continue;
    if (title != group.title) text += std::string("\n") + group.title + "\n";
    title = group.title;
    text += entries;
  }
  std::string examples;
  for (const Example& example : kExamples) {
    if (binary != example.binary) continue;
    const std::string words = example.flags;
    // A shell takes ; and | apart.
    const bool quoted = words.find_first_of(";|") != std::string::npos;
    examples += "  " + binary;
    std::istringstream list(words);
    for (std::string word; list >> word;) {
      const bool quote =
          quoted && word.find_first_of(";|") != std::string::npos;
      examples += quote ? " '" + word + "'" : " " + word;
    }
    examples += "\n";
  }
  if (!examples.empty()) text += "\nExamples\n" + examples;
  return text +
         "\nSwitches are off with --noNAME. Exit status: 0 done, 1 did not "
         "converge (results are\nwritten all the same), 2 bad input or usage "
         "(nothing is written).\n";
}

}  // namespace granopt
