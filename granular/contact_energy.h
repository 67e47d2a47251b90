// granopt: the potential energy of a packing.

#ifndef GRANOPT_GRANULAR_CONTACT_ENERGY_H_
#define GRANOPT_GRANULAR_CONTACT_ENERGY_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "granular/neighbor_list.h"
#include "granular/packing.h"
#include "granular/pair_loops.h"
#include "solvers/unilateral.h"

namespace granopt {

// k_ij from the stiffnesses of two grains.
enum class StiffnessRule {
  MEAN,       // (k_i + k_j) / 2
  SERIES,     // 2 k_i k_j / (k_i + k_j): two springs in series
  GEOMETRIC,  // sqrt(k_i k_j)
};

// Of gaps and directions in EvaluateWithScales(). Variables, laws, forces and
// sums are double whatever it is, and so is all of second order: Hessians, gaps
// and contacts.
enum class Precision {
  DOUBLE,
  // Single until max|g| < 30 eps32 times the mean contact force (3.6e-6 of it),
  // then double for good: methods call Refine() there.
  MIXED,
  // Single throughout: forces are off by some eps32 mean forces, and tolerances
  // near 1e-6 or below are out of reach.
  FLOAT,
};

// "double", "mixed", "float".
const char* PrecisionName(Precision precision);

struct ContactEnergyOptions {
  // Exponent of the law, >= 2 (4).
  double alpha = 2.0;
  // Multiplies every k_ij.
  double stiffness = 1.0;
  StiffnessRule rule = StiffnessRule::MEAN;
  Precision precision = Precision::DOUBLE;
  // N, or empty: none. Grains that stay where they are: the function does not
  // depend on their coordinates (no gradient; the Hessian is diagonal there),
  // and two of them have no energy with each other.
  std::vector<bool> fixed;
};

// k_ij of two grains of a packing.
double PairStiffness(const Packing& packing,
                     const ContactEnergyOptions& options,
                     int i,
                     int j);

// A reference is moved when a grain has moved by more than this many mean
// overlaps from it. Near jamming the error of a gap is then still below 1e-14
// mean overlaps; where overlaps are comparable with radii it reaches 2e-13.
constexpr double kRecenterOverlaps = 10.0;

// The Hessian's pattern holds pairs nearer than this part of the smallest
// radius: a wider margin serves longer, but its factor has more entries (0.1
// doubles the time of a factorization).
constexpr double kPatternMargin = 0.02;

// Displacements of more cell lengths than this are refused.
constexpr double kMaxCells = 1e6;

// A pair of grains that touch.
struct Contact {
  GapId id;
  double overlap = 0.0;    // delta_c (7)
  double distance = 0.0;   // l_c (3)
  SmallVector normal;      // n_c (3), from j to i
  double force = 0.0;      // |f_c| (8)
  double stiffness = 0.0;  // d|f_c| / d delta_c
};

// E(u) = sum over pairs of k_ij (delta_ij v 0)^alpha / alpha  (4)-(6), as a
// function of displacements u (d N entries, grain by grain) from the positions
// of the packing given: u = 0 is that packing, exactly.
//
// Gaps are evaluated by differences from a reference configuration that
// Recenter() moves along (see pair_loops.h and README); E, gradient
// and Hessian are pure functions of (reference, u): bitwise independent of the
// neighbour list that happens to be in use, and of the number of threads
// (solvers/threads.h).
//
// Scales: gradient = mean contact force, length = mean overlap / (alpha - 1),
// over which a force changes by its own size, vanishing = the
// larger of (p / (k r^(alpha-d)))^(1/(alpha-1)) and mean overlap / r with the
// mean radius r, both of the order of a distance in packing fraction. Grains
// whose centres coincide exactly exert no force on each other (the direction is
// not defined) though they have energy.
class ContactEnergy : public UnilateralFunction {
 public:
  // Returns null and one line in `error` for a packing that is not valid, an
  // alpha < 2 or a cell too short for its grains.
  static std::unique_ptr<ContactEnergy> Create(
      const Packing& packing,
      const ContactEnergyOptions& options,
      std::string* error);

  // ceres::FirstOrderFunction, FirstOrderFunction.
  int NumParameters() const override { return dimension_ * num_grains_; }
  bool EvaluateWithScales(const double* u,
                          double* energy,
                          double* gradient,
                          Scales* scales) const override;
  bool Recenter(const double* u) override;
  bool Rebase(double* u) override;
  bool Refine() override;

  // SecondOrderFunction. The pattern holds every pair that touches or is nearly
  // in touch; it is kept until a pair outside of it touches.
  bool EvaluateHessian(const double* u, SparseMatrix* hessian) const override {
    return EvaluateStiffness(u, 1.0, hessian);
  }
  std::int64_t PatternVersion() const override { return pattern_version_; }
  int BlockSize() const override { return dimension_; }
  bool HessianTimes(const double* u,
                    const double* v,
                    double* hv) const override;

  // UnilateralFunction. The second part of the Hessian is the pre-stress of
  // (9).
  double Exponent() const override { return options_.alpha; }
  bool EvaluateStiffness(const double* u,
                         double theta,
                         SparseMatrix* hessian) const override;
  bool EvaluateWeightedHessian(const double* u,
                               const double* first,
                               const double* second,
                               SparseMatrix* hessian) const override;
  void EvaluateLaw(int n,
                   const double* overlap,
                   double* force,
                   double* stiffness) const override;
  bool EvaluateGaps(const double* u, Gaps* gaps) const override;

  // Leaves single precision, whatever the options say. False if it is left.
  bool UseDouble();

  // The packing at displacement u, not wrapped, positions rounded to
  // double-double once.
  Packing Configuration(const double* u) const;
  // The contacts of that packing, in increasing order of id.
  std::vector<Contact> Contacts(const double* u) const;

  const ContactEnergyOptions& options() const { return options_; }
  // Rebuilds of the neighbour list so far, and its skin now.
  std::int64_t num_list_builds() const { return list_.version(); }
  double skin() const { return list_.skin(); }
  int num_near_pairs() const { return list_.num_pairs(); }

 private:
  ContactEnergy(const Packing& packing, const ContactEnergyOptions& options);

  // The arrays of PairView, with their padding.
  template <typename T>
  struct ReferencePairs {
    bool is_current = false;
    std::vector<T> r0[3], d0, delta0;
  };
  struct PairArrays {
    std::vector<int> at_i, at_j;
    std::vector<double> stiffness;  // empty: all 1
    ReferencePairs<double> reference;
    ReferencePairs<float> single;
  };

  // Sums are taken over pieces of so many rows, then over pieces.
  static constexpr int kPieceGrains = 4096;
  int NumPieces() const;
  // f(piece, first grain, end) for all pieces, by threads.
  template <typename Function>
  void ForPieces(const Function& f) const;

  // w = u - u_ref in workspace_; rebuilds the list if a grain has left its
  // skin. False where u is not finite or astronomically large.
  bool Prepare(const double* u) const;
  Displacement Displace(const double* u, const double* u_list) const;
  bool HasLeftSkin(const double* u, double usable) const;
  void UpdateReferenceFromList() const;
  bool BuildList(const double* u, std::string* error) const;
  // Without pairs of grains that are both fixed.
  void RemoveFixedPairs() const;
  // Rows and columns of fixed grains are those of a multiple of the unit
  // matrix, the largest of the stiffnesses `first` or 1.
  double StiffnessOfFixed(const double* first) const;
  void FixHessian(const double* first, SparseMatrix* hessian) const;
  bool IsFixed(int i) const {
    return !options_.fixed.empty() && options_.fixed[i];
  }
  // The arrays of PairView for the list as it is.
  void SetPairs() const;
  // Those that depend on the reference, of the precision in use; those of the
  // other are made when asked for.
  void RenewReferencePairs() const;
  void SetReferencePairs(bool single) const;
  // Who does what, and copies of those pairs that two do.
  void SetParts() const;
  ContactSums Sweep(double* gradient) const;
  // states_ of all pairs at workspace_.
  void UpdateStates() const;
  // Makes the Hessian's pattern anew if a pair outside of it has a weight.
  void UpdatePattern(const double* first) const;
  void WriteBlocks(const double* first,
                   const double* second,
                   double theta,
                   SparseMatrix* hessian) const;
  // Of all pairs.
  PairView View() const;
  PairView View(const PairArrays& pairs, int first, int end) const;

  const ContactEnergyOptions options_;
  const int dimension_;
  const int num_grains_;
  Packing packing_;  // the origin u = 0
  double mean_radius_ = 0.0;
  double min_radius_ = 0.0;
  const PairLoops loops_;

  std::vector<double> u_reference_;
  // Workspaces: one object must not be evaluated from two threads at once.
  mutable std::vector<double> workspace_;
  mutable AdaptiveNeighborList list_;
  mutable std::vector<double> u_list_;  // where the list was built
  mutable bool has_self_pairs_ = false;
  mutable PairArrays pairs_;  // of the list
  bool is_single_;            // is the sweep?
  double single_unit_ = 1.0;
  mutable std::vector<float> single_workspace_;
  // What one thread does: all forces on the grains of its pieces. They are
  // those of its own rows and of pairs in the rows of threads before it, copied
  // to `shared`, which are evaluated by both, so that no two write to the same
  // grain and each grain's forces are added up in the order of the list.
  struct Part {
    int first_piece = 0;
    int end_piece = 0;
    PairArrays shared;
    std::vector<int> shared_rank;  // in the list
  };
  mutable std::vector<Part> parts_;
  mutable std::int64_t parts_list_version_ = -1;
  mutable PairStates states_;
  mutable std::vector<double> states_memory_;
  // The pattern of the Hessian: the place of a pair's block below the diagonal
  // of its column, -1 if it has none, and the start of each column.
  mutable std::int64_t pattern_version_ = 0;
  mutable std::int64_t pattern_list_version_ = -1;
  mutable std::vector<int> block_rank_, column_start_, rows_;
  mutable bool has_shared_blocks_ = false;
  mutable Displacement moved_;                // of the last evaluation
  mutable double reference_from_list_ = 0.0;  // max |u_ref - u_list|
  mutable double last_overlap_ = 0.0;         // mean, of the last evaluation
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_CONTACT_ENERGY_H_
