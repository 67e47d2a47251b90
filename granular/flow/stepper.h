// granopt: steps in time.

#ifndef GRANOPT_GRANULAR_FLOW_STEPPER_H_
#define GRANOPT_GRANULAR_FLOW_STEPPER_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "granular/flow/flow.h"
#include "solvers/solver.h"

namespace granopt {

// A step that was tried and not taken.
struct Rejection {
  double time = 0.0;
  double step = 0.0;
  int iterations = 0;
  double ratio = 0.0;  // measure of error over what is tolerated
  std::string reason;
};

struct StepReport {
  double step = 0.0;  // that was taken
  int iterations = 0;
  // Of a minimization: evaluations, Hessians that were not positive definite.
  std::int64_t evaluations = 0;
  std::vector<Rejection> rejections;
};

struct StepperOptions {
  double step = 0.01;         // Dt, or its upper limit Dt_lim
  double first_step = 0.001;  // of adaptive ones
  // Order in which positions of a sweep are updated (remarks 5, 6).
  enum class Sweep { JACOBI, GAUSS_SEIDEL, GROUPS };
  Sweep sweep = Sweep::JACOBI;
  int groups = 4;
  double tolerance = 1e-8;      // TOL on the relative change of an iteration
  int desired_iterations = 10;  // K_d
  double safety = 0.9;          // times Dt of (6.8)
  double relaxation = 1.0;      // gamma of (6.13)
  bool is_adaptive = true;
};

// Steps of one flow. A stepper keeps no state but workspaces: the same state
// gives the same step. (Verlet's keeps the forces at the end of a step for the
// next one: another scene needs another stepper.)
class Stepper {
 public:
  virtual ~Stepper() = default;
  // Takes one step of at most `limit`: x, v, time, the step to try next, counts
  // and ledgers of `state`. False with one line in `error`: the state as it was
  // but for counts where no step is possible ("step floor ...", "collapse
  // ...": Dt would fall below its floor, or forces are not finite), the state
  // after the step where that brought two grains so near each other that
  // nothing holds them apart ("collapse ...", FlowScene::HasCollapsed()).
  virtual bool Step(const FlowScene& scene,
                    double limit,
                    FlowState* state,
                    StepReport* report,
                    std::string* error) = 0;
  virtual double FirstStep() const = 0;
};

// Backward Euler by the paper's fixed point (6.6), its step adapted (6.8):
//   r^K = Dt^2 / m Psi(r^(K-1)) + r^L + Dt v^L.
// Contacts are found at r^L and frozen for the step, with normals and e; their
// impulses (collision.h) are evaluated anew in each iteration with the forces E
// of r^(K-1). The change of an iteration is
//   w_K = sum_i |r_i^K - r_i^(K-1)| / sum_i |r_i^K - r_i^L|,
// converged at w_K <= TOL. Started from r^L, w_1 = 1 takes the place of w_0.
// Then, or after K_d iterations in vain,
//   Dt <- 0.9 Dt (TOL / w_0)^(1 / (p K_d)) / (w_K / w_0)^(1 / (p K)),  p = 2,
// at most Dt_lim. Damping is implicit, v <- (u + Dt Psi / m) / (1 + Dt d / m).
//
// Deviations: the frozen list (found at the iterate, contacts come and go for
// ever); sequential impulses; the factor 0.9, without which every tenth step is
// rejected in strong fields; the change of Dt but for it is in [0.1, 10], and
// half where an iterate is not finite; velocities from impulses, which is the
// same to TOL and exact in momentum.
std::unique_ptr<Stepper> CreateImplicitStepper(const StepperOptions& options);

// Velocity Verlet: impacts at the start of a step, then
//   u' = u + Dt/2 a(x), x += Dt u', v = u' + Dt/2 a(x), damping by the
//   trapezoid.
// One evaluation of forces a step, two where a grain jumped at the boundary
// before; second order between impacts.
std::unique_ptr<Stepper> CreateVerletStepper(const StepperOptions& options);

// Backward Euler as a minimization (remark 8): r^(L+1) is a minimum of
//   Phi(r) = sum_i m_i / (2 Dt^2) |r_i - r_i^L - Dt u_i|^2 + V(r)
//            - sum_i Psi_i^ext . r_i + sum_i d_i / (2 Dt) |r_i - r_i^L|^2,
// u = velocities after impacts, whose forces E are those of the last pass (two
// or three passes where grains touch). `solver` is any first-order method, or
// second-order one up to some thousand grains (the matrix of a near field is
// full).
std::unique_ptr<Stepper> CreateMinimizingStepper(
    const StepperOptions& options, std::unique_ptr<Solver> solver);

// True if Phi of a step of that length has a positive definite tangent at r^L:
// m / Dt^2 + d / Dt + V''. From there Newton's method has a direction; wherever
// the fixed point contracts it is so.
bool HasConvexStep(const FlowScene& scene, const FlowState& state, double dt);

// False, with one line in `error`, for a method that cannot serve Phi.
bool SolvesSteps(const Solver& solver, std::string* error);

// Steps until `end`; false with the stepper's error. `observer` sees each
// accepted step and may stop the run by returning false (which is no error:
// state->time tells). `last` (may be null): what the step that failed reports,
// its rejections above all, which `observer` does not see.
bool RunFlow(
    const FlowScene& scene,
    double end,
    Stepper* stepper,
    const std::function<bool(const FlowState&, const StepReport&)>& observer,
    FlowState* state,
    std::string* error,
    StepReport* last = nullptr);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_STEPPER_H_
