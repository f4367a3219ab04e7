// Four numbers at a time, in the vectors that gcc and clang have for any processor. Operators work
// on each lane; comparisons give lanes of 0 or -1, and `mask ? a : b` chooses lane by lane.
#pragma once

#include <cstdint>

#include "simd.h"

namespace octobrick::codec::detail {

using DoubleTwo [[gnu::vector_size(16)]] = double;
using DoubleFour [[gnu::vector_size(32)]] = double;
using FloatFour [[gnu::vector_size(16)]] = float;
using IntFour [[gnu::vector_size(16)]] = std::int32_t;
using UintFour [[gnu::vector_size(16)]] = std::uint32_t;

// Lanes as another kind of number; doubles are cut to integers.
template <class To, class From>
OCTOBRICK_INLINE void convert(const From& from, To& to) {
    to = __builtin_convertvector(from, To);
}

}  // namespace octobrick::codec::detail
