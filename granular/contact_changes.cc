#include "granular/contact_changes.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "granular/neighbor_list.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Shifts of the Hessian, in kappa.
constexpr double kFirstShift = 1e-10;
constexpr double kShiftGrowth = 4.0;
constexpr int kMaxShifts = 40;
// What a positive definite one is given for its blind motions.
constexpr double kBlindShift = 1e-13;

// -(hessian + shift 1)^-1 gradient, see NewtonStep.
bool SolveAmong(const ContactEnergy& energy,
                const double* u,
                const std::vector<bool>& counts,
                const SparseMatrix& hessian,
                const VectorXd& gradient,
                NewtonStep* step,
                std::string* error) {
  const int d = energy.BlockSize();
  double force = 0.0, overlap = 0.0;
  const std::vector<Contact> contacts = energy.Contacts(u);
  for (const Contact& c : contacts) {
    force += c.force;
    overlap += c.overlap;
  }
  if (!(force > 0.0) || !(overlap > 0.0)) {
    *error = "no grain touches another";
    return false;
  }
  const double kappa = (energy.Exponent() - 1.0) * force / overlap;
  overlap /= static_cast<double>(contacts.size());
  SparseCholesky cholesky;
  double relative = kBlindShift;
  int tries = 0;
  while (!cholesky.Factorize(hessian, 1, relative * kappa)) {
    if (++tries > kMaxShifts) {
      *error = "no shift makes the Hessian positive definite";
      return false;
    }
    relative = tries == 1 ? kFirstShift : relative * kShiftGrowth;
  }
  step->relative_shift = tries == 0 ? 0.0 : relative;
  step->shift = step->relative_shift * kappa;
  VectorXd x(gradient.size());
  cholesky.Solve(gradient.data(), x.data());
  x = -x;
  // Blind motions are rounding errors over the shift.
  Eigen::Map<MatrixXd> moves(x.data(), d, x.size() / d);
  VectorXd mean = VectorXd::Zero(d);
  const auto grains = std::count(counts.begin(), counts.end(), true);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i]) mean += moves.col(i) / static_cast<double>(grains);
  }
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i]) {
      moves.col(i) -= mean;
    } else {
      moves.col(i).setZero();
    }
  }
  step->displacement.assign(x.data(), x.data() + x.size());
  step->length = 0.0;
  for (const Contact& c : contacts) {
    if (!counts[c.id.i] || !counts[c.id.j]) continue;
    step->length = std::max(
        step->length, (moves.col(c.id.i) - moves.col(c.id.j)).norm() / overlap);
  }
  return true;
}

}  // namespace

bool EvaluateAmong(const ContactEnergy& energy,
                   const double* u,
                   const std::vector<bool>& counts,
                   VectorXd* gradient,
                   SparseMatrix* hessian) {
  Gaps gaps;
  if (!energy.EvaluateGaps(u, &gaps)) return false;
  const auto m = static_cast<int>(gaps.ids.size());
  const VectorXd closure = gaps.delta.cwiseMax(0.0);
  VectorXd force(m), stiffness(m);
  energy.EvaluateLaw(m, closure.data(), force.data(), stiffness.data());
  for (int c = 0; c < m; ++c) {
    const GapId& id = gaps.ids[c];
    // A grain moves with its own image.
    const bool active = gaps.delta[c] > 0.0 && counts[id.i] && counts[id.j];
    force[c] = active ? force[c] * gaps.stiffness[c] : 0.0;
    stiffness[c] = active ? stiffness[c] * gaps.stiffness[c] : 0.0;
  }
  *gradient = gaps.jacobian.transpose() * force;
  return energy.EvaluateWeightedHessian(
      u, stiffness.data(), force.data(), hessian);
}

MatrixXd BlindMotions(int dimension, const std::vector<bool>& counts) {
  const auto n = static_cast<int>(counts.size());
  const auto still =
      static_cast<int>(std::count(counts.begin(), counts.end(), false));
  // Without a grain that counts nothing can be translated.
  const int translations = still < n ? dimension : 0;
  MatrixXd motions =
      MatrixXd::Zero(dimension * n, dimension * still + translations);
  int column = 0;
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < dimension; ++k) {
      if (!counts[i]) {
        motions(dimension * i + k, column++) = 1.0;
      } else {
        motions(dimension * i + k, dimension * still + k) = 1.0;
      }
    }
  }
  return motions;
}

ContactPairs PairsInTouch(const std::vector<Contact>& contacts,
                          const std::vector<bool>& counts) {
  ContactPairs pairs;
  for (const Contact& c : contacts) {
    if (counts[c.id.i] && counts[c.id.j]) {
      pairs.push_back({std::min(c.id.i, c.id.j), std::max(c.id.i, c.id.j)});
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

ContactChange Compare(const ContactPairs& before, const ContactPairs& after) {
  ContactPairs lost, made;
  std::set_difference(before.begin(),
                      before.end(),
                      after.begin(),
                      after.end(),
                      std::back_inserter(lost));
  std::set_difference(after.begin(),
                      after.end(),
                      before.begin(),
                      before.end(),
                      std::back_inserter(made));
  return {static_cast<int>(lost.size()), static_cast<int>(made.size())};
}

bool ChangesOnTheWay(const Packing& packing,
                     const double* displacement,
                     const std::vector<bool>& counts,
                     WayChanges* changes,
                     std::string* error) {
  const int d = packing.dimension();
  *changes = WayChanges();
  changes->first = std::numeric_limits<double>::infinity();
  const Eigen::Map<const MatrixXd> moves(displacement, d, packing.size());
  const double longest = std::sqrt(moves.colwise().squaredNorm().maxCoeff());
  if (!(longest <= packing.MeanRadius())) {
    *error = "a grain moves by more than the mean radius";
    return false;
  }
  NeighborList list;
  if (!BuildNeighborList(packing.box,
                         packing.positions,
                         packing.radii,
                         2.0 * longest * (1.0 + 1e-9),
                         &list,
                         error)) {
    return false;
  }
  for (int p = 0; p < list.num_pairs(); ++p) {
    const int i = list.i[p], j = list.j[p];
    if (i == j || !counts[i] || !counts[j]) continue;
    VectorXd r(d);
    for (int k = 0; k < d; ++k) {
      const DoubleDouble a = packing.Position(i, k), b = packing.Position(j, k);
      r[k] = (a.hi - b.hi) + (a.lo - b.lo);
    }
    for (int c = 0; c < d; ++c) {
      r += list.image[p][c] * packing.box.edges().col(c);
    }
    const VectorXd w = moves.col(i) - moves.col(j);
    // |r + t w|^2 = sum^2, a t^2 + 2 b t + c = 0; c > 0 for a gap.
    const double sum = packing.radii[i] + packing.radii[j];
    const double distance = r.norm();
    const double a = w.squaredNorm(), b = r.dot(w);
    const double c = (distance - sum) * (distance + sum);
    const double disc = b * b - a * c;
    if (!(a > 0.0) || !(disc > 0.0)) continue;
    const double q = -(b + std::copysign(std::sqrt(disc), b));
    double first = q / a;
    double second = q != 0.0 ? c / q : 0.0;
    if (first > second) std::swap(first, second);
    // The quadratic is positive outside of its roots: a pair touches between.
    if (first > 0.0 && first <= 1.0) {
      ++changes->closed;
      changes->first = std::min(changes->first, first);
    }
    if (second > 0.0 && second <= 1.0) {
      ++changes->opened;
      changes->first = std::min(changes->first, second);
    }
  }
  return true;
}

bool ComputeNewtonStep(const ContactEnergy& energy,
                       const double* u,
                       const std::vector<bool>& counts,
                       NewtonStep* step,
                       std::string* error) {
  VectorXd gradient;
  SparseMatrix hessian;
  if (!EvaluateAmong(energy, u, counts, &gradient, &hessian)) {
    *error = "the energy is not defined";
    return false;
  }
  return SolveAmong(energy, u, counts, hessian, gradient, step, error);
}

bool ComputeLinearResponse(const ContactEnergy& energy,
                           const double* u,
                           const std::vector<bool>& counts,
                           const SmallMatrix& deformation,
                           NewtonStep* step,
                           std::string* error) {
  const int d = energy.BlockSize();
  VectorXd gradient;
  SparseMatrix hessian;
  if (!EvaluateAmong(energy, u, counts, &gradient, &hessian)) {
    *error = "the energy is not defined";
    return false;
  }
  gradient.setZero();
  for (const Contact& c : energy.Contacts(u)) {
    if (!counts[c.id.i] || !counts[c.id.j]) continue;
    const VectorXd n = c.normal;
    const VectorXd change = deformation * (c.distance * n);
    const double along = n.dot(change);
    // (stiffness n (x) n - force / distance (1 - n (x) n)) change
    const VectorXd pull =
        c.stiffness * along * n - c.force / c.distance * (change - along * n);
    gradient.segment(d * c.id.i, d) += pull;
    gradient.segment(d * c.id.j, d) -= pull;
  }
  return SolveAmong(energy, u, counts, hessian, gradient, step, error);
}

}  // namespace granopt
