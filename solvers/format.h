// granopt: printf into a string.

#ifndef GRANOPT_SOLVERS_FORMAT_H_
#define GRANOPT_SOLVERS_FORMAT_H_

#include <string>

namespace granopt {

std::string Format(const char* format, ...)
    __attribute__((format(printf, 1, 2)));

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_FORMAT_H_
