// Random strings, and nothing else: what every method has to beat.

#include <algorithm>

#include "solvers/search/search.h"

namespace granopt {
namespace {

class RandomSearch : public SearchMethod {
 public:
  explicit RandomSearch(Parameters* parameters)
      : strings_(parameters->Int("strings", 310, 1, "at most")),
        list_(parameters->Int("list", 20, 1, "strings handed over at once")) {}

 protected:
  void Run(SearchRun* run) const override {
    UniformRandom random(run->seed());
    const std::vector<double> low(run->size(), 0.0), high(run->size(), 1.0);
    std::vector<double> values;
    for (int done = 0; done < strings_; done += list_) {
      const int count = std::min(list_, strings_ - done);
      if (!run->Evaluate(RandomStrings(count, low, high, &random), &values)) {
        return;
      }
    }
  }

 private:
  const int strings_, list_;
};

}  // namespace

REGISTER_SEARCH(random_search,
                RandomSearch,
                "Strings uniform in the box",
                "Rastrigin, Autom. Remote Control 24 (1963) 1337");

}  // namespace granopt
