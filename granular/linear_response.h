// granopt: elastic moduli of a packing by linear response.

#ifndef GRANOPT_GRANULAR_LINEAR_RESPONSE_H_
#define GRANOPT_GRANULAR_LINEAR_RESPONSE_H_

#include <string>

#include "Eigen/Core"
#include "granular/contact_energy.h"

namespace granopt {

// What an infinitesimal strain of the cell and a growth of the radii do to a
// packing at a minimum, once its grains have moved to the new one. Moduli are
// energies a volume, in the units of the packing; rattlers take no part.
//
// With x -> F x of cell and grains, displacements u on top of that, and the
// first derivatives P = (1 / V) dE/dF = -sigma at F = 1,
//
//   A_ijkl = (1 / V) (d2E/dF_ij dF_kl - X_ij . H^-1 X_kl),
//   X_kl = d2E/du dF_kl, H = d2E/du du:
//
// an affine part, at fixed u, less a non-affine one. For a contact with the
// separation l n and the block K = a n n + b 1 of the Hessian (9) these are
// sums of K_ik l^2 n_j n_l and +-K_ik l n_l. One factorization of H serves all.
struct ElasticResponse {
  // False if the response is not defined: nothing carries forces, pieces that
  // do not touch, or a point that is no strict minimum. Then `message` is one
  // line with the reason.
  bool found = false;
  std::string message;
  int dimension = 0;

  // d^2 x d^2, row d i + j and column d k + l of A_ijkl; symmetric.
  Eigen::MatrixXd affine, relaxed;
  // sigma, positive in compression, of the contacts that count.
  SmallMatrix stress;
  // (1 / V) d2E/dF dln r, relaxed: what growth of all radii does to -sigma.
  SmallMatrix growth;

  double A(int i, int j, int k, int l) const {
    return relaxed(dimension * i + j, dimension * k + l);
  }
  // The elasticities of the Lagrangian (Green) strain,
  //   C_ijkl = A_ijkl + sigma_jl delta_ik,
  // with all symmetries of an elastic tensor.
  double C(int i, int j, int k, int l) const {
    return A(i, j, k, l) + (i == k ? stress(j, l) : 0.0);
  }
  // C in Voigt's notation, 3 x 3 (11, 22, 12) or 6 x 6 (11, 22, 33, 23, 13,
  // 12).
  Eigen::MatrixXd Voigt() const;

  double pressure = 0.0;  // tr sigma / d
  // -V dp/dV = A_iijj / d^2 + (d - 1) p / d: the cell shrinks, radii stay.
  double bulk_box = 0.0;
  // phi dp/dphi as radii grow in a fixed cell, which is what (12) measures:
  // bulk_box + (alpha - d) p / d.
  double bulk_growth = 0.0;
  // The same, as radii grow, at fixed u.
  double bulk_affine = 0.0;
  // (13): d(-sigma_12)/dgamma of simple shear, 1 + gamma e_1 (x) e_2, is
  // A_1212 = C_1212 - sigma_22.
  double shear = 0.0;
  double shear_affine = 0.0;
  // The mean of n_i m_j n_k m_l A_ijkl, simple shear along n with gradient m,
  // over all orthonormal n and m.
  double shear_mean = 0.0;
  // Second derivatives of E / V along exp(t e) with tr e = 0, e symmetric and
  // |e|^2 = 1 / 2, as e_12 = e_21 = t / 2 has:
  //   A_ijkl e_ij e_kl - sigma_ij e_ik e_kj.
  // The stationary values over e, d (d + 1) / 2 - 1 of them in increasing
  // order; a packing resists every shear at fixed volume if the first is
  // positive.
  Eigen::VectorXd shear_principal;
};

// The response of a packing at a minimum of its energy: to what extent it is at
// one is up to the caller (stability.h). Energies in units of 2^a, lengths in
// units of 2^b give bitwise the scaled result (as far as the contact law does).
//
// Without `prestress` the second term of (9), which forces of contacts make, is
// left out: b = 0. That is the answer of a network of unstretched springs.
//
// Source: Maloney, Lemaitre, Phys. Rev. E 74 (2006) 016118, sec. II; the
// distinction of A and C under stress: Barron, Klein, Proc. Phys. Soc. 85
// (1965) 523.
ElasticResponse ComputeElasticResponse(const Packing& packing,
                                       const ContactEnergyOptions& options,
                                       bool prestress = true);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_LINEAR_RESPONSE_H_
