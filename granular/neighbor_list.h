// granopt: which grains could touch.

#ifndef GRANOPT_GRANULAR_NEIGHBOR_LIST_H_
#define GRANOPT_GRANULAR_NEIGHBOR_LIST_H_

#include <cstdint>
#include <string>
#include <vector>

#include "Eigen/Core"
#include "granular/box.h"

namespace granopt {

// All pairs (i, j, image) with
//   |x_i - x_j + H image| < r_i + r_j + skin,
// each once: i < j, or i = j with an image whose first non-zero entry is
// positive (a grain that touches itself across the cell). Rows are compressed
// by i and sorted by (j, image), so that sums over contacts do not depend on
// the skin.
struct NeighborList {
  std::vector<int> row_start;  // N + 1
  std::vector<int> i, j;
  std::vector<Image> image;

  int num_pairs() const { return static_cast<int>(j.size()); }
};

// Cells shorter than the range are served by as many images as needed; beyond 8
// in one direction (a cell height of an eighth of the range) the search is
// refused.
constexpr int kMaxImages = 8;

// Multi-level cell grid: grains are binned by size (factors of 2) and each is
// looked up in the grids of its own and of all coarser levels, so that the cost
// stays O(N) per level for any mixture of sizes. The search runs in a reduced
// cell, so that any shear is served alike. Positions (d x N) may lie in any
// image; radii N entries; skin >= 0. Returns false, with one line in `error`
// and the list as it was, where the search is refused.
bool BuildNeighborList(const Box& box,
                       const Eigen::MatrixXd& positions,
                       const Eigen::VectorXd& radii,
                       double skin,
                       NeighborList* list,
                       std::string* error);

// A list that is made again when a grain leaves its skin, whose width lies
// between 0.05 and 0.8 smallest radii and is adapted by counts: a list should
// serve between 20 and 200 evaluations.
class AdaptiveNeighborList : public NeighborList {
 public:
  explicit AdaptiveNeighborList(double min_radius);

  // Anew, with the narrowest skin where the cell is too short for a wide one.
  // Refused as by BuildNeighborList().
  bool Renew(const Box& box,
             const Eigen::MatrixXd& positions,
             const Eigen::VectorXd& radii,
             std::string* error);
  void CountEvaluation() { ++evaluations_; }

  double skin() const { return skin_; }
  // By how much a pair may come closer; the rest is for the rounding of
  // positions.
  double usable_skin() const { return 0.999 * skin_; }
  // How often it was made.
  std::int64_t version() const { return version_; }

 private:
  const double min_radius_;
  double skin_;
  std::int64_t version_ = 0;
  std::int64_t evaluations_ = 0;  // since then
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_NEIGHBOR_LIST_H_
