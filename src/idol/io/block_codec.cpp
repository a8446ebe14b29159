#include "idol/io/block_codec.hpp"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <memory>
#include <new>
#include <stdexcept>

namespace idol {
namespace {

constexpr std::size_t kStep = 1 << 20;
constexpr const char* kDamaged = "its compressed data are damaged";
constexpr const char* kTruncated = "its compressed data are cut off";
constexpr const char* kTooLarge = "its compressed data are larger than stated";

/// Room behind the first `used` bytes: memory grows with what was decoded, not with what a damaged size says.
void make_room(std::vector<std::uint8_t>& out, std::size_t used, std::size_t most) {
  if (used < out.size()) return;
  if (used >= most) throw BadBytes{kTooLarge};
  out.resize(std::min(most, used + std::max(kStep, used)));
}

void decompress_lz4(Bytes block, std::size_t most, std::vector<std::uint8_t>& out) {
  LZ4F_dctx* raw = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&raw, LZ4F_VERSION)) != 0) throw std::bad_alloc();
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      raw, &LZ4F_freeDecompressionContext);
  std::size_t used = 0, eaten = 0;
  for (std::size_t wanted = 1; wanted != 0;) {
    // A frame that fills its room to the last byte still has an end mark to be read.
    std::uint8_t spare = 0;
    const bool full = used == most;
    if (!full) make_room(out, used, most);
    std::size_t in = block.size() - eaten;
    std::size_t got = full ? 1 : out.size() - used;
    wanted = LZ4F_decompress(context.get(), full ? &spare : out.data() + used, &got, block.data() + eaten,
                             &in, nullptr);
    if (LZ4F_isError(wanted) != 0) throw BadBytes{kDamaged};
    if (full && got > 0) throw BadBytes{kTooLarge};
    used += got;
    eaten += in;
    if (wanted != 0 && in == 0 && got == 0) throw BadBytes{kTruncated};
  }
  out.resize(used);
}

void decompress_zstd(Bytes block, std::size_t most, std::vector<std::uint8_t>& out) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(), &ZSTD_freeDCtx);
  if (!context) throw std::bad_alloc();
  ZSTD_inBuffer in{block.data(), block.size(), 0};
  std::size_t used = 0;
  for (std::size_t wanted = 1; wanted != 0;) {
    std::uint8_t spare = 0;
    const bool full = used == most;
    if (!full) make_room(out, used, most);
    ZSTD_outBuffer room{full ? &spare : out.data() + used, full ? 1 : out.size() - used, 0};
    const std::size_t before = in.pos;
    wanted = ZSTD_decompressStream(context.get(), &room, &in);
    if (ZSTD_isError(wanted) != 0) throw BadBytes{kDamaged};
    if (full && room.pos > 0) throw BadBytes{kTooLarge};
    used += room.pos;
    if (wanted != 0 && in.pos == before && room.pos == 0) throw BadBytes{kTruncated};
  }
  out.resize(used);
}

void decompress_bzip2(Bytes block, std::size_t most, std::vector<std::uint8_t>& out) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) throw std::bad_alloc();
  const std::unique_ptr<bz_stream, decltype(&BZ2_bzDecompressEnd)> owner(&stream, &BZ2_bzDecompressEnd);
  stream.next_in = reinterpret_cast<char*>(const_cast<std::uint8_t*>(block.data()));
  stream.avail_in = static_cast<unsigned>(block.size());
  std::size_t used = 0;
  for (int status = BZ_OK; status != BZ_STREAM_END;) {
    char spare = 0;
    const bool full = used == most;
    if (!full) make_room(out, used, most);
    const auto room = static_cast<unsigned>(full ? 1 : out.size() - used);
    stream.next_out = full ? &spare : reinterpret_cast<char*>(out.data() + used);
    stream.avail_out = room;
    const unsigned before = stream.avail_in;
    status = BZ2_bzDecompress(&stream);
    if (status != BZ_OK && status != BZ_STREAM_END) throw BadBytes{kDamaged};
    const unsigned got = room - stream.avail_out;
    if (full && got > 0) throw BadBytes{kTooLarge};
    used += got;
    if (status == BZ_OK && got == 0 && stream.avail_in == before) throw BadBytes{kTruncated};
  }
  out.resize(used);
}

}  // namespace

void decompress(BlockCodec codec, Bytes block, std::size_t most, std::vector<std::uint8_t>& out) {
  out.clear();
  switch (codec) {
    case BlockCodec::kNone:
      if (block.size() > most) throw BadBytes{kTooLarge};
      out.assign(block.begin(), block.end());
      break;
    case BlockCodec::kLz4:
      return decompress_lz4(block, most, out);
    case BlockCodec::kZstd:
      return decompress_zstd(block, most, out);
    case BlockCodec::kBzip2:
      return decompress_bzip2(block, most, out);
  }
}

std::vector<std::uint8_t> compress(BlockCodec codec, Bytes block) {
  std::vector<std::uint8_t> out;
  std::size_t size = block.size();
  switch (codec) {
    case BlockCodec::kNone:
      return {block.begin(), block.end()};
    case BlockCodec::kLz4: {
      // Such frames as ROS's own decoder takes.
      LZ4F_preferences_t frame{};
      frame.frameInfo.blockSizeID = LZ4F_max1MB;
      frame.frameInfo.blockMode = LZ4F_blockIndependent;
      frame.frameInfo.contentChecksumFlag = LZ4F_contentChecksumEnabled;
      out.resize(LZ4F_compressFrameBound(block.size(), &frame));
      size = LZ4F_compressFrame(out.data(), out.size(), block.data(), block.size(), &frame);
      if (LZ4F_isError(size) != 0) throw std::runtime_error(LZ4F_getErrorName(size));
      break;
    }
    case BlockCodec::kZstd:
      out.resize(ZSTD_compressBound(block.size()));
      size = ZSTD_compress(out.data(), out.size(), block.data(), block.size(), 3);
      if (ZSTD_isError(size) != 0) throw std::runtime_error(ZSTD_getErrorName(size));
      break;
    case BlockCodec::kBzip2: {
      auto length = static_cast<unsigned>(block.size() + block.size() / 100 + 600);
      out.resize(length);
      if (BZ2_bzBuffToBuffCompress(reinterpret_cast<char*>(out.data()), &length,
                                   reinterpret_cast<char*>(const_cast<std::uint8_t*>(block.data())),
                                   static_cast<unsigned>(block.size()), 9, 0, 0) != BZ_OK)
        throw std::runtime_error("bzip2 failed");
      size = length;
      break;
    }
  }
  out.resize(size);
  return out;
}

}  // namespace idol
