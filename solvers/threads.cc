#include "solvers/threads.h"

namespace granopt {
namespace {

int num_threads = 1;

}  // namespace

bool SetNumThreads(int threads) {
#ifdef _OPENMP
  if (threads < 1) return false;
#else
  if (threads != 1) return false;
#endif
  num_threads = threads;
  return true;
}

int NumThreads() { return num_threads; }

void ForEach(int count, const std::function<void(int)>& f) {
  // Without a parallel region: it would start OpenMP, which costs the memory of
  // its threads and does not survive a fork().
  if (num_threads == 1 || count == 1) {
    for (int k = 0; k < count; ++k) f(k);
    return;
  }
#pragma omp parallel for schedule(static) num_threads(num_threads)
  for (int k = 0; k < count; ++k) f(k);
}

}  // namespace granopt
