// HDF5 files: groups and columns of numbers, in pieces.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace idol {

/// An object of the HDF5 library, closed with its last owner. The library counts references: a data set may
/// outlive its file.
using Hdf5Id = std::int64_t;
using Hdf5Handle = std::shared_ptr<const Hdf5Id>;
/// Takes what a call of the library returned; empty if it failed.
Hdf5Handle own_hdf5(Hdf5Id id);

/// One data set: a column of numbers, or of rows of `width` numbers.
class Hdf5Column {
 public:
  [[nodiscard]] std::uint64_t rows() const { return rows_; }
  [[nodiscard]] std::uint64_t width() const { return width_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  /// Replaces `out` by `count` rows from `begin` on, converted; numbers beyond T's range become its ends. T
  /// is std::int64_t, std::uint16_t, std::int8_t or double. Throws DataError on damage.
  template <class T>
  void read(std::uint64_t begin, std::size_t count, std::vector<T>& out) const;

 private:
  friend class Hdf5File;
  [[nodiscard]] bool chunks_are_whole(std::uint64_t begin, std::size_t count) const;
  void read_as(Hdf5Id type, std::uint64_t begin, std::size_t count, void* out) const;

  Hdf5Handle dataset_;
  std::string name_;  // "file: /data/set"
  std::uint64_t rows_ = 0, width_ = 1;
};

/// Filters known beside the library's own (zlib, shuffle and so on): Blosc and LZF.
class Hdf5File {
 public:
  /// Throws DataError if it cannot be opened.
  explicit Hdf5File(const std::filesystem::path& path);

  [[nodiscard]] const std::string& name() const { return name_; }
  /// Whether there is a group or data set at `path`, "group/name".
  [[nodiscard]] bool has(const std::string& path) const;
  /// Throws DataError if there is no data set of numbers at `path`, or one that cannot be read.
  [[nodiscard]] Hdf5Column column(const std::string& path) const;

 private:
  std::string name_;
  Hdf5Handle file_;
};

}  // namespace idol
