// Filters of HDF5 files: compression, and what prepares for it.
#pragma once

#include <cstdint>
#include <vector>

namespace idol {

struct Hdf5Filter {
  std::uint16_t id = 0;  ///< as registered with The HDF Group
  std::vector<std::uint32_t> values;
};

/// Replaces `data`, a chunk as stored, by its `bytes` bytes. Bit i of `skipped`: filter i was not applied.
/// Knows zlib, shuffle, Fletcher's checksum, LZF, Blosc and Zstandard. Throws BadBytes on damage,
/// UnknownFormat for other filters.
void decode_hdf5_chunk(const std::vector<Hdf5Filter>& filters, std::uint32_t skipped, std::size_t bytes,
                       std::vector<std::uint8_t>& data);

}  // namespace idol
