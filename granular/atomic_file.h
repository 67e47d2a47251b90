// granopt: files that are there in full or not at all.

#ifndef GRANOPT_GRANULAR_ATOMIC_FILE_H_
#define GRANOPT_GRANULAR_ATOMIC_FILE_H_

#include <string>

namespace granopt {

// Writes `content` to a temporary file beside `path`, syncs it and renames it
// to `path`. On failure `path` is as before, and `error` has one line with the
// path and the system's reason.
bool WriteFileAtomically(const std::string& path,
                         const std::string& content,
                         std::string* error);

// The whole file. Refuses directories and files larger than 4 GiB.
bool ReadFile(const std::string& path,
              std::string* content,
              std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_ATOMIC_FILE_H_
