#include "granular/linear_response.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "Eigen/Eigenvalues"
#include "granular/force_network.h"
#include "granular/relaxation.h"
#include "solvers/format.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// An orthonormal basis of the symmetric matrices without trace, as columns of
// d^2 entries.
MatrixXd TracelessBasis(int d) {
  MatrixXd basis = MatrixXd::Zero(d * d, d * (d + 1) / 2 - 1);
  int column = 0;
  for (int i = 0; i < d; ++i) {
    for (int j = i + 1; j < d; ++j) {
      basis(d * i + j, column) = basis(d * j + i, column) = std::sqrt(0.5);
      ++column;
    }
  }
  for (int k = 1; k < d; ++k) {
    const double norm = std::sqrt(k * (k + 1.0));
    for (int i = 0; i < k; ++i) basis(d * i + i, column) = 1.0 / norm;
    basis(d * k + k, column) = -k / norm;
    ++column;
  }
  return basis;
}

void SetModuli(double growth_affine, ElasticResponse* r) {
  const int d = r->dimension;
  r->pressure = r->stress.trace() / d;
  double trace = 0.0;
  double square = 0.0;  // A_ijij
  double mixed = 0.0;   // A_ijji
  for (int i = 0; i < d; ++i) {
    for (int j = 0; j < d; ++j) {
      trace += r->A(i, i, j, j);
      square += r->A(i, j, i, j);
      mixed += r->A(i, j, j, i);
    }
  }
  r->bulk_box = trace / (d * d) + (d - 1) * r->pressure / d;
  // tr sigma = -(tr of the derivative by F), and dln phi = d dln r.
  r->bulk_growth = -r->growth.trace() / (d * d);
  r->bulk_affine = growth_affine;
  r->shear = r->A(0, 1, 0, 1);
  r->shear_affine = r->affine(1, 1);
  r->shear_mean =
      ((d + 1) * square - trace - mixed) / (d * (d - 1.0) * (d + 2.0));

  const MatrixXd basis = TracelessBasis(d);
  MatrixXd form = basis.transpose() * r->relaxed * basis;
  for (Eigen::Index a = 0; a < form.rows(); ++a) {
    for (Eigen::Index b = 0; b < form.cols(); ++b) {
      const Eigen::Map<const MatrixXd> e(basis.col(a).data(), d, d);
      const Eigen::Map<const MatrixXd> f(basis.col(b).data(), d, d);
      form(a, b) -= 0.5 * (MatrixXd(r->stress) * (e * f + f * e)).trace();
    }
  }
  r->shear_principal =
      0.5 * Eigen::SelfAdjointEigenSolver<MatrixXd>(form).eigenvalues();
}

}  // namespace

MatrixXd ElasticResponse::Voigt() const {
  std::vector<std::pair<int, int>> pairs = {{0, 0}, {1, 1}, {0, 1}};
  if (dimension == 3) {
    pairs = {{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
  }
  const int n = static_cast<int>(pairs.size());
  MatrixXd voigt(n, n);
  for (int a = 0; a < n; ++a) {
    for (int b = 0; b < n; ++b) {
      voigt(a, b) =
          C(pairs[a].first, pairs[a].second, pairs[b].first, pairs[b].second);
    }
  }
  return voigt;
}

ElasticResponse ComputeElasticResponse(const Packing& packing,
                                       const ContactEnergyOptions& options,
                                       bool prestress) {
  ElasticResponse r;
  const auto fail = [&r](const std::string& message) {
    r.found = false;
    r.message = message;
    return r;
  };
  const int d = r.dimension = packing.dimension();
  Relaxation as_it_is;
  std::string error;
  if (!MeasureAsItIs(packing, options, &as_it_is, &error)) return fail(error);
  const ForceNetwork network = MakeForceNetwork(
      d, options.alpha, as_it_is.observables, as_it_is.contacts);
  if (network.links.empty()) return fail("no two rigid grains touch");
  const std::vector<int> pieces = Pieces(network);
  if (pieces.size() > 1) {
    return fail(
        Format("%zu pieces that do not touch each other", pieces.size()));
  }

  // Of derivatives by F_kl, column d k + l, and by ln r, the last one.
  const int columns = d * d + 1;
  const int n = network.size();
  MatrixXd forces = MatrixXd::Zero(columns, d * n);
  MatrixXd affine = MatrixXd::Zero(columns, columns);
  SmallMatrix virial = SmallMatrix::Zero(d, d);
  std::vector<LinkBlock> blocks;
  blocks.reserve(network.links.size());
  MatrixXd pair(columns, d);
  for (const Link& link : network.links) {
    const LinkBlock block =
        prestress ? BlockOf(link) : LinkBlock{link.stiffness, 0.0};
    blocks.push_back(block);
    const SmallVector& n_ij = link.normal;
    const double l = link.distance;
    const double stretch = link.stiffness * (l + link.overlap);
    for (int k = 0; k < d; ++k) {
      for (int j = 0; j < d; ++j) {
        for (int i = 0; i < d; ++i) {
          const double stiffness =
              block.a * n_ij[i] * n_ij[k] + (i == k ? block.b : 0.0);
          pair(d * k + j, i) = stiffness * l * n_ij[j];
          for (int m = 0; m < d; ++m) {
            affine(d * i + m, d * k + j) +=
                stiffness * l * l * n_ij[m] * n_ij[j];
          }
        }
        affine(d * d, d * k + j) -= stretch * l * n_ij[k] * n_ij[j];
        virial(k, j) += l * link.force * n_ij[k] * n_ij[j];
      }
      pair(d * d, k) = -stretch * n_ij[k];
    }
    if (link.i == link.j) continue;
    forces.middleCols(d * link.i, d) += pair;
    forces.middleCols(d * link.j, d) -= pair;
  }

  affine.col(d * d).head(d * d) = affine.row(d * d).head(d * d).transpose();

  MatrixXd relaxed = affine;
  if (n > 1) {
    // Translations cost nothing: one grain is held.
    const int held = network.held;
    MatrixXd right(columns, d * (n - 1));
    right << forces.leftCols(d * held), forces.rightCols(d * (n - 1 - held));
    MatrixXd response(columns, d * (n - 1));
    SparseCholesky cholesky;
    if (!cholesky.Factorize(AssembleBlocks(network, blocks, held), 1)) {
      return fail(
          "the Hessian of the grains that carry forces is not positive "
          "definite: no strict minimum");
    }
    cholesky.Solve(right.data(), response.data(), columns);
    relaxed -= right * response.transpose();
    relaxed = (0.5 * (relaxed + relaxed.transpose())).eval();
  }

  const double unit = 1.0 / (network.stiffness_unit * network.length_unit *
                             network.length_unit * packing.box.Volume());
  r.affine = unit * affine.topLeftCorner(d * d, d * d);
  r.relaxed = unit * relaxed.topLeftCorner(d * d, d * d);
  r.stress = unit * virial;
  r.growth.resize(d, d);
  double growth_affine = 0.0;
  for (int k = 0; k < d; ++k) {
    for (int l = 0; l < d; ++l)
      r.growth(k, l) = unit * relaxed(d * d, d * k + l);
    growth_affine -= unit * affine(d * d, d * k + k) / (d * d);
  }
  SetModuli(growth_affine, &r);
  r.found = true;
  return r;
}

}  // namespace granopt
