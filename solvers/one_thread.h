// granopt: CHOLMOD on one thread.

#ifndef GRANOPT_SOLVERS_ONE_THREAD_H_
#define GRANOPT_SOLVERS_ONE_THREAD_H_

#ifdef GRANOPT_HAVE_GOMP
// As <omp.h> has them, which not every compiler comes with.
extern "C" int omp_get_max_active_levels();
extern "C" void omp_set_max_active_levels(int levels);
#endif

namespace granopt {

// CHOLMOD opens four threads, however few processors there are and whatever
// OMP_NUM_THREADS says, for updates so small that one thread is faster: not
// while one of these lives.
class OneThread {
#ifdef GRANOPT_HAVE_GOMP
 public:
  OneThread() : levels_(omp_get_max_active_levels()) {
    omp_set_max_active_levels(0);
  }
  ~OneThread() { omp_set_max_active_levels(levels_); }
  OneThread(const OneThread&) = delete;
  OneThread& operator=(const OneThread&) = delete;

 private:
  const int levels_;
#endif
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_ONE_THREAD_H_
