// The program's own HDF5 layout (docs/formats.md): columns of numbers, read back at the speed of memory.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "idol/io/pending_file.hpp"
#include "idol/io/recording_writer.hpp"

namespace idol {

/// An object of the HDF5 library, closed with its last owner. The library counts references: a data set may
/// outlive its file.
using Hdf5Id = std::int64_t;
using Hdf5Handle = std::shared_ptr<const Hdf5Id>;
/// Takes what a call of the library returned; empty if it failed.
Hdf5Handle own_hdf5(Hdf5Id id);

class Hdf5Writer : public RecordingWriter {
 public:
  /// With `compress`: shuffle and zlib. Throws DataError if the file cannot be created.
  Hdf5Writer(const std::filesystem::path& path, const WriterOptions& options);

  void add(const Packet& packet) override;
  bool add_groundtruth(const Trajectory& truth) override;
  void close() override;

 private:
  /// Appends rows of `width` numbers to the data set at `path`, which is created with its first rows.
  template <class T>
  void append(const std::string& path, const std::vector<T>& values, std::uint64_t width = 1);
  Hdf5Handle create(const std::string& path, Hdf5Id type, std::uint64_t width);
  void check(bool good) const;

  std::string name_;
  PendingFile pending_;
  bool compress_;
  Hdf5Handle file_;
  struct Column {
    Hdf5Handle dataset;
    std::uint64_t rows = 0;
  };
  std::map<std::string, Column> columns_;
};

}  // namespace idol
