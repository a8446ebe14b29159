// Writing bytes to disk and noticing when the disk refuses.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "idol/io/pending_file.hpp"

namespace idol {

/// A file being written. Call close() at the end: only then is it known that everything arrived, and only
/// then does the file stand under its name.
class FileWriter {
 public:
  /// Throws DataError if the file cannot be created, as do all others if the disk refuses.
  explicit FileWriter(const std::filesystem::path& path);
  void write(const void* data, std::size_t size);
  /// Goes back (or forth) to a place in the file.
  void seek(std::uint64_t place);
  [[nodiscard]] std::uint64_t place() const { return place_; }
  void close();

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  [[noreturn]] void refuse() const;

  std::string name_;
  PendingFile pending_;
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t place_ = 0;
};

}  // namespace idol
