// One source, several instruction sets: a function that wants them is written once, as an
// OCTOBRICK_INLINE body, and called through what fastest<body>(execution) returns, which is that
// body compiled for the best set that the processor has. Nothing in a body depends on the set (no
// fused multiply-add, no reassociation), so that all give the same bits.
//
// x86-64 has three: the baseline (SSE2), AVX2, and AVX-512 where it pays. aarch64 has one: NEON is
// its baseline, and compilers vectorise the bodies for it as they are.
//
// AVX-512 is used where it was faster than AVX2 by a tenth, in each of four runs. Medians over
// a few calls in turn, one thread, a brick of 64^3 in cache, gcc 12 on an EPYC of fourth
// generation (Zen 4); AVX2's gain over the baseline in brackets:
//
//   S3Dc encode, 8 bits a sample   0.88 - 0.97 (1.1 - 1.3)
//                16 bits           1.10 - 1.62 (1.4 - 2.1)    used
//                f32               1.06 - 1.22 (1.5 - 1.7)    used: 1.06 for 1-bit codes, else 1.10
//        decode, 1-bit codes       1.32 - 1.70 (1.0 - 1.4)    used
//                8, 16 bits        0.82 - 0.99 (1.2 - 1.5)
//                f32               1.14 - 1.37 (1.3 - 1.8)    used
//   mean2                          0.97 - 1.00 (1.2 - 1.4)
//   compare      8, 16 bits        0.92 - 1.08 (2.4 - 2.9)
//                f32               1.18 - 1.22 (2.2 - 2.3)    used
//   directions   encode            1.13 - 2.45 (2.3 - 2.8)    used
//                decode            0.63 - 0.68 (4.0 - 4.2)
//
// bench/instruction_sets.cpp measures this.
#pragma once

#include "octobrick/codec/view.h"

// Bodies must be inlined into what calls them, or they would be compiled for the baseline.
#define OCTOBRICK_INLINE [[gnu::always_inline]] inline
#define OCTOBRICK_INLINE_LAMBDA __attribute__((always_inline))  // behind the parameters of one

#if defined(__x86_64__)
#define OCTOBRICK_AVX2_TARGET [[gnu::target("avx2")]]
#define OCTOBRICK_AVX512_SETS "avx512f,avx512bw,avx512dq,avx512vl"
#if defined(__clang__)  // takes no width here, and needs none
#define OCTOBRICK_AVX512_TARGET [[gnu::target(OCTOBRICK_AVX512_SETS)]]
#else
#define OCTOBRICK_AVX512_TARGET [[gnu::target(OCTOBRICK_AVX512_SETS ",prefer-vector-width=512")]]
#endif
// The bit counting of the same processors; without it a popcount is a table look-up.
#define OCTOBRICK_BITS_TARGET [[gnu::flatten, gnu::target("avx2,popcnt,bmi,bmi2")]]
#else
#define OCTOBRICK_AVX2_TARGET  // never chosen: has_avx2() is false
#define OCTOBRICK_AVX512_TARGET
#define OCTOBRICK_BITS_TARGET
#endif

namespace octobrick::codec::detail {

// Whether this processor and operating system run AVX2 code, and what we use of AVX-512.
bool has_avx2() noexcept;
bool has_avx512() noexcept;

template <auto Body, class Type = decltype(Body)>
struct Compiled;
template <auto Body, class Result, class... Arguments>
struct Compiled<Body, Result (*)(Arguments...)> {
    static Result baseline(Arguments... arguments) { return Body(arguments...); }
    OCTOBRICK_AVX2_TARGET static Result avx2(Arguments... arguments) { return Body(arguments...); }
    OCTOBRICK_AVX512_TARGET static Result avx512(Arguments... arguments) {
        return Body(arguments...);
    }
};

// A pointer to the form of a body that `execution` allows and this processor runs fastest.
// Arguments are copied on the way: pass what is large by reference.
template <auto Body, bool Avx512Pays = false>
auto fastest(Execution execution) noexcept {
#if defined(OCTOBRICK_AVX512_EVERYWHERE)  // to measure whether it pays
    constexpr bool kCompiled = true;
#else
    constexpr bool kCompiled = Avx512Pays;
#endif
    if constexpr (kCompiled) {
        if (execution.simd && execution.avx512 && has_avx512()) return &Compiled<Body>::avx512;
    }
    return execution.simd && has_avx2() ? &Compiled<Body>::avx2 : &Compiled<Body>::baseline;
}

}  // namespace octobrick::codec::detail
