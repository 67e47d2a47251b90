// The gradient flow dx/dt = -grad E(x), followed with error control by CVODE's
// backward differentiation formulas: the minimum that it ends in is the one
// whose basin of attraction the start belongs to, so it is the reference for
// methods that are faster and less faithful.
//
// Lengths are in units of Scales::length at the start, forces of
// Scales::gradient (both rounded to powers of two, so that other units give the
// same bits), which makes 1 a typical rate. The local error of a step, as root
// mean square over the variables, is kept below rtol * Scales::length of the
// current point. The formulas are implicit; as the flow comes to rest steps
// grow without bound (up to kMaxStep) and turn into Newton's method, so any
// tolerance is reached without following the last exponential decay.
//
// How small rtol must be depends on how near the start is to the border of a
// basin. Of 40 starts far from any minimum, with 256 variables and forces whose
// derivatives jump, 39 ended in the same minimum for 1e-6 as for 1e-8, 36 for
// 1e-5, 34 for 1e-4, 19 for 1e-3. Each power of ten costs a factor of about 2
// in evaluations.
//
// A SecondOrderFunction provides H v, and (H + 1 / gamma)^-1 as preconditioner
// of GMRES; where that matrix is not positive definite, the step is made
// shorter. Otherwise H v is a difference quotient.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cvode/cvode.h"
#include "cvode/cvode_ls.h"
#include "nvector/nvector_serial.h"
#include "solvers/format.h"
#include "solvers/linear_solver.h"
#include "solvers/monitor.h"
#include "solvers/normalize.h"
#include "solvers/registry.h"
#include "solvers/second_order.h"
#include "sundials/sundials_context.h"
#include "sunlinsol/sunlinsol_spgmr.h"

namespace granopt {
namespace {

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
// In typical times. H + 1 / kMaxStep is safely definite where H has zero modes.
constexpr double kMaxStep = 1e10;
// CVODE ends Newton's iteration at this fraction of the error tolerance. Its
// default, 0.1, relies on a rate of convergence measured in earlier steps,
// which is wrong where second derivatives jump; what then remains looks like an
// error of the step, and steps stay short for ever in a cycle of two states.
constexpr double kNewtonFraction = 1e-3;
constexpr double kLeastNewtonFraction = 1e-5;
// After so many steps without gain the fraction is reduced, or the run ended.
constexpr int kStallWindow = 300;

// One run of Minimize(): what CVODE's callbacks need, and CVODE itself.
class Flow {
 public:
  Flow(Monitor* monitor,
       std::unique_ptr<LinearSolver> linear,
       double rtol,
       int krylov)
      : monitor_(monitor),
        second_order_(dynamic_cast<SecondOrderFunction*>(monitor->function())),
        linear_(std::move(linear)),
        rtol_(rtol),
        krylov_(std::max(1, std::min(krylov, monitor->n()))),
        x_(monitor->n()) {}

  ~Flow() {
    CVodeFree(&cvode_);
    if (gmres_ != nullptr) SUNLinSolFree(gmres_);
    if (y_ != nullptr) N_VDestroy(y_);
    if (context_ != nullptr) SUNContext_Free(&context_);
  }
  Flow(const Flow&) = delete;
  Flow& operator=(const Flow&) = delete;

  void Run(const Solver& solver, const double* x) {
    std::copy(x, x + monitor_->n(), x_.begin());
    double cost;
    const double* gradient;
    Scales scales;
    if (!monitor_->BeginCached(solver, x, &cost, &gradient, &scales)) return;
    monitor_->Recenter(x_.data());
    length_unit_ = 1.0 / NormalizingPower(scales.length);
    force_unit_ = 1.0 / NormalizingPower(scales.gradient);
    length_ = scales.length > 0.0 ? scales.length : length_unit_;
    if (!Create()) {
      monitor_->GiveUp("CVODE could not be set up");
      return;
    }

    std::int64_t steps = 0;  // since the last start
    double newton_fraction = kNewtonFraction;
    double least_cost = cost;
    double least_gradient = monitor_->max_gradient();
    int stalled_steps = 0;
    while (!monitor_->stopped()) {
      double t = 0.0;
      const int flag = CVode(cvode_, 1.0, y_, &t, CV_ONE_STEP);
      CountLinearIterations();
      if (monitor_->stopped()) return;
      if (flag < 0) {
        if (monitor_->LastEvaluationFailed()) {
          monitor_->FailEvaluation();
          return;
        }
        // History may be at fault, once.
        if (steps < 10) {
          char* name = CVodeGetReturnFlagName(flag);
          monitor_->GiveUp("CVODE: " + std::string(name));
          free(name);
          return;
        }
        ++monitor_->counters().restarts;
        steps = 0;
        Restart();
        continue;
      }
      ++steps;
      ReadState();
      if (!monitor_->IsCached(x_.data()) && monitor_->BudgetSpent()) return;
      if (!monitor_->EvaluateCached(x_.data(), &cost, &gradient, &scales)) {
        monitor_->FailEvaluation();
        return;
      }
      if (monitor_->Accept(x_.data(), cost, gradient, scales)) return;
      if (scales.length > 0.0) length_ = scales.length;

      const double now = monitor_->max_gradient();
      if (cost < least_cost - 1e-12 * std::abs(least_cost) ||
          now < 0.9 * least_gradient) {
        least_cost = std::min(cost, least_cost);
        least_gradient = std::min(now, least_gradient);
        stalled_steps = 0;
      } else if (++stalled_steps == kStallWindow) {
        newton_fraction *= 0.1;
        if (newton_fraction < 0.5 * kLeastNewtonFraction) {
          monitor_->GiveUp(
              Format("%d steps without gain, the last of %.1e typical times",
                     kStallWindow,
                     LastStep()));
          return;
        }
        CVodeSetNonlinConvCoef(cvode_, newton_fraction);
        ++monitor_->counters().restarts;
        stalled_steps = 0;
        steps = 0;
        Restart();
        continue;
      }
      if (NeedsRebase(scales)) {
        if (monitor_->Rebase(x_.data())) {
          steps = 0;
          Restart();
          continue;
        }
        can_rebase_ = false;
      }
      monitor_->Recenter(x_.data());
      TightenLinearTolerance(gradient);
    }
  }

 private:
  static Flow& Of(void* data) { return *static_cast<Flow*>(data); }

  bool Create() {
    const int n = monitor_->n();
    if (SUNContext_Create(nullptr, &context_) != 0) return false;
    y_ = N_VNew_Serial(n, context_);
    cvode_ = CVodeCreate(CV_BDF, context_);
    gmres_ = SUNLinSol_SPGMR(
        y_,
        second_order_ != nullptr ? SUN_PREC_RIGHT : SUN_PREC_NONE,
        krylov_,
        context_);
    if (y_ == nullptr || cvode_ == nullptr || gmres_ == nullptr) return false;
    WriteState();
    bool done = CVodeSetErrHandlerFn(
                    cvode_,
                    [](int, const char*, const char*, char*, void*) {},
                    nullptr) == CV_SUCCESS &&
                CVodeInit(cvode_, Rate, 0.0, y_) == CV_SUCCESS &&
                CVodeSetUserData(cvode_, this) == CV_SUCCESS &&
                CVodeWFtolerances(cvode_, Weights) == CV_SUCCESS &&
                CVodeSetMaxStep(cvode_, kMaxStep) == CV_SUCCESS &&
                CVodeSetNonlinConvCoef(cvode_, kNewtonFraction) == CV_SUCCESS &&
                CVodeSetMaxErrTestFails(cvode_, 20) == CV_SUCCESS &&
                CVodeSetMaxConvFails(cvode_, 20) == CV_SUCCESS &&
                CVodeSetLinearSolver(cvode_, gmres_, nullptr) == CV_SUCCESS;
    if (second_order_ != nullptr) {
      done = done &&
             CVodeSetJacTimes(cvode_, nullptr, HessianTimes) == CV_SUCCESS &&
             CVodeSetPreconditioner(cvode_, Factorize, Precondition) ==
                 CV_SUCCESS &&
             // A new H for each factor costs little and saves two of five
             // linear iterations; by default it is kept for 51 steps.
             CVodeSetJacEvalFrequency(cvode_, 1) == CV_SUCCESS;
    }
    return done;
  }

  // From x_, without history.
  void Restart() {
    WriteState();
    linear_iterations_ = 0;
    CVodeReInit(cvode_, 0.0, y_);
  }

  void WriteState() {
    double* y = N_VGetArrayPointer(y_);
    for (int i = 0; i < monitor_->n(); ++i) y[i] = x_[i] / length_unit_;
  }
  void ReadState() { ToVariables(y_); }
  void ToVariables(N_Vector y) {
    const double* values = N_VGetArrayPointer(y);
    for (int i = 0; i < monitor_->n(); ++i) x_[i] = length_unit_ * values[i];
  }

  double LastStep() const {
    double step = 0.0;
    CVodeGetLastStep(cvode_, &step);
    return step;
  }

  void CountLinearIterations() {
    long total = 0;
    CVodeGetNumLinIters(cvode_, &total);
    monitor_->counters().linear_iterations += total - linear_iterations_;
    linear_iterations_ = total;
  }

  // The rounding of x must not show in the error estimate, nor limit the run.
  bool NeedsRebase(const Scales& scales) const {
    if (!can_rebase_) return false;
    if (monitor_->WantsRebase()) return true;
    double largest = 0.0;
    for (const double value : x_) largest = std::max(largest, std::abs(value));
    return scales.length > 0.0 &&
           kEpsilon * largest > 1e-2 * rtol_ * scales.length;
  }

  // By default CVODE solves linear systems to 0.05 of the tolerance of a step.
  // Once the flow comes to rest that is more than the whole right-hand side,
  // gamma * rate, which is then taken for the solution. So the bound follows
  // that right-hand side down.
  void TightenLinearTolerance(const double* gradient) {
    double gamma = 0.0;
    CVodeGetCurrentGamma(cvode_, &gamma);
    double squares = 0.0;
    for (int i = 0; i < monitor_->n(); ++i) {
      const double rate = gradient[i] / force_unit_;
      squares += rate * rate;
    }
    const double rms = std::sqrt(squares / monitor_->n());
    const double in_tolerances = gamma * rms * length_unit_ / (rtol_ * length_);
    CVodeSetEpsLin(cvode_, std::clamp(0.1 * in_tolerances, 1e-300, 0.05));
  }

  // dy/dt.
  static int Rate(double, N_Vector y, N_Vector rate, void* data) {
    Flow& flow = Of(data);
    Monitor* monitor = flow.monitor_;
    flow.ToVariables(y);
    const double* x = flow.x_.data();
    // Below zero is "give up", above zero "try a shorter step".
    if (!monitor->IsCached(x) && monitor->BudgetSpent()) return -1;
    double cost;
    const double* gradient;
    Scales scales;
    if (!monitor->EvaluateCached(x, &cost, &gradient, &scales)) return 1;
    double* values = N_VGetArrayPointer(rate);
    for (int i = 0; i < monitor->n(); ++i) {
      values[i] = -gradient[i] / flow.force_unit_;
    }
    return 0;
  }

  static int Weights(N_Vector, N_Vector weights, void* data) {
    const Flow& flow = Of(data);
    N_VConst(flow.length_unit_ / (flow.rtol_ * flow.length_), weights);
    return 0;
  }

  static int HessianTimes(N_Vector v,
                          N_Vector jv,
                          double,
                          N_Vector y,
                          N_Vector,
                          void* data,
                          N_Vector) {
    Flow& flow = Of(data);
    const Monitor::LinearTimer timer(flow.monitor_);
    flow.ToVariables(y);
    double* values = N_VGetArrayPointer(jv);
    if (!flow.second_order_->HessianTimes(
            flow.x_.data(), N_VGetArrayPointer(v), values)) {
      return 1;
    }
    const double factor = -flow.length_unit_ / flow.force_unit_;
    for (int i = 0; i < flow.monitor_->n(); ++i) values[i] *= factor;
    return 0;
  }

  // 1 + gamma (length / force) H = gamma (length / force) (H + shift 1).
  static int Factorize(double,
                       N_Vector y,
                       N_Vector,
                       booleantype,
                       booleantype* hessian_is_new,
                       double gamma,
                       void* data) {
    Flow& flow = Of(data);
    const Monitor::LinearTimer timer(flow.monitor_);
    Counters& counters = flow.monitor_->counters();
    flow.ToVariables(y);
    ++counters.hessians;
    *hessian_is_new = SUNTRUE;
    if (!flow.second_order_->EvaluateHessian(flow.x_.data(), &flow.hessian_)) {
      return 1;
    }
    flow.shift_ = flow.force_unit_ / (gamma * flow.length_unit_);
    ++counters.factorizations;
    const bool done = flow.linear_->Factorize(
        flow.hessian_, flow.second_order_->PatternVersion(), flow.shift_);
    if (!flow.linear_->refusal().empty()) {
      flow.monitor_->RunOutOfMemory(flow.linear_->refusal());
      return -1;  // no shorter step will help
    }
    return done ? 0 : 1;
  }

  static int Precondition(double,
                          N_Vector,
                          N_Vector,
                          N_Vector r,
                          N_Vector z,
                          double,
                          double,
                          int,
                          void* data) {
    Flow& flow = Of(data);
    const Monitor::LinearTimer timer(flow.monitor_);
    ++flow.monitor_->counters().solves;
    double* values = N_VGetArrayPointer(z);
    flow.linear_->Solve(N_VGetArrayPointer(r), values, 1);
    for (int i = 0; i < flow.monitor_->n(); ++i) values[i] *= flow.shift_;
    return 0;
  }

  Monitor* monitor_;
  SecondOrderFunction* second_order_;  // null for a first-order function
  const std::unique_ptr<LinearSolver> linear_;
  const double rtol_;
  const int krylov_;
  double length_unit_ = 1.0;
  double force_unit_ = 1.0;
  double length_ = 1.0;  // Scales::length of the last accepted point
  bool can_rebase_ = true;
  std::vector<double> x_;
  SparseMatrix hessian_;
  double shift_ = 0.0;
  long linear_iterations_ = 0;

  SUNContext context_ = nullptr;
  void* cvode_ = nullptr;
  SUNLinearSolver gmres_ = nullptr;
  N_Vector y_ = nullptr;
};

class GradientFlow : public Solver {
 public:
  explicit GradientFlow(Parameters* parameters)
      : rtol_(parameters->Double(
            "rtol", 1e-6, 1e-10, 0.1, "error of a step / Scales::length")),
        krylov_(parameters->Int(
            "krylov",
            50,
            1,
            "Krylov vectors of GMRES, which is not restarted")) {
    MakeLinearSolver(parameters);
    parameters_ = *parameters;
  }

  Summary Minimize(FirstOrderFunction* function,
                   const SolveOptions& options,
                   double* x) const override {
    Monitor monitor(function, options, name(), Monitor::Cache::LAST_EVALUATION);
    Parameters parameters = parameters_;
    Flow flow(&monitor, MakeLinearSolver(&parameters), rtol_, krylov_);
    flow.Run(*this, x);
    return monitor.Finish(x);
  }

 private:
  const double rtol_;
  const int krylov_;
  Parameters parameters_;
};

}  // namespace

REGISTER_SOLVER(gradient_flow,
                GradientFlow,
                "The gradient flow, integrated with error control: ends in the "
                "basin it starts in",
                "Cohen, Hindmarsh, Comput. Phys. 10 (1996) 138; Hindmarsh et "
                "al., ACM Trans. Math. Softw. 31 (2005) 363");

}  // namespace granopt
