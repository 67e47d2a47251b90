// A contact energy behind another object, for tests that meddle with some of
// its functions.

#ifndef GRANOPT_TESTS_GRANULAR_FORWARDING_H_
#define GRANOPT_TESTS_GRANULAR_FORWARDING_H_

#include <cstdint>

#include "granular/contact_energy.h"
#include "solvers/unilateral.h"

namespace granopt {

class Forwarding : public UnilateralFunction {
 public:
  explicit Forwarding(ContactEnergy* f) : f_(f) {}

  int NumParameters() const override { return f_->NumParameters(); }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    return f_->EvaluateWithScales(x, cost, gradient, scales);
  }
  bool Recenter(const double* x) override { return f_->Recenter(x); }
  bool Rebase(double* x) override { return f_->Rebase(x); }
  bool EvaluateHessian(const double* x, SparseMatrix* h) const override {
    return f_->EvaluateHessian(x, h);
  }
  std::int64_t PatternVersion() const override { return f_->PatternVersion(); }
  int BlockSize() const override { return f_->BlockSize(); }
  bool HessianTimes(const double* x,
                    const double* v,
                    double* hv) const override {
    return f_->HessianTimes(x, v, hv);
  }
  double Exponent() const override { return f_->Exponent(); }
  void EvaluateLaw(int n,
                   const double* closure,
                   double* force,
                   double* stiffness) const override {
    f_->EvaluateLaw(n, closure, force, stiffness);
  }
  bool EvaluateGaps(const double* x, Gaps* gaps) const override {
    return f_->EvaluateGaps(x, gaps);
  }
  bool EvaluateStiffness(const double* x,
                         double theta,
                         SparseMatrix* h) const override {
    return f_->EvaluateStiffness(x, theta, h);
  }
  bool EvaluateWeightedHessian(const double* x,
                               const double* first,
                               const double* second,
                               SparseMatrix* h) const override {
    return f_->EvaluateWeightedHessian(x, first, second, h);
  }

 protected:
  ContactEnergy* const f_;
};

}  // namespace granopt

#endif  // GRANOPT_TESTS_GRANULAR_FORWARDING_H_
