#include "granular/neighbor_list.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "solvers/format.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

// Of an adaptive list, see there.
constexpr double kMinSkin = 0.05;
constexpr double kMaxSkin = 0.8;
constexpr int kFewEvaluations = 20;
constexpr int kManyEvaluations = 200;

struct Entry {
  int i, j;
  Image image;
};

bool IsBefore(const Entry& a, const Entry& b) {
  return a.j != b.j ? a.j < b.j : a.image < b.image;
}

// Most rows have two or three entries.
void SortRow(Entry* begin, Entry* end) {
  constexpr int kShort = 16;
  if (end - begin > kShort) return std::sort(begin, end, IsBefore);
  for (Entry* next = begin + 1; next < end; ++next) {
    const Entry entry = *next;
    Entry* to = next;
    for (; to > begin && IsBefore(entry, to[-1]); --to) *to = to[-1];
    *to = entry;
  }
}

// The grains of one size class, binned in fractional coordinates.
struct Level {
  double max_radius = 0.0;
  std::array<int, 3> cells = {1, 1, 1};
  std::array<double, 3> width = {1.0, 1.0, 1.0};  // of a cell
  std::vector<int> start;                         // cells + 1
  std::vector<int> members;                       // grains, by cell
  std::vector<double> place;                      // their d coordinates,
  std::vector<double> radius;                     // and their radii
};

// Cells in one direction, seen from another: the first, their number, and how
// many cell lengths away their image is.
struct Step {
  int cell;
  int count;
  int turns;
};

// The cells home - reach ... home + reach of a ring of `cells`; `join`: in
// runs.
void SetSteps(
    int home, int reach, int cells, bool join, std::vector<Step>* steps) {
  steps->clear();
  Step next = {home - reach, 1, 0};
  for (; next.cell < 0; next.cell += cells) --next.turns;
  for (int left = 2 * reach + 1; left > 0; left -= next.count) {
    if (next.cell == cells) next = {0, 1, next.turns + 1};
    if (join) next.count = std::min(left, cells - next.cell);
    steps->push_back(next);
    next.cell += next.count;
  }
}

bool IsPositive(const Image& n) {
  for (int k = 0; k < 3; ++k) {
    if (n[k] != 0) return n[k] > 0;
  }
  return false;
}

// The grains in the reduced cell, in one grid for each size class.
template <int d>
class Grids {
 public:
  Grids(const Box& box,
        const Eigen::MatrixXd& positions,
        const Eigen::VectorXd& radii,
        double skin)
      : radii_(radii), skin_(skin), box_(box.Reduced(&transform_)) {
    Wrap(positions);
    SetLevels();
  }

  // What one thread needs besides.
  struct Workspace {
    std::vector<Step> steps[3] = {{{0, 1, 0}}, {{0, 1, 0}}, {{0, 1, 0}}};
    std::vector<int> found;
  };

  // Adds the pairs of grain i with grains of its own and larger classes. False
  // with a line in `refused` if it reaches too many images.
  bool FindPairs(int i,
                 Workspace* workspace,
                 std::vector<Entry>* entries,
                 std::string* refused) const {
    std::vector<Step>* const steps = workspace->steps;
    for (std::size_t a = level_[i]; a < levels_.size(); ++a) {
      const Level& l = levels_[a];
      if (l.members.empty()) continue;
      const double range = (radii_[i] + l.max_radius + skin_) * (1.0 + 1e-12);
      int home[3];
      CellOf(l, i, home);
      for (int k = 0; k < d; ++k) {
        const double cells = range / l.width[k];
        if (!(cells <= static_cast<double>(kMaxImages) * l.cells[k])) {
          *refused = "grain " + std::to_string(i) + ": range " +
                     std::to_string(range) + " needs more than " +
                     std::to_string(kMaxImages) +
                     " images of a cell of height " +
                     std::to_string(box_.Height(k));
          return false;
        }
        SetSteps(home[k],
                 static_cast<int>(cells) + 1,
                 l.cells[k],
                 /*join=*/k == d - 1,
                 &steps[k]);
      }
      // Cells that differ in the last direction only lie one after the other.
      const std::vector<Step>& last = steps[d - 1];
      for (const Step& s0 : steps[0]) {
        for (const Step& s1 : d == 3 ? steps[1] : last) {
          for (const Step& s2 : d == 3 ? last : steps[2]) {
            const int row = d == 2
                                ? s0.cell * l.cells[1]
                                : (s0.cell * l.cells[1] + s1.cell) * l.cells[2];
            const Step& run = d == 2 ? s1 : s2;
            FindInRun(i,
                      l,
                      static_cast<int>(a) > level_[i],
                      l.start[row + run.cell],
                      l.start[row + run.cell + run.count],
                      {s0.turns, s1.turns, s2.turns},
                      &workspace->found,
                      entries);
          }
        }
      }
    }
    return true;
  }

 private:
  // Into the cell; the list's images refer to the positions as given.
  void Wrap(const Eigen::MatrixXd& positions) {
    const int n = static_cast<int>(radii_.size());
    at_.resize(static_cast<std::size_t>(d) * n);
    fraction_.resize(d, n);
    wrap_.resize(n);
    for (int i = 0; i < n; ++i) {
      double p[3];
      for (int k = 0; k < d; ++k) p[k] = positions(k, i);
      wrap_[i] = box_.CellOf(p);
      for (int k = 0; k < d; ++k) {
        double shift = 0.0;
        for (int c = 0; c < d; ++c) shift += box_.edges()(k, c) * wrap_[i][c];
        at_[d * i + k] = p[k] - shift;
      }
      for (int k = 0; k < d; ++k) {
        double f = 0.0;
        for (int c = 0; c < d; ++c) f += box_.inverse()(k, c) * at_[d * i + c];
        // Rounding may leave the cell by an ulp; the bin is then the nearest
        // one.
        fraction_(k, i) = std::min(std::max(f, 0.0), 1.0 - 1e-16);
      }
    }
  }

  // Size classes: radii in [s, 2 s) with s = r_min 2^level.
  void SetLevels() {
    const int n = static_cast<int>(radii_.size());
    const double min_radius = radii_.minCoeff();
    std::vector<int> population;
    level_.resize(n);
    for (int i = 0; i < n; ++i) {
      const double ratio = radii_[i] / min_radius;
      level_[i] = ratio < 2.0 ? 0 : std::ilogb(ratio);
      if (level_[i] >= static_cast<int>(levels_.size())) {
        levels_.resize(level_[i] + 1);
        population.resize(level_[i] + 1, 0);
      }
      Level& l = levels_[level_[i]];
      l.max_radius = std::max(l.max_radius, radii_[i]);
      ++population[level_[i]];
    }
    for (std::size_t a = 0; a < levels_.size(); ++a) {
      if (population[a] > 0) {
        SetLevel(static_cast<int>(a), population[a], &levels_[a]);
      }
    }
  }

  void SetLevel(int a, int population, Level* level) const {
    Level& l = *level;
    const int n = static_cast<int>(radii_.size());
    const double width = 2.0 * l.max_radius + skin_;
    // No more cells a side than the grains can fill.
    const int most =
        static_cast<int>(std::ceil(std::pow(2.0 * population, 1.0 / d))) + 1;
    int total = 1;
    for (int k = 0; k < d; ++k) {
      const double fit = std::floor(box_.Height(k) / width);
      l.cells[k] = std::max(1, static_cast<int>(std::min<double>(fit, most)));
      l.width[k] = box_.Height(k) / l.cells[k];
      total *= l.cells[k];
    }
    const auto cell_index = [&](int i) {
      int c[3];
      CellOf(l, i, c);
      int index = c[0];
      for (int k = 1; k < d; ++k) index = index * l.cells[k] + c[k];
      return index;
    };
    l.start.assign(total + 1, 0);
    l.members.resize(population);
    for (int i = 0; i < n; ++i) {
      if (level_[i] == a) ++l.start[cell_index(i) + 1];
    }
    for (int k = 0; k < total; ++k) l.start[k + 1] += l.start[k];
    std::vector<int> fill(l.start.begin(), l.start.end() - 1);
    for (int i = 0; i < n; ++i) {
      if (level_[i] == a) l.members[fill[cell_index(i)]++] = i;
    }
    l.place.resize(static_cast<std::size_t>(d) * population);
    l.radius.resize(population);
    for (int q = 0; q < population; ++q) {
      const int i = l.members[q];
      for (int k = 0; k < d; ++k) l.place[d * q + k] = at_[d * i + k];
      l.radius[q] = radii_[i];
    }
  }

  void CellOf(const Level& l, int i, int* c) const {
    for (int k = 0; k < d; ++k) {
      c[k] = std::min(l.cells[k] - 1,
                      static_cast<int>(fraction_(k, i) * l.cells[k]));
    }
  }

  // Of grain i and members begin ... end - 1 of a class, their image
  // `cell_image` lengths of the reduced cell away.
  void FindInRun(int i,
                 const Level& l,
                 bool is_larger,
                 int begin,
                 int end,
                 const Image& cell_image,
                 std::vector<int>* found,
                 std::vector<Entry>* entries) const {
    const bool shifted =
        cell_image[0] != 0 || cell_image[1] != 0 || cell_image[2] != 0;
    // x_i less the image's shift.
    double from[d];
    for (int k = 0; k < d; ++k) {
      from[k] = at_[d * i + k];
      if (!shifted) continue;
      for (int m = 0; m < d; ++m) {
        from[k] -= box_.edges()(k, m) * cell_image[m];
      }
    }
    // Of a class with itself each pair is found once.
    const int least = is_larger ? 0 : shifted ? i : i + 1;
    const double reach = radii_[i] + skin_;
    // Without branches, which would be guessed wrong half of the time.
    if (static_cast<int>(found->size()) < end - begin) {
      found->resize(end - begin);
    }
    int* const near = found->data();
    int count = 0;
    for (int q = begin; q < end; ++q) {
      double r2 = 0.0;
      for (int k = 0; k < d; ++k) {
        const double r = from[k] - l.place[d * q + k];
        r2 += r * r;
      }
      const double cutoff = reach + l.radius[q];
      near[count] = l.members[q];
      count += static_cast<int>(r2 < cutoff * cutoff) &
               static_cast<int>(l.members[q] >= least);
    }
    for (int f = 0; f < count; ++f) {
      const int j = near[f];
      // j's image is at x_j + H cell_image: r = x_i - x_j - H cell_image.
      if (j == i && (!shifted || IsPositive(cell_image))) continue;
      entries->push_back(MakeEntry(i, j, cell_image));
    }
  }

  // From wrapped to given positions: x_i = p_i - H wrap_i.
  Entry MakeEntry(int i, int j, const Image& cell_image) const {
    Image reduced = {0, 0, 0};
    for (int k = 0; k < d; ++k) {
      reduced[k] = wrap_[j][k] - wrap_[i][k] - cell_image[k];
    }
    Entry entry = {i, j, {0, 0, 0}};
    for (int k = 0; k < d; ++k) {
      for (int m = 0; m < d; ++m) {
        entry.image[k] += transform_(k, m) * reduced[m];
      }
    }
    if (i == j ? !IsPositive(entry.image) : j < i) {
      std::swap(entry.i, entry.j);
      for (int k = 0; k < d; ++k) entry.image[k] = -entry.image[k];
    }
    return entry;
  }

  const Eigen::VectorXd& radii_;
  const double skin_;
  Eigen::Matrix3i transform_;  // before box_, which sets it
  const Box box_;
  std::vector<double> at_;    // d a grain, in the cell
  Eigen::MatrixXd fraction_;  // d x N, of the cell's edges
  std::vector<Image> wrap_;
  std::vector<int> level_;  // of each grain
  std::vector<Level> levels_;
};

// Pieces of so many rows, for threads.
constexpr int kPiece = 4096;

// Compressed by rows, each in order.
void Compress(int n,
              std::vector<std::vector<Entry>>* found_by,
              std::size_t num_entries,
              NeighborList* list) {
  list->row_start.assign(n + 1, 0);
  for (const std::vector<Entry>& entries : *found_by) {
    for (const Entry& e : entries) ++list->row_start[e.i + 1];
  }
  for (int i = 0; i < n; ++i) list->row_start[i + 1] += list->row_start[i];
  std::vector<Entry> sorted(num_entries);
  std::vector<int> fill(list->row_start.begin(), list->row_start.end() - 1);
  for (std::vector<Entry>& entries : *found_by) {
    for (const Entry& e : entries) sorted[fill[e.i]++] = e;
    std::vector<Entry>().swap(entries);
  }
  list->i.resize(num_entries);
  list->j.resize(num_entries);
  list->image.resize(num_entries);
  ForEach(static_cast<int>(found_by->size()), [&](int piece) {
    const int end_row = std::min(n, (piece + 1) * kPiece);
    for (int i = piece * kPiece; i < end_row; ++i) {
      SortRow(sorted.data() + list->row_start[i],
              sorted.data() + list->row_start[i + 1]);
      for (int p = list->row_start[i]; p < list->row_start[i + 1]; ++p) {
        list->i[p] = i;
        list->j[p] = sorted[p].j;
        list->image[p] = sorted[p].image;
      }
    }
  });
}

template <int d>
bool Build(const Box& box,
           const Eigen::MatrixXd& positions,
           const Eigen::VectorXd& radii,
           double skin,
           NeighborList* list,
           std::string* error) {
  const int n = static_cast<int>(radii.size());
  // Beyond this ratio small grains are lost in the rounding of large ones.
  constexpr double kMostRatio = 1e9;
  int smallest;
  if (radii.minCoeff(&smallest) < radii.maxCoeff() / kMostRatio) {
    *error = Format(
        "grain %d: radius = %g is more than 1e9 times smaller than the largest",
        smallest,
        radii[smallest]);
    return false;
  }
  const int pieces = (n + kPiece - 1) / kPiece;
  std::vector<std::vector<Entry>> found_by(pieces);
  std::vector<std::string> refused_by(pieces);
  {
    const Grids<d> grids(box, positions, radii, skin);
    ForEach(pieces, [&](int piece) {
      const int end_row = std::min(n, (piece + 1) * kPiece);
      std::vector<Entry>& entries = found_by[piece];
      entries.reserve(static_cast<std::size_t>(end_row - piece * kPiece) *
                      (d == 2 ? 4 : 8));
      typename Grids<d>::Workspace workspace;
      for (int i = piece * kPiece; i < end_row; ++i) {
        if (!grids.FindPairs(i, &workspace, &entries, &refused_by[piece])) {
          return;
        }
      }
    });
  }
  std::size_t num_entries = 0;
  for (int piece = 0; piece < pieces; ++piece) {
    if (!refused_by[piece].empty()) {
      *error = refused_by[piece];
      return false;
    }
    num_entries += found_by[piece].size();
  }
  constexpr int kMostEntries = std::numeric_limits<int>::max() / 8;
  if (num_entries > static_cast<std::size_t>(kMostEntries)) {
    *error = "more than " + std::to_string(kMostEntries) + " near pairs";
    return false;
  }
  Compress(n, &found_by, num_entries, list);
  return true;
}

}  // namespace

bool BuildNeighborList(const Box& box,
                       const Eigen::MatrixXd& positions,
                       const Eigen::VectorXd& radii,
                       double skin,
                       NeighborList* list,
                       std::string* error) {
  return box.dimension() == 2
             ? Build<2>(box, positions, radii, skin, list, error)
             : Build<3>(box, positions, radii, skin, list, error);
}

AdaptiveNeighborList::AdaptiveNeighborList(double min_radius)
    : min_radius_(min_radius), skin_(kMinSkin * min_radius) {}

bool AdaptiveNeighborList::Renew(const Box& box,
                                 const Eigen::MatrixXd& positions,
                                 const Eigen::VectorXd& radii,
                                 std::string* error) {
  const double narrowest = kMinSkin * min_radius_;
  if (version_ > 0 && evaluations_ < kFewEvaluations) {
    skin_ = std::min(1.5 * skin_, kMaxSkin * min_radius_);
  } else if (evaluations_ > kManyEvaluations) {
    skin_ = std::max(skin_ / 1.5, narrowest);
  }
  if (!BuildNeighborList(box, positions, radii, skin_, this, error)) {
    if (!(skin_ > narrowest)) return false;
    skin_ = narrowest;
    if (!BuildNeighborList(box, positions, radii, skin_, this, error)) {
      return false;
    }
  }
  ++version_;
  evaluations_ = 0;
  return true;
}

}  // namespace granopt
