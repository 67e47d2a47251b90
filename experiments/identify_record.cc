#include "experiments/identify_record.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace granopt::identify {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A killed run loses no more than this many runs, and of long ones a minute's.
constexpr std::size_t kRunsOfSave = 200;
constexpr std::chrono::seconds kTimeOfSave(60);

}  // namespace

Record::Record(const Checkpoint* checkpoint,
               EvaluateStrings evaluate,
               std::size_t piece)
    : checkpoint_(checkpoint),
      evaluate_(std::move(evaluate)),
      piece_(piece),
      saved_(std::chrono::steady_clock::now()) {}

void Record::Load(const Json& state) {
  for (const auto& [name, list] : state.at("stages").items()) {
    for (const Json& row : list) {
      Ensemble e;
      row.at(0).get_to(e.string);
      row.at(1).get_to(e.values);
      loaded_ += e.values.size();
      stages_[name].done.push_back(std::move(e));
    }
  }
}

bool Record::Evaluate(const std::string& name,
                      const Task& task,
                      const EnsembleRule& rule,
                      const Strings& strings,
                      std::vector<Ensemble>* ensembles) {
  if (halted_) return false;
  Stage& stage = stages_[name];
  const std::size_t first = stage.next, end = first + strings.size();
  // What a run before this one has left may end within the list.
  while (stage.done.size() < end) {
    std::vector<Ensemble> more;
    std::vector<std::int64_t> indices;
    for (std::size_t s = stage.done.size(); s < end && more.size() < piece_;
         ++s) {
      more.push_back({strings[s - first], {}});
      indices.push_back(static_cast<std::int64_t>(s));
    }
    if (!evaluate_(name,
                   task,
                   rule,
                   indices,
                   &more,
                   [&](int strings, int run, int runs) {
                     Show(name, stage, strings, run, runs);
                   })) {
      halted_ = true;
      Save();
      return false;
    }
    for (Ensemble& e : more) {
      unsaved_ += e.values.size();
      stage.done.push_back(std::move(e));
    }
    if (unsaved_ >= kRunsOfSave ||
        std::chrono::steady_clock::now() - saved_ >= kTimeOfSave) {
      Save();
    }
  }
  ensembles->clear();
  for (std::size_t s = first; s < end; ++s) {
    const Ensemble& e = stage.done[s];
    if (e.string != strings[s - first]) {
      BadInput(checkpoint_->path() + ": stage " + name +
               " holds other strings: written by another version?");
    }
    stage.runs += e.values.size();
    best_[name] =
        std::min(best_.count(name) > 0 ? best_[name] : kInfinity, e.mean());
    ensembles->push_back(e);
  }
  stage.next = end;
  return true;
}

void Record::Save() {
  Json stages = Json::object();
  for (const auto& [name, stage] : stages_) {
    Json list = Json::array();
    for (const Ensemble& e : stage.done) {
      list.push_back(Json::array({e.string, e.values}));
    }
    stages[name] = std::move(list);
  }
  std::string error;
  if (!checkpoint_->Write({{"stages", stages}}, &error)) BadInput(error);
  unsaved_ = 0;
  saved_ = std::chrono::steady_clock::now();
}

std::int64_t Record::runs() const {
  std::int64_t sum = 0;
  for (const auto& [name, stage] : stages_) sum += stage.runs;
  return sum;
}

void Record::Show(const std::string& name,
                  const Stage& stage,
                  int strings,
                  int run,
                  int runs) {
  if (!progress_.Due()) return;
  const double best = best_.count(name) > 0 ? best_[name] : kInfinity;
  progress_.Show(
      Format("%s: %zu strings and %lld runs done%s; run %d of %d for the "
             "next %d",
             name.c_str(),
             stage.done.size(),
             static_cast<long long>(stage.runs),
             std::isfinite(best) ? Format(", best P %.4f", best).c_str() : "",
             run,
             runs,
             strings));
}

}  // namespace granopt::identify
