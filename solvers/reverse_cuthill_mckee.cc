#include "solvers/reverse_cuthill_mckee.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "boost/graph/compressed_sparse_row_graph.hpp"
#include "boost/graph/cuthill_mckee_ordering.hpp"

namespace granopt {

std::vector<int> ReverseCuthillMcKee(const SparseMatrix& lower) {
  const auto n = static_cast<std::size_t>(lower.cols());
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  edges.reserve(2 * static_cast<std::size_t>(lower.nonZeros()));
  for (int j = 0; j < lower.cols(); ++j) {
    for (SparseMatrix::InnerIterator entry(lower, j); entry; ++entry) {
      if (entry.row() == j) continue;
      edges.emplace_back(entry.row(), j);
      edges.emplace_back(j, entry.row());
    }
  }
  std::sort(edges.begin(), edges.end());
  const boost::compressed_sparse_row_graph<boost::directedS> graph(
      boost::edges_are_sorted, edges.begin(), edges.end(), n);

  std::vector<boost::default_color_type> color(n);
  std::vector<std::size_t> degree(n);
  for (std::size_t v = 0; v < n; ++v) degree[v] = out_degree(v, graph);
  const auto index = get(boost::vertex_index, graph);
  std::vector<int> order(n);
  boost::cuthill_mckee_ordering(
      graph,
      order.rbegin(),
      boost::make_iterator_property_map(color.begin(), index),
      boost::make_iterator_property_map(degree.begin(), index));
  return order;
}

}  // namespace granopt
