#include "granular/network_preconditioner.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/neighbor_list.h"
#include "solvers/matrix_preconditioner.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

bool IsContactEnergy(const FirstOrderFunction& function, std::string* error) {
  if (dynamic_cast<const ContactEnergy*>(&function) != nullptr) return true;
  *error = "preconditioners laplacian and contact need a contact energy";
  return false;
}

// The universal preconditioner of Packwood et al., (19) and (20):
//   u^T P u = mu (sum over pairs nearer than r_cut of c_ij |u_i - u_j|^2
//             + C_stab sum |u_i|^2),
//   c_ij = exp(-A (r_ij / r_nn - 1)),   r_cut = 2.2 r_max,
// one graph Laplacian for all coordinates. Made anew, mu too, when a grain has
// moved by more than r_cut / 4. The energy scale is that of (21),
//   mu = nu.(g(x + nu) - g(x)) / nu.P_{mu=1} nu,
// with the probe (22), nu_k = 1e-3 r_cut sin(2 pi s_k) for the fractional
// coordinate s_k.
//
// Deviations: (22) prints sin(x / L), which is not periodic. Where (21) gives
// mu <= 0 or no number (pre-stress may outweigh the contacts), mu is the ratio
// of mean force and Scales::length. The paper does not define r_nn: here it is
// the mean distance of a grain's nearest neighbour. C_stab stands inside c_ij's
// bracket for A > 0 as it does in (20) for A = 0.
class Laplacian : public MatrixPreconditioner {
 public:
  explicit Laplacian(Parameters* parameters)
      : MatrixPreconditioner(parameters),
        decay_(parameters->Double("A", 0.0, 0.0, 100.0, "decay A in (19)")),
        stabilizer_(parameters->Double(
            "C_stab", 0.1, 1e-12, 1e6, "added to the diagonal (20)")),
        cutoff_(parameters->Double(
            "r_cut", 2.2, 2.0, 100.0, "cutoff, in units of r_max")),
        refresh_(parameters->Double(
            "refresh",
            0.25,
            0.0,
            1e6,
            "made anew after a displacement of this part of r_cut")) {}

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    return IsContactEnergy(function, error);
  }

 protected:
  bool Assemble(const Iterate& at, Monitor* monitor, Matrix* matrix) override {
    const auto& energy =
        dynamic_cast<const ContactEnergy&>(*monitor->function());
    const Packing packing = energy.Configuration(at.x);
    const int n = packing.size();
    const int d = packing.dimension();
    r_cut_ = cutoff_ * packing.radii.maxCoeff();
    {
      const Monitor::LinearTimer timer(monitor);
      if (!AssembleGraph(packing, &matrix->lower)) return false;
    }
    matrix->pattern_version = ++version_;
    matrix->shift = stabilizer_;
    matrix->columns = d;

    // mu, for which the energy is evaluated once.
    std::vector<double> nu(n * d), x(n * d), g(n * d);
    const Eigen::MatrixXd fractional =
        packing.box.inverse() * packing.positions;
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < d; ++k) {
        nu[d * i + k] = 1e-3 * r_cut_ * std::sin(2.0 * kPi * fractional(k, i));
        x[d * i + k] = at.x[d * i + k] + nu[d * i + k];
      }
    }
    double cost;
    const bool measured = !monitor->BudgetSpent() &&
                          monitor->Evaluate(x.data(), &cost, g.data(), nullptr);
    const Monitor::LinearTimer timer(monitor);
    double mu = 0.0;
    if (measured) {
      double nu_dg = 0.0, nu_nu = 0.0;
      for (int v = 0; v < n * d; ++v) {
        nu_dg += nu[v] * (g[v] - at.gradient[v]);
        nu_nu += nu[v] * nu[v];
      }
      double nu_p_nu = stabilizer_ * nu_nu;
      const SparseMatrix& a = matrix->lower;
      for (int j = 0; j < n; ++j) {
        for (SparseMatrix::InnerIterator it(a, j); it; ++it) {
          if (it.row() == j) continue;
          for (int k = 0; k < d; ++k) {
            const double apart = nu[d * it.row() + k] - nu[d * j + k];
            nu_p_nu -= it.value() * (apart * apart);
          }
        }
      }
      mu = nu_dg / nu_p_nu;
    }
    if (!(mu > 0.0) || !std::isfinite(mu)) {
      if (!(at.scales.length > 0.0)) return false;
      mu = at.scales.gradient / at.scales.length;
    }
    matrix->scale = mu;
    return true;
  }

  bool IsStale(const Iterate& /*at*/, const Age& age) const override {
    return age.moved > refresh_ * r_cut_;
  }

 private:
  // The graph Laplacian with weights c_ij.
  bool AssembleGraph(const Packing& packing, SparseMatrix* lower) const {
    const int n = packing.size();
    const Eigen::VectorXd half = Eigen::VectorXd::Constant(n, 0.5 * r_cut_);
    NeighborList list;
    std::string error;
    if (!BuildNeighborList(
            packing.box, packing.positions, half, 0.0, &list, &error)) {
      return false;
    }
    std::vector<double> distance(list.num_pairs());
    std::vector<double> nearest(n, r_cut_);
    for (int p = 0; p < list.num_pairs(); ++p) {
      const int i = list.i[p], j = list.j[p];
      Eigen::VectorXd r = packing.positions.col(i) - packing.positions.col(j);
      for (int c = 0; c < packing.dimension(); ++c) {
        r += list.image[p][c] * packing.box.edges().col(c);
      }
      distance[p] = r.norm();
      nearest[i] = std::min(nearest[i], distance[p]);
      nearest[j] = std::min(nearest[j], distance[p]);
    }
    double r_nn = 0.0;
    for (const double v : nearest) r_nn += v;
    r_nn /= n;
    std::vector<double> diagonal(n, 0.0);
    std::vector<Eigen::Triplet<double, int>> entries;
    entries.reserve(list.num_pairs() + n);
    for (int p = 0; p < list.num_pairs(); ++p) {
      const int i = list.i[p], j = list.j[p];
      if (i == j) continue;  // moves with itself
      const double c =
          decay_ == 0.0 ? 1.0 : std::exp(-decay_ * (distance[p] / r_nn - 1.0));
      diagonal[i] += c;
      diagonal[j] += c;
      entries.emplace_back(j, i, -c);
    }
    for (int i = 0; i < n; ++i) entries.emplace_back(i, i, diagonal[i]);
    lower->resize(n, n);
    lower->setFromTriplets(entries.begin(), entries.end());
    return true;
  }

  const double decay_;
  const double stabilizer_;
  const double cutoff_;
  const double refresh_;
  double r_cut_ = 0.0;
  std::int64_t version_ = 0;
};

// The network of contacts as linear springs, H of (9) without its pre-stress:
//   P = sum over contacts of f'(delta) n (x) n + shift kappa 1,
// kappa = mean force / Scales::length. Positive semidefinite as it is; the
// shift serves translations and rattlers.
class ContactNetwork : public StiffnessPreconditioner {
 public:
  explicit ContactNetwork(Parameters* parameters)
      : StiffnessPreconditioner(parameters) {
    ReadPolicy(parameters, 1e-2, 1e-12);
  }

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    return IsContactEnergy(function, error);
  }

 protected:
  bool EvaluateMatrix(const SecondOrderFunction& function,
                      const Iterate& at,
                      SparseMatrix* lower) override {
    return dynamic_cast<const ContactEnergy&>(function).EvaluateStiffness(
        at.x, 0.0, lower);
  }
};

REGISTER_PRECONDITIONER(
    laplacian,
    Laplacian,
    "graph Laplacian of near grains (19)-(22)",
    "Packwood et al., J. Chem. Phys. 144 (2016) 164109; Wang, Zhang, "
    "Electron. Res. Arch. 28 (2020) 405, 3.2");

REGISTER_PRECONDITIONER(contact,
                        ContactNetwork,
                        "stiffness of the contacts without pre-stress, shifted",
                        "Wang, Zhang, Electron. Res. Arch. 28 (2020) 405, (9)");

}  // namespace

void RegisterNetworkPreconditioners() {
  GranoptRegister_contact();
  GranoptRegister_laplacian();
}

}  // namespace granopt
