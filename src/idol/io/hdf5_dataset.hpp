// Data sets of an HDF5 file: what they hold, and where and how it is stored.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "idol/io/hdf5_filters.hpp"
#include "idol/io/random_file.hpp"

namespace idol {

/// Part of a data set, stored in one piece. Unused dimensions are 0 here and 1 in sizes.
struct Hdf5Chunk {
  std::array<std::uint64_t, 3> at{};  ///< its first element
  std::uint64_t address = 0, size = 0;
  std::uint32_t skipped = 0;  ///< bit i: filter i was not applied
};

/// A table of numbers.
struct Hdf5Dataset {
  enum class Storage { kCompact, kContiguous, kChunked };

  std::size_t bytes = 0;  ///< of a number: 1, 2, 4 or 8
  std::size_t record_bytes = 0,
              record_at = 0;  ///< where it is one of several in a record: its size, and its place
  bool is_float = false, is_signed = false, big_endian = false;
  std::array<std::uint64_t, 3> size{1, 1, 1};  ///< rows, and what a row is made of
  Storage storage = Storage::kCompact;
  std::vector<std::uint8_t> compact;  ///< the data themselves
  std::uint64_t address = 0;          ///< kContiguous
  std::array<std::uint64_t, 3> chunk{1, 1, 1};
  std::vector<Hdf5Chunk> chunks;    ///< in the order of `at`
  std::vector<Hdf5Filter> filters;  ///< as applied when it was written
  std::vector<std::uint8_t> fill;   ///< a number never written; empty: 0

  [[nodiscard]] std::uint64_t width() const { return size[1] * size[2]; }
  [[nodiscard]] std::size_t element_bytes() const { return record_bytes > 0 ? record_bytes : bytes; }
  [[nodiscard]] std::size_t row_bytes() const { return static_cast<std::size_t>(width()) * element_bytes(); }
  [[nodiscard]] std::size_t chunk_bytes() const {
    return static_cast<std::size_t>(chunk[0] * chunk[1] * chunk[2]) * element_bytes();
  }
};

/// Throws BadBytes on damage, and if this is no data set of up to three dimensions, with up to 16 numbers in
/// the second and third. Throws UnknownFormat if it is none of whole or floating-point numbers. Of a data set
/// of records, `member` is the number to read.
Hdf5Dataset read_hdf5_dataset(const RandomFile& file, std::uint64_t address, const std::string& member);

}  // namespace idol
