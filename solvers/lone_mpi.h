// granopt: Open MPI in a process that is alone.

#ifndef GRANOPT_SOLVERS_LONE_MPI_H_
#define GRANOPT_SOLVERS_LONE_MPI_H_

#include <cstdlib>
#include <vector>

namespace granopt {

// For while it starts: one process needs no daemon (without which Open MPI
// would end it), no folder in /tmp and no network, and its signals are its own.
// Variables that are set already stay as they are, children do not inherit
// these, and under mpirun nothing is set.
class LoneMpi {
 public:
  LoneMpi() {
    if (std::getenv("OMPI_COMM_WORLD_SIZE") != nullptr) return;
    constexpr const char* kSettings[][2] = {
        {"OMPI_MCA_ess_singleton_isolated", "1"},
        {"OMPI_MCA_orte_create_session_dirs", "0"},
        {"OMPI_MCA_btl", "self"},
        {"OMPI_MCA_pml", "ob1"},
        {"OMPI_MCA_opal_signal", ""},
    };
    for (const auto& [name, value] : kSettings) {
      if (std::getenv(name) != nullptr) continue;
      setenv(name, value, 0);
      set_.push_back(name);
    }
  }
  ~LoneMpi() {
    for (const char* name : set_) unsetenv(name);
  }
  LoneMpi(const LoneMpi&) = delete;
  LoneMpi& operator=(const LoneMpi&) = delete;

 private:
  std::vector<const char*> set_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_LONE_MPI_H_
