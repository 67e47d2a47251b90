// Conjugate gradients preconditioned by hypre's BoomerAMG.
// Source: Henson, Yang, Appl. Numer. Math. 41 (2002) 155.

#include "solvers/iterative_linear_solver.h"

#ifdef GRANOPT_HAVE_HYPRE

#include <cstdlib>
#include <numeric>
#include <vector>

// MPI's C++ bindings, long withdrawn, would need a library of their own.
#define OMPI_SKIP_MPICXX 1
#define MPICH_SKIP_MPICXX 1
#include "HYPRE.h"
#include "HYPRE_IJ_mv.h"
#include "HYPRE_krylov.h"
#include "HYPRE_parcsr_ls.h"
#include "mpi.h"
#include "solvers/lone_mpi.h"

namespace granopt {
namespace {

// hypre cannot be called before MPI_Init().
void StartMpi() {
  {
    const LoneMpi alone;
    MPI_Init(nullptr, nullptr);
  }
  std::atexit([] {
    int finalized = 0;
    MPI_Finalized(&finalized);
    if (!finalized) MPI_Finalize();
  });
}

// At the first use; the program may have started MPI itself.
void StartHypre() {
  static const bool started = [] {
    int initialized = 0;
    MPI_Initialized(&initialized);
    if (!initialized) StartMpi();
    HYPRE_Init();
    return true;
  }();
  (void)started;
}

class BoomerAmg : public IterativeLinearSolver {
 public:
  explicit BoomerAmg(double tolerance) : tolerance_(tolerance) {}
  ~BoomerAmg() override { Free(); }

 protected:
  bool SetUp(bool) override {
    StartHypre();
    Free();
    ++analyses_;  // coarse grids depend on the values: nothing is kept
    const auto n = static_cast<HYPRE_Int>(matrix().cols());
    indices_.resize(n);
    std::iota(indices_.begin(), indices_.end(), 0);
    sizes_.resize(n);
    for (HYPRE_Int i = 0; i < n; ++i) {
      sizes_[i] = matrix().outerIndexPtr()[i + 1] - matrix().outerIndexPtr()[i];
    }
    HYPRE_IJMatrixCreate(MPI_COMM_SELF, 0, n - 1, 0, n - 1, &ij_matrix_);
    HYPRE_IJMatrixSetObjectType(ij_matrix_, HYPRE_PARCSR);
    HYPRE_IJMatrixSetRowSizes(ij_matrix_, sizes_.data());
    HYPRE_IJMatrixInitialize(ij_matrix_);
    // Columns of a symmetric matrix are its rows.
    HYPRE_IJMatrixSetValues(ij_matrix_,
                            n,
                            sizes_.data(),
                            indices_.data(),
                            matrix().innerIndexPtr(),
                            matrix().valuePtr());
    HYPRE_IJMatrixAssemble(ij_matrix_);
    void* object = nullptr;
    HYPRE_IJMatrixGetObject(ij_matrix_, &object);
    parcsr_matrix_ = static_cast<HYPRE_ParCSRMatrix>(object);
    b_ = MakeVector(n, &ij_b_);
    x_ = MakeVector(n, &ij_x_);

    HYPRE_BoomerAMGCreate(&amg_);
    HYPRE_BoomerAMGSetPrintLevel(amg_, 0);
    // One V-cycle a call, smoothed symmetrically.
    HYPRE_BoomerAMGSetTol(amg_, 0.0);
    HYPRE_BoomerAMGSetMaxIter(amg_, 1);
    HYPRE_BoomerAMGSetRelaxType(amg_, 6);
    HYPRE_ParCSRPCGCreate(MPI_COMM_SELF, &pcg_);
    HYPRE_PCGSetTol(pcg_, tolerance_);
    HYPRE_PCGSetMaxIter(pcg_, 2 * n);
    HYPRE_PCGSetTwoNorm(pcg_, 1);
    HYPRE_PCGSetPrintLevel(pcg_, 0);
    HYPRE_PCGSetPrecond(
        pcg_,
        reinterpret_cast<HYPRE_PtrToSolverFcn>(HYPRE_BoomerAMGSolve),
        reinterpret_cast<HYPRE_PtrToSolverFcn>(HYPRE_BoomerAMGSetup),
        amg_);
    HYPRE_ParCSRPCGSetup(pcg_, parcsr_matrix_, b_, x_);
    const bool done = HYPRE_GetError() == 0;
    HYPRE_ClearAllErrors();
    return done;
  }

  void SolveColumn(const Eigen::VectorXd& b, Eigen::VectorXd* x) override {
    const auto n = static_cast<HYPRE_Int>(b.size());
    HYPRE_IJVectorSetValues(ij_b_, n, indices_.data(), b.data());
    x->setZero();
    HYPRE_IJVectorSetValues(ij_x_, n, indices_.data(), x->data());
    HYPRE_ParCSRPCGSolve(pcg_, parcsr_matrix_, b_, x_);
    HYPRE_Int iterations = 0;
    HYPRE_ParCSRPCGGetNumIterations(pcg_, &iterations);
    iterations_ += iterations;
    HYPRE_IJVectorGetValues(ij_x_, n, indices_.data(), x->data());
    // "Not converged" is an error there.
    HYPRE_ClearAllErrors();
  }

 private:
  static HYPRE_ParVector MakeVector(HYPRE_Int n, HYPRE_IJVector* ij) {
    HYPRE_IJVectorCreate(MPI_COMM_SELF, 0, n - 1, ij);
    HYPRE_IJVectorSetObjectType(*ij, HYPRE_PARCSR);
    HYPRE_IJVectorInitialize(*ij);
    HYPRE_IJVectorAssemble(*ij);
    void* object = nullptr;
    HYPRE_IJVectorGetObject(*ij, &object);
    return static_cast<HYPRE_ParVector>(object);
  }

  void Free() {
    if (ij_matrix_ == nullptr) return;
    HYPRE_ParCSRPCGDestroy(pcg_);
    HYPRE_BoomerAMGDestroy(amg_);
    HYPRE_IJMatrixDestroy(ij_matrix_);
    HYPRE_IJVectorDestroy(ij_b_);
    HYPRE_IJVectorDestroy(ij_x_);
    ij_matrix_ = nullptr;
  }

  const double tolerance_;
  std::vector<HYPRE_Int> indices_, sizes_;
  HYPRE_IJMatrix ij_matrix_ = nullptr;
  HYPRE_IJVector ij_b_ = nullptr, ij_x_ = nullptr;
  HYPRE_ParCSRMatrix parcsr_matrix_ = nullptr;
  HYPRE_ParVector b_ = nullptr, x_ = nullptr;
  HYPRE_Solver amg_ = nullptr, pcg_ = nullptr;
};

}  // namespace

std::unique_ptr<LinearSolver> MakeBoomerAmg(double tolerance) {
  return std::make_unique<BoomerAmg>(tolerance);
}

}  // namespace granopt

#else

namespace granopt {

std::unique_ptr<LinearSolver> MakeBoomerAmg(double) { return nullptr; }

}  // namespace granopt

#endif
