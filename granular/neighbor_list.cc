#include "granular/neighbor_list.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "solvers/format.h"

namespace granopt {
namespace {

struct Entry {
  int i, j;
  Image image;
};

// The grains of one size class, binned in fractional coordinates.
struct Level {
  double max_radius = 0.0;
  std::array<int, 3> cells = {1, 1, 1};
  std::vector<int> start;    // cells + 1
  std::vector<int> members;  // grains, by cell
};

bool IsPositive(const Image& n) {
  for (int k = 0; k < 3; ++k) {
    if (n[k] != 0) return n[k] > 0;
  }
  return false;
}

}  // namespace

bool BuildNeighborList(const Box& given_box,
                       const Eigen::MatrixXd& positions,
                       const Eigen::VectorXd& radii,
                       double skin,
                       NeighborList* list,
                       std::string* error) {
  const int n = static_cast<int>(radii.size());
  const int d = given_box.dimension();
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
  Eigen::MatrixXd x(d, n);
  Eigen::MatrixXd fraction(d, n);
  std::vector<Image> wrap(n);
  for (int i = 0; i < n; ++i) {
    double p[3];
    for (int k = 0; k < d; ++k) p[k] = positions(k, i);
    wrap[i] = box.CellOf(p);
    for (int k = 0; k < d; ++k) {
      double shift = 0.0;
      for (int c = 0; c < d; ++c) shift += box.edges()(k, c) * wrap[i][c];
      x(k, i) = p[k] - shift;
    }
    for (int k = 0; k < d; ++k) {
      double f = 0.0;
      for (int c = 0; c < d; ++c) f += box.inverse()(k, c) * x(c, i);
      // Rounding may leave the cell by an ulp; the bin is then the nearest one.
      fraction(k, i) = std::min(std::max(f, 0.0), 1.0 - 1e-16);
    }
  }

  // Size classes: radii in [s, 2 s) with s = r_min 2^level.
  const double min_radius = radii.minCoeff();
  const auto level_of = [&](int i) {
    return std::max(0, std::ilogb(radii[i] / min_radius));
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
  const auto cell_index = [d](const Level& l, const int* c) {
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
  }

  std::vector<Entry> entries;
  entries.reserve(static_cast<std::size_t>(n) * (d == 2 ? 4 : 8));
  for (int i = 0; i < n; ++i) {
    for (int a = level[i]; a < num_levels; ++a) {
      const Level& l = levels[a];
      if (population[a] == 0) continue;
      const double range = (radii[i] + l.max_radius + skin) * (1.0 + 1e-12);
      int home[3], reach[3] = {0, 0, 0};
      cell_of(l, i, home);
      for (int k = 0; k < d; ++k) {
        const double cell_width = box.Height(k) / l.cells[k];
        const double steps = std::ceil(range / cell_width);
        if (!(steps <= static_cast<double>(kMaxImages) * l.cells[k])) {
          *error = "grain " + std::to_string(i) + ": range " +
                   std::to_string(range) + " needs more than " +
                   std::to_string(kMaxImages) + " images of a cell of height " +
                   std::to_string(box.Height(k));
          return false;
        }
        reach[k] = static_cast<int>(steps);
      }
      int offset[3] = {0, 0, 0};
      for (offset[0] = -reach[0]; offset[0] <= reach[0]; ++offset[0]) {
        for (offset[1] = -reach[1]; offset[1] <= reach[1]; ++offset[1]) {
          for (offset[2] = -reach[2]; offset[2] <= reach[2]; ++offset[2]) {
            int c[3] = {0, 0, 0};
            Image cell_image = {0, 0, 0};
            double shift[3] = {0.0, 0.0, 0.0};
            bool shifted = false;
            for (int k = 0; k < d; ++k) {
              int target = home[k] + offset[k];
              // floor division
              int turns = target / l.cells[k];
              if (target % l.cells[k] < 0) --turns;
              c[k] = target - turns * l.cells[k];
              cell_image[k] = turns;
              shifted = shifted || turns != 0;
            }
            if (shifted) {
              for (int k = 0; k < d; ++k) {
                for (int m = 0; m < d; ++m) {
                  shift[k] += box.edges()(k, m) * cell_image[m];
                }
              }
            }
            const int cell = cell_index(l, c);
            for (int q = l.start[cell]; q < l.start[cell + 1]; ++q) {
              const int j = l.members[q];
              // j's image is at x_j + H cell_image: r = x_i - x_j - H
              // cell_image.
              if (a == level[i] && (j < i || (j == i && !shifted))) continue;
              if (j == i && IsPositive(cell_image)) continue;
              double r2 = 0.0;
              for (int k = 0; k < d; ++k) {
                const double r = x(k, i) - (x(k, j) + shift[k]);
                r2 += r * r;
              }
              const double cutoff = radii[i] + radii[j] + skin;
              if (!(r2 < cutoff * cutoff)) continue;
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
  if (entries.size() >
      static_cast<std::size_t>(std::numeric_limits<int>::max() / 8)) {
    *error = "more than " +
             std::to_string(std::numeric_limits<int>::max() / 8) +
             " near pairs";
    return false;
  }

  list->row_start.assign(n + 1, 0);
  for (const Entry& e : entries) ++list->row_start[e.i + 1];
  for (int i = 0; i < n; ++i) list->row_start[i + 1] += list->row_start[i];
  std::vector<int> order(entries.size());
  std::vector<int> fill(list->row_start.begin(), list->row_start.end() - 1);
  for (std::size_t e = 0; e < entries.size(); ++e) {
    order[fill[entries[e].i]++] = static_cast<int>(e);
  }
  list->i.resize(entries.size());
  list->j.resize(entries.size());
  list->image.resize(entries.size());
  for (int i = 0; i < n; ++i) {
    std::sort(order.begin() + list->row_start[i],
              order.begin() + list->row_start[i + 1],
              [&](int a, int b) {
                const Entry& ea = entries[a];
                const Entry& eb = entries[b];
                return ea.j != eb.j ? ea.j < eb.j : ea.image < eb.image;
              });
  }
  for (std::size_t p = 0; p < order.size(); ++p) {
    list->i[p] = entries[order[p]].i;
    list->j[p] = entries[order[p]].j;
    list->image[p] = entries[order[p]].image;
  }
  return true;
}

}  // namespace granopt
