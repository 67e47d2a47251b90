#include "solvers/search/search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace granopt {
namespace {

struct Entry {
  std::string name, summary, citation;
  internal::SearchFactory factory;
};

std::map<std::string, Entry>& Entries() {
  static std::map<std::string, Entry> entries;
  return entries;
}

const std::map<std::string, Entry>& RegisteredEntries() {
  ListPreconditioners();  // registers all that there is, once
  return Entries();
}

}  // namespace

namespace internal {

void RegisterSearch(const std::string& name,
                    const std::string& summary,
                    const std::string& citation,
                    SearchFactory factory) {
  Entries()[name] = {name, summary, citation, factory};
}

}  // namespace internal

bool HasSearch(const std::string& name) {
  return RegisteredEntries().count(name) > 0;
}

std::unique_ptr<SearchMethod> CreateSearch(const std::string& spec,
                                           std::string* error) {
  const std::size_t colon = spec.find(':');
  const std::string name = spec.substr(0, colon);
  const auto entry = RegisteredEntries().find(name);
  if (entry == RegisteredEntries().end()) {
    std::string names;
    for (const auto& known : RegisteredEntries()) {
      names += (names.empty() ? "" : ", ") + known.first;
    }
    *error = "unknown search '" + name + "' (known: " + names + ")";
    return nullptr;
  }
  std::map<std::string, std::string> values;
  std::size_t at = colon == std::string::npos ? spec.size() : colon + 1;
  while (at < spec.size()) {
    const std::size_t end = std::min(spec.find(',', at), spec.size());
    const std::string item = spec.substr(at, end - at);
    const std::size_t equals = item.find('=');
    if (equals == std::string::npos || equals == 0) {
      *error = "search '" + spec + "': '" + item + "' is not key=value";
      return nullptr;
    }
    if (!values.emplace(item.substr(0, equals), item.substr(equals + 1))
             .second) {
      *error = "search '" + spec + "': option '" + item.substr(0, equals) +
               "' is given twice";
      return nullptr;
    }
    at = end + 1;
  }
  Parameters parameters(values);
  std::unique_ptr<SearchMethod> method = entry->second.factory(&parameters);
  const std::string problem = parameters.Error();
  if (problem.empty()) return method;
  *error = "search '" + name + "': " + problem;
  return nullptr;
}

std::string SearchTable() {
  std::string table;
  for (const auto& [name, entry] : RegisteredEntries()) {
    Parameters parameters;
    entry.factory(&parameters);
    table += name + "\n    " + entry.summary + "\n";
    for (const Parameters::Spec& option : parameters.specs()) {
      table += "    " + option.key + "=" + option.default_value + "  (" +
               option.choices + ")  " + option.help + "\n";
    }
    table += "    [" + entry.citation + "]\n";
  }
  return table;
}

SearchRun::SearchRun(const SearchProblem& problem) : problem_(problem) {
  result_.value = std::numeric_limits<double>::infinity();
}

std::vector<double> SearchRun::Start() const {
  std::vector<double> unit(size(), 0.5);
  for (int k = 0; HasStart() && k < size(); ++k) {
    const double u = (problem_.start[k] - problem_.low[k]) /
                     (problem_.high[k] - problem_.low[k]);
    unit[k] = std::min(1.0, std::max(0.0, u));
  }
  return unit;
}

bool SearchRun::Evaluate(const std::vector<std::vector<double>>& unit_strings,
                         std::vector<double>* values) {
  const double kInfinity = std::numeric_limits<double>::infinity();
  values->assign(unit_strings.size(), kInfinity);
  if (ended_) return false;
  std::size_t count = unit_strings.size();
  bool fits = true;
  if (problem_.budget > 0) {
    const std::size_t left = problem_.budget - result_.strings;
    fits = count <= left;
    count = std::min(count, left);
  }
  ended_ = !fits;
  if (count == 0) return fits;
  std::vector<std::vector<double>> strings(count, std::vector<double>(size()));
  for (std::size_t s = 0; s < count; ++s) {
    for (int k = 0; k < size(); ++k) {
      const double u = std::min(1.0, std::max(0.0, unit_strings[s][k]));
      // Exact at both ends.
      strings[s][k] = (1.0 - u) * problem_.low[k] + u * problem_.high[k];
    }
  }
  std::vector<double> found;
  if (!problem_.objective(strings, &found)) {
    ended_ = true;
    return false;
  }
  SearchRow row;
  double sum = 0.0;
  int finite = 0;
  for (std::size_t s = 0; s < count; ++s) {
    if (std::isnan(found[s])) found[s] = kInfinity;
    (*values)[s] = found[s];
    if (std::isfinite(found[s])) {
      sum += found[s];
      ++finite;
    }
    if (found[s] < result_.value || result_.best.empty()) {
      result_.value = found[s];
      result_.best = strings[s];
    }
  }
  result_.strings += static_cast<int>(count);
  row.strings = result_.strings;
  row.best = result_.value;
  row.list_mean = finite > 0 ? sum / finite : kInfinity;
  row.best_string = result_.best;
  result_.history.push_back(row);
  return fits;
}

SearchResult SearchMethod::Search(const SearchProblem& problem) const {
  SearchRun run(problem);
  Run(&run);
  return run.result_;
}

double Reflect(double u) {
  if (!std::isfinite(u)) return 0.5;
  u = std::fabs(std::fmod(u, 2.0));
  return u > 1.0 ? 2.0 - u : u;
}

std::vector<std::vector<double>> RandomStrings(int count,
                                               const std::vector<double>& low,
                                               const std::vector<double>& high,
                                               UniformRandom* random) {
  std::vector<std::vector<double>> strings(count);
  for (auto& string : strings) {
    for (std::size_t k = 0; k < low.size(); ++k) {
      string.push_back(low[k] + (high[k] - low[k]) * (*random)());
    }
  }
  return strings;
}

}  // namespace granopt
