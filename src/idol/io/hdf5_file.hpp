// HDF5 files read: columns of numbers, in pieces. Damaged files cost an error and nothing else.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace idol {

class RandomFile;

/// One data set: a column of numbers, or of rows of `width` numbers. It may outlive its file; copies share
/// what was decoded last, so they belong to one thread.
class Hdf5Column {
 public:
  [[nodiscard]] std::uint64_t rows() const;
  [[nodiscard]] std::uint64_t width() const;
  [[nodiscard]] bool is_float() const;
  [[nodiscard]] const std::string& name() const { return name_; }
  /// Replaces `out` by `count` rows from `begin` on, converted; numbers beyond T's range become its ends. T
  /// is std::int64_t, std::uint16_t, std::int8_t or double. Throws DataError on damage.
  template <class T>
  void read(std::uint64_t begin, std::size_t count, std::vector<T>& out) const;

 private:
  friend class Hdf5File;
  class Data;

  std::shared_ptr<Data> data_;
  std::string name_;  // "file: /data/set"
};

class Hdf5File {
 public:
  /// Throws DataError if it cannot be opened.
  explicit Hdf5File(const std::filesystem::path& path);

  [[nodiscard]] const std::string& name() const;
  /// Whether there is a group or data set at `path`, "group/name". Throws DataError on damage.
  [[nodiscard]] bool has(const std::string& path) const;
  /// Throws DataError if there is no data set of numbers at `path`, or one that cannot be read.
  /// Of a data set of records, `member` is the number to read.
  [[nodiscard]] Hdf5Column column(const std::string& path, const std::string& member = {}) const;

 private:
  std::shared_ptr<const RandomFile> file_;
  std::uint64_t root_ = 0;
};

}  // namespace idol
