// Indices of one block, of up to 14 bits: from values, back to values, and packed.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "index_rows.h"
#include "rows.h"
#include "simd.h"

namespace octobrick::codec::detail {

// Indices of values, which may lie outside of the end points: floor(d·L/R + 1/2), d = v − first.
// Integers exactly, as (dL + R div 2) div R: the dividend is below 2^16·2^14 + 2^15, and a double
// quotient of such integers is never rounded up to the next one.
OCTOBRICK_INLINE void find_indices(const std::int32_t* values, std::size_t n, std::int32_t first,
                                   std::int32_t last, unsigned width, std::uint16_t* indices) {
    const std::int32_t range = last - first, levels = (1 << width) - 1;
    const double divisor = range > 0 ? range : 1, half = range / 2;
    for (std::size_t i = 0; i < n; ++i) {
        std::int32_t d = values[i] - first;
        d = d < 0 ? 0 : d;
        d = d > range ? range : d;
        const double quotient = (static_cast<double>(d) * levels + half) / divisor;
        indices[i] = static_cast<std::uint16_t>(static_cast<std::int32_t>(quotient));
    }
}

OCTOBRICK_INLINE void find_indices(const float* values, std::size_t n, float first, float last,
                                   unsigned width, std::uint16_t* indices) {
    const double low = static_cast<double>(first);
    const double range = static_cast<double>(last) - low, levels = (1 << width) - 1;
    const double divisor = range > 0 ? range : 1;
    for (std::size_t i = 0; i < n; ++i) {
        double d = static_cast<double>(values[i]) - low;
        d = d < 0 ? 0 : d;
        d = d > range ? range : d;
        indices[i] =
            static_cast<std::uint16_t>(static_cast<std::int32_t>(d / divisor * levels + 0.5));
    }
}

// What an index decodes to, for any width.
inline std::int32_t value_at(std::int32_t first, std::int32_t last, unsigned width,
                             std::uint16_t index) {
    const std::int64_t levels = (1 << width) - 1, range = last - first;
    return width == 0 ? first
                      : static_cast<std::int32_t>(first + (range * index + levels / 2) / levels);
}
inline float value_at(float first, float last, unsigned width, std::uint16_t index) {
    const int levels = (1 << width) - 1;
    if (index == levels) return last;  // and so where the width is 0
    const double range = static_cast<double>(last) - static_cast<double>(first);
    const auto value = static_cast<float>(static_cast<double>(first) + range * index / levels);
    return std::clamp(value, first, last);
}

// Calls f(number among the voxels that a cut block has, number in the whole block).
template <class F>
void for_each_voxel(Zyx extent, Zyx whole, const F& f) {
    std::size_t i = 0;
    for (std::size_t z = 0; z < extent.z; ++z) {
        for (std::size_t y = 0; y < extent.y; ++y) {
            for (std::size_t x = 0; x < extent.x; ++x) f(i++, (z * whole.y + y) * whole.x + x);
        }
    }
}

template <class T, class Value>
void store_ends(Value first, Value last, std::uint8_t* to) {
    const T ends[2] = {static_cast<T>(first), static_cast<T>(last)};
    std::memcpy(to, ends, sizeof ends);
}

template <unsigned W, class Byte>
OCTOBRICK_INLINE void pack_plane(std::size_t n, const Byte& byte_of, std::uint8_t* to) {
    for (std::size_t i = 0; i < n; i += kChunk) {
        const std::size_t here = std::min(kChunk, n - i);
        std::uint8_t chunk[kChunk] = {};
        for (std::size_t k = 0; k < here; ++k) chunk[k] = byte_of(i + k);
        pack_tail<W>(chunk, to + i * W / 8, here * W / 8);
    }
}

// The mirror of read_indices in s3dc_variable_decode.cpp. n is a multiple of 32.
template <unsigned W>
OCTOBRICK_INLINE void pack_width(const std::uint16_t* indices, std::size_t n, std::uint8_t* to) {
    const auto low = [indices](std::size_t i) { return static_cast<std::uint8_t>(indices[i]); };
    const auto high = [indices](std::size_t i) {
        return static_cast<std::uint8_t>(indices[i] >> 8);
    };
    if constexpr (W <= 8) {
        pack_plane<W>(n, low, to);
    } else {
        pack_plane<8>(n, low, to);
        pack_plane<W - 8>(n, high, to + n);
    }
}

OCTOBRICK_INLINE void pack_indices(const std::uint16_t* indices, std::size_t n, unsigned width,
                                   std::uint8_t* to) {
    switch (width) {
        case 1: return pack_width<1>(indices, n, to);
        case 2: return pack_width<2>(indices, n, to);
        case 3: return pack_width<3>(indices, n, to);
        case 4: return pack_width<4>(indices, n, to);
        case 5: return pack_width<5>(indices, n, to);
        case 6: return pack_width<6>(indices, n, to);
        case 7: return pack_width<7>(indices, n, to);
        case 8: return pack_width<8>(indices, n, to);
        case 9: return pack_width<9>(indices, n, to);
        case 10: return pack_width<10>(indices, n, to);
        case 11: return pack_width<11>(indices, n, to);
        case 12: return pack_width<12>(indices, n, to);
        case 13: return pack_width<13>(indices, n, to);
        case 14: return pack_width<14>(indices, n, to);
    }
}

}  // namespace octobrick::codec::detail
