// granopt: several operations on long vectors in one pass through memory, for
// each instruction set and on threads.

#ifndef GRANOPT_SOLVERS_VECTOR_LOOPS_H_
#define GRANOPT_SOLVERS_VECTOR_LOOPS_H_

#include <array>

namespace granopt {

// One thread's part; see vector_loops.inc. Sums have the same bits for every
// instruction set.
struct VectorLoops {
  double (*max_norm)(int n, const double* x);
  double (*dot)(int n, const double* a, const double* b);
  void (*dots)(int n, const double* a, const double* b, double* sums);
  double (*combine)(int n,
                    double scale,
                    const double* x,
                    double a,
                    const double* z,
                    double* y,
                    const double* b);
  void (*differences)(int n,
                      const double* x_new,
                      const double* x,
                      const double* g_new,
                      const double* g,
                      double* s,
                      double* y,
                      double* sums);
  void (*move)(int n,
               double keep,
               double push,
               const double* z,
               double h,
               double* v,
               double* x);
};

extern const VectorLoops kPortableVectors;  // SSE2, or what the target has
#ifdef __x86_64__
extern const VectorLoops kAvx2Vectors;
extern const VectorLoops kAvx512Vectors;
#endif
// The widest that this machine runs.
const VectorLoops& FastestVectors();

// On NumThreads() threads: sums are over pieces of so many entries, then over
// pieces.
constexpr int kVectorPiece = 16384;

void CopyVector(int n, const double* from, double* to);
// max|x|; not finite if an entry is not.
double MaxNorm(int n, const double* x);
double Dot(int n, const double* a, const double* b);
// a.b, a.a and b.b.
std::array<double, 3> Dots(int n, const double* a, const double* b);
// y = scale (x + a z), which may be x or z; returns y.b, which may be y too, or
// 0 where b is null.
double Combine(int n,
               double scale,
               const double* x,
               double a,
               const double* z,
               double* y,
               const double* b = nullptr);
// s = x_new - x and y = g_new - g; returns s.y, s.s and y.y.
std::array<double, 3> Differences(int n,
                                  const double* x_new,
                                  const double* x,
                                  const double* g_new,
                                  const double* g,
                                  double* s,
                                  double* y);
// v = keep v - push z, x += h v.
void Move(int n,
          double keep,
          double push,
          const double* z,
          double h,
          double* v,
          double* x);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_VECTOR_LOOPS_H_
