// A file as it is on disk, in chunks: what all byte sources read from.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace idol {

/// Throws DataError for a pipe, a socket or a terminal: files are read more than once. What does not exist
/// passes.
void refuse_pipe(const std::filesystem::path& path);

class RawFile {
 public:
  /// Throws DataError if the file is missing, unreadable, empty, a folder or a pipe.
  explicit RawFile(const std::filesystem::path& path);
  ~RawFile();
  RawFile(const RawFile&) = delete;
  RawFile& operator=(const RawFile&) = delete;

  /// The unread bytes of the present chunk; reads the next chunk when there are none. Empty at the end.
  std::string_view peek();
  /// Marks `count` of the peeked bytes as read.
  void consume(std::size_t count) { begin_ += count; }

  [[nodiscard]] double progress() const;
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  std::string name_;
  int descriptor_ = -1;
  std::vector<char> chunk_;
  std::size_t begin_ = 0, end_ = 0;  // unread part of the chunk
  double size_ = 0, read_ = 0;       // [bytes]
};

}  // namespace idol
