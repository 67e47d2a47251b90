// Nonlinear conjugate gradients, d = -z + beta d_before with z = P^-1 g
// (Algorithms 3 and 4 of Wang & Zhang).
//
// With y = g - g_before and w = z - z_before:
//   fr   g^T z / (g_before^T z_before)                      Fletcher-Reeves
//   pr   max(0, z^T y / (g_before^T z_before))              Polak-Ribiere+
//   hs   max(0, z^T y / (d_before^T y))                     Hestenes-Stiefel
//   hz   max(b, 0.4 g^T d / d^T P d),
//        b = (z^T y - 2 g^T d y^T w / (d^T y)) / (d^T y)    Hager-Zhang
//
// Deviations: a direction that does not descend, and a change of P, start
// afresh from -z (the paper does not say). The bound of hz is the one of Hager
// & Zhang, SIAM J. Optim. 23 (2013) 2150, (7.4), which in contrast to that of
// 2005 has no units.

#include <algorithm>
#include <memory>

#include "Eigen/Core"
#include "solvers/line_search_method.h"
#include "solvers/normalize.h"
#include "solvers/registry.h"
#include "solvers/vector_loops.h"

namespace granopt {
namespace {

using Eigen::VectorXd;
using ConstMap = Eigen::Map<const VectorXd>;

enum class Beta { FR, PR, HS, HZ };

class NcgRule : public DirectionRule {
 public:
  NcgRule(int n, Beta beta, bool preconditioned)
      : n_(n), beta_(beta), preconditioned_(preconditioned), d_(n) {}

  Outlook Direction(const double* g,
                    const double* z,
                    double unit,
                    double* d) override {
    if (is_fresh_) {
      scale_ = NormalizingPower(ConstMap(z, n_).lpNorm<Eigen::Infinity>());
      d_ = -scale_ * ConstMap(z, n_);
      if (beta_ == Beta::HZ && preconditioned_) pd_ = -scale_ * ConstMap(g, n_);
    } else {
      d_ = -scale_ * ConstMap(z, n_) + next_beta_ * d_;
      if (beta_ == Beta::HZ && preconditioned_) {
        pd_ = -scale_ * ConstMap(g, n_) + next_beta_ * pd_;
      }
    }
    Eigen::Map<VectorXd>(d, n_) = d_;
    const double slope = Dot(n_, g, d);
    // The same first-order change as in the last step: Nocedal, Wright, 2nd
    // ed., p. 59.
    const double first_step =
        !is_fresh_ && slope < 0.0 ? last_step_ * (last_slope_ / slope)
                                  : unit / scale_;
    return {first_step, slope};
  }

  void Taken(const Step& step) override {
    const ConstMap g(step.g, n_), z(step.z, n_);
    const ConstMap g_new(step.g_new, n_), z_new(step.z_new, n_);
    const double gz = (scale_ * g).dot(z);
    const double zy = (scale_ * z_new).dot(g_new) - (scale_ * z_new).dot(g);
    const double dy = step.end.slope - step.start.slope;
    switch (beta_) {
      case Beta::FR:
        next_beta_ = (scale_ * g_new).dot(z_new) / gz;
        break;
      case Beta::PR:
        next_beta_ = std::max(0.0, zy / gz);
        break;
      case Beta::HS:
        next_beta_ = dy > 0.0 ? std::max(0.0, zy / dy) : 0.0;
        break;
      case Beta::HZ: {
        const double yw = (scale_ * (g_new - g)).dot(z_new - z);
        const double dd = preconditioned_ ? d_.dot(pd_) : d_.squaredNorm();
        const double b =
            dy > 0.0 ? (zy - 2.0 * step.end.slope * (yw / dy)) / dy : 0.0;
        next_beta_ = std::max(b, 0.4 * step.start.slope / dd * scale_);
        break;
      }
    }
    last_step_ = step.end.step;
    last_slope_ = step.start.slope;
    is_fresh_ = false;
  }

  void PreconditionerChanged(const Solve& /*solve*/) override { Forget(); }
  void Forget() override { is_fresh_ = true; }

 private:
  const int n_;
  const Beta beta_;
  const bool preconditioned_;
  // Of directions over gradients, a power of two: products of two gradients of
  // 1e-160 would be zero.
  double scale_ = 1.0;
  VectorXd d_;
  VectorXd pd_;  // P d, by the recursion of d
  bool is_fresh_ = true;
  double next_beta_ = 0.0;
  double last_step_ = 0.0;
  double last_slope_ = 0.0;
};

LineSearchOptions TightLineSearch() {
  LineSearchOptions options;
  options.curvature = 0.1;
  return options;
}

class Ncg : public LineSearchMethod {
 public:
  explicit Ncg(Parameters* parameters)
      : LineSearchMethod(parameters, TightLineSearch()),
        beta_(static_cast<Beta>(
            parameters->Choice("beta",
                               "hs",
                               "fr|pr|hs|hz",
                               "Fletcher-Reeves, Polak-Ribiere+, "
                               "Hestenes-Stiefel+ or Hager-Zhang"))) {}

 protected:
  std::unique_ptr<DirectionRule> MakeRule(int n,
                                          bool preconditioned) const override {
    return std::make_unique<NcgRule>(n, beta_, preconditioned);
  }

 private:
  const Beta beta_;
};

}  // namespace

REGISTER_SOLVER(
    ncg,
    Ncg,
    "nonlinear conjugate gradients, preconditioned",
    "Fletcher, Reeves, Comput. J. 7 (1964) 149; Polak, Ribiere, RIRO 3 (1969) "
    "35; Hager, Zhang, SIAM J. Optim. 16 (2005) 170; Wang, Zhang, Electron. "
    "Res. Arch. 28 (2020) 405, Algorithms 3 and 4");

}  // namespace granopt
