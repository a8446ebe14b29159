#include "idol/io/hdf5_filters.hpp"

#include <blosc.h>
#include <hdf5.h>
#include <lzf.h>

#include <cstdlib>

namespace idol {
namespace {

constexpr H5Z_filter_t kLzf = 32000, kBlosc = 32001;  // as registered with The HDF Group
constexpr std::size_t kLargestChunk = 1U << 30;

thread_local std::size_t least_chunk = 0;  // that the reads of this thread need

/// The library owns the buffer: what replaces it comes from malloc too.
std::size_t replace(void* decoded, std::size_t size, std::size_t* buffer_size, void** buffer) {
  std::free(*buffer);
  *buffer = decoded;
  *buffer_size = size;
  return size;
}

std::size_t decode_blosc(unsigned flags, std::size_t, const unsigned[], std::size_t bytes,
                         std::size_t* buffer_size, void** buffer) {
  std::size_t size = 0;
  if ((flags & H5Z_FLAG_REVERSE) == 0 || blosc_cbuffer_validate(*buffer, bytes, &size) < 0) return 0;
  if (size == 0 || size < least_chunk || size > kLargestChunk) return 0;
  void* decoded = std::malloc(size);
  if (decoded == nullptr) return 0;
  constexpr int kThreads = 1;
  if (blosc_decompress_ctx(*buffer, decoded, size, kThreads) == static_cast<int>(size))
    return replace(decoded, size, buffer_size, buffer);
  std::free(decoded);
  return 0;
}

/// h5py's: the third parameter is the size of a chunk, decoded.
std::size_t decode_lzf(unsigned flags, std::size_t parameters, const unsigned values[], std::size_t bytes,
                       std::size_t* buffer_size, void** buffer) {
  if ((flags & H5Z_FLAG_REVERSE) == 0 || parameters < 3 || values[2] == 0 || values[2] > kLargestChunk)
    return 0;
  void* decoded = std::malloc(values[2]);
  if (decoded == nullptr) return 0;
  const unsigned size = lzf_decompress(*buffer, static_cast<unsigned>(bytes), decoded, values[2]);
  if (size != 0 && size >= least_chunk) return replace(decoded, size, buffer_size, buffer);
  std::free(decoded);
  return 0;
}

}  // namespace

void expect_hdf5_chunk(std::size_t bytes) { least_chunk = bytes; }

void register_hdf5_filters() {
  const H5Z_class2_t blosc{H5Z_CLASS_T_VERS, kBlosc, 0, 1, "blosc", nullptr, nullptr, decode_blosc};
  const H5Z_class2_t lzf{H5Z_CLASS_T_VERS, kLzf, 0, 1, "lzf", nullptr, nullptr, decode_lzf};
  H5Zregister(&blosc);
  H5Zregister(&lzf);
}

}  // namespace idol
