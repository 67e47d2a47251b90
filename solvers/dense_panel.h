// granopt: the dense kernels of MultifrontalCholesky for each instruction set,
// see dense_panel.inc.

#ifndef GRANOPT_SOLVERS_DENSE_PANEL_H_
#define GRANOPT_SOLVERS_DENSE_PANEL_H_

namespace granopt {

struct DensePanel {
  const char* name;  // "AVX-512"
  bool (*factor)(int rows, int columns, double* a, long lda);
  void (*update_lower)(
      int rows, int k, const double* a, long lda, double* u, long ldu);
  void (*subtract_product)(int rows,
                           int columns,
                           const double* a,
                           long lda,
                           const double* x,
                           double* y);
  double (*product)(int rows, const double* a, const double* y);
};

extern const DensePanel kPortablePanel;  // SSE2, or what the target has
#ifdef __x86_64__
extern const DensePanel kAvx2Panel;
extern const DensePanel kAvx512Panel;
#endif

// The widest that this machine runs.
const DensePanel& FastestPanel();

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_DENSE_PANEL_H_
