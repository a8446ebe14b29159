#include "idol/io/pending_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>

#include "idol/base/diagnostics.hpp"

namespace idol {

namespace fs = std::filesystem;

namespace {

/// What a chain of symbolic links leads to, there or not.
fs::path behind_links(fs::path path) {
  constexpr int kMost = 40;
  std::error_code error;
  for (int i = 0; i < kMost && fs::is_symlink(fs::symlink_status(path, error)); ++i) {
    const fs::path target = fs::read_symlink(path, error);
    if (error) break;
    path = target.is_absolute() ? target : path.parent_path() / target;
  }
  return path;
}

}  // namespace

void refuse_to_write(const fs::path& path, int reason) {
  throw DataError(fmt::format("{}: cannot be written: {}; {}", path.string(), std::strerror(reason),
                              reason == ENOSPC || reason == EDQUOT ? "free some space, or write elsewhere"
                                                                   : "give a path that can be written"));
}

PendingFile::PendingFile(const fs::path& place) : place_(behind_links(place)) {
  struct stat status {};
  const bool there = ::stat(place_.c_str(), &status) == 0;
  if (there && !S_ISREG(status.st_mode)) {
    if (S_ISDIR(status.st_mode)) refuse_to_write(place, EISDIR);
    temporary_ = place_;
    return;
  }
  if (there && ::access(place_.c_str(), W_OK) != 0) refuse_to_write(place, errno);
  static std::atomic<int> count = 0;
  temporary_ = place_.parent_path() / fmt::format(".idol-{}-{}.part", ::getpid(), count++);
  constexpr mode_t kReadAndWrite = 0666;
  const int file = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kReadAndWrite);
  if (file < 0) refuse_to_write(place, errno);
  if (there) static_cast<void>(::fchmod(file, status.st_mode & 07777));
  ::close(file);
}

PendingFile::~PendingFile() {
  if (!done_ && temporary_ != place_) ::unlink(temporary_.c_str());
}

void PendingFile::commit() {
  if (temporary_ != place_ && ::rename(temporary_.c_str(), place_.c_str()) != 0)
    refuse_to_write(place_, errno);
  done_ = true;
}

}  // namespace idol
