// granopt: the least value of an objective in a box, without its derivatives.
//
//   min P(K),  low_k <= K_k <= high_k
//
// for objectives that are not smooth, have many minima or are known with noise.
// A point is called a string. Methods hand over lists of strings, so that those
// of a list can be evaluated at the same time or on other machines.

#ifndef GRANOPT_SOLVERS_SEARCH_SEARCH_H_
#define GRANOPT_SOLVERS_SEARCH_SEARCH_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "solvers/random.h"
#include "solvers/registry.h"

namespace granopt {

// Writes the value of each string; +infinity (or NaN, which is taken for it)
// where there is none. Returning false, or not one value a string, ends the
// search; values are then not looked at.
using ListObjective =
    std::function<bool(const std::vector<std::vector<double>>& strings,
                       std::vector<double>* values)>;

struct SearchProblem {
  std::vector<double> low, high;  // low < high, finite
  ListObjective objective;
  // Where local methods begin, and the first string of others that take one;
  // empty: the middle of the box.
  std::vector<double> start;
  std::uint64_t seed = 1;
  // Most strings that are evaluated; 0: the method's own end.
  int budget = 0;
};

// After a list.
struct SearchRow {
  int strings = 0;  // evaluated so far
  double best = 0.0;
  double list_mean = 0.0;  // of its finite values
  std::vector<double> best_string;
};

struct SearchResult {
  std::vector<double> best;
  double value = 0.0;  // +infinity if no string has one
  int strings = 0;
  std::vector<SearchRow> history;
  std::string message;
};

// What a method sees of a problem: the unit box. ("It is important to scale the
// system variables", sec. 8.1.)
class SearchRun {
 public:
  explicit SearchRun(const SearchProblem& problem);

  int size() const { return static_cast<int>(problem_.low.size()); }
  // False once the search is to end. A list that exceeds the budget is
  // evaluated as far as that goes, and false is returned.
  bool Evaluate(const std::vector<std::vector<double>>& unit_strings,
                std::vector<double>* values);
  // The start, in the unit box.
  std::vector<double> Start() const;
  bool HasStart() const { return !problem_.start.empty(); }
  std::uint64_t seed() const { return problem_.seed; }
  bool ended() const { return ended_; }
  void set_message(const std::string& text) { result_.message = text; }

 private:
  friend class SearchMethod;
  const SearchProblem& problem_;
  SearchResult result_;
  bool ended_ = false;
};

class SearchMethod {
 public:
  virtual ~SearchMethod() = default;
  // Every random number comes from problem.seed: the same strings in the same
  // order whatever evaluates them.
  SearchResult Search(const SearchProblem& problem) const;

 protected:
  virtual void Run(SearchRun* run) const = 0;
};

// The method of "name" or "name:key=value,key=value"; null and one line in
// `error` for one that is unknown or has no such option.
std::unique_ptr<SearchMethod> CreateSearch(const std::string& spec,
                                           std::string* error);
bool HasSearch(const std::string& name);
// Names, lines, options, citations: what --list_methods prints.
std::string SearchTable();

// A number anywhere folded into [0, 1] as by mirrors at 0 and 1.
double Reflect(double u);
// `count` strings, uniform in the box from low to high.
std::vector<std::vector<double>> RandomStrings(int count,
                                               const std::vector<double>& low,
                                               const std::vector<double>& high,
                                               UniformRandom* random);

namespace internal {

using SearchFactory = std::unique_ptr<SearchMethod> (*)(Parameters*);
void RegisterSearch(const std::string& name,
                    const std::string& summary,
                    const std::string& citation,
                    SearchFactory factory);

}  // namespace internal
}  // namespace granopt

// As REGISTER_SOLVER, for the files in solvers/search/methods: the library
// `searches`.
#define REGISTER_SEARCH(name, Class, summary, citation)   \
  void GranoptRegister_##name() {                         \
    ::granopt::internal::RegisterSearch(                  \
        #name,                                            \
        summary,                                          \
        citation,                                         \
        [](::granopt::Parameters* parameters)             \
            -> std::unique_ptr<::granopt::SearchMethod> { \
          return std::make_unique<Class>(parameters);     \
        });                                               \
  }                                                       \
  static_assert(true, "")

#endif  // GRANOPT_SOLVERS_SEARCH_SEARCH_H_
