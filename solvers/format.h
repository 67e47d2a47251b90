// granopt: printf into a string.

#ifndef GRANOPT_SOLVERS_FORMAT_H_
#define GRANOPT_SOLVERS_FORMAT_H_

#include <string>

namespace granopt {

// Cut after 1023 characters.
std::string Format(const char* format, ...)
    __attribute__((format(printf, 1, 2)));

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_FORMAT_H_
