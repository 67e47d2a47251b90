// granopt: in which minimum a run ended.

#ifndef GRANOPT_EXPERIMENTS_MINIMA_H_
#define GRANOPT_EXPERIMENTS_MINIMA_H_

#include <algorithm>
#include <string>
#include <vector>

namespace granopt {

// The largest difference of a coordinate of a grain that is rigid in both,
// after the mean difference of those (a translation) has been removed. `a` and
// `b`: d N entries, grain by grain.
double RigidDistance(const std::vector<double>& a,
                     const std::vector<bool>& is_rattler_a,
                     const std::vector<double>& b,
                     const std::vector<bool>& is_rattler_b);

// Tells minima of one case, seed and step apart.
class Minima {
 public:
  // Two runs are in one minimum if their energies agree to kEnergyBound of the
  // energy and their RigidDistance() is at most kOverlapBound mean overlaps.
  static constexpr double kEnergyBound = 1e-6;
  static constexpr double kOverlapBound = 0.1;
  // A run that ends with more than this, in mean forces, is at no minimum.
  static constexpr double kResidualBound = 1e-6;
  // Unless Scales::vanishing is at most this: forces that fade unbalanced.
  static constexpr double kVanishingBound = 1e-9;

  // `displacements`: d N entries, grain by grain, from the common start.
  // Returns "A" for the first minimum seen, "B" for the next one, ..., "0" at E
  // = 0 or on the way there (Scales::vanishing), "-" if the residual is too
  // large.
  std::string Tag(double energy,
                  double residual,
                  double vanishing,
                  double mean_overlap,
                  const std::vector<double>& displacements,
                  const std::vector<bool>& is_rattler);
  // The first `letters` names are taken by minima that are not known here.
  void Reserve(int letters) { next_ = std::max(next_, letters); }

 private:
  struct Minimum {
    std::string name;
    double energy;
    std::vector<double> displacements;
    std::vector<bool> is_rattler;
  };
  std::vector<Minimum> minima_;
  int next_ = 0;
};

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_MINIMA_H_
