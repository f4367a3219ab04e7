// One source, two instruction sets: a function that wants both is written once as an
// OCTOBRICK_INLINE body, and wrapped twice, plainly and as OCTOBRICK_AVX2_TARGET. Nothing in a
// body depends on the set (no fused multiply-add, no reassociation), so both give the same bits.
#pragma once

// Bodies must be inlined into their wrappers, or they would be compiled for the baseline.
#define OCTOBRICK_INLINE [[gnu::always_inline]] inline

#if defined(__x86_64__)
// AVX-512 was measured too: slower for decoding 8-bit samples.
#define OCTOBRICK_AVX2_TARGET [[gnu::target("avx2")]]
// The bit counting of the same processors; without it a popcount is a table look-up.
#define OCTOBRICK_BITS_TARGET [[gnu::flatten, gnu::target("avx2,popcnt,bmi,bmi2")]]
#else
#define OCTOBRICK_AVX2_TARGET  // never chosen: has_avx2() is false
#define OCTOBRICK_BITS_TARGET
#endif

namespace octobrick::codec::detail {

// Whether this processor and operating system run AVX2 code.
bool has_avx2() noexcept;

}  // namespace octobrick::codec::detail
