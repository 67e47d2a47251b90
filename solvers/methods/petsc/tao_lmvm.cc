// Limited-memory variable metric of PETSc's optimizers (TAO lmvm: L-BFGS with
// the line search of More and Thuente), on one process.

#include <petsctao.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include "solvers/external_method.h"
#include "solvers/registry.h"

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
#endif

namespace granopt {
namespace {

// What MPI forgets to free is not counted as a leak of ours.
class TheirMemory {
#ifdef __SANITIZE_ADDRESS__
  __lsan::ScopedDisabler disabler_;
#endif
 public:
  TheirMemory() {}
};

// An environment variable for as long as it lives; one that is set already
// stays as it is.
class Environment {
 public:
  Environment(const char* name, const char* value)
      : name_(name), set_(std::getenv(name) == nullptr) {
    if (set_) setenv(name, value, 0);
  }
  ~Environment() {
    if (set_) unsetenv(name_);
  }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;

 private:
  const char* const name_;
  const bool set_;
};

// A PETSc error handler that prints nothing; keeps the first words of an error
// in the std::string `context`.
PetscErrorCode KeepWords(MPI_Comm,
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

void Finalize() {
  const TheirMemory theirs;
  // Whoever ended MPI before has ended PETSc, too.
  int finalized = 1;
  if (MPI_Finalized(&finalized) == MPI_SUCCESS && !finalized) PetscFinalize();
}

// PETSc, and MPI with it, unless the program has initialized them itself. Once
// for all: neither can be initialized again after it has been finalized.
bool Initialize() {
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
    // For Open MPI: one process needs no daemon, no folder and no network, and
    // our signals are not its business. Children do not inherit this.
    const Environment isolated("OMPI_MCA_ess_singleton_isolated", "1");
    const Environment folder("OMPI_MCA_orte_create_session_dirs", "0");
    const Environment transport("OMPI_MCA_btl", "self");
    const Environment messages("OMPI_MCA_pml", "ob1");
    const Environment signals("OMPI_MCA_opal_signal", "");
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

class TaoLmvm : public ExternalMethod {
 public:
  explicit TaoLmvm(Parameters* parameters)
      : ExternalMethod(parameters),
        memory_(
            parameters->Int("memory", 5, 1, "number of stored (s, y) pairs")),
        scaling_(parameters->Choice("scaling",
                                    "scalar",
                                    "scalar|diagonal|none",
                                    "initial Hessian; TAO's own default is "
                                    "diagonal")) {}

 protected:
  const char* library() const override { return "TAO"; }

  std::string Run(Problem* problem, double* y) const override {
    if (!Initialize()) return "PETSc cannot be initialized";
    std::string words;
    PetscPushErrorHandler(&KeepWords, &words);
    Objects objects;
    TaoConvergedReason reason = TAO_CONTINUE_ITERATING;
    const PetscErrorCode error = Solve(problem, y, &objects, &reason);
    TaoDestroy(&objects.tao);
    VecDestroy(&objects.x);
    PetscOptionsDestroy(&objects.options);
    PetscPopErrorHandler();
    return error == 0 ? TaoConvergedReasons[reason] : words;
  }

 private:
  struct Objects {
    Tao tao = nullptr;
    Vec x = nullptr;  // on the memory of y
    PetscOptions options = nullptr;
  };

  PetscErrorCode Solve(Problem* problem,
                       double* y,
                       Objects* objects,
                       TaoConvergedReason* reason) const {
    constexpr const char* kScaling[] = {"scalar", "diagonal", "none"};
    PetscFunctionBegin;
    PetscCall(VecCreateSeqWithArray(
        PETSC_COMM_SELF, 1, problem->n(), y, &objects->x));
    PetscCall(TaoCreate(PETSC_COMM_SELF, &objects->tao));
    PetscCall(TaoSetType(objects->tao, TAOLMVM));
    // The matrix can be reached in no other way. A data base of our own, since
    // in the common one options of others may be.
    PetscCall(PetscOptionsCreate(&objects->options));
    PetscCall(PetscOptionsSetValue(
        objects->options, "-tao_lmvm_mat_lmvm_scale_type", kScaling[scaling_]));
    PetscCall(PetscOptionsSetValue(objects->options,
                                   "-tao_lmvm_mat_lmvm_hist_size",
                                   std::to_string(memory_).c_str()));
    PetscCall(PetscOptionsPush(objects->options));
    const PetscErrorCode error = TaoSetFromOptions(objects->tao);
    PetscCall(PetscOptionsPop());
    PetscCall(error);
    PetscCall(
        TaoSetObjectiveAndGradient(objects->tao, nullptr, &Evaluate, problem));
    // Replaces all tests of TAO's own.
    PetscCall(TaoSetConvergenceTest(objects->tao, &Accept, problem));
    PetscCall(TaoSetSolution(objects->tao, objects->x));
    PetscCall(TaoSolve(objects->tao));
    PetscCall(TaoGetConvergedReason(objects->tao, reason));
    PetscFunctionReturn(0);
  }

  static PetscErrorCode Evaluate(
      Tao, Vec x, PetscReal* cost, Vec gradient, void* problem) {
    const PetscScalar* y;
    PetscScalar* g;
    PetscFunctionBegin;
    PetscCall(VecGetArrayRead(x, &y));
    PetscCall(VecGetArrayWrite(gradient, &g));
    if (!static_cast<Problem*>(problem)->Evaluate(y, cost, g)) {
      // At such a point its line search ends.
      *cost = PETSC_INFINITY;
    }
    PetscCall(VecRestoreArrayWrite(gradient, &g));
    PetscCall(VecRestoreArrayRead(x, &y));
    PetscFunctionReturn(0);
  }

  // Called at the start and at each accepted iterate, and also, without a new
  // one, where TAO gives up.
  static PetscErrorCode Accept(Tao tao, void* problem) {
    TaoConvergedReason reason;
    PetscInt iteration;
    Vec x;
    const PetscScalar* y;
    PetscFunctionBegin;
    PetscCall(TaoGetConvergedReason(tao, &reason));
    PetscCall(TaoGetIterationNumber(tao, &iteration));
    if (reason != TAO_CONTINUE_ITERATING || iteration == 0) {
      PetscFunctionReturn(0);
    }
    PetscCall(TaoGetSolution(tao, &x));
    PetscCall(VecGetArrayRead(x, &y));
    const bool goes_on = static_cast<Problem*>(problem)->Accept(y);
    PetscCall(VecRestoreArrayRead(x, &y));
    if (!goes_on) PetscCall(TaoSetConvergedReason(tao, TAO_CONVERGED_USER));
    PetscFunctionReturn(0);
  }

  const int memory_;
  const int scaling_;
};

}  // namespace

REGISTER_SOLVER(
    tao_lmvm,
    TaoLmvm,
    "PETSc TAO's limited-memory variable metric (L-BFGS)",
    "Nocedal, Math. Comp. 35 (1980) 773; More, Thuente, ACM Trans. Math. "
    "Softw. 20 (1994) 286; Balay et al., PETSc/TAO 3.18");

}  // namespace granopt
