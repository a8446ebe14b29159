// Bytes of a file, decompressed on the fly where its content says so (gzip, Zstandard).
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>

namespace idol {

/// A stream of bytes read front to back in bounded memory.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Writes 1 to `size` bytes to `out` and returns how many; 0 at the end. On damage, first returns
  /// everything before it, then throws DataError.
  virtual std::size_t read(char* out, std::size_t size) = 0;
  /// Share of the file on disk consumed so far, in [0, 1].
  [[nodiscard]] virtual double progress() const = 0;
};

/// Opens a file, plain or compressed: decided by its first bytes, not by its name. Throws DataError.
std::unique_ptr<ByteSource> open_bytes(const std::filesystem::path& path);

}  // namespace idol
