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
#include "solvers/vector_loops.h"

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

  Outlook Direction(const double* g,
                    const double* z,
                    double unit,
                    double* d) override {
    if (count_ == 0) {
      Eigen::Map<VectorXd>(d, n_) = -unit * ConstMap(z, n_);
      return {1.0, Dot(n_, g, d)};
    }
    // q = g - sum a_i y_i, and r = P^-1 q, which is q without P. Each pass
    // through memory changes them by one pair and takes the product with the
    // next one.
    const double scale = rescales_ ? Newest(1).sy / Newest(1).yw : 1.0;
    const double* q = g;
    const double* r = z;
    double* const q_next = preconditioned_ ? q_.data() : d;
    double product = Dot(n_, Newest(1).s.data(), g);
    for (int k = 1; k <= count_; ++k) {
      Pair& pair = Newest(k);
      pair.a = product / pair.sy;
      const bool is_last = k == count_;
      const double rescale = is_last ? scale : 1.0;
      const double* const y = pair.y.data();
      if (!preconditioned_) {
        product = Combine(n_,
                          rescale,
                          q,
                          -pair.a,
                          y,
                          q_next,
                          is_last ? y : Newest(k + 1).s.data());
      } else {
        const double* const w = pair.w.data();
        if (!is_last) {
          product =
              Combine(n_, 1.0, q, -pair.a, y, q_next, Newest(k + 1).s.data());
          Combine(n_, 1.0, r, -pair.a, w, d);
        } else {
          product = Combine(n_, rescale, r, -pair.a, w, d, y);
        }
        r = d;
      }
      q = q_next;
    }
    for (int k = count_; k >= 1; --k) {
      const Pair& pair = Newest(k);
      const double part = pair.a - product / pair.sy;
      product = Combine(n_,
                        k > 1 ? 1.0 : -1.0,
                        d,
                        part,
                        pair.s.data(),
                        d,
                        k > 1 ? Newest(k - 1).y.data() : g);
    }
    return {1.0, product};
  }

  void Taken(const Step& step) override {
    Pair& pair = pairs_[next_];
    // The norms squared, so that no square root spoils the invariance of units.
    const auto [sy, ss, yy] = Differences(n_,
                                          step.x_new,
                                          step.x,
                                          step.g_new,
                                          step.g,
                                          pair.s.data(),
                                          pair.y.data());
    pair.sy = sy;
    pair.yw = yy;
    if (preconditioned_) {
      pair.yw = Combine(
          n_, 1.0, step.z_new, -1.0, step.z, pair.w.data(), pair.y.data());
    }
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
