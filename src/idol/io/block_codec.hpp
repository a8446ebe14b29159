// Whole blocks of compressed bytes, as chunks of bags and packets of AEDAT4 files hold them.
#pragma once

#include <cstdint>
#include <vector>

#include "idol/io/bytes.hpp"

namespace idol {

enum class BlockCodec { kNone, kLz4, kZstd, kBzip2 };

/// Replaces `out` by the block, decompressed. Throws BadBytes if it is damaged, or larger than `most` bytes.
void decompress(BlockCodec codec, Bytes block, std::size_t most, std::vector<std::uint8_t>& out);

/// The block, compressed.
std::vector<std::uint8_t> compress(BlockCodec codec, Bytes block);

}  // namespace idol
