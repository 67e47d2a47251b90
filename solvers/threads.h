// granopt: threads for long vectors and sums of many terms.

#ifndef GRANOPT_SOLVERS_THREADS_H_
#define GRANOPT_SOLVERS_THREADS_H_

#include <functional>

namespace granopt {

// How many threads ForEach() runs on: 1 unless set. It is process-wide and
// changes no result, bit for bit: work is cut into pieces that depend on its
// size alone, and sums of pieces are added up in order. Not to be set while
// anything runs. Returns false, and changes nothing, for less than 1, or for
// more than 1 where the library was built without OpenMP.
bool SetNumThreads(int threads);
int NumThreads();

// f(0) ... f(count - 1), in any order and at the same time; neighbours go to
// the same thread. f must not throw or call ForEach().
void ForEach(int count, const std::function<void(int)>& f);

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_THREADS_H_
