// granopt: the enthalpy of a packing, a function of its positions and its cell.

#ifndef GRANOPT_GRANULAR_CELL_ENERGY_H_
#define GRANOPT_GRANULAR_CELL_ENERGY_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/neighbor_list.h"
#include "granular/packing.h"
#include "solvers/second_order.h"

namespace granopt {

// Strains a cell may take. All symmetric ones, d (d + 1) / 2 of them, the
// isotropic one first; those but the first; the isotropic one alone; e_1 e_2.
std::vector<SmallMatrix> AllStrains(int dimension);
std::vector<SmallMatrix> VolumePreservingStrains(int dimension);
std::vector<SmallMatrix> IsotropicStrain(int dimension);
std::vector<SmallMatrix> SimpleShearStrain(int dimension);

struct CellEnergyOptions {
  // Evaluated in double, whatever the precision asked for.
  ContactEnergyOptions energy;
  double pressure = 0.0;
  // s, d x d, positive in compression; empty: none.
  SmallMatrix load;
  // M_m, d x d, linearly independent; see above.
  std::vector<SmallMatrix> strains;
};

// H(u, q) = E(x, F H) + p (V - V_0) + V_0 s : eps,
//   x = F (X + u),   F = 1 + eps,   eps = sum_m (q_m / l) M_m,
// of displacements u (d N entries, grain by grain, before the strain) and
// strains q from the packing given. Where it is stationary at q = 0 the forces
// balance and the stress (10) is p 1 + s in the strains that are free; a
// hydrostatic load is exact for any q, s is a dead load, which is the stress
// for eps -> 0 only (see constant_stress.h).
//
// The length l = r N^(1/2) with the mean radius r makes the stiffness of the
// cell, V B / l^2, that of a contact. Gaps are evaluated by differences from a
// reference as in ContactEnergy,
//   s_c = (eps - eps_ref) R_c + F (w_i - w_j),
// R_c the separation before the strain, so that strains keep their digits next
// to jamming, too. The volume enters as V - V_0, without cancellation.
//
// Scales: gradient = mean contact force, or p (2 r)^(d-1) without contacts;
// length = mean overlap / (alpha - 1), or r; vanishing as ContactEnergy's
// without a load, else infinity. Not defined where an entry of eps exceeds 4 or
// det F <= 0.
class CellEnergy : public SecondOrderFunction {
 public:
  // Null and one line in `error` for a packing that is not valid, a bad law, or
  // strains that are not of the packing's dimension.
  static std::unique_ptr<CellEnergy> Create(const Packing& packing,
                                            const CellEnergyOptions& options,
                                            std::string* error);

  int NumParameters() const override { return num_coordinates_ + num_strains_; }
  int num_strains() const { return num_strains_; }
  // l, by which q_m is a strain.
  double strain_length() const { return strain_length_; }

  bool EvaluateWithScales(const double* x,
                          double* enthalpy,
                          double* gradient,
                          Scales* scales) const override;
  bool Recenter(const double* x) override;

  bool EvaluateHessian(const double* x, SparseMatrix* hessian) const override;
  std::int64_t PatternVersion() const override { return pattern_version_; }
  bool HessianTimes(const double* x,
                    const double* v,
                    double* hv) const override;

  SmallMatrix Strain(const double* x) const;  // eps
  // The packing at x, cell edges rounded to double, not wrapped.
  Packing Configuration(const double* x) const;

 private:
  CellEnergy(const Packing& packing, const CellEnergyOptions& options);

  struct Pair {
    int i = 0, j = 0;
    double stiffness = 1.0;
    // R_c, and the separation, distance and overlap at the reference.
    double before[3] = {}, r0[3] = {}, d0 = 1.0, delta0 = -1.0;
    int rank = -1;  // of its block, -1: not in the pattern
  };
  struct PairState {
    double delta = 0.0, distance = 0.0, force = 0.0, stiffness = 0.0;
    double n[3] = {}, before[3] = {};  // R_c + w_i - w_j
  };
  struct Point {
    SmallMatrix strain, f;
  };

  bool Prepare(const double* x, Point* point) const;
  bool BuildList(const double* x, const Point& point, std::string* error) const;
  void SetReference() const;
  // False where the pair is open.
  bool Evaluate(const Pair& pair,
                const double* x,
                const Point& point,
                PairState* state) const;
  void UpdatePattern(const double* x, const Point& point) const;
  template <typename Function>
  void ForContacts(const double* x,
                   const Point& point,
                   const Function& f) const;
  // H_qq of the load.
  void AddLoad(const Point& point, Eigen::MatrixXd* block) const;

  const CellEnergyOptions options_;
  const int dimension_;
  const int num_grains_;
  const int num_coordinates_;
  const int num_strains_;
  const Packing packing_;
  const double mean_radius_, min_radius_, max_radius_;
  const double strain_length_;
  const double volume_;
  // For its law.
  std::unique_ptr<ContactEnergy> law_;

  mutable AdaptiveNeighborList list_;
  mutable std::vector<Pair> pairs_;
  mutable std::vector<double> x_list_, x_reference_;
  mutable SmallMatrix f_list_, strain_reference_;
  mutable std::int64_t pattern_version_ = 0;
  mutable std::int64_t pattern_list_version_ = -1;
  mutable std::vector<int> column_start_, rows_, blocks_;
  mutable double last_overlap_ = 0.0, last_move_ = 0.0;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_CELL_ENERGY_H_
