// The genetic algorithm of Zohdi, Int. J. Solids Struct. 42 (2005) 539,
// sec. 8.1.

#include <algorithm>
#include <numeric>
#include <string>
#include <vector>

#include "solvers/format.h"
#include "solvers/search/search.h"

namespace granopt {
namespace {

// Steps 1 to 6:
//   1 a population of S random strings K^i
//   2 the value of each
//   3 rank them
//   4 mate neighbours of the ranking: of K^i, K^(i+1) come
//       U K^i + (1 - U) K^(i+1)  and  U' K^i + (1 - U') K^(i+1),
//     U, U' uniform in [0, 1], other ones for each component
//   5 keep the first K parents and their K offspring
//   6 go on with them and M = S - 2 K new random strings.
// Parents keep their values, so that the best one never rises. Every `restart`
// generations the box is rescaled around the best string, which alone is kept.
//
// Deviations: none known; that the box shrinks by a half, cut to the original
// one, and that the first pairs are (1, 2), (3, 4), ... the paper leaves open.
// With the defaults 20 + 18 (6 + 8) + 2 19 = 310 strings are evaluated, which
// is the paper's number.
class GeneticAlgorithm : public SearchMethod {
 public:
  explicit GeneticAlgorithm(Parameters* parameters)
      : population_(parameters->Int("population", 20, 2, "strings S")),
        generations_(parameters->Int(
            "generations", 20, 1, "after the first population, at most")),
        parents_(parameters->Int("parents", 6, 2, "K, even, at most S / 2")),
        restart_(parameters->Int(
            "restart", 10, 1, "generations between rescalings of the box")),
        shrink_(parameters->Double(
            "shrink", 0.5, 0.01, 1.0, "sides of the box at each rescaling")) {
    if (parents_ % 2 != 0 || 2 * parents_ > population_) {
      parameters->Refuse("parents",
                         Format("%d", parents_),
                         Format("must be even and at most half of "
                                "population=%d",
                                population_));
    }
  }

 protected:
  void Run(SearchRun* run) const override {
    struct Member {
      std::vector<double> string;
      double value;
    };
    const int n = run->size();
    UniformRandom random(run->seed());
    std::vector<double> low(n, 0.0), high(n, 1.0);
    std::vector<Member> members;
    // Evaluates and adds them; ranks all.
    const auto add = [&](const std::vector<std::vector<double>>& strings) {
      std::vector<double> values;
      const bool goes_on = run->Evaluate(strings, &values);
      for (std::size_t s = 0; s < strings.size(); ++s) {
        members.push_back({strings[s], values[s]});
      }
      std::stable_sort(
          members.begin(), members.end(), [](const Member& a, const Member& b) {
            return a.value < b.value;
          });
      return goes_on;
    };
    std::vector<std::vector<double>> first =
        RandomStrings(population_, low, high, &random);
    if (run->HasStart()) first[0] = run->Start();
    if (!add(first)) return;
    double scale = 1.0;
    for (int g = 1; g <= generations_; ++g) {
      std::vector<std::vector<double>> strings;
      if (g % restart_ == 0) {
        scale *= shrink_;
        for (int k = 0; k < n; ++k) {
          const double best = members[0].string[k];
          low[k] = std::max(0.0, best - 0.5 * scale);
          high[k] = std::min(1.0, best + 0.5 * scale);
        }
        members.resize(1);
        strings = RandomStrings(population_ - 1, low, high, &random);
      } else {
        members.resize(parents_);
        for (int p = 0; p < parents_; p += 2) {
          for (int child = 0; child < 2; ++child) {
            std::vector<double> string(n);
            for (int k = 0; k < n; ++k) {
              const double u = random();
              string[k] = u * members[p].string[k] +
                          (1.0 - u) * members[p + 1].string[k];
            }
            strings.push_back(std::move(string));
          }
        }
        for (auto& string :
             RandomStrings(population_ - 2 * parents_, low, high, &random)) {
          strings.push_back(std::move(string));
        }
      }
      if (!add(strings)) return;
    }
    run->set_message(Format("%d generations", generations_));
  }

 private:
  const int population_, generations_, parents_, restart_;
  const double shrink_;
};

}  // namespace

REGISTER_SEARCH(
    genetic_algorithm,
    GeneticAlgorithm,
    "Ranks strings, mates neighbours of the ranking, keeps parents; "
    "rescales its box",
    "Zohdi, Int. J. Solids Struct. 42 (2005) 539, sec. 8.1; Holland "
    "(1975); Davis (1991)");

}  // namespace granopt
