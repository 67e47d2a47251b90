#include "solvers/trust_region.h"

#include <algorithm>
#include <cmath>

namespace granopt {
namespace {

using Eigen::VectorXd;

// A shift that was not enough grows by this factor at least ...
constexpr double kRaise = 4.0;
// ... and from one step to the next, by the secular equation, by no more than
// this in either direction.
constexpr double kTrust = 16.0;
// Of the shifts that failed, what is believed one step later.
constexpr double kForget = 0.25;
constexpr int kInverseIterations = 3;

}  // namespace

void NearlyExactSubproblem::FindSlope(const VectorXd& s, double norm2) {
  linear_->Solve(s.data(), w_.data(), 1);
  const double bend = s.dot(w_);
  slope_ = bend > 0.0 ? norm2 / bend : 0.0;
}

void NearlyExactSubproblem::Suggest(const VectorXd& s, double radius) {
  if (!is_known_) return;
  // The factor is still there.
  if (slope_ == 0.0 && last_norm_ > options_.most * radius) {
    FindSlope(s, s.squaredNorm());
  }
  double next = last_lambda_ + Growth(radius);
  next = std::max({next, last_lambda_ / kTrust, barrier_});
  if (last_lambda_ > 0.0) next = std::min(next, kTrust * last_lambda_);
  lambda_ = next > options_.negligible * unit_ ? next : 0.0;
}

SubproblemStep NearlyExactSubproblem::Solve(
    const SparseMatrix& lower,
    std::int64_t pattern_version,
    double floor,
    double unit,
    const VectorXd& g,
    double radius,
    const std::function<double()>& first_raise,
    VectorXd* s) {
  SubproblemStep step;
  const auto n = g.size();
  w_.resize(n);
  z_.resize(n);
  s->resize(n);
  minus_g_ = -g;
  unit_ = unit;
  double lambda = lambda_;
  // What has failed may do so for a while, but not for ever.
  barrier_ *= kForget;
  is_known_ = false;
  double low = -1.0;   // too small: the step is too long, or there is none
  double high = -1.0;  // large enough
  bool low_failed = false;
  bool is_factored = false;

  for (int k = 0; k < options_.max_factorizations; ++k) {
    is_factored = linear_->Factorize(lower, pattern_version, floor + lambda);
    if (!is_factored) {
      if (!linear_->refusal().empty()) return step;
      low = lambda;
      low_failed = true;
      if (high > 0.0) {
        lambda = low > 0.0 ? std::sqrt(low * high) : 0.01 * high;
      } else {
        lambda = std::max(kRaise * lambda, lambda > 0.0 ? 0.0 : first_raise());
      }
      if (!std::isfinite(lambda)) return step;
      continue;
    }
    linear_->Solve(minus_g_.data(), s->data(), 1);
    double norm2 = s->squaredNorm();
    if (!std::isfinite(norm2)) return step;
    const double norm = std::sqrt(norm2);
    step.end = SubproblemStep::End::BOUNDARY;
    is_known_ = true;
    last_lambda_ = lambda;
    last_norm_ = norm;
    slope_ = 0.0;
    if (norm > options_.most * radius || lambda > 0.0) FindSlope(*s, norm2);
    const double growth = Growth(radius);
    if (low_failed) barrier_ = std::sqrt(low * lambda);
    if (norm > options_.most * radius) {
      low = lambda;
      low_failed = false;
      double next = lambda + growth;
      if (high > 0.0 && !(next < high)) next = 0.5 * (low + high);
      if (!(next > lambda)) break;  // within rounding
      lambda = next;
      continue;
    }
    if (lambda == 0.0) {
      step.end = SubproblemStep::End::INTERIOR;
      break;
    }
    if (norm >= options_.least * radius) break;
    step.end = SubproblemStep::End::SHORT;
    high = lambda;
    if (low_failed && high - low <= options_.hard * high) {
      // (H + lambda 1)^-1 applied to anything brings out the lowest
      // eigenvector.
      z_ = *s;
      double size2 = norm2;
      for (int i = 0; i < kInverseIterations && size2 > 0.0; ++i) {
        w_ = z_ / std::sqrt(size2);
        linear_->Solve(w_.data(), z_.data(), 1);
        size2 = z_.squaredNorm();
      }
      if (!(size2 > 0.0) || !std::isfinite(size2)) break;
      z_ /= std::sqrt(size2);
      // The root of |s + t z| = radius that is smaller in magnitude.
      const double b = s->dot(z_);
      const double c = radius * radius - norm2;
      const double root = std::sqrt(b * b + c);
      *s += (b > 0.0 ? c / (b + root) : -c / (root - b)) * z_;
      step.end = SubproblemStep::End::BOUNDARY;
      break;
    }
    if (options_.accepts_short) break;
    double next = lambda + growth;
    if (low >= 0.0) {
      if (!(next > low)) next = low > 0.0 ? std::sqrt(low * high) : 0.1 * high;
    } else if (!(next > options_.negligible * unit)) {
      next = 0.0;
    }
    if (!(next < lambda)) break;
    lambda = next;
  }
  is_known_ = is_known_ && is_factored;
  if (!is_known_) {
    step.end = SubproblemStep::End::FAILED;
    return step;
  }
  step.lambda = last_lambda_;
  step.norm2 = s->squaredNorm();
  // H s + floor s = -g - lambda s, but for what was added.
  step.change = 0.5 * (g.dot(*s) - step.lambda * step.norm2);
  lambda_ = last_lambda_;
  return step;
}

SubproblemStep TruncatedSubproblem::Solve(const VectorXd& g,
                                          double radius2,
                                          VectorXd* s) const {
  SubproblemStep step;
  const auto n = g.size();
  VectorXd r = g, z(n), p(n), hp(n);
  s->setZero(n);
  const auto precondition = [&]() {
    if (solve) {
      solve(r, &z);
    } else {
      z = r;
    }
  };
  precondition();
  double rz = r.dot(z);
  const double target = tolerance * tolerance * rz;
  p = -z;
  // Products in P by recurrence, Conn, Gould, Toint, (7.5.5)-(7.5.7).
  double pp = rz, sp = 0.0, ss = 0.0;
  step.end = SubproblemStep::End::INTERIOR;
  while (step.iterations < max_iterations && rz > 0.0) {
    times(p, &hp);
    ++step.iterations;
    const double bend = p.dot(hp);
    const double a = bend > 0.0 ? rz / bend : 0.0;
    const double next_ss = ss + 2.0 * a * sp + a * a * pp;
    if (!(bend > 0.0) || next_ss >= radius2) {
      step.end = bend > 0.0 ? SubproblemStep::End::BOUNDARY
                            : SubproblemStep::End::CURVED;
      // |s + t p| = radius, in a form without cancellation.
      const double c = radius2 - ss;
      const double root = std::sqrt(sp * sp + pp * c);
      const double t = sp > 0.0 ? c / (sp + root) : (root - sp) / pp;
      step.change += t * (-rz) + 0.5 * t * t * bend;
      *s += t * p;
      ss = radius2;
      break;
    }
    *s += a * p;
    step.change -= 0.5 * a * rz;
    ss = next_ss;
    r += a * hp;
    precondition();
    const double next_rz = r.dot(z);
    if (!(next_rz > target)) break;
    const double b = next_rz / rz;
    rz = next_rz;
    sp = b * (sp + a * pp);
    pp = rz + b * b * pp;
    p = b * p - z;
  }
  step.norm2 = ss;
  return step;
}

}  // namespace granopt
