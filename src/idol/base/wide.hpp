// Functions that are compiled for wide registers too; which one runs is chosen when the program starts.
#pragma once

// IDOL_WIDE before a function of a source file (not one that headers declare): the same bits with and without
// AVX2.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define IDOL_WIDE [[gnu::target_clones("avx2", "default")]]
#else
#define IDOL_WIDE
#endif
