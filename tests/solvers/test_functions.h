// Small functions with known minima, and wrappers that make them misbehave.

#ifndef GRANOPT_TESTS_SOLVERS_TEST_FUNCTIONS_H_
#define GRANOPT_TESTS_SOLVERS_TEST_FUNCTIONS_H_

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "Eigen/Core"
#include "Eigen/SparseCore"
#include "solvers/first_order.h"
#include "solvers/second_order.h"

namespace granopt {

// (x - s)^T A (x - s) / 2 with A = Q diag(lambda) Q, lambda from 1 to
// `condition` in geometric steps, Q = I - 2 v v^T a reflection that couples all
// variables, and a solution s of entries of order one. The minimum is 0.
class Quadratic : public FirstOrderFunction {
 public:
  explicit Quadratic(int n, double condition = 1e3)
      : lambda_(n), v_(n), solution_(n) {
    for (int i = 0; i < n; ++i) {
      lambda_[i] = n == 1 ? condition : std::pow(condition, i / (n - 1.0));
      v_[i] = 1.0 + 0.5 * std::sin(3.0 * i);
      solution_[i] = std::cos(1.0 + i * i);
    }
    v_.normalize();
    // The gradient at x = 0.
    gradient_scale_ = Times(solution_).cwiseAbs().mean();
  }

  int NumParameters() const override { return static_cast<int>(v_.size()); }
  const Eigen::VectorXd& solution() const { return solution_; }

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const int n = NumParameters();
    const Eigen::VectorXd d =
        Eigen::Map<const Eigen::VectorXd>(x, n) - solution_;
    const Eigen::VectorXd g = Times(d);
    *cost = 0.5 * d.dot(g);
    if (gradient != nullptr) Eigen::Map<Eigen::VectorXd>(gradient, n) = g;
    if (scales != nullptr) {
      scales->gradient = gradient_scale_;
      scales->length = gradient_scale_ / lambda_.maxCoeff();
    }
    return true;
  }

 private:
  Eigen::VectorXd Times(const Eigen::VectorXd& d) const {
    const Eigen::VectorXd t = lambda_.cwiseProduct(d - 2.0 * v_.dot(d) * v_);
    return t - 2.0 * v_.dot(t) * v_;
  }

  Eigen::VectorXd lambda_, v_, solution_;
  double gradient_scale_;
};

// (x - s)^T A (x - s) / 2 with a sparse A: a chain of springs of very different
// stiffness, 1 to `condition`, and a solution of order one.
class Chain : public SecondOrderFunction {
 public:
  Chain(int n, double condition) : solution_(n), a_(n, n) {
    std::vector<Eigen::Triplet<double>> entries;
    const auto add = [&](int i, int j, double k) {
      entries.emplace_back(i, i, k);
      entries.emplace_back(j, j, k);
      entries.emplace_back(std::max(i, j), std::min(i, j), -k);
    };
    for (int i = 0; i < n; ++i) {
      solution_[i] = std::cos(1.0 + i * i);
      entries.emplace_back(i, i, 1.0);
      if (i + 1 < n) add(i, i + 1, std::pow(condition / 4.0, i / (n - 1.0)));
    }
    a_.setFromTriplets(entries.begin(), entries.end());
    gradient_scale_ =
        Eigen::VectorXd(a_.selfadjointView<Eigen::Lower>() * solution_)
            .cwiseAbs()
            .mean();
    largest_ = a_.diagonal().maxCoeff();
  }
  int NumParameters() const override {
    return static_cast<int>(solution_.size());
  }
  const Eigen::VectorXd& solution() const { return solution_; }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const int n = NumParameters();
    const Eigen::VectorXd d =
        Eigen::Map<const Eigen::VectorXd>(x, n) - solution_;
    const Eigen::VectorXd g = a_.selfadjointView<Eigen::Lower>() * d;
    *cost = 0.5 * d.dot(g);
    if (gradient != nullptr) Eigen::Map<Eigen::VectorXd>(gradient, n) = g;
    if (scales != nullptr) {
      scales->gradient = gradient_scale_;
      scales->length = gradient_scale_ / largest_;
    }
    return true;
  }
  bool EvaluateHessian(const double* /*x*/, SparseMatrix* h) const override {
    *h = a_;
    return true;
  }
  std::int64_t PatternVersion() const override { return 1; }
  bool HessianTimes(const double* /*x*/,
                    const double* v,
                    double* hv) const override {
    Eigen::Map<Eigen::VectorXd>(hv, NumParameters()) =
        a_.selfadjointView<Eigen::Lower>() *
        Eigen::Map<const Eigen::VectorXd>(v, NumParameters());
    return true;
  }

 private:
  Eigen::VectorXd solution_;
  SparseMatrix a_;
  double gradient_scale_, largest_;
};

// For functions of two variables, from EvaluateHessian() with all entries.
class OfTwoVariables : public SecondOrderFunction {
 public:
  int NumParameters() const override { return 2; }
  bool EvaluateHessian(const double* x, SparseMatrix* h) const override {
    const Eigen::Matrix2d dense = Hessian(x);
    h->resize(2, 2);
    h->setZero();
    h->insert(0, 0) = dense(0, 0);
    h->insert(1, 0) = dense(1, 0);
    h->insert(1, 1) = dense(1, 1);
    h->makeCompressed();
    return true;
  }
  std::int64_t PatternVersion() const override { return 1; }
  bool HessianTimes(const double* x,
                    const double* v,
                    double* hv) const override {
    Eigen::Map<Eigen::Vector2d>(hv, 2) =
        Hessian(x) * Eigen::Map<const Eigen::Vector2d>(v, 2);
    return true;
  }

 protected:
  virtual Eigen::Matrix2d Hessian(const double* x) const = 0;
};

// 100 (x_2 - x_1^2)^2 + (1 - x_1)^2, minimum 0 at (1, 1). By default its terms
// are about as large as the scales say one unit away from the minimum.
// Source: Rosenbrock, Comput. J. 3 (1960) 175.
class Rosenbrock : public OfTwoVariables {
 public:
  explicit Rosenbrock(double gradient_scale = 200.0, double length = 1.0)
      : gradient_scale_(gradient_scale), length_(length) {}

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const double a = x[1] - x[0] * x[0];
    const double b = 1.0 - x[0];
    *cost = 100.0 * a * a + b * b;
    if (gradient != nullptr) {
      gradient[0] = -400.0 * x[0] * a - 2.0 * b;
      gradient[1] = 200.0 * a;
    }
    if (scales != nullptr) {
      scales->gradient = gradient_scale_;
      scales->length = length_;
    }
    return true;
  }

 protected:
  Eigen::Matrix2d Hessian(const double* x) const override {
    Eigen::Matrix2d h;
    h << 1200.0 * x[0] * x[0] - 400.0 * x[1] + 2.0, -400.0 * x[0],
        -400.0 * x[0], 200.0;
    return h;
  }

 private:
  const double gradient_scale_, length_;
};

// What is around another function, of which it hides all but the first
// derivatives.
class Wrapper : public FirstOrderFunction {
 public:
  explicit Wrapper(const FirstOrderFunction* f) : f_(f) {}
  int NumParameters() const override { return f_->NumParameters(); }
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    return f_->EvaluateWithScales(x, cost, gradient, scales);
  }

 protected:
  const FirstOrderFunction* const f_;
};

// 2^a f(2^b x): f in other units. Exact, so a method without absolute constants
// takes bitwise the same iterations.
class InOtherUnits : public Wrapper {
 public:
  InOtherUnits(const FirstOrderFunction* f, int a, int b)
      : Wrapper(f), cost_(std::exp2(a)), length_(std::exp2(b)) {}

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    const int n = NumParameters();
    std::vector<double> y(x, x + n);
    for (double& v : y) v *= length_;
    if (!f_->EvaluateWithScales(y.data(), cost, gradient, scales)) return false;
    *cost *= cost_;
    if (gradient != nullptr) {
      for (int i = 0; i < n; ++i) gradient[i] *= cost_ * length_;
    }
    if (scales != nullptr) {
      scales->gradient *= cost_ * length_;
      scales->length /= length_;
    }
    return true;
  }

 private:
  const double cost_, length_;
};

// f(x - offset): variables far from zero, whose rounding limits the gradient
// until the origin is moved.
class Offset : public Wrapper {
 public:
  Offset(const FirstOrderFunction* f, double offset, bool can_rebase = false)
      : Wrapper(f),
        origin_(f->NumParameters(), -offset),
        can_rebase_(can_rebase) {}

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    std::vector<double> y(origin_);
    for (std::size_t i = 0; i < y.size(); ++i) y[i] += x[i];
    return f_->EvaluateWithScales(y.data(), cost, gradient, scales);
  }

  bool Rebase(double* x) override {
    if (!can_rebase_) return false;
    for (std::size_t i = 0; i < origin_.size(); ++i) {
      origin_[i] += x[i];
      x[i] = 0.0;
    }
    return true;
  }

 private:
  std::vector<double> origin_;
  const bool can_rebase_;
};

// f + 1000: the minimum is not zero, so that near it a change of the cost is
// lost in the roundoff of the cost.
class Raised : public Wrapper {
 public:
  using Wrapper::Wrapper;
  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    if (!f_->EvaluateWithScales(x, cost, gradient, scales)) return false;
    *cost += 1000.0;
    return true;
  }
};

// No term is active.
class Nothing : public FirstOrderFunction {
 public:
  int NumParameters() const override { return 3; }
  bool EvaluateWithScales(const double* /*x*/,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    *cost = 0.0;
    if (gradient != nullptr) std::fill(gradient, gradient + 3, 0.0);
    if (scales != nullptr) *scales = {0.0, 0.0, 0.0};
    return true;
  }
};

// Counts the evaluations of f, remembers the least cost among them, and lets
// `meddle` change what an evaluation (1, 2, ...) returns, or fail it.
class Spy : public Wrapper {
 public:
  using Meddle =
      std::function<bool(int evaluation, double* cost, double* gradient)>;

  explicit Spy(const FirstOrderFunction* f, Meddle meddle = nullptr)
      : Wrapper(f), meddle_(std::move(meddle)) {}

  bool EvaluateWithScales(const double* x,
                          double* cost,
                          double* gradient,
                          Scales* scales) const override {
    ++evaluations_;
    if (!f_->EvaluateWithScales(x, cost, gradient, scales)) return false;
    if (meddle_ && !meddle_(evaluations_, cost, gradient)) return false;
    least_cost_ = std::fmin(least_cost_, *cost);
    return true;
  }

  int evaluations() const { return evaluations_; }
  double least_cost() const { return least_cost_; }

 private:
  const Meddle meddle_;
  mutable int evaluations_ = 0;
  mutable double least_cost_ = std::numeric_limits<double>::infinity();
};

}  // namespace granopt

#endif  // GRANOPT_TESTS_SOLVERS_TEST_FUNCTIONS_H_
