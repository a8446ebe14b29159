// The one way in which this program puts a file in its place: whole, or not at all.
#pragma once

#include <filesystem>

namespace idol {

/// A file under a temporary name beside its place. commit() gives it its own name, and only then is a file of
/// that name replaced: a job that fails leaves what was there. What is no regular file (a pipe, a device) is
/// written as it is. A symbolic link stays one; the file that it leads to is replaced.
class PendingFile {
 public:
  /// Creates the empty file. Throws DataError if that cannot be.
  explicit PendingFile(const std::filesystem::path& place);
  /// Removes the file unless it was committed.
  ~PendingFile();
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;

  /// Where to write.
  [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
  /// Once, when all is written and closed. Throws DataError.
  void commit();

 private:
  std::filesystem::path place_, temporary_;  // equal: written as it is
  bool done_ = false;
};

/// The error that `path` cannot be written, with the reason (of errno) and what to do.
[[noreturn]] void refuse_to_write(const std::filesystem::path& path, int reason);

}  // namespace idol
