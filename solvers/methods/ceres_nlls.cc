// A sum of one-sided power laws as nonlinear least squares, minimized by Ceres'
// trust-region methods:
//   E = sum k_c (delta_c v 0)^alpha / alpha = 1/2 sum r_c^2,
//   r_c = (2 k_c / alpha)^(1/2) (delta_c v 0)^(alpha / 2).
// The model of a step is J^T J: the Hessian without the second derivatives of
// delta (Gauss & Newton), which is positive semidefinite. Where these matter,
// at alpha = 2 above all, it converges linearly. At alpha = 2 r_c has a kink
// where a gap closes; its derivative there is taken from the open side, 0.
//
// Each point costs one evaluation of the function, which the stopping test and
// the counts are about, and one of its gaps. A residual block is a gap, its
// parameter blocks are the blocks of variables (SecondOrderFunction::
// BlockSize()) in its row of the Jacobian. Ceres wants to know all of them
// before it starts: these are the gaps that the function lists there. Where
// another one closes at a trial point the trial is off; Ceres starts anew from
// the last accepted iterate with that gap in the list and the same trust
// region. That is a counted restart, not one of `restarts`.
//
// differences=1 tells Ceres the cost relative to the start, and replaces a
// change that is lost in roundoff (below 1e-8 of the cost) by the trapezoidal
// rule (g_a + g_b).(x_b - x_a) / 2 from the last accepted iterate a, as
// solvers/ceres_line_search.h does. A residual cannot carry that; a loss
// function with derivative 1 can.
//
// Deviations: all tolerances of Ceres' own are 0; its tests are replaced.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ceres/cost_function.h"
#include "ceres/evaluation_callback.h"
#include "ceres/iteration_callback.h"
#include "ceres/loss_function.h"
#include "ceres/problem.h"
#include "ceres/solver.h"
#include "solvers/external_method.h"
#include "solvers/line_search.h"
#include "solvers/one_thread.h"
#include "solvers/quiet_log.h"
#include "solvers/registry.h"
#include "solvers/unilateral.h"

namespace granopt {
namespace {

// A gap in Ceres' list and the blocks of variables that it depends on.
struct Term {
  GapId id;
  std::vector<int> blocks;  // increasing
};

// The blocks in row c, or block 0 for a gap that depends on none.
std::vector<int> BlocksOf(const Gaps& gaps, int c, int block_size) {
  std::vector<int> blocks;
  for (decltype(gaps.jacobian)::InnerIterator it(gaps.jacobian, c); it; ++it) {
    const int block = static_cast<int>(it.col()) / block_size;
    const auto at = std::lower_bound(blocks.begin(), blocks.end(), block);
    if (at == blocks.end() || *at != block) blocks.insert(at, block);
  }
  if (blocks.empty()) blocks.push_back(0);
  return blocks;
}

// `terms` with those of `more`, both in order of their ids.
std::vector<Term> Union(const std::vector<Term>& terms,
                        const std::vector<Term>& more) {
  std::vector<Term> all;
  auto t = terms.begin();
  for (const Term& term : more) {
    for (; t != terms.end() && t->id < term.id; ++t) all.push_back(*t);
    all.push_back(term);
    if (t == terms.end() || !(t->id == term.id)) continue;
    std::vector<int> blocks;
    std::set_union(t->blocks.begin(),
                   t->blocks.end(),
                   term.blocks.begin(),
                   term.blocks.end(),
                   std::back_inserter(blocks));
    all.back().blocks = std::move(blocks);
    ++t;
  }
  all.insert(all.end(), t, terms.end());
  return all;
}

// All residuals and their derivatives at the point that Ceres is at.
class Residuals : public ceres::EvaluationCallback {
 public:
  Residuals(ExternalMethod::Problem* problem,
            const double* y,
            std::vector<Term> terms,
            double alpha,
            int block_size)
      : problem_(problem),
        y_(y),
        terms_(std::move(terms)),
        alpha_(alpha),
        block_size_(block_size),
        gap_of_(terms_.size()),
        residual_(terms_.size()),
        slope_(terms_.size()),
        start_(terms_.size() + 1) {
    for (std::size_t t = 0; t < terms_.size(); ++t) {
      start_[t + 1] =
          start_[t] + block_size * static_cast<int>(terms_[t].blocks.size());
    }
    jacobian_.resize(start_.back());
    here_.gradient.resize(problem->n());
  }

  // ceres::EvaluationCallback: y_ is where Ceres wants to know.
  void PrepareForEvaluation(bool jacobians, bool is_new) override {
    if (is_new) is_valid_ = Evaluate();
    if (jacobians && is_valid_) EvaluateJacobian();
  }

  // The last point that was evaluated becomes the one that changes of the cost
  // are taken from.
  void Anchor() { anchor_ = here_; }

  const std::vector<Term>& terms() const { return terms_; }
  // Gaps that have closed without being in the list.
  const std::vector<Term>& newcomers() const { return newcomers_; }
  // False where the run must end, or where a gap is missing.
  bool is_valid() const { return is_valid_; }
  double residual(int t) const { return residual_[t]; }
  // Its derivatives, block after block.
  const double* jacobian(int t) const { return &jacobian_[start_[t]]; }
  int block_size() const { return block_size_; }
  double told() const { return here_.told; }

 private:
  bool Evaluate() {
    here_.x.assign(y_, y_ + problem_->n());
    if (!problem_->Evaluate(y_, &here_.cost, here_.gradient.data()) ||
        !problem_->EvaluateGaps(y_, &gaps_)) {
      return false;
    }
    if (!anchor_.x.empty()) {
      here_.told =
          anchor_.told + anchor_.Change(y_, here_.cost, here_.gradient.data());
    }
    std::fill(gap_of_.begin(), gap_of_.end(), -1);
    newcomers_.clear();
    std::size_t t = 0;
    for (int c = 0; c < gaps_.delta.size(); ++c) {
      while (t < terms_.size() && terms_[t].id < gaps_.ids[c]) ++t;
      if (!(gaps_.delta[c] > 0.0)) continue;
      if (t < terms_.size() && terms_[t].id == gaps_.ids[c] && Covers(t, c)) {
        gap_of_[t] = c;
      } else {
        newcomers_.push_back({gaps_.ids[c], BlocksOf(gaps_, c, block_size_)});
      }
    }
    for (std::size_t k = 0; k < terms_.size(); ++k) {
      residual_[k] = slope_[k] = 0.0;
      const int c = gap_of_[k];
      if (c < 0) continue;
      const double delta = gaps_.delta[c];
      const double root = std::sqrt(2.0 * gaps_.stiffness[c] / alpha_);
      slope_[k] = 0.5 * alpha_ * root *
                  (alpha_ == 2.0 ? 1.0 : std::pow(delta, 0.5 * alpha_ - 1.0));
      residual_[k] = 2.0 / alpha_ * slope_[k] * delta;
    }
    return newcomers_.empty();
  }

  // True if the blocks of term t are enough for row c.
  bool Covers(std::size_t t, int c) const {
    const std::vector<int>& blocks = terms_[t].blocks;
    for (decltype(gaps_.jacobian)::InnerIterator it(gaps_.jacobian, c); it;
         ++it) {
      if (!std::binary_search(blocks.begin(),
                              blocks.end(),
                              static_cast<int>(it.col()) / block_size_)) {
        return false;
      }
    }
    return true;
  }

  void EvaluateJacobian() {
    ++problem_->monitor()->counters().hessians;
    std::fill(jacobian_.begin(), jacobian_.end(), 0.0);
    for (std::size_t t = 0; t < terms_.size(); ++t) {
      if (gap_of_[t] < 0) continue;
      const std::vector<int>& blocks = terms_[t].blocks;
      for (decltype(gaps_.jacobian)::InnerIterator it(gaps_.jacobian,
                                                      gap_of_[t]);
           it;
           ++it) {
        const int column = static_cast<int>(it.col());
        const auto place =
            std::lower_bound(
                blocks.begin(), blocks.end(), column / block_size_) -
            blocks.begin();
        jacobian_[start_[t] + place * block_size_ + column % block_size_] =
            slope_[t] * it.value();
      }
    }
  }

  ExternalMethod::Problem* problem_;
  const double* y_;
  const std::vector<Term> terms_;
  const double alpha_;
  const int block_size_;
  Gaps gaps_;
  std::vector<int> gap_of_;  // row of a term's gap in gaps_, -1 if it is open
  std::vector<double> residual_, slope_;  // slope: dr / d(delta)
  std::vector<int> start_;                // of a term in jacobian_
  std::vector<double> jacobian_;
  std::vector<Term> newcomers_;
  CostAnchor here_, anchor_;  // x: y, in the library's units
  bool is_valid_ = false;
};

// One of them, for Ceres.
class Residual : public ceres::CostFunction {
 public:
  Residual(const Residuals* residuals, int term)
      : residuals_(residuals), term_(term) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->assign(
        residuals->terms()[term].blocks.size(), residuals->block_size());
  }

  bool Evaluate(double const* const* /*parameters*/,
                double* residuals,
                double** jacobians) const override {
    if (!residuals_->is_valid()) return false;
    residuals[0] = residuals_->residual(term_);
    if (jacobians == nullptr) return true;
    const double* row = residuals_->jacobian(term_);
    const int size = residuals_->block_size();
    const std::size_t count = parameter_block_sizes().size();
    for (std::size_t b = 0; b < count; ++b, row += size) {
      if (jacobians[b] != nullptr) std::copy(row, row + size, jacobians[b]);
    }
    return true;
  }

 private:
  const Residuals* residuals_;
  const int term_;
};

// Leaves residuals as they are and says what the cost is: all of it with one
// residual, nothing with the others.
class Loss : public ceres::LossFunction {
 public:
  explicit Loss(const Residuals* residuals) : residuals_(residuals) {}
  void Evaluate(double /*square*/, double rho[3]) const override {
    rho[0] = residuals_ == nullptr ? 0.0 : 2.0 * residuals_->told();
    rho[1] = 1.0;
    rho[2] = 0.0;
  }

 private:
  const Residuals* residuals_;
};

class Callback : public ceres::IterationCallback {
 public:
  Callback(ExternalMethod::Problem* problem,
           Residuals* residuals,
           bool differences,
           double* y)
      : problem_(problem),
        residuals_(residuals),
        differences_(differences),
        y_(y),
        accepted_(y, y + problem->n()) {}

  ceres::CallbackReturnType operator()(
      const ceres::IterationSummary& summary) override {
    const bool is_start = summary.iteration == 0;
    if (!residuals_->is_valid()) return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
    radius_ = summary.trust_region_radius;
    if (!is_start && !summary.step_is_successful) return ceres::SOLVER_CONTINUE;
    // y is where the Jacobian was evaluated last, which is here.
    accepted_.assign(y_, y_ + problem_->n());
    if (differences_) residuals_->Anchor();
    if (!is_start && !problem_->Accept(y_)) {
      return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
    }
    return ceres::SOLVER_CONTINUE;
  }

  const std::vector<double>& accepted() const { return accepted_; }
  // Of the last trial that was not off.
  double radius() const { return radius_; }

 private:
  ExternalMethod::Problem* problem_;
  Residuals* residuals_;
  const bool differences_;
  const double* y_;
  std::vector<double> accepted_;
  double radius_ = 0.0;
};

class CeresNlls : public ExternalMethod {
 public:
  explicit CeresNlls(Parameters* parameters)
      : ExternalMethod(parameters),
        differences_(parameters->Bool(
            "differences",
            false,
            "small cost differences from gradients; wants restarts > 0")) {
    constexpr ceres::TrustRegionStrategyType kStrategies[] = {
        ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG};
    options_.trust_region_strategy_type = kStrategies[parameters->Choice(
        "strategy", "lm", "lm|dogleg", "Levenberg-Marquardt or dogleg")];
    options_.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options_.logging_type = ceres::SILENT;
    options_.max_num_iterations = std::numeric_limits<int>::max();
    options_.max_solver_time_in_seconds = std::numeric_limits<double>::max();
    options_.function_tolerance = 0.0;
    options_.gradient_tolerance = 0.0;
    options_.parameter_tolerance = 0.0;
  }

  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const UnilateralFunction*>(&function) != nullptr) {
      return true;
    }
    *error = "ceres_nlls needs a sum of powers of gaps (UnilateralFunction)";
    return false;
  }

 protected:
  const char* library() const override { return "Ceres"; }

  std::string Run(Problem* problem, double* y) const override {
    const auto& function = dynamic_cast<const UnilateralFunction&>(
        *problem->monitor()->function());
    const int n = problem->n();
    const int block_size =
        n % function.BlockSize() == 0 ? function.BlockSize() : 1;
    const QuietLog quiet;
    [[maybe_unused]] const OneThread one_thread;
    Gaps gaps;
    if (!problem->EvaluateGaps(y, &gaps)) return "";
    std::vector<Term> terms;
    for (int c = 0; c < gaps.delta.size(); ++c) {
      terms.push_back({gaps.ids[c], BlocksOf(gaps, c, block_size)});
    }
    if (terms.empty()) return "there are no gaps";

    ceres::Solver::Options options = options_;
    while (true) {
      Residuals residuals(problem, y, terms, function.Exponent(), block_size);
      Callback callback(problem, &residuals, differences_, y);
      options.callbacks = {&callback};
      ceres::Solver::Summary summary;
      Solve(options, &residuals, y, &summary);
      std::copy(callback.accepted().begin(), callback.accepted().end(), y);
      Monitor* const monitor = problem->monitor();
      // Each with a factorization of its own.
      monitor->counters().factorizations += summary.num_linear_solves;
      monitor->counters().solves += summary.num_linear_solves;
      monitor->AddLinearSeconds(summary.linear_solver_time_in_seconds);
      if (residuals.newcomers().empty()) return summary.message;
      terms = Union(terms, residuals.newcomers());
      options.initial_trust_region_radius = callback.radius();
      ++monitor->counters().restarts;
    }
  }

 private:
  void Solve(const ceres::Solver::Options& options,
             Residuals* residuals,
             double* y,
             ceres::Solver::Summary* summary) const {
    const std::vector<Term>& terms = residuals->terms();
    std::deque<Residual> functions;
    const Loss speaker(residuals), silent(nullptr);
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.disable_all_safety_checks = true;
    problem_options.evaluation_callback = residuals;
    ceres::Problem problem(problem_options);
    std::vector<double*> blocks;
    for (std::size_t t = 0; t < terms.size(); ++t) {
      functions.emplace_back(residuals, static_cast<int>(t));
      blocks.clear();
      for (const int block : terms[t].blocks) {
        blocks.push_back(y + block * residuals->block_size());
      }
      const Loss* loss = t == 0 ? &speaker : &silent;
      problem.AddResidualBlock(&functions.back(),
                               differences_ ? const_cast<Loss*>(loss) : nullptr,
                               blocks);
    }
    ceres::Solve(options, &problem, summary);
  }

  ceres::Solver::Options options_;
  bool differences_;
};

}  // namespace

REGISTER_SOLVER(
    ceres_nlls,
    CeresNlls,
    "Ceres' nonlinear least squares: Gauss-Newton in a trust region",
    "Levenberg, Q. Appl. Math. 2 (1944) 164; Marquardt, SIAM J. Appl. Math. "
    "11 (1963) 431; Powell (1970), dogleg; Ceres Solver 2.1");

}  // namespace granopt
