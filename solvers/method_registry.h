// granopt: what the registries of solvers, preconditioners and searches share.

#ifndef GRANOPT_SOLVERS_METHOD_REGISTRY_H_
#define GRANOPT_SOLVERS_METHOD_REGISTRY_H_

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "solvers/registry.h"

namespace granopt {
namespace internal {

// The parts of "name" or "name:key=value,key=value"; false with one line in
// `error`, which begins with `kind` ("solver").
bool ParseSpec(const std::string& kind,
               const std::string& spec,
               std::string* name,
               std::map<std::string, std::string>* options,
               std::string* error);

// Names, lines, options, citations.
std::string MethodTable(const std::vector<SolverInfo>& infos);

// Methods by name. A Factory makes one from a Parameters*.
template <typename Factory>
class MethodRegistry {
 public:
  struct Entry {
    std::string name, summary, citation;
    Factory factory;
  };

  void Insert(Entry entry) {
    const auto place = std::lower_bound(
        entries_.begin(),
        entries_.end(),
        entry,
        [](const auto& a, const auto& b) { return a.name < b.name; });
    entries_.insert(place, std::move(entry));
  }
  // Null for an unknown name.
  const Entry* Find(const std::string& name) const {
    for (const Entry& entry : entries_) {
      if (entry.name == name) return &entry;
    }
    return nullptr;
  }
  const std::vector<Entry>& entries() const { return entries_; }

  std::vector<SolverInfo> Infos() const {
    std::vector<SolverInfo> infos;
    for (const Entry& entry : entries_) {
      Parameters parameters;
      entry.factory(&parameters);
      infos.push_back(
          {entry.name, entry.summary, entry.citation, parameters.specs()});
    }
    return infos;
  }

  // What `spec` describes; null and one line in `error` for an unknown name
  // (the known ones are listed), an unknown option or a value that does not
  // fit.
  auto Make(const std::string& kind,
            const std::string& spec,
            std::string* error) const
      -> decltype(std::declval<Factory>()(nullptr)) {
    std::string name;
    std::map<std::string, std::string> options;
    if (!ParseSpec(kind, spec, &name, &options, error)) return nullptr;
    const Entry* const entry = Find(name);
    if (entry == nullptr) {
      std::string names;
      for (const Entry& known : entries_) {
        names += (names.empty() ? "" : ", ") + known.name;
      }
      *error = "unknown " + kind + " '" + name + "' (known: " + names + ")";
      return nullptr;
    }
    Parameters parameters(options);
    auto method = entry->factory(&parameters);
    const std::string problem = parameters.Error();
    if (problem.empty()) return method;
    *error = kind + " '" + name + "': " + problem;
    return nullptr;
  }

 private:
  std::vector<Entry> entries_;  // by name
};

}  // namespace internal
}  // namespace granopt

#endif  // GRANOPT_SOLVERS_METHOD_REGISTRY_H_
