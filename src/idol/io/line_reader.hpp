// Lines of a text file, compressed or not, without copies.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "idol/io/byte_source.hpp"

namespace idol {

class LineReader {
 public:
  /// Throws DataError if the file cannot be opened.
  explicit LineReader(const std::filesystem::path& path);

  /// The next line without its end (LF or CR LF); valid until the next call. False at the end of the file.
  /// Throws DataError on damage, after every whole line before it was given out; the torn line is not.
  bool next(std::string_view& line) {
    const void* end = std::memchr(begin_, '\n', static_cast<std::size_t>(end_ - begin_));
    if (end == nullptr) return refill_and_next(line);
    take(static_cast<const char*>(end), line);
    return true;
  }

  [[nodiscard]] std::int64_t line_number() const {
    return line_number_;
  }  ///< of the last line given out, from 1
  [[nodiscard]] bool torn() const {
    return torn_;
  }  ///< the last line given out ended with the file, not with LF
  [[nodiscard]] const std::string& name() const { return name_; }
  /// "file:line" of the last line given out.
  [[nodiscard]] std::string where() const;
  [[nodiscard]] double progress() const { return bytes_->progress(); }

 private:
  bool refill_and_next(std::string_view& line);
  std::size_t read_bytes(char* out, std::size_t size);
  void take(const char* end, std::string_view& line) {
    const char* last = end;
    if (last != begin_ && last[-1] == '\r') --last;
    line = {begin_, static_cast<std::size_t>(last - begin_)};
    begin_ = end + 1;
    ++line_number_;
  }

  std::string name_;
  std::unique_ptr<ByteSource> bytes_;
  std::vector<char> buffer_;
  const char* begin_;  // unread part of the buffer
  const char* end_;
  std::int64_t line_number_ = 0;
  bool torn_ = false;
};

}  // namespace idol
