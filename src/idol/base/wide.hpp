// Functions that are compiled for wide registers too; which one runs is chosen when the program starts.
#pragma once

#include <cstddef>
#include <cstdint>

// IDOL_WIDE before a function of a source file (not one that headers declare): the same bits with and without
// AVX2.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define IDOL_WIDE [[gnu::target_clones("avx2", "default")]]
#else
#define IDOL_WIDE
#endif

namespace idol {

/// Eight numbers at once; a comparison gives all bits set, or none, in each.
constexpr std::size_t kLanes = 8, kLaneBytes = kLanes * sizeof(float);
using IntLanes [[gnu::vector_size(kLaneBytes)]] = std::int32_t;
using FloatLanes [[gnu::vector_size(kLaneBytes)]] = float;

}  // namespace idol
