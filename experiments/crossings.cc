#include "experiments/crossings.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>

namespace granopt {

Crossings::Crossings(const std::vector<Level>& ladder, double force_unit)
    : force_unit_(force_unit) {
  for (const Level& level : ladder) {
    (level.absolute ? absolute_ : relative_).push_back(level);
  }
  const auto smaller = [](const Level& a, const Level& b) {
    return a.value < b.value;
  };
  std::sort(relative_.begin(), relative_.end(), smaller);
  std::sort(absolute_.begin(), absolute_.end(), smaller);
}

bool Crossings::Due(double max_gradient, double force_scale) const {
  return (!relative_.empty() &&
          max_gradient <= Bound(relative_.back(), force_scale)) ||
         (!absolute_.empty() &&
          max_gradient <= Bound(absolute_.back(), force_scale));
}

void Crossings::Note(const RunKey& key,
                     double max_gradient,
                     double force_scale,
                     const Work& work,
                     double energy,
                     std::vector<Event>* events) {
  for (std::vector<Level>* levels : {&relative_, &absolute_}) {
    while (!levels->empty() &&
           max_gradient <= Bound(levels->back(), force_scale)) {
      events->push_back({key, levels->back(), work, energy});
      levels->pop_back();
    }
  }
}

std::vector<int> ThinTrace(const std::vector<double>& residuals, int buckets) {
  const int n = static_cast<int>(residuals.size());
  std::set<int> kept;
  if (n == 0) return {};
  kept.insert(0);
  kept.insert(n - 1);
  const auto keep = [&](int begin, int end) {
    if (begin >= end) return;
    const auto first = residuals.begin();
    kept.insert(
        static_cast<int>(std::min_element(first + begin, first + end) - first));
    kept.insert(
        static_cast<int>(std::max_element(first + begin, first + end) - first));
  };
  for (int b = 0; b < buckets; ++b) {
    keep(static_cast<int>(static_cast<std::int64_t>(n) * b / buckets),
         static_cast<int>(static_cast<std::int64_t>(n) * (b + 1) / buckets));
    keep(static_cast<int>(std::pow(n, static_cast<double>(b) / buckets)),
         static_cast<int>(std::pow(n, static_cast<double>(b + 1) / buckets)));
  }
  return {kept.begin(), kept.end()};
}

}  // namespace granopt
