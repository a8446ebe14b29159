// Writing text to disk and noticing when the disk refuses.
#pragma once

#include <filesystem>
#include <memory>
#include <string_view>

#include "idol/io/file_writer.hpp"

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

  FileWriter file_;
  std::unique_ptr<Compressor> compressor_;
};

/// Writes a whole file at once. Throws DataError if the disk refuses.
void write_text_file(const std::filesystem::path& path, std::string_view text);

}  // namespace idol
