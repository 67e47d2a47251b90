// granopt: a step of backward Euler as a function to be minimized.

#ifndef GRANOPT_GRANULAR_FLOW_INCREMENTAL_POTENTIAL_H_
#define GRANOPT_GRANULAR_FLOW_INCREMENTAL_POTENTIAL_H_

#include <vector>

#include "granular/flow/flow.h"
#include "solvers/second_order.h"

namespace granopt {

// Phi of stepper.h (remark 8) as a function of displacements s = r - r^L of the
// grains that move, three each. `u`: velocities after impacts. The scene, the
// state and u must outlive it.
class IncrementalPotential : public SecondOrderFunction {
 public:
  IncrementalPotential(const FlowScene& scene,
                       const FlowState& state,
                       double dt,
                       const std::vector<double>& u);

  int NumParameters() const override {
    return 3 * static_cast<int>(free_.size());
  }
  int BlockSize() const override { return 3; }
  std::int64_t PatternVersion() const override { return 1; }
  // The unit of displacements: the mean way of a grain in the step.
  double length() const { return length_; }
  void set_length(double length) { length_ = length; }

  bool EvaluateWithScales(const double* s,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override;
  // The full lower triangle: a near field couples all grains.
  bool EvaluateHessian(const double* s, SparseMatrix* hessian) const override;
  // Without the matrix.
  bool HessianTimes(const double* s,
                    const double* v,
                    double* hv) const override;

 private:
  bool Place(const double* s) const;
  // Of m |d|^2 / 2 Dt^2 and of damping.
  double Inertia(int grain) const;
  // Second derivatives of V of a pair by the position of one of the two:
  // V'' n n + V' / d (1 - n n). False if the pair has none.
  bool PairBlock(int i, int j, double* block) const;
  // f(i, j, block) for all pairs with a block and a grain that moves.
  template <typename Function>
  void ForBlocks(const Function& f) const;

  const FlowScene& scene_;
  const FlowState& state_;
  const double dt_;
  const std::vector<double>& u_;
  std::vector<int> free_;  // grains that move
  std::vector<int> rank_;  // of each grain in free_, or -1
  double external_[3] = {};
  double length_ = 1.0;
  mutable std::vector<double> x_;
  mutable SmoothForces forces_;
};

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_INCREMENTAL_POTENTIAL_H_
