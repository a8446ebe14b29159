// A file read from any place, for binary formats with tables and offsets.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"

namespace idol {

class RandomFile {
 public:
  /// One compressed by gzip or Zstandard is decompressed into a temporary file, which goes with the program.
  /// Throws DataError if the file is missing, unreadable, empty or a folder.
  explicit RandomFile(const std::filesystem::path& path);
  ~RandomFile();
  RandomFile(const RandomFile&) = delete;
  RandomFile& operator=(const RandomFile&) = delete;

  [[nodiscard]] std::uint64_t size() const { return size_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  /// Replaces `out` by the `size` bytes from `offset` on. Throws DataError if the file ends before.
  void read(std::uint64_t offset, std::size_t size, std::vector<std::uint8_t>& out) const;
  /// "file, byte N".
  [[nodiscard]] std::string where(std::uint64_t offset) const;
  /// The error that what lies there cannot be right.
  [[nodiscard]] DataError damaged(std::uint64_t offset, const char* what, const char* why) const;

 private:
  std::string name_;
  class Descriptor;
  std::shared_ptr<const Descriptor> descriptor_;
  std::uint64_t size_ = 0;
};

}  // namespace idol
