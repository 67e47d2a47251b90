// granopt: Ceres without its warnings.

#ifndef GRANOPT_SOLVERS_QUIET_LOG_H_
#define GRANOPT_SOLVERS_QUIET_LOG_H_

#include "glog/logging.h"

namespace granopt {

// While one lives nothing but what ends the process is logged. Ceres warns at
// every restart of its NCG and at every factorization that fails, and calls it
// an error where a first evaluation does, also when asked to be silent: to us
// all of that is data.
class QuietLog {
 public:
  QuietLog() : level_(FLAGS_minloglevel) {
    FLAGS_minloglevel = google::GLOG_FATAL;
  }
  ~QuietLog() { FLAGS_minloglevel = level_; }
  QuietLog(const QuietLog&) = delete;
  QuietLog& operator=(const QuietLog&) = delete;

 private:
  const int level_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_QUIET_LOG_H_
