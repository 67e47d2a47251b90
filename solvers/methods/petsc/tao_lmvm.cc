// Limited-memory variable metric of PETSc's optimizers (TAO lmvm: L-BFGS with
// the line search of More and Thuente), on one process.

#include <string>

#include "solvers/methods/petsc/tao_method.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

class TaoLmvm : public TaoMethod {
 public:
  explicit TaoLmvm(Parameters* parameters)
      : TaoMethod(parameters, TAOLMVM, /*hessian=*/false),
        memory_(
            parameters->Int("memory", 5, 1, "number of stored (s, y) pairs")),
        scaling_(parameters->Choice("scaling",
                                    "scalar",
                                    "scalar|diagonal|none",
                                    "initial Hessian; TAO's own default is "
                                    "diagonal")) {}

 protected:
  // The matrix can be reached in no other way.
  Options TaoOptions() const override {
    constexpr const char* kScaling[] = {"scalar", "diagonal", "none"};
    return {{"-tao_lmvm_mat_lmvm_scale_type", kScaling[scaling_]},
            {"-tao_lmvm_mat_lmvm_hist_size", std::to_string(memory_)}};
  }

 private:
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
