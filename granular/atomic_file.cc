#include "granular/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>

namespace granopt {

bool WriteFileAtomically(const std::string& path,
                         const std::string& content,
                         std::string* error) {
  const std::string temporary =
      path + "." + std::to_string(static_cast<long>(getpid())) + ".tmp";
  int file = -1;
  const auto fail = [&](const char* what) {
    *error = path + ": cannot " + what + ": " + std::strerror(errno);
    if (file >= 0) close(file);
    unlink(temporary.c_str());
    return false;
  };
  // Renaming over a device or a pipe would put a file in its place.
  struct stat status;
  if (stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    *error = path + ": cannot write: not a regular file";
    return false;
  }
  file = open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (file < 0) return fail("write");
  std::size_t done = 0;
  while (done < content.size()) {
    const ssize_t written =
        write(file, content.data() + done, content.size() - done);
    if (written < 0) {
      if (errno == EINTR) continue;
      return fail("write");
    }
    done += static_cast<std::size_t>(written);
  }
  if (fsync(file) != 0 && errno != EINVAL) return fail("sync");
  const int closed = close(file);
  file = -1;
  if (closed != 0) return fail("close");
  if (std::rename(temporary.c_str(), path.c_str()) != 0) return fail("rename");
  return true;
}

bool ReadFile(const std::string& path,
              std::string* content,
              std::string* error) {
  const auto fail = [&]() {
    *error = path + ": cannot read: " + std::strerror(errno);
    return false;
  };
  const int file = open(path.c_str(), O_RDONLY);
  if (file < 0) return fail();
  struct stat status;
  if (fstat(file, &status) != 0) {
    close(file);
    return fail();
  }
  constexpr std::int64_t kMostBytes = std::int64_t{1} << 32;
  if (S_ISDIR(status.st_mode) || status.st_size > kMostBytes) {
    errno = S_ISDIR(status.st_mode) ? EISDIR : EFBIG;
    close(file);
    return fail();
  }
  content->clear();
  char buffer[1 << 16];
  for (;;) {
    const ssize_t got = read(file, buffer, sizeof(buffer));
    if (got == 0) break;
    if (got < 0) {
      if (errno == EINTR) continue;
      close(file);
      return fail();
    }
    content->append(buffer, static_cast<std::size_t>(got));
    if (static_cast<std::int64_t>(content->size()) > kMostBytes) {
      errno = EFBIG;
      close(file);
      return fail();
    }
  }
  close(file);
  return true;
}

}  // namespace granopt
