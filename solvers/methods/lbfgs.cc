// Limited-memory BFGS (Algorithm 2 of Wang & Zhang), preconditioned by (16).
//
// Deviations: the boxed step of Algorithm 2 needs P^-1 q with
// q = g - sum a_i y_i. Here it is z - sum a_i w_i with z = P^-1 g and stored
// w_i = P^-1 y_i = z_{i+1} - z_i, so that an iteration costs one solve whatever
// the scaling; when P changes, the w_i are made anew. scaling=gamma multiplies
// P^-1 by s^T y / y^T w of the last pair, which for P = 1 is the paper's own
// choice of B_0; scaling=paper is (16) as printed. The first direction without
// a preconditioner is a steepest descent of the function's own length (the
// paper does not say).

#include <cmath>
#include <memory>
#include <vector>

#include "Eigen/Core"
#include "solvers/line_search_method.h"
#include "solvers/registry.h"
#include "solvers/vector_blocks.h"

namespace granopt {
namespace {

using Eigen::VectorXd;
using ConstMap = Eigen::Map<const VectorXd>;

// s^T y must exceed this part of |s| |y|, else the pair says nothing.
constexpr double kLeastCurvature = 1e-12;

class LbfgsRule : public DirectionRule {
 public:
  LbfgsRule(int n, int memory, bool preconditioned, bool rescales)
      : n_(n),
        memory_(memory),
        preconditioned_(preconditioned),
        rescales_(rescales || !preconditioned),
        pairs_(memory),
        q_(preconditioned ? n : 0) {
    for (Pair& pair : pairs_) {
      pair.s.resize(n);
      pair.y.resize(n);
      if (preconditioned) pair.w.resize(n);
    }
  }

  double Direction(const double* g,
                   const double* z,
                   double unit,
                   double* d) override {
    Eigen::Map<VectorXd> r(d, n_);
    if (count_ == 0) {
      r = -unit * ConstMap(z, n_);
      return 1.0;
    }
    // q = g - sum a_i y_i, and r = P^-1 q. Each pass through memory changes
    // them by one pair and takes the product with the next one.
    Eigen::Map<VectorXd> q(preconditioned_ ? q_.data() : d, n_);
    double product = SumBlocks(n_, 1, [&](int at, int length, double* sum) {
      q.segment(at, length) = ConstMap(g, n_).segment(at, length);
      if (preconditioned_) {
        r.segment(at, length) = ConstMap(z, n_).segment(at, length);
      }
      *sum += Newest(1).s.segment(at, length).dot(q.segment(at, length));
    })[0];
    const double scale = rescales_ ? Newest(1).sy / Newest(1).yw : 1.0;
    for (int k = 1; k <= count_; ++k) {
      Pair& pair = Newest(k);
      pair.a = product / pair.sy;
      product = SumBlocks(n_, 1, [&](int at, int length, double* sum) {
        q.segment(at, length) -= pair.a * pair.y.segment(at, length);
        if (preconditioned_) {
          r.segment(at, length) -= pair.a * pair.w.segment(at, length);
        }
        if (k < count_) {
          *sum +=
              Newest(k + 1).s.segment(at, length).dot(q.segment(at, length));
        } else {
          r.segment(at, length) *= scale;
          *sum += pair.y.segment(at, length).dot(r.segment(at, length));
        }
      })[0];
    }
    for (int k = count_; k >= 1; --k) {
      const Pair& pair = Newest(k);
      const double part = pair.a - product / pair.sy;
      product = SumBlocks(n_, 1, [&](int at, int length, double* sum) {
        r.segment(at, length) += part * pair.s.segment(at, length);
        if (k > 1) {
          *sum +=
              Newest(k - 1).y.segment(at, length).dot(r.segment(at, length));
        } else {
          r.segment(at, length) = -r.segment(at, length);
        }
      })[0];
    }
    return 1.0;
  }

  void Taken(const Step& step) override {
    Pair& pair = pairs_[next_];
    // The norms squared, so that no square root spoils the invariance of units.
    const auto products =
        SumBlocks(n_, 4, [&](int at, int length, double* sums) {
          auto s = pair.s.segment(at, length);
          auto y = pair.y.segment(at, length);
          s = ConstMap(step.x_new, n_).segment(at, length) -
              ConstMap(step.x, n_).segment(at, length);
          y = ConstMap(step.g_new, n_).segment(at, length) -
              ConstMap(step.g, n_).segment(at, length);
          if (preconditioned_) {
            auto w = pair.w.segment(at, length);
            w = ConstMap(step.z_new, n_).segment(at, length) -
                ConstMap(step.z, n_).segment(at, length);
            sums[3] += y.dot(w);
          }
          sums[0] += s.dot(y);
          sums[1] += y.squaredNorm();
          sums[2] += s.squaredNorm();
        });
    pair.sy = products[0];
    const double yy = products[1], ss = products[2], yw = products[3];
    pair.yw = preconditioned_ ? yw : yy;
    if (!(pair.sy > 0.0 && pair.yw > 0.0) ||
        !(pair.sy / ss * (pair.sy / yy) > kLeastCurvature * kLeastCurvature)) {
      // It has been written over the oldest one.
      if (count_ == memory_) --count_;
      return;
    }
    next_ = (next_ + 1) % memory_;
    if (count_ < memory_) ++count_;
  }

  void PreconditionerChanged(const Solve& solve) override {
    for (int k = 1; k <= count_; ++k) {
      Pair& pair = Newest(k);
      solve(pair.y.data(), pair.w.data());
      pair.yw = pair.y.dot(pair.w);
    }
  }

  void Forget() override { count_ = 0; }

 private:
  struct Pair {
    VectorXd s, y, w;
    double sy = 0.0;
    double yw = 0.0;
    double a = 0.0;
  };

  // k = 1 is the last pair stored.
  Pair& Newest(int k) { return pairs_[(next_ - k + memory_) % memory_]; }

  const int n_;
  const int memory_;
  const bool preconditioned_;
  const bool rescales_;
  std::vector<Pair> pairs_;
  VectorXd q_;
  int next_ = 0;
  int count_ = 0;
};

class Lbfgs : public LineSearchMethod {
 public:
  explicit Lbfgs(Parameters* parameters)
      : LineSearchMethod(parameters, LineSearchOptions()),
        memory_(
            parameters->Int("memory", 5, 1, "number m of stored (s, y) pairs")),
        rescales_(parameters->Choice("scaling",
                                     "gamma",
                                     "gamma|paper",
                                     "of a preconditioner: by the last (s, y), "
                                     "or none (16)") == 0) {}

 protected:
  std::unique_ptr<DirectionRule> MakeRule(int n,
                                          bool preconditioned) const override {
    return std::make_unique<LbfgsRule>(n, memory_, preconditioned, rescales_);
  }

 private:
  const int memory_;
  const bool rescales_;
};

}  // namespace

REGISTER_SOLVER(lbfgs,
                Lbfgs,
                "limited-memory BFGS, preconditioned",
                "Nocedal, Math. Comp. 35 (1980) 773; Wang, Zhang, Electron. "
                "Res. Arch. 28 (2020) 405, Algorithm 2");

}  // namespace granopt
