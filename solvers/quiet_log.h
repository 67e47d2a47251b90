// granopt: Ceres without its warnings.

#ifndef GRANOPT_SOLVERS_QUIET_LOG_H_
#define GRANOPT_SOLVERS_QUIET_LOG_H_

#include <algorithm>

#include "glog/logging.h"

namespace granopt {

// While one lives nothing under an error is logged. Ceres warns at every
// restart of its NCG and at every factorization that fails, also when asked to
// be silent.
class QuietLog {
 public:
  QuietLog() : level_(FLAGS_minloglevel) {
    FLAGS_minloglevel = std::max<int>(FLAGS_minloglevel, google::GLOG_ERROR);
  }
  ~QuietLog() { FLAGS_minloglevel = level_; }
  QuietLog(const QuietLog&) = delete;
  QuietLog& operator=(const QuietLog&) = delete;

 private:
  const int level_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_QUIET_LOG_H_
