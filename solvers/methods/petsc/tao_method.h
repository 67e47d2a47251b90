// granopt: the optimizers of PETSc (TAO) behind the Solver interface, on one
// process.

#ifndef GRANOPT_SOLVERS_METHODS_PETSC_TAO_METHOD_H_
#define GRANOPT_SOLVERS_METHODS_PETSC_TAO_METHOD_H_

#include <petscksp.h>
#include <petsctao.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "solvers/diagonal.h"
#include "solvers/external_method.h"
#include "solvers/lone_mpi.h"
#include "solvers/one_thread.h"
#include "solvers/registry.h"
#include "solvers/second_order.h"

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
#endif

namespace granopt {
namespace petsc {

// What MPI forgets to free is not counted as a leak of ours.
class TheirMemory {
#ifdef __SANITIZE_ADDRESS__
  __lsan::ScopedDisabler disabler_;
#endif
 public:
  TheirMemory() {}
};

// A PETSc error handler that prints nothing; keeps the first words of an error
// in the std::string `context`.
inline PetscErrorCode KeepWords(MPI_Comm,
                                int /*line*/,
                                const char* /*function*/,
                                const char* /*file*/,
                                PetscErrorCode code,
                                PetscErrorType type,
                                const char* words,
                                void* context) {
  auto* kept = static_cast<std::string*>(context);
  if (type == PETSC_ERROR_INITIAL && words != nullptr) *kept = words;
  return code;
}

inline void Finalize() {
  const TheirMemory theirs;
  // Whoever ended MPI before has ended PETSc, too.
  int finalized = 1;
  if (MPI_Finalized(&finalized) == MPI_SUCCESS && !finalized) PetscFinalize();
}

// PETSc, and MPI with it, unless the program has initialized them itself. Once
// for all: neither can be initialized again after it has been finalized.
inline bool Initialize() {
  const auto is_ready = []() {
    PetscBool ready = PETSC_FALSE;
    return PetscInitialized(&ready) == 0 && ready;
  };
  static const bool done = [&]() {
    if (is_ready()) return true;
    const TheirMemory theirs;
    int mpi = 0, finalized = 0;
    MPI_Initialized(&mpi);
    MPI_Finalized(&finalized);
    if (finalized) return false;
    const LoneMpi alone;
    // No ~/.petscrc, no handler of signals, no word about unused options.
    std::string words[] = {
        "granopt", "-skip_petscrc", "-no_signal_handler", "-options_left", "0"};
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    int count = static_cast<int>(pointers.size());
    pointers.push_back(nullptr);
    char** arguments = pointers.data();
    const PetscErrorCode error =
        PetscInitialize(&count, &arguments, nullptr, nullptr);
    if (error != 0) return false;
    if (!mpi) MPI_Comm_set_errhandler(PETSC_COMM_SELF, MPI_ERRORS_RETURN);
    std::atexit(&Finalize);
    return true;
  }();
  // The program may have finalized its own since.
  return done && is_ready();
}

}  // namespace petsc

// One of TAO's types, with options of its own in a data base of our own, since
// in the common one options of others may be. Its tests of convergence are
// replaced by ours.
class TaoMethod : public ExternalMethod {
 public:
  using Options = std::vector<std::pair<std::string, std::string>>;

 protected:
  // `type` as TaoSetType() takes it; with second derivatives if `hessian`.
  TaoMethod(Parameters* parameters, const char* type, bool hessian)
      : ExternalMethod(parameters), type_(type), hessian_(hessian) {}

  // {"-tao_...", "value"}, read at each run.
  virtual Options TaoOptions() const = 0;
  // See TaoNewton.
  virtual double shift() const { return 0.0; }

  const char* library() const override { return "TAO"; }

  std::string Run(Problem* problem, double* y) const override {
    if (!petsc::Initialize()) return "PETSc cannot be initialized";
    [[maybe_unused]] const OneThread one_thread;
    std::string words;
    PetscPushErrorHandler(&petsc::KeepWords, &words);
    State state(problem, y, shift());
    TaoConvergedReason reason = TAO_CONTINUE_ITERATING;
    const PetscErrorCode error = Solve(y, &state, &reason);
    TaoDestroy(&state.tao);
    MatDestroy(&state.hessian);
    VecDestroy(&state.x);
    if (state.pushed) PetscOptionsPop();
    PetscOptionsDestroy(&state.options);
    PetscPopErrorHandler();
    return error == 0 ? TaoConvergedReasons[reason] : words;
  }

 private:
  struct State {
    State(Problem* p, const double* y, double s)
        : problem(p), last(y, y + p->n()), shift(s) {}
    Problem* problem;
    std::vector<double> last;  // iterate that we know of
    const double shift;
    Tao tao = nullptr;
    Vec x = nullptr;  // on the memory of y
    PetscOptions options = nullptr;
    bool pushed = false;
    // Its lower triangle by columns is the upper one by rows, which PETSc's
    // symmetric format keeps. `hessian` lives on the memory of `lower`.
    SparseMatrix lower;
    Mat hessian = nullptr;
    std::int64_t pattern_version = -1;
    const double* values = nullptr;
    bool is_new = false;  // since the last solve
    std::optional<Monitor::LinearTimer> timer;
  };

  PetscErrorCode Solve(double* y,
                       State* state,
                       TaoConvergedReason* reason) const {
    PetscFunctionBegin;
    PetscCall(VecCreateSeqWithArray(
        PETSC_COMM_SELF, 1, state->problem->n(), y, &state->x));
    PetscCall(PetscOptionsCreate(&state->options));
    for (const auto& [key, value] : TaoOptions()) {
      PetscCall(
          PetscOptionsSetValue(state->options, key.c_str(), value.c_str()));
    }
    PetscCall(PetscOptionsPush(state->options));
    state->pushed = true;
    PetscCall(TaoCreate(PETSC_COMM_SELF, &state->tao));
    PetscCall(TaoSetType(state->tao, type_));
    PetscCall(TaoSetFromOptions(state->tao));
    PetscCall(
        TaoSetObjectiveAndGradient(state->tao, nullptr, &Evaluate, state));
    if (hessian_) {
      // Its pattern is not known before it is asked for.
      const int n = state->problem->n();
      state->lower.resize(n, n);
      state->lower.setIdentity();
      PetscCall(MakeHessian(state));
      PetscCall(TaoSetHessian(
          state->tao, state->hessian, state->hessian, &EvaluateHessian, state));
      KSP ksp = nullptr;
      PetscCall(TaoGetKSP(state->tao, &ksp));
      PetscCall(KSPSetPreSolve(ksp, &BeforeSolve, state));
      PetscCall(KSPSetPostSolve(ksp, &AfterSolve, state));
    }
    PetscCall(TaoSetConvergenceTest(state->tao, &Accept, state));
    PetscCall(TaoSetSolution(state->tao, state->x));
    PetscCall(TaoSolve(state->tao));
    PetscCall(TaoGetConvergedReason(state->tao, reason));
    PetscFunctionReturn(0);
  }

  static PetscErrorCode Evaluate(
      Tao, Vec x, PetscReal* cost, Vec gradient, void* context) {
    const PetscScalar* y;
    PetscScalar* g;
    PetscFunctionBegin;
    PetscCall(VecGetArrayRead(x, &y));
    PetscCall(VecGetArrayWrite(gradient, &g));
    if (!static_cast<State*>(context)->problem->Evaluate(y, cost, g)) {
      // At such a point its line search ends.
      *cost = PETSC_INFINITY;
    }
    PetscCall(VecRestoreArrayWrite(gradient, &g));
    PetscCall(VecRestoreArrayRead(x, &y));
    PetscFunctionReturn(0);
  }

  // A matrix on the memory of `lower`, in the place of the one before.
  static PetscErrorCode MakeHessian(State* state) {
    PetscFunctionBegin;
    const int n = state->problem->n();
    Mat made = nullptr;
    PetscCall(MatCreateSeqSBAIJWithArrays(PETSC_COMM_SELF,
                                          1,
                                          n,
                                          n,
                                          state->lower.outerIndexPtr(),
                                          state->lower.innerIndexPtr(),
                                          state->lower.valuePtr(),
                                          &made));
    PetscCall(MatSetOption(made, MAT_SPD, PETSC_FALSE));
    if (state->hessian == nullptr) {
      state->hessian = made;
    } else {
      PetscCall(MatHeaderReplace(state->hessian, &made));
    }
    state->values = state->lower.valuePtr();
    PetscFunctionReturn(0);
  }

  static bool ReadHessian(State* state, const double* y) {
    if (!state->problem->EvaluateHessian(y, &state->lower)) return false;
    const auto& function = dynamic_cast<const SecondOrderFunction&>(
        *state->problem->monitor()->function());
    state->pattern_version = function.PatternVersion();
    state->is_new = true;
    SparseMatrix& lower = state->lower;
    bool has_diagonal = true;
    for (int i = 0; i < lower.cols(); ++i) {
      has_diagonal = has_diagonal && DiagonalPlace(lower, i) >= 0;
    }
    if (!has_diagonal) {
      SparseMatrix zeros(lower.rows(), lower.cols());
      zeros.setIdentity();
      zeros.coeffs() = 0.0;
      lower = SparseMatrix(lower + zeros);
    }
    double largest = 0.0;
    for (int i = 0; i < lower.cols(); ++i) {
      largest = std::max(largest, lower.valuePtr()[DiagonalPlace(lower, i)]);
    }
    for (int i = 0; i < lower.cols(); ++i) {
      lower.valuePtr()[DiagonalPlace(lower, i)] += state->shift * largest;
    }
    return true;
  }

  static PetscErrorCode EvaluateHessian(
      Tao tao, Vec x, Mat hessian, Mat, void* context) {
    auto* state = static_cast<State*>(context);
    const PetscScalar* y;
    PetscFunctionBegin;
    const std::int64_t version = state->pattern_version;
    PetscCall(VecGetArrayRead(x, &y));
    const bool done = ReadHessian(state, y);
    PetscCall(VecRestoreArrayRead(x, &y));
    if (!done) PetscFunctionReturn(PETSC_ERR_USER);
    if (version != state->pattern_version ||
        state->values != state->lower.valuePtr()) {
      PetscCall(MakeHessian(state));
      // It would go on with the symbolic factor of the old pattern, and crash:
      // it compares counters that a new matrix starts again.
      KSP ksp = nullptr;
      PetscCall(TaoGetKSP(tao, &ksp));
      PetscCall(KSPReset(ksp));
    } else {
      PetscCall(MatAssemblyBegin(hessian, MAT_FINAL_ASSEMBLY));
      PetscCall(MatAssemblyEnd(hessian, MAT_FINAL_ASSEMBLY));
    }
    PetscFunctionReturn(0);
  }

  // A solve with a new matrix sets its preconditioner up first.
  static PetscErrorCode BeforeSolve(KSP, Vec, Vec, void* context) {
    auto* state = static_cast<State*>(context);
    Counters& counters = state->problem->monitor()->counters();
    PetscFunctionBegin;
    if (state->is_new) ++counters.factorizations;
    state->is_new = false;
    ++counters.solves;
    state->timer.emplace(state->problem->monitor());
    PetscFunctionReturn(0);
  }

  static PetscErrorCode AfterSolve(KSP ksp, Vec, Vec, void* context) {
    auto* state = static_cast<State*>(context);
    PetscInt iterations;
    PetscBool direct;
    PetscFunctionBegin;
    state->timer.reset();
    PetscCall(KSPGetIterationNumber(ksp, &iterations));
    PetscCall(PetscObjectTypeCompare(
        reinterpret_cast<PetscObject>(ksp), KSPPREONLY, &direct));
    if (!direct) {
      state->problem->monitor()->counters().linear_iterations += iterations;
    }
    PetscFunctionReturn(0);
  }

  // Called at the start and at each accepted iterate, and also, without a new
  // one, where TAO gives up. A trust region may have moved the start.
  static PetscErrorCode Accept(Tao tao, void* context) {
    auto* state = static_cast<State*>(context);
    TaoConvergedReason reason;
    Vec x;
    const PetscScalar* y;
    PetscFunctionBegin;
    PetscCall(TaoGetConvergedReason(tao, &reason));
    if (reason != TAO_CONTINUE_ITERATING) PetscFunctionReturn(0);
    PetscCall(TaoGetSolution(tao, &x));
    PetscCall(VecGetArrayRead(x, &y));
    bool goes_on = true;
    if (!std::equal(state->last.begin(), state->last.end(), y)) {
      state->last.assign(y, y + state->last.size());
      goes_on = state->problem->Accept(y);
    }
    PetscCall(VecRestoreArrayRead(x, &y));
    if (!goes_on) PetscCall(TaoSetConvergedReason(tao, TAO_CONVERGED_USER));
    PetscFunctionReturn(0);
  }

  const char* const type_;
  const bool hessian_;
};

// With the exact sparse Hessian of a SecondOrderFunction.
class TaoNewton : public TaoMethod {
 public:
  bool Supports(const FirstOrderFunction& function,
                std::string* error) const override {
    if (dynamic_cast<const SecondOrderFunction*>(&function) != nullptr) {
      return true;
    }
    *error = "TAO's Newton methods need second derivatives";
    return false;
  }

 protected:
  // Its linear solver's options begin with `prefix`. `trust` if that must be
  // one that knows of a trust region, preconditioned by what `linear` says.
  TaoNewton(Parameters* parameters,
            const char* type,
            const char* prefix,
            const char* linear,
            bool trust)
      : TaoMethod(parameters, type, /*hessian=*/true),
        prefix_(prefix),
        trust_(trust),
        linear_(parameters->Choice(
            "linear",
            linear,
            "mumps|icc|jacobi",
            trust ? "preconditioner of conjugate gradients (Steihaug & Toint): "
                    "MUMPS' factors, incomplete ones, the diagonal"
                  : "MUMPS' factors, or conjugate gradients preconditioned by "
                    "incomplete ones or by the diagonal")),
        shift_(parameters->Double(
            "shift",
            1e-12,
            0.0,
            1.0,
            "added to the Hessian's diagonal, relative to its largest "
            "entry")) {
#ifndef PETSC_HAVE_MUMPS
    if (linear_ == 0) {
      parameters->Refuse("linear", "mumps", "needs a PETSc that has MUMPS");
    }
#endif
  }

  double shift() const override { return shift_; }
  Options TaoOptions() const override {
    const bool direct = linear_ == 0;
    constexpr const char* kPc[] = {"cholesky", "icc", "jacobi"};
    Options options = {
        {prefix_ + "ksp_type", direct && !trust_ ? "preonly" : "stcg"},
        {prefix_ + "pc_type", kPc[linear_]}};
    if (direct) {
      options.emplace_back(prefix_ + "pc_factor_mat_solver_type", "mumps");
    }
    return options;
  }

 private:
  const std::string prefix_;
  const bool trust_;
  const int linear_;
  const double shift_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_METHODS_PETSC_TAO_METHOD_H_
