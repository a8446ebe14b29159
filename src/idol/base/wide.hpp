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

/// Eight rows of eight become the columns: pairs are interleaved within the halves of a register, then pairs
/// of pairs, and then halves change places.
[[gnu::always_inline]] inline void transpose(FloatLanes (&m)[kLanes]) {
  FloatLanes pairs[kLanes], fours[kLanes];
  for (int k = 0; k < 8; k += 2) {
    pairs[k] = __builtin_shufflevector(m[k], m[k + 1], 0, 8, 1, 9, 4, 12, 5, 13);
    pairs[k + 1] = __builtin_shufflevector(m[k], m[k + 1], 2, 10, 3, 11, 6, 14, 7, 15);
  }
  for (int k = 0; k < 8; k += 4)
    for (int i = 0; i < 2; ++i) {
      fours[k + 2 * i] = __builtin_shufflevector(pairs[k + i], pairs[k + 2 + i], 0, 1, 8, 9, 4, 5, 12, 13);
      fours[k + 2 * i + 1] =
          __builtin_shufflevector(pairs[k + i], pairs[k + 2 + i], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int k = 0; k < 4; ++k) {
    m[k] = __builtin_shufflevector(fours[k], fours[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    m[k + 4] = __builtin_shufflevector(fours[k], fours[k + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

}  // namespace idol
