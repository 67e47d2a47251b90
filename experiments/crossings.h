// granopt: what is kept of a method's way to the minimum: first crossings of
// levels, and the rows of a trace that a curve needs.

#ifndef GRANOPT_EXPERIMENTS_CROSSINGS_H_
#define GRANOPT_EXPERIMENTS_CROSSINGS_H_

#include <vector>

#include "experiments/comparison_records.h"

namespace granopt {

// Writes down first crossings.
class Crossings {
 public:
  // `force_unit`: the force that is 1 in units k = 1, box = 1.
  Crossings(const std::vector<Level>& ladder, double force_unit);
  // True if Note() would add something: the clock is read only then.
  bool Due(double max_gradient, double force_scale) const;
  // Appends an event for each level that is crossed for the first time.
  void Note(const RunKey& key,
            double max_gradient,
            double force_scale,
            const Work& work,
            double energy,
            std::vector<Event>* events);

 private:
  double Bound(const Level& level, double force_scale) const {
    return level.value * (level.absolute ? force_unit_ : force_scale);
  }

  const double force_unit_;
  std::vector<Level> relative_, absolute_;  // not crossed yet, smallest first
};

// The rows (indices) of a trace that a curve keeps: first and last, and the
// least and the largest residual of each of `buckets` equal parts and of each
// of `buckets` parts that are equal in the logarithm of the row. Increasing.
std::vector<int> ThinTrace(const std::vector<double>& residuals, int buckets);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CROSSINGS_H_
