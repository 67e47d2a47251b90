// granopt: a multifrontal Cholesky factorization for matrices of small blocks.
//
// A = L L^T of a permuted matrix. Columns with (nearly) the same pattern form
// supernodes; each gathers its rows of A and what its children in the
// elimination tree leave in one dense matrix, the front, factors its own
// columns and hands the rest on (Duff & Reid, ACM Trans. Math. Softw. 9 (1983)
// 302; Liu, SIAM Rev. 34 (1992) 82). Fronts of networks in the plane are small,
// 20 to 300 rows, where a call of a BLAS costs as much as its work: the dense
// kernels are our own (dense_panel.inc), and pattern, ordering and assembly
// know blocks of the 2 x 2 or 3 x 3 entries of two points instead of entries.

#ifndef GRANOPT_SOLVERS_MULTIFRONTAL_CHOLESKY_H_
#define GRANOPT_SOLVERS_MULTIFRONTAL_CHOLESKY_H_

#include <cstdint>
#include <vector>

#include "solvers/dense_panel.h"
#include "solvers/second_order.h"

namespace granopt {

class MultifrontalCholesky {
 public:
  // Orders by approximate minimum degree (of blocks, if the pattern consists of
  // such) and finds the supernodes. `lower`: the lower triangle, rows in
  // increasing order. False if an entry of the diagonal is missing.
  bool Analyze(const SparseMatrix& lower);

  // Of the matrix with these values (in the order of the analyzed one's) plus
  // shift 1. False if it is not positive definite.
  bool Factorize(const double* values, double shift);

  // x = A^-1 b; b and x may be the same array.
  void Solve(const double* b, double* x);

  int size() const { return size_; }
  int block_size() const { return block_; }
  // Entries of L without those that supernodes are padded with, and with them.
  std::int64_t num_nonzeros() const { return num_nonzeros_; }
  std::int64_t num_stored() const {
    return offset_.empty() ? 0 : offset_.back();
  }
  // Multiplications of one factorization.
  double flops() const { return flops_; }
  // Of the factor and its work space.
  double Bytes() const;

  // Instead of the fastest, for tests and measurements.
  void set_panel(const DensePanel& panel) { panel_ = &panel; }

 private:
  struct Graph;  // of blocks

  bool Order(const SparseMatrix& lower, Graph* graph);
  void Permute(Graph* graph) const;
  void FindSupernodes(const Graph& graph, const std::vector<int>& parent);
  void FindRows(const Graph& graph);
  void PlaceEntries(const SparseMatrix& lower, const Graph& graph);

  const DensePanel* panel_ = &FastestPanel();
  int size_ = 0;
  int block_ = 1;
  int blocks_ = 0;          // size_ / block_
  std::vector<int> order_;  // order_[k]: the block that comes k-th
  std::vector<int> place_;  // its inverse

  // Supernode s has block columns first_[s] to first_[s + 1] - 1 and block rows
  // rows_[row_start_[s]] to rows_[row_start_[s + 1] - 1] below them.
  std::vector<int> first_, row_start_, rows_;
  std::vector<int> super_;         // of a block column
  std::vector<int> super_parent_;  // -1: a root
  std::vector<int> num_children_;
  // Where each of its rows is in the front of its parent, in blocks.
  std::vector<int> relative_;
  // Its columns in factor_, by columns of stride_[s] doubles.
  std::vector<std::int64_t> offset_;
  std::vector<int> stride_;
  // Entries of A by supernodes: their number in values, and where they go.
  std::vector<int> entry_start_, entry_;
  std::vector<std::int64_t> entry_place_;
  std::vector<std::int64_t> diagonal_place_;  // of entry (i, i), by i
  std::int64_t stack_size_ = 0;
  std::int64_t num_nonzeros_ = 0;
  double flops_ = 0.0;

  std::vector<double> factor_, stack_, permuted_, below_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_MULTIFRONTAL_CHOLESKY_H_
