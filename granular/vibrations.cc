#include "granular/vibrations.h"

#include <algorithm>
#include <cmath>

#include "Eigen/Eigenvalues"
#include "granular/force_network.h"
#include "granular/relaxation.h"
#include "solvers/lowest_modes.h"

namespace granopt {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

Vibration ModeOf(double eigenvalue, const VectorXd& vector, int d) {
  const Index n = vector.size() / d;
  double sum = 0.0;
  double squares = 0.0;
  for (Index i = 0; i < n; ++i) {
    const double weight = vector.segment(d * i, d).squaredNorm();
    sum += weight;
    squares += weight * weight;
  }
  return {std::copysign(std::sqrt(std::abs(eigenvalue)), eigenvalue),
          sum * sum / (static_cast<double>(n) * squares)};
}

// H + c T T^T with the normalized translations T: its modes are those of H, and
// if c exceeds every eigenvalue of H, the last d of them are T.
MatrixXd Dense(const SparseMatrix& lower, int d) {
  const SparseMatrix full = lower.selfadjointView<Eigen::Lower>();
  MatrixXd matrix(full);
  const double c = 2.0 * matrix.cwiseAbs().rowwise().sum().maxCoeff();
  const Index n = matrix.rows() / d;
  for (int k = 0; k < d; ++k) {
    for (Index j = 0; j < n; ++j) {
      for (Index i = 0; i < n; ++i) {
        matrix(d * i + k, d * j + k) += c / static_cast<double>(n);
      }
    }
  }
  return matrix;
}

}  // namespace

Vibrations ComputeVibrations(const Packing& packing,
                             const ContactEnergyOptions& law,
                             const VibrationOptions& options) {
  Vibrations result;
  const int d = packing.dimension();
  Relaxation as_it_is;
  if (!MeasureAsItIs(packing, law, &as_it_is, &result.message)) return result;
  const ForceNetwork network =
      MakeForceNetwork(d, law.alpha, as_it_is.observables, as_it_is.contacts);
  if (network.links.empty()) {
    result.message = "no two rigid grains touch";
    return result;
  }
  result.grains = network.size();
  result.stiffness = network.stiffness / network.stiffness_unit;
  std::vector<LinkBlock> blocks;
  blocks.reserve(network.links.size());
  for (const Link& link : network.links) blocks.push_back(BlockOf(link));
  SparseMatrix hessian = AssembleBlocks(network, blocks, -1);
  hessian *= 1.0 / network.stiffness;

  const Index dofs = hessian.rows();
  if (network.size() <= options.most_dense) {
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(Dense(hessian, d));
    if (solver.info() != Eigen::Success) {
      result.message = "the dense eigenvalue method did not converge";
      return result;
    }
    for (Index k = 0; k + d < dofs; ++k) {
      result.modes.push_back(
          ModeOf(solver.eigenvalues()[k], solver.eigenvectors().col(k), d));
    }
    result.complete = true;
    result.found = true;
    return result;
  }
  LowestModesOptions lowest;
  lowest.count = options.lowest;
  lowest.left_out.setZero(dofs, d);
  for (Index i = 0; i < network.size(); ++i) {
    lowest.left_out.middleRows(d * i, d).setIdentity();
  }
  const LowestModes modes = ComputeLowestModes(hessian, lowest);
  if (!modes.converged) {
    result.message = modes.message;
    return result;
  }
  for (Index k = 0; k < modes.values.size(); ++k) {
    result.modes.push_back(ModeOf(modes.values[k], modes.vectors.col(k), d));
  }
  result.found = true;
  return result;
}

DensityOfStates BinModes(const std::vector<Vibration>& modes,
                         const std::vector<double>& edges) {
  DensityOfStates result;
  result.edges = edges;
  const std::size_t bins = edges.empty() ? 0 : edges.size() - 1;
  result.density.assign(bins, 0.0);
  result.participation.assign(bins, 0.0);
  result.counts.assign(bins, 0);
  for (const Vibration& mode : modes) {
    const auto above =
        std::upper_bound(edges.begin(), edges.end(), mode.frequency);
    if (above == edges.begin() || above == edges.end()) continue;
    const std::size_t b = above - edges.begin() - 1;
    ++result.counts[b];
    result.participation[b] += mode.participation;
  }
  for (std::size_t b = 0; b < bins; ++b) {
    if (result.counts[b] == 0) continue;
    result.participation[b] /= result.counts[b];
    result.density[b] = result.counts[b] / (edges[b + 1] - edges[b]) /
                        static_cast<double>(modes.size());
  }
  return result;
}

}  // namespace granopt
