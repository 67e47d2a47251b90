#include "solvers/multifrontal_cholesky.h"

#include <amd.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <numeric>

#include "solvers/diagonal.h"
#include "solvers/instruction_set.h"

namespace granopt {
namespace {

// The kernels work on four columns at a time and may overwrite up to three
// beyond the last one.
constexpr int kSpareColumns = 3;

int Even(int rows) { return rows + (rows & 1); }

// Do every B columns have the same block rows, all of them full?
template <int B>
bool HasBlocks(const SparseMatrix& lower) {
  const int* start = lower.outerIndexPtr();
  const int n = static_cast<int>(lower.cols());
  bool fits = n % B == 0;
  for (int j = 0; j < n && fits; j += B) {
    const int* first = lower.innerIndexPtr() + start[j];
    const int rows = start[j + 1] - start[j];
    fits = rows % B == 0;
    for (int k = 0; k < rows && fits; k += B) fits = first[k] % B == 0;
    for (int c = 0; c < B && fits; ++c) {
      // Column j + c begins with rows j + c to j + B - 1.
      fits = start[j + c + 1] - start[j + c] == rows - c;
      const int* column = lower.innerIndexPtr() + start[j + c] - c;
      for (int k = 0; k < rows && fits; k += B) {
        for (int r = k == 0 ? c : 0; r < B; ++r) {
          fits = fits && column[k + r] == first[k] + r;
        }
      }
    }
  }
  return fits;
}

int BlockSize(const SparseMatrix& lower) {
  return HasBlocks<2>(lower) ? 2 : HasBlocks<3>(lower) ? 3 : 1;
}

// Should a supernode of `columns` (in entries) be joined to its parent although
// that stores this part of zeros?
bool Relax(int columns, double zeros) {
  return columns <= 8 || (columns <= 32 && zeros < 0.4) ||
         (columns <= 96 && zeros < 0.1) || zeros < 0.03;
}

}  // namespace

const DensePanel& FastestPanel() {
#ifdef __x86_64__
  if (Runs(InstructionSet::AVX512)) return kAvx512Panel;
  if (Runs(InstructionSet::AVX2)) return kAvx2Panel;
#endif
  return kPortablePanel;
}

// Block rows below the diagonal by block columns: of the matrix as it was
// given, and of the permuted one with the number of each in `row`.
struct MultifrontalCholesky::Graph {
  std::vector<int> start, row;
  std::vector<int> below_start, below, from;
};

bool MultifrontalCholesky::Order(const SparseMatrix& lower, Graph* graph) {
  graph->start.assign(blocks_ + 1, 0);
  graph->row.reserve(lower.nonZeros() / (block_ * block_));
  for (int j = 0; j < blocks_; ++j) {
    const int column = j * block_;
    for (int k = lower.outerIndexPtr()[column];
         k < lower.outerIndexPtr()[column + 1];
         k += block_) {
      const int i = lower.innerIndexPtr()[k] / block_;
      if (i != j) graph->row.push_back(i);
    }
    graph->start[j + 1] = static_cast<int>(graph->row.size());
  }
  order_.resize(blocks_);
  static int none = 0;  // AMD refuses null pointers
  const int status = amd_order(blocks_,
                               graph->start.data(),
                               graph->row.empty() ? &none : graph->row.data(),
                               order_.data(),
                               nullptr,
                               nullptr);
  return status == AMD_OK;
}

namespace {

// The postorder of a forest: node k of it comes at place[k].
std::vector<int> Postorder(const std::vector<int>& parent) {
  const int n = static_cast<int>(parent.size());
  std::vector<int> first(n, -1), next(n, -1), place(n), path;
  std::vector<int> roots;
  for (int k = n - 1; k >= 0; --k) {
    if (parent[k] < 0) {
      roots.push_back(k);
    } else {
      next[k] = first[parent[k]];
      first[parent[k]] = k;
    }
  }
  int count = 0;
  while (!roots.empty()) {
    path.push_back(roots.back());
    roots.pop_back();
    while (!path.empty()) {
      const int k = path.back();
      if (first[k] >= 0) {
        path.push_back(first[k]);
        first[k] = next[first[k]];
      } else {
        place[k] = count++;
        path.pop_back();
      }
    }
  }
  return place;
}

// From the length of each list, ends of lists that follow one another: starts,
// once each has been filled from its end.
void Accumulate(std::vector<int>* counts) {
  std::partial_sum(counts->begin(), counts->end(), counts->begin());
}

// Entries of each column of L, with the diagonal, of a matrix in postorder:
// its row i is a subtree with the root i, of which only the leaves and where
// their paths meet count (Gilbert, Ng, Peyton, SIAM J. Matrix Anal. Appl. 15
// (1994) 1075).
std::vector<int> CountColumns(const std::vector<int>& parent,
                              const std::vector<int>& below_start,
                              const std::vector<int>& below) {
  const int n = static_cast<int>(parent.size());
  // The first node of each subtree, and what a column has beyond its children.
  std::vector<int> first(n), count(n, 0);
  std::iota(first.begin(), first.end(), 0);
  for (int k = 0; k < n; ++k) {
    if (first[k] == k) count[k] = 1;  // a leaf
    if (parent[k] < 0) continue;
    first[parent[k]] = std::min(first[parent[k]], first[k]);
    --count[parent[k]];
  }
  std::vector<int> last_leaf(n, -1), ancestor(n);
  std::iota(ancestor.begin(), ancestor.end(), 0);
  for (int k = 0; k < n; ++k) {
    for (int e = below_start[k]; e < below_start[k + 1]; ++e) {
      const int i = below[e];
      const int leaf = last_leaf[i];
      if (leaf >= first[k]) continue;  // within the subtree of k
      ++count[k];
      last_leaf[i] = k;
      if (leaf < 0) continue;
      int meet = leaf;
      while (meet != ancestor[meet]) meet = ancestor[meet];
      for (int a = leaf; a != meet;) {
        const int up = ancestor[a];
        ancestor[a] = meet;
        a = up;
      }
      --count[meet];
    }
    if (parent[k] >= 0) ancestor[k] = parent[k];
  }
  for (int k = 0; k < n; ++k) {
    if (parent[k] >= 0) count[parent[k]] += count[k];
  }
  return count;
}

}  // namespace

bool MultifrontalCholesky::Analyze(const SparseMatrix& lower) {
  size_ = static_cast<int>(lower.cols());
  for (int j = 0; j < size_; ++j) {
    if (DiagonalPlace(lower, j) < 0) return false;
  }
  block_ = BlockSize(lower);
  blocks_ = size_ / block_;
  Graph graph;
  if (!Order(lower, &graph)) return false;
  place_.resize(blocks_);
  for (int k = 0; k < blocks_; ++k) place_[order_[k]] = k;

  // The elimination tree (Liu 1990, with compressed paths), by the neighbours
  // of a row that come before it.
  std::vector<int> start(blocks_ + 1, 0), before(graph.row.size());
  for (int j = 0; j < blocks_; ++j) {
    for (int k = graph.start[j]; k < graph.start[j + 1]; ++k) {
      ++start[std::max(place_[j], place_[graph.row[k]])];
    }
  }
  Accumulate(&start);
  for (int j = 0; j < blocks_; ++j) {
    for (int k = graph.start[j]; k < graph.start[j + 1]; ++k) {
      const int a = place_[j], b = place_[graph.row[k]];
      before[--start[std::max(a, b)]] = std::min(a, b);
    }
  }
  std::vector<int> parent(blocks_, -1), ancestor(blocks_, -1);
  for (int k = 0; k < blocks_; ++k) {
    for (int e = start[k]; e < start[k + 1]; ++e) {
      for (int i = before[e]; i >= 0 && i < k;) {
        const int up = ancestor[i];
        ancestor[i] = k;
        if (up < 0) parent[i] = k;
        i = up;
      }
    }
  }
  // In postorder, so that supernodes are contiguous and fronts form a stack.
  const std::vector<int> post = Postorder(parent);
  std::vector<int> order(blocks_), tree(blocks_, -1);
  for (int k = 0; k < blocks_; ++k) {
    order[post[k]] = order_[k];
    if (parent[k] >= 0) tree[post[k]] = post[parent[k]];
  }
  order_.swap(order);
  for (int k = 0; k < blocks_; ++k) place_[order_[k]] = k;
  Permute(&graph);
  FindSupernodes(graph, tree);
  FindRows(graph);
  PlaceEntries(lower, graph);
  return true;
}

void MultifrontalCholesky::Permute(Graph* graph) const {
  graph->below_start.assign(blocks_ + 1, 0);
  graph->below.resize(graph->row.size());
  graph->from.resize(graph->row.size());
  for (int j = 0; j < blocks_; ++j) {
    for (int k = graph->start[j]; k < graph->start[j + 1]; ++k) {
      ++graph->below_start[std::min(place_[j], place_[graph->row[k]])];
    }
  }
  Accumulate(&graph->below_start);
  for (int j = 0; j < blocks_; ++j) {
    for (int k = graph->start[j]; k < graph->start[j + 1]; ++k) {
      const int a = place_[j], b = place_[graph->row[k]];
      const int to = --graph->below_start[std::min(a, b)];
      graph->below[to] = std::max(a, b);
      graph->from[to] = k;
    }
  }
}

void MultifrontalCholesky::FindSupernodes(const Graph& graph,
                                          const std::vector<int>& parent) {
  const std::vector<int> count =
      CountColumns(parent, graph.below_start, graph.below);
  num_nonzeros_ = 0;
  for (const int c : count) {
    num_nonzeros_ += static_cast<std::int64_t>(c) * block_ * block_ -
                     block_ * (block_ - 1) / 2;
  }
  // From left to right; each may swallow what is just left of it.
  struct Super {
    int first, last;
    int rows;       // below
    double filled;  // entries in blocks, without padding
    int parent;     // a column, -1: a root
  };
  std::vector<Super> supers;
  for (int k = 0; k < blocks_; ++k) {
    if (!supers.empty() && supers.back().parent == k &&
        supers.back().rows == count[k]) {
      // The same pattern.
      Super& last = supers.back();
      last.last = k;
      last.rows = count[k] - 1;
      last.filled += count[k];
      last.parent = parent[k];
    } else {
      supers.push_back(
          {k, k, count[k] - 1, static_cast<double>(count[k]), parent[k]});
    }
  }
  std::vector<Super> joined;
  for (const Super& super : supers) {
    joined.push_back(super);
    while (joined.size() > 1) {
      const Super& child = joined[joined.size() - 2];
      Super& self = joined.back();
      if (child.parent < self.first || child.parent > self.last) break;
      const int columns = self.last - child.first + 1;
      const double stored = 0.5 * columns * (columns + 1) +
                            static_cast<double>(columns) * self.rows;
      const double filled = child.filled + self.filled;
      if (!Relax(columns * block_, (stored - filled) / stored)) break;
      const Super both = {
          child.first, self.last, self.rows, filled, self.parent};
      joined.pop_back();
      joined.back() = both;
    }
  }
  const int n = static_cast<int>(joined.size());
  first_.resize(n + 1);
  super_.resize(blocks_);
  for (int s = 0; s < n; ++s) {
    first_[s] = joined[s].first;
    for (int k = joined[s].first; k <= joined[s].last; ++k) super_[k] = s;
  }
  first_[n] = blocks_;
  super_parent_.resize(n);
  num_children_.assign(n, 0);
  for (int s = 0; s < n; ++s) {
    super_parent_[s] = joined[s].parent < 0 ? -1 : super_[joined[s].parent];
    if (super_parent_[s] >= 0) ++num_children_[super_parent_[s]];
  }
}

void MultifrontalCholesky::FindRows(const Graph& graph) {
  const int n = static_cast<int>(super_parent_.size());
  std::vector<int> first_child(n, -1), next_child(n, -1);
  std::vector<int> seen(blocks_, -1);
  row_start_.assign(n + 1, 0);
  rows_.clear();
  for (int s = 0; s < n; ++s) {
    const int end = first_[s + 1];
    const auto begin = static_cast<std::ptrdiff_t>(rows_.size());
    const auto add = [&](int i) {
      if (i >= end && seen[i] != s) {
        seen[i] = s;
        rows_.push_back(i);
      }
    };
    for (int k = graph.below_start[first_[s]]; k < graph.below_start[end];
         ++k) {
      add(graph.below[k]);
    }
    for (int c = first_child[s]; c >= 0; c = next_child[c]) {
      for (int k = row_start_[c]; k < row_start_[c + 1]; ++k) add(rows_[k]);
    }
    std::sort(rows_.begin() + begin, rows_.end());
    row_start_[s + 1] = static_cast<int>(rows_.size());
    if (super_parent_[s] >= 0) {
      next_child[s] = first_child[super_parent_[s]];
      first_child[super_parent_[s]] = s;
    }
  }
  // Places in the parent's front, storage, and the height of the stack.
  relative_.resize(rows_.size());
  offset_.assign(n + 1, 0);
  stride_.resize(n);
  flops_ = 0.0;
  stack_size_ = 0;
  std::int64_t top = 0;
  std::vector<std::int64_t> held(n, 0);  // by the children of s
  std::size_t largest = 0;
  for (int s = 0; s < n; ++s) {
    const int columns = (first_[s + 1] - first_[s]) * block_;
    const int below = (row_start_[s + 1] - row_start_[s]) * block_;
    stride_[s] = Even(columns + below);
    largest = std::max(largest, static_cast<std::size_t>(stride_[s]));
    offset_[s + 1] =
        offset_[s] + static_cast<std::int64_t>(stride_[s]) * columns;
    for (int c = 0; c < columns; ++c) {
      const double m = columns + below - c;
      flops_ += 0.5 * m * m;
    }
    const int p = super_parent_[s];
    if (p >= 0) {
      int k = row_start_[p];
      for (int r = row_start_[s]; r < row_start_[s + 1]; ++r) {
        if (rows_[r] < first_[p + 1]) {
          relative_[r] = rows_[r] - first_[p];
        } else {
          while (rows_[k] != rows_[r]) ++k;
          relative_[r] = first_[p + 1] - first_[p] + k - row_start_[p];
        }
      }
    }
    const std::int64_t ld = Even(below);
    stack_size_ = std::max(stack_size_, top + (ld + kSpareColumns) * ld);
    top += ld * ld - held[s];
    if (p >= 0) held[p] += ld * ld;
  }
  below_.resize(largest);
}

void MultifrontalCholesky::PlaceEntries(const SparseMatrix& lower,
                                        const Graph& graph) {
  const int n = static_cast<int>(super_parent_.size());
  const int* start = lower.outerIndexPtr();
  entry_start_.assign(n + 1, 0);
  entry_.resize(lower.nonZeros());
  entry_place_.resize(lower.nonZeros());
  diagonal_place_.resize(size_);
  int to = 0;
  const auto add = [&](int entry, std::int64_t place) {
    entry_[to] = entry;
    entry_place_[to++] = place;
  };
  std::vector<int> local(blocks_);  // block rows in the front of s
  for (int s = 0; s < n; ++s) {
    const int columns = first_[s + 1] - first_[s];
    for (int k = 0; k < columns; ++k) local[first_[s] + k] = k;
    for (int r = row_start_[s]; r < row_start_[s + 1]; ++r) {
      local[rows_[r]] = columns + r - row_start_[s];
    }
    const std::int64_t stride = stride_[s];
    for (int k = first_[s]; k < first_[s + 1]; ++k) {
      std::int64_t corner =
          offset_[s] + (k - first_[s]) * block_ * (stride + 1);
      for (int c = 0; c < block_; ++c, corner += stride + 1) {
        const int column = order_[k] * block_ + c;
        diagonal_place_[column] = corner;
        for (int r = c; r < block_; ++r) {
          add(start[column] + r - c, corner + r - c);
        }
      }
      for (int e = graph.below_start[k]; e < graph.below_start[k + 1]; ++e) {
        const int i = graph.below[e];
        // Which of the two is the column as it was given.
        const bool swap = order_[i] < order_[k];
        const int j = swap ? order_[i] : order_[k];
        const int above = (graph.from[e] - graph.start[j] + 1) * block_;
        const std::int64_t block =
            offset_[s] + (k - first_[s]) * block_ * stride + local[i] * block_;
        for (int c = 0; c < block_; ++c) {
          // Column c lacks what is above the diagonal.
          const int entry = start[j * block_ + c] + above - c;
          for (int r = 0; r < block_; ++r) {
            add(entry + r, block + (swap ? r * stride + c : c * stride + r));
          }
        }
      }
    }
    entry_start_[s + 1] = to;
  }
}

double MultifrontalCholesky::Bytes() const {
  if (offset_.empty()) return 0.0;
  const double numbers = static_cast<double>(offset_.back() + stack_size_);
  return 8.0 * numbers + 12.0 * static_cast<double>(entry_.size()) +
         8.0 * static_cast<double>(rows_.size());
}

namespace {

// The lower triangle of a child's square, added to the front of its parent:
// blocks of B columns go to the panel or to the rest.
template <int B>
void ExtendAdd(int blocks,
               const int* relative,
               const double* child,
               int ld,
               int panel_blocks,
               double* panel,
               int panel_stride,
               double* rest,
               int rest_stride) {
  for (int j = 0; j < blocks; ++j) {
    const bool in_panel = relative[j] < panel_blocks;
    const int column =
        (in_panel ? relative[j] : relative[j] - panel_blocks) * B;
    const int stride = in_panel ? panel_stride : rest_stride;
    const int up = in_panel ? 0 : panel_blocks;
    double* to = (in_panel ? panel : rest) +
                 static_cast<std::ptrdiff_t>(column) * stride;
    const double* from = child + static_cast<std::ptrdiff_t>(j) * B * ld;
    for (int i = j; i < blocks; ++i) {
      double* target = to + (relative[i] - up) * B;
      const double* source = from + i * B;
      for (int c = 0; c < B; ++c) {
        for (int r = 0; r < B; ++r) {
          target[r + static_cast<std::ptrdiff_t>(c) * stride] +=
              source[r + static_cast<std::ptrdiff_t>(c) * ld];
        }
      }
    }
  }
}

}  // namespace

bool MultifrontalCholesky::Factorize(const double* values, double shift) {
  const int n = static_cast<int>(super_parent_.size());
  int widest = 0;
  for (const int stride : stride_) widest = std::max(widest, stride);
  factor_.resize(static_cast<std::size_t>(offset_[n]) +
                 static_cast<std::size_t>(kSpareColumns) * widest);
  stack_.resize(static_cast<std::size_t>(stack_size_));
  // Children whose rest is on the stack, from the bottom up.
  struct Held {
    int super;
    std::int64_t at;
  };
  std::vector<Held> held;
  std::int64_t top = 0;
  const auto extend_add = block_ == 2   ? ExtendAdd<2>
                          : block_ == 3 ? ExtendAdd<3>
                                        : ExtendAdd<1>;
  for (int s = 0; s < n; ++s) {
    const int panel_blocks = first_[s + 1] - first_[s];
    const int rest_blocks = row_start_[s + 1] - row_start_[s];
    const int columns = panel_blocks * block_;
    const int rest_rows = Even(rest_blocks * block_);
    double* panel = factor_.data() + offset_[s];
    std::memset(panel, 0, sizeof(double) * (offset_[s + 1] - offset_[s]));
    for (int e = entry_start_[s]; e < entry_start_[s + 1]; ++e) {
      factor_[entry_place_[e]] = values[entry_[e]];
    }
    if (shift != 0.0) {
      for (int k = first_[s]; k < first_[s + 1]; ++k) {
        for (int c = 0; c < block_; ++c) {
          factor_[diagonal_place_[order_[k] * block_ + c]] += shift;
        }
      }
    }
    double* rest = stack_.data() + top;
    for (int j = 0; j < rest_rows; ++j) {
      std::memset(rest + static_cast<std::ptrdiff_t>(j) * rest_rows + j,
                  0,
                  sizeof(double) * (rest_rows - j));
    }
    std::int64_t bottom = top;
    for (int c = 0; c < num_children_[s]; ++c) {
      const Held& child = held[held.size() - 1 - c];
      const int count = row_start_[child.super + 1] - row_start_[child.super];
      extend_add(count,
                 relative_.data() + row_start_[child.super],
                 stack_.data() + child.at,
                 Even(count * block_),
                 panel_blocks,
                 panel,
                 stride_[s],
                 rest,
                 rest_rows);
      bottom = child.at;
    }
    held.resize(held.size() - num_children_[s]);
    if (!panel_->factor(stride_[s], columns, panel, stride_[s])) return false;
    if (super_parent_[s] < 0) {
      top = bottom;
      continue;
    }
    // The odd row of padding, if there is one, begins a row earlier.
    panel_->update_lower(
        rest_rows, columns, panel + columns, stride_[s], rest, rest_rows);
    const std::int64_t size = static_cast<std::int64_t>(rest_rows) * rest_rows;
    if (bottom != top) {
      std::memmove(stack_.data() + bottom, rest, sizeof(double) * size);
    }
    held.push_back({s, bottom});
    top = bottom + size;
  }
  return true;
}

void MultifrontalCholesky::Solve(const double* b, double* x) {
  const int n = static_cast<int>(super_parent_.size());
  permuted_.resize(size_ + 2);
  double* y = permuted_.data();
  for (int k = 0; k < blocks_; ++k) {
    for (int c = 0; c < block_; ++c) {
      y[k * block_ + c] = b[order_[k] * block_ + c];
    }
  }
  double* below = below_.data();
  for (int s = 0; s < n; ++s) {
    const int columns = (first_[s + 1] - first_[s]) * block_;
    const int count = row_start_[s + 1] - row_start_[s];
    const int* rows = rows_.data() + row_start_[s];
    const double* panel = factor_.data() + offset_[s];
    const int stride = stride_[s];
    double* own = y + first_[s] * block_;
    for (int c = 0; c < columns; ++c) {
      const double* column = panel + static_cast<std::ptrdiff_t>(c) * stride;
      own[c] /= column[c];
      for (int r = c + 1; r < columns; ++r) own[r] -= column[r] * own[c];
    }
    const int height = Even(count * block_);
    std::memset(below, 0, sizeof(double) * height);
    panel_->subtract_product(
        height, columns, panel + columns, stride, own, below);
    for (int r = 0; r < count; ++r) {
      for (int c = 0; c < block_; ++c) {
        y[rows[r] * block_ + c] += below[r * block_ + c];
      }
    }
  }
  for (int s = n - 1; s >= 0; --s) {
    const int columns = (first_[s + 1] - first_[s]) * block_;
    const int count = row_start_[s + 1] - row_start_[s];
    const int* rows = rows_.data() + row_start_[s];
    const double* panel = factor_.data() + offset_[s];
    const int stride = stride_[s];
    double* own = y + first_[s] * block_;
    const int height = Even(count * block_);
    if (height > 0) below[height - 1] = 0.0;
    for (int r = 0; r < count; ++r) {
      for (int c = 0; c < block_; ++c) {
        below[r * block_ + c] = y[rows[r] * block_ + c];
      }
    }
    for (int c = columns - 1; c >= 0; --c) {
      const double* column = panel + static_cast<std::ptrdiff_t>(c) * stride;
      double sum = own[c] - panel_->product(height, column + columns, below);
      for (int r = c + 1; r < columns; ++r) sum -= column[r] * own[r];
      own[c] = sum / column[c];
    }
  }
  for (int k = 0; k < blocks_; ++k) {
    for (int c = 0; c < block_; ++c) {
      x[order_[k] * block_ + c] = y[k * block_ + c];
    }
  }
}

}  // namespace granopt
