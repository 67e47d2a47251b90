#include "granular/observables.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "Eigen/Eigenvalues"

namespace granopt {

TensorParts SplitTensor(const SmallMatrix& tensor) {
  const int d = static_cast<int>(tensor.rows());
  const SmallMatrix symmetric = 0.5 * (tensor + tensor.transpose());
  Eigen::SelfAdjointEigenSolver<SmallMatrix> solver(symmetric,
                                                    Eigen::EigenvaluesOnly);
  const auto& l = solver.eigenvalues();
  return {l.sum() / d, (l[d - 1] - l[0]) / 2.0};
}

Observables Measure(const Packing& packing,
                    const std::vector<Contact>& contacts,
                    double energy,
                    const std::vector<bool>& fixed) {
  const auto is_fixed = [&fixed](int i) { return !fixed.empty() && fixed[i]; };
  const int n = packing.size();
  const int d = packing.dimension();
  const double volume = packing.box.Volume();
  Observables o;
  o.packing_fraction = packing.PackingFraction();
  o.energy = energy;
  o.grains = n;
  o.contacts = static_cast<int>(contacts.size());
  o.stress = SmallMatrix::Zero(d, d);
  o.fabric = SmallMatrix::Zero(d, d);
  Eigen::MatrixXd force = Eigen::MatrixXd::Zero(d, n);
  for (const Contact& c : contacts) {
    const SmallMatrix nn = c.normal * c.normal.transpose();
    o.stress += c.distance * c.force * nn;
    o.fabric += (GrainVolume(d, packing.radii[c.id.i]) +
                 GrainVolume(d, packing.radii[c.id.j])) *
                nn;
    o.mean_force += c.force;
    o.mean_overlap += c.overlap;
    force.col(c.id.i) += c.force * c.normal;
    force.col(c.id.j) -= c.force * c.normal;
  }
  o.stress /= volume;
  o.fabric /= volume;
  if (!contacts.empty()) {
    o.mean_force /= static_cast<double>(contacts.size());
    o.mean_overlap /= static_cast<double>(contacts.size());
  }
  o.pressure = o.stress.trace() / d;
  o.shear_stress = -o.stress(0, 1);
  o.stress_parts = SplitTensor(o.stress);
  o.fabric_parts = SplitTensor(o.fabric);
  for (int i = 0; i < n; ++i) {
    if (is_fixed(i)) force.col(i).setZero();
  }
  o.max_residual = force.cwiseAbs().maxCoeff();
  o.relative_residual =
      o.mean_force > 0.0 ? o.max_residual / o.mean_force : 0.0;

  // Peel off grains below d + 1 contacts until none is left to peel.
  std::vector<std::vector<int>> of_grain(n);
  std::vector<int> degree(n, 0);
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    const GapId& id = contacts[c].id;
    of_grain[id.i].push_back(static_cast<int>(c));
    of_grain[id.j].push_back(static_cast<int>(c));
    ++degree[id.i];
    ++degree[id.j];
  }
  o.is_rattler.assign(n, false);
  std::vector<bool> alive(contacts.size(), true);
  std::vector<int> queue;
  for (int i = 0; i < n; ++i) {
    if (degree[i] < d + 1 && !is_fixed(i)) {
      o.is_rattler[i] = true;
      queue.push_back(i);
    }
  }
  while (!queue.empty()) {
    const int i = queue.back();
    queue.pop_back();
    ++o.rattlers;
    for (const int c : of_grain[i]) {
      if (!alive[c]) continue;
      alive[c] = false;
      const int other =
          contacts[c].id.i == i ? contacts[c].id.j : contacts[c].id.i;
      --degree[other];
      if (degree[other] < d + 1 && !o.is_rattler[other] && !is_fixed(other)) {
        o.is_rattler[other] = true;
        queue.push_back(other);
      }
    }
  }
  o.rigid_grains = n - o.rattlers;
  o.smallest_force = std::numeric_limits<double>::infinity();
  for (std::size_t c = 0; c < contacts.size(); ++c) {
    if (!alive[c]) continue;
    ++o.rigid_contacts;
    o.smallest_force = std::min(o.smallest_force, contacts[c].force);
  }
  if (o.rigid_contacts == 0) o.smallest_force = 0.0;
  if (o.rigid_grains > 0) {
    o.coordination = 2.0 * o.rigid_contacts / o.rigid_grains;
    o.isostatic_contacts = d * o.rigid_grains - d + 1;
  }
  return o;
}

}  // namespace granopt
