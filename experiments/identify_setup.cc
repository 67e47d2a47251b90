#include "experiments/identify_setup.h"

#include <algorithm>
#include <memory>
#include <set>

#include "experiments/checkpoint.h"
#include "experiments/identify_flags.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"

namespace granopt::identify {

std::vector<double> ReadNumbers(const char* flag, const std::string& text) {
  std::vector<double> numbers;
  if (!ParseNumbers(text, &numbers)) {
    BadInput(Format("--%s=%s must be numbers, as 1,0.5,2", flag, text.c_str()));
  }
  return numbers;
}

Task MakeTask() {
  Task task;
  std::string error;
  if (!ParseSearched(FLAGS_search, &task.flags, &error)) {
    BadInput("--search: " + error);
  }
  std::vector<double> middle;
  for (const SearchedFlag& flag : task.flags) {
    gflags::CommandLineFlagInfo info;
    if (!gflags::GetCommandLineFlagInfo(flag.name.c_str(), &info) ||
        info.type != "double" ||
        info.filename.find("flow_scene") == std::string::npos) {
      BadInput("--search: '" + flag.name +
               "' is not a flag of a flow that is a number");
    }
    if (flag.name == "duration") {
      BadInput("--search: 'duration' is what energies are compared over");
    }
    if (!info.is_default) {
      BadInput("--" + flag.name +
               " is searched (--search) and cannot be given");
    }
    middle.push_back(0.5 * (flag.low + flag.high));
  }
  const std::vector<double> w = ReadNumbers("weights", FLAGS_weights);
  if (w.size() != 3 || *std::min_element(w.begin(), w.end()) < 0.0 ||
      !(w[0] + w[1] + w[2] > 0.0)) {
    BadInput("--weights=" + FLAGS_weights +
             " must be three numbers >= 0, not all 0");
  }
  task.weights = {w[0], w[1], w[2]};
  CheckPositive("duration", FLAGS_duration);
  CheckPositive("dt", FLAGS_dt);
  // Now: while flows run, dt may be one of the parameters.
  if (FLAGS_most_steps == 0) {
    FLAGS_most_steps = static_cast<int>(
        std::min(2e9, 1.0 + 100.0 * FLAGS_duration / FLAGS_dt));
  }
  if (!FLAGS_target.empty()) {
    if (IsGiven("target_energies")) {
      BadInput("--target and --target_energies exclude each other");
    }
    if (!ReadTarget(
            FLAGS_target, FLAGS_duration, task.weights, &task.target, &error)) {
      BadInput("--target: " + error);
    }
  } else {
    const std::vector<double> t =
        ReadNumbers("target_energies", FLAGS_target_energies);
    if (t.size() != 3 || *std::min_element(t.begin(), t.end()) < 0.0) {
      BadInput("--target_energies=" + FLAGS_target_energies +
               " must be three numbers >= 0");
    }
    for (int k = 0; k < 3; ++k) {
      if (w[k] > 0.0 && t[k] == 0.0) {
        BadInput("--target_energies=" + FLAGS_target_energies +
                 ": 0 cannot be divided by; its weight may be 0");
      }
    }
    task.target = ConstantTarget(t[0], t[1], t[2], FLAGS_duration);
  }
  // Flags that are wrong by themselves, and bounds that no flow can have, are
  // told now. What goes with what (beta2 > beta1, mu_d <= mu_s) is a matter of
  // strings.
  bool possible = false;
  for (std::size_t k = 0; k <= 2 * task.flags.size(); ++k) {
    std::vector<double> string = middle;
    if (k > 0) {
      const SearchedFlag& flag = task.flags[(k - 1) / 2];
      string[(k - 1) / 2] = k % 2 == 0 ? flag.high : flag.low;
    }
    FlowCase flow;
    std::unique_ptr<Stepper> stepper;
    possible =
        Compose(task, string, FLAGS_seed, &flow, &stepper, &error) || possible;
  }
  if (!possible) BadInput(error);
  return task;
}

Json Setup(const Task& task) {
  const std::set<std::string> own = {"out",
                                     "resume",
                                     "threads",
                                     "pictures",
                                     "external",
                                     "worker",
                                     "strings",
                                     "share",
                                     "list_methods",
                                     // Stages of their own: --resume adds them
                                     // to a search that is done.
                                     "profile",
                                     "alternatives",
                                     "recovery",
                                     // Their text instead.
                                     "target",
                                     "input"};
  Json setup = Json::object();
  for (const auto& flag : FlagsDefinedIn("experiments/")) {
    if (own.count(flag.name) == 0) setup[flag.name] = flag.current_value;
  }
  setup["target"] = Crc32(FormatCurve(task.target));
  setup["input"] = nullptr;
  if (!FLAGS_input.empty()) {
    std::string text, error;
    if (!ReadFile(FLAGS_input, &text, &error)) BadInput("--input: " + error);
    setup["input"] = Crc32(text);
  }
  return setup;
}

}  // namespace granopt::identify
