// Writing text to disk and noticing when the disk refuses.
#pragma once

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace idol {

/// A text file being written; compressed if its name ends in .zst. Call close() at the end: only then is it
/// known that everything arrived.
class TextWriter {
 public:
  /// Throws DataError if the file cannot be created.
  explicit TextWriter(const std::filesystem::path& path);
  ~TextWriter();
  /// Throws DataError if the disk refuses.
  void write(std::string_view text);
  /// Flushes and closes. Throws DataError if the disk refuses.
  void close();

 private:
  class Compressor;
  void put(const void* data, std::size_t size);
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  [[noreturn]] void refuse() const;

  std::string name_;
  std::unique_ptr<std::FILE, Close> file_;
  std::unique_ptr<Compressor> compressor_;
};

/// Writes a whole file at once. Throws DataError if the disk refuses.
void write_text_file(const std::filesystem::path& path, std::string_view text);

}  // namespace idol
