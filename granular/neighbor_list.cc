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

template <int d>
bool Build(const Box& given_box,
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
  Eigen::Matrix3i transform;
  const Box box = given_box.Reduced(&transform);

  // Into the cell; the list's images refer to the positions as given.
  std::vector<double> at(static_cast<std::size_t>(d) * n);
  Eigen::MatrixXd fraction(d, n);
  std::vector<Image> wrap(n);
  for (int i = 0; i < n; ++i) {
    double p[3];
    for (int k = 0; k < d; ++k) p[k] = positions(k, i);
    wrap[i] = box.CellOf(p);
    for (int k = 0; k < d; ++k) {
      double shift = 0.0;
      for (int c = 0; c < d; ++c) shift += box.edges()(k, c) * wrap[i][c];
      at[d * i + k] = p[k] - shift;
    }
    for (int k = 0; k < d; ++k) {
      double f = 0.0;
      for (int c = 0; c < d; ++c) f += box.inverse()(k, c) * at[d * i + c];
      // Rounding may leave the cell by an ulp; the bin is then the nearest one.
      fraction(k, i) = std::min(std::max(f, 0.0), 1.0 - 1e-16);
    }
  }

  // Size classes: radii in [s, 2 s) with s = r_min 2^level.
  const double min_radius = radii.minCoeff();
  const auto level_of = [&](int i) {
    const double ratio = radii[i] / min_radius;
    return ratio < 2.0 ? 0 : std::ilogb(ratio);
  };
  std::vector<int> level(n);
  int num_levels = 1;
  for (int i = 0; i < n; ++i) {
    level[i] = level_of(i);
    num_levels = std::max(num_levels, level[i] + 1);
  }
  std::vector<Level> levels(num_levels);
  std::vector<int> population(num_levels, 0);
  for (int i = 0; i < n; ++i) {
    Level& l = levels[level[i]];
    l.max_radius = std::max(l.max_radius, radii[i]);
    ++population[level[i]];
  }
  const auto cell_index = [](const Level& l, const int* c) {
    int index = c[0];
    for (int k = 1; k < d; ++k) index = index * l.cells[k] + c[k];
    return index;
  };
  const auto cell_of = [&](const Level& l, int i, int* c) {
    for (int k = 0; k < d; ++k) {
      c[k] = std::min(l.cells[k] - 1,
                      static_cast<int>(fraction(k, i) * l.cells[k]));
    }
  };
  for (int a = 0; a < num_levels; ++a) {
    Level& l = levels[a];
    if (population[a] == 0) continue;
    const double width = 2.0 * l.max_radius + skin;
    // No more cells a side than the grains can fill.
    const int most =
        static_cast<int>(std::ceil(std::pow(2.0 * population[a], 1.0 / d))) + 1;
    int total = 1;
    for (int k = 0; k < d; ++k) {
      const double fit = std::floor(box.Height(k) / width);
      l.cells[k] = std::max(1, static_cast<int>(std::min<double>(fit, most)));
      l.width[k] = box.Height(k) / l.cells[k];
      total *= l.cells[k];
    }
    l.start.assign(total + 1, 0);
    l.members.resize(population[a]);
    int c[3];
    for (int i = 0; i < n; ++i) {
      if (level[i] != a) continue;
      cell_of(l, i, c);
      ++l.start[cell_index(l, c) + 1];
    }
    for (int k = 0; k < total; ++k) l.start[k + 1] += l.start[k];
    std::vector<int> fill(l.start.begin(), l.start.end() - 1);
    for (int i = 0; i < n; ++i) {
      if (level[i] != a) continue;
      cell_of(l, i, c);
      l.members[fill[cell_index(l, c)]++] = i;
    }
    l.place.resize(static_cast<std::size_t>(d) * population[a]);
    l.radius.resize(population[a]);
    for (int q = 0; q < population[a]; ++q) {
      const int i = l.members[q];
      for (int k = 0; k < d; ++k) l.place[d * q + k] = at[d * i + k];
      l.radius[q] = radii[i];
    }
  }

  // By rows, in pieces for threads.
  constexpr int kPiece = 4096;
  const int pieces = (n + kPiece - 1) / kPiece;
  std::vector<std::vector<Entry>> found_by(pieces);
  std::vector<std::string> refused_by(pieces);
  ForEach(pieces, [&](int piece) {
    const int end_row = std::min(n, (piece + 1) * kPiece);
    std::vector<Entry>& entries = found_by[piece];
    entries.reserve(static_cast<std::size_t>(end_row - piece * kPiece) *
                    (d == 2 ? 4 : 8));
    std::vector<Step> steps[3] = {{{0, 1, 0}}, {{0, 1, 0}}, {{0, 1, 0}}};
    std::vector<int> found;
    for (int i = piece * kPiece; i < end_row; ++i) {
      for (int a = level[i]; a < num_levels; ++a) {
        const Level& l = levels[a];
        if (population[a] == 0) continue;
        const double range = (radii[i] + l.max_radius + skin) * (1.0 + 1e-12);
        int home[3];
        cell_of(l, i, home);
        for (int k = 0; k < d; ++k) {
          const double cells = range / l.width[k];
          if (!(cells <= static_cast<double>(kMaxImages) * l.cells[k])) {
            refused_by[piece] = "grain " + std::to_string(i) + ": range " +
                                std::to_string(range) + " needs more than " +
                                std::to_string(kMaxImages) +
                                " images of a cell of height " +
                                std::to_string(box.Height(k));
            return;
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
              const Image cell_image = {s0.turns, s1.turns, s2.turns};
              const bool shifted =
                  s0.turns != 0 || s1.turns != 0 || s2.turns != 0;
              // x_i less the image's shift.
              double from[d];
              for (int k = 0; k < d; ++k) {
                from[k] = at[d * i + k];
                if (!shifted) continue;
                for (int m = 0; m < d; ++m) {
                  from[k] -= box.edges()(k, m) * cell_image[m];
                }
              }
              const int row =
                  d == 2 ? s0.cell * l.cells[1]
                         : (s0.cell * l.cells[1] + s1.cell) * l.cells[2];
              const Step& run = d == 2 ? s1 : s2;
              const int begin = l.start[row + run.cell];
              const int end = l.start[row + run.cell + run.count];
              // Of a level with itself each pair is found once.
              const int least = a > level[i] ? 0 : shifted ? i : i + 1;
              const double reach = radii[i] + skin;
              // Without branches, which would be guessed wrong half of the
              // time.
              if (static_cast<int>(found.size()) < end - begin) {
                found.resize(end - begin);
              }
              int count = 0;
              for (int q = begin; q < end; ++q) {
                double r2 = 0.0;
                for (int k = 0; k < d; ++k) {
                  const double r = from[k] - l.place[d * q + k];
                  r2 += r * r;
                }
                const double cutoff = reach + l.radius[q];
                found[count] = l.members[q];
                count += static_cast<int>(r2 < cutoff * cutoff) &
                         static_cast<int>(l.members[q] >= least);
              }
              for (int f = 0; f < count; ++f) {
                const int j = found[f];
                // j's image is at x_j + H cell_image: r = x_i - x_j - H
                // cell_image.
                if (j == i && (!shifted || IsPositive(cell_image))) continue;
                // From wrapped to given positions: x_i = p_i - H wrap_i.
                Image reduced = {0, 0, 0};
                for (int k = 0; k < d; ++k) {
                  reduced[k] = wrap[j][k] - wrap[i][k] - cell_image[k];
                }
                Entry entry = {i, j, {0, 0, 0}};
                for (int k = 0; k < d; ++k) {
                  for (int m = 0; m < d; ++m) {
                    entry.image[k] += transform(k, m) * reduced[m];
                  }
                }
                if (i == j ? !IsPositive(entry.image) : j < i) {
                  std::swap(entry.i, entry.j);
                  for (int k = 0; k < d; ++k) entry.image[k] = -entry.image[k];
                }
                entries.push_back(entry);
              }
            }
          }
        }
      }
    }
  });
  std::size_t num_entries = 0;
  for (int piece = 0; piece < pieces; ++piece) {
    if (!refused_by[piece].empty()) {
      *error = refused_by[piece];
      return false;
    }
    num_entries += found_by[piece].size();
  }
  if (num_entries >
      static_cast<std::size_t>(std::numeric_limits<int>::max() / 8)) {
    *error = "more than " +
             std::to_string(std::numeric_limits<int>::max() / 8) +
             " near pairs";
    return false;
  }

  list->row_start.assign(n + 1, 0);
  for (const std::vector<Entry>& entries : found_by) {
    for (const Entry& e : entries) ++list->row_start[e.i + 1];
  }
  for (int i = 0; i < n; ++i) list->row_start[i + 1] += list->row_start[i];
  // Into rows, each in order.
  std::vector<Entry> sorted(num_entries);
  std::vector<int> fill(list->row_start.begin(), list->row_start.end() - 1);
  for (std::vector<Entry>& entries : found_by) {
    for (const Entry& e : entries) sorted[fill[e.i]++] = e;
    std::vector<Entry>().swap(entries);
  }
  list->i.resize(num_entries);
  list->j.resize(num_entries);
  list->image.resize(num_entries);
  ForEach(pieces, [&](int piece) {
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

}  // namespace granopt
