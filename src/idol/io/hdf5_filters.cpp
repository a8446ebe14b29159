#include "idol/io/hdf5_filters.hpp"

#include <blosc.h>
#include <fmt/format.h>
#include <lzf.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>

#include "idol/io/bytes.hpp"

namespace idol {
namespace {

enum FilterId : std::uint16_t {
  kDeflate = 1,
  kShuffle = 2,
  kFletcher32 = 3,
  kLzf = 32000,
  kBlosc = 32001,
  kZstd = 32015
};

/// Those that files are met with, and that are not read.
const char* name_of(std::uint16_t id) {
  switch (id) {
    case 4:
      return "szip";
    case 5:
      return "n-bit";
    case 6:
      return "scale-offset";
    case 307:
      return "bzip2";
    case 32004:
      return "LZ4";
    case 32008:
      return "bitshuffle";
    case 32013:
      return "ZFP";
    case 32026:
      return "Blosc 2";
    case 36559:
      return "Metavision ECF";
    default:
      return "of no name known here";
  }
}

using Data = std::vector<std::uint8_t>;

constexpr const char* kDamaged = "its compression is damaged";

/// Room for what `data` decodes to, unless so few bytes cannot hold it: damage must not cost memory.
Data room_for(std::size_t bytes, const Data& data, std::size_t largest_ratio) {
  if (bytes / largest_ratio > data.size()) throw BadBytes{kDamaged};
  return Data(bytes);
}

void inflate(std::size_t bytes, Data& data) {
  constexpr std::size_t kRatio = 1032;  // of zlib's format
  Data decoded = room_for(bytes, data, kRatio);
  uLongf size = decoded.size();
  if (uncompress(decoded.data(), &size, data.data(), data.size()) != Z_OK) throw BadBytes{kDamaged};
  decoded.resize(size);
  data.swap(decoded);
}

/// The first bytes of all numbers, then all second ones and so on; what is left over is kept as it is.
void unshuffle(const Hdf5Filter& filter, Data& data) {
  const std::size_t width = filter.values.empty() ? 0 : filter.values[0];
  if (width == 0) throw BadBytes{"a filter lacks its parameters"};
  const std::size_t count = data.size() / width;
  if (width == 1 || count <= 1) return;
  Data ordered(data);
  for (std::size_t b = 0; b < width; ++b) {
    const std::uint8_t* from = data.data() + b * count;
    std::uint8_t* to = ordered.data() + b;
    for (std::size_t i = 0; i < count; ++i) to[i * width] = from[i];
  }
  data.swap(ordered);
}

/// Sums of big-endian words, as the HDF5 library takes them.
void check_fletcher32(Data& data) {
  constexpr std::size_t kPart = 360;  // words until a sum could overflow
  if (data.size() < 4) throw BadBytes{kDamaged};
  const auto stated = load<std::uint32_t>(data, data.size() - 4);
  data.resize(data.size() - 4);
  std::uint32_t first = 0, second = 0;
  const auto fold = [](std::uint32_t sum) { return (sum & 0xffff) + (sum >> 16); };
  const auto fold_both = [&] {
    first = fold(first);
    second = fold(second);
  };
  for (std::size_t i = 0; i < data.size(); i += 2) {
    first += static_cast<std::uint32_t>(data[i] << 8) | (i + 1 < data.size() ? data[i + 1] : 0U);
    second += first;
    if ((i / 2 + 1) % kPart == 0) fold_both();
  }
  fold_both();
  fold_both();
  if (((second << 16) | first) != stated) throw BadBytes{"its checksum is wrong"};
}

void decode_lzf(std::size_t bytes, Data& data) {
  constexpr std::size_t kRatio = 88;  // 264 bytes from 3
  Data decoded = room_for(bytes, data, kRatio);
  const unsigned size = lzf_decompress(data.data(), static_cast<unsigned>(data.size()), decoded.data(),
                                       static_cast<unsigned>(bytes));
  if (size == 0) throw BadBytes{kDamaged};
  decoded.resize(size);
  data.swap(decoded);
}

void decode_blosc(std::size_t bytes, Data& data) {
  std::size_t size = 0;
  if (blosc_cbuffer_validate(data.data(), data.size(), &size) < 0 || size > bytes) throw BadBytes{kDamaged};
  Data decoded(size);
  constexpr int kThreads = 1;
  if (blosc_decompress_ctx(data.data(), decoded.data(), size, kThreads) != static_cast<int>(size))
    throw BadBytes{kDamaged};
  data.swap(decoded);
}

void decode_zstd(std::size_t bytes, Data& data) {
  constexpr std::size_t kRatio = 1 << 15;  // of Zstandard's format, about
  Data decoded = room_for(bytes, data, kRatio);
  const std::size_t size = ZSTD_decompress(decoded.data(), decoded.size(), data.data(), data.size());
  if (ZSTD_isError(size) != 0) throw BadBytes{kDamaged};
  decoded.resize(size);
  data.swap(decoded);
}

}  // namespace

void decode_hdf5_chunk(const std::vector<Hdf5Filter>& filters, std::uint32_t skipped, std::size_t bytes,
                       std::vector<std::uint8_t>& data) {
  const auto applied = [&](std::size_t i) { return i >= 32 || (skipped >> i & 1) == 0; };
  for (std::size_t i = filters.size(); i-- > 0;) {
    if (!applied(i)) continue;
    // Checksums taken before the compression were compressed too.
    std::size_t most = bytes;
    for (std::size_t j = 0; j < i; ++j)
      if (filters[j].id == kFletcher32 && applied(j)) most += 4;
    switch (filters[i].id) {
      case kDeflate:
        inflate(most, data);
        break;
      case kShuffle:
        unshuffle(filters[i], data);
        break;
      case kFletcher32:
        check_fletcher32(data);
        break;
      case kLzf:
        decode_lzf(most, data);
        break;
      case kBlosc:
        decode_blosc(most, data);
        break;
      case kZstd:
        decode_zstd(most, data);
        break;
      default:
        throw UnknownFormat(fmt::format(
            "it is stored with filter {} ({}), which is not read; 'h5repack -f NONE' takes it off",
            filters[i].id, name_of(filters[i].id)));
    }
  }
  if (data.size() < bytes) throw BadBytes{"a chunk is too short"};
}

}  // namespace idol
