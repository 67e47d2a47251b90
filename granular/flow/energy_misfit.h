// granopt: how far the energies of a flow are from those that are wanted.
//
// Source: Zohdi, Int. J. Solids Struct. 42 (2005) 539, sec. 8; equation numbers
// are theirs.

#ifndef GRANOPT_GRANULAR_FLOW_ENERGY_MISFIT_H_
#define GRANOPT_GRANULAR_FLOW_ENERGY_MISFIT_H_

#include <vector>

namespace granopt {

// Kinetic energies per mass over time, J / kg: of all motion T, of the centre
// of mass T_b, relative to it T_r (4.7). Linear between times.
struct EnergyCurve {
  std::vector<double> time, total, bulk, relative;
  // Of a target that was measured: their standard deviations, > 0, at the same
  // times; empty where they are not known.
  std::vector<double> total_error = {}, bulk_error = {}, relative_error = {};
};

// A target that does not change (sec. 8.2: 1.0, 0.5, 0.5).
EnergyCurve ConstantTarget(double total,
                           double bulk,
                           double relative,
                           double duration);

// w_E, w_Eb, w_Er of (8.5), >= 0, not all 0.
struct MisfitWeights {
  double total = 1.0, bulk = 1.0, relative = 1.0;
};

// True if the target has errors of all energies whose weight is not 0.
bool HasErrors(const EnergyCurve& target, const MisfitWeights& weights);

//   P_E = int_0^T |T - T*| dt / int_0^T |T*| dt                     (8.2)
// and the same for T_r (8.3) and T_b (8.4);
//   P = (w_E P_E + w_Er P_Er + w_Eb P_Eb) / (w_E + w_Er + w_Eb)     (8.5)
//
// With errors s(t) of the target both integrals are over dt / s, and the
// weights are multiplied by how many errors the target is large:
//   P_E = int |T - T*| / s dt / int |T*| / s dt,
//   w_E -> w_E int |T*| / s dt,
// so that P = sum_k w_k int |T_k - T*_k| / s_k dt
//           / sum_k w_k int |T*_k| / s_k dt.
// What is known ten times better counts ten times as much. Errors of one size
// relative to the target's mean, the same at all times, are (8.2) to (8.5)
// again; only ratios of errors matter. 1 / s is linear between times.
struct Misfit {
  double total = 0.0, bulk = 0.0, relative = 0.0;
  double value = 0.0;  // P
  // With errors: the mean of |T - T*| / s over time, about 0.8 where nothing
  // but normal errors is between the two.
  double total_errors = 0.0, bulk_errors = 0.0, relative_errors = 0.0;
};
// Integrals of curves that are linear between their times are exact. A curve
// that ends before `duration`, or has NaN, has no misfit: +infinity.
Misfit ComputeMisfit(const EnergyCurve& curve,
                     const EnergyCurve& target,
                     const MisfitWeights& weights,
                     double duration);

// int_0^end |a - b| dt of two curves; with `weight`, at the times of b and
// linear between them, int_0^end |a - b| weight dt.
double IntegrateDifference(const std::vector<double>& time_a,
                           const std::vector<double>& a,
                           const std::vector<double>& time_b,
                           const std::vector<double>& b,
                           double end,
                           const std::vector<double>& weight = {});
// y at a time, that of the nearest end beyond both ends. Not for none.
double Interpolate(const std::vector<double>& time,
                   const std::vector<double>& y,
                   double at);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_ENERGY_MISFIT_H_
