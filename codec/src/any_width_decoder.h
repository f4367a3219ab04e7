// One voxel, or four, from indices of any width and end points: what VoxelDecoder does for one
// width, where each block has its own.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "four.h"
#include "s3dc_variable_format.h"
#include "simd.h"

namespace octobrick::codec::detail {

// Integers: with R = max − min,
//   min + (R·index + (L div 2)) div L = min + floor((R·index + (L div 2) + 1/2) · (1/L))
//
// in double: the dividend is below 2^30, so two roundings change the quotient by less than 2^-22/L,
// and it is at least 1/(2L) away from any integer. A block without indices has 1/L = 0; one of raw
// voxels has the least number of the type as min and R = L = 1.
template <class T>
class AnyWidthDecoder {
  public:
    struct Ends {
        double min, range, half, reciprocal;
    };

    AnyWidthDecoder() {
        for (unsigned width = 1; width <= kMostWidth; ++width) {
            const unsigned levels = (1u << width) - 1;
            half_[width] = levels / 2 + 0.5;
            reciprocal_[width] = 1.0 / levels;
        }
        half_[kRaw] = 0.5;
        reciprocal_[kRaw] = 1;
    }

    OCTOBRICK_INLINE Ends ends(T min, T max, unsigned width) const {
        const bool raw = width == kRaw;
        return {static_cast<double>(raw ? std::numeric_limits<T>::lowest() : min),
                raw ? 1.0 : static_cast<double>(max) - static_cast<double>(min), half_[width],
                reciprocal_[width]};
    }

    // Raw bits as an index: signed voxels in the order of unsigned ones.
    OCTOBRICK_INLINE static std::uint32_t index_of_raw(std::uint32_t bits) {
        constexpr std::uint32_t kSign = std::is_signed_v<T> ? 1u << (8 * sizeof(T) - 1) : 0;
        return bits ^ kSign;
    }

    OCTOBRICK_INLINE double value(const Ends& e, std::uint32_t index) const {
        const double quotient = (e.range * static_cast<double>(index) + e.half) * e.reciprocal;
        return e.min + static_cast<double>(static_cast<std::int32_t>(quotient));
    }

    // Four voxels with end points of their own, or with the same.
    OCTOBRICK_INLINE void values(const Ends (&e)[4], const UintFour& index, DoubleFour& out) const {
        const DoubleFour min = {e[0].min, e[1].min, e[2].min, e[3].min};
        const DoubleFour range = {e[0].range, e[1].range, e[2].range, e[3].range};
        const DoubleFour half = {e[0].half, e[1].half, e[2].half, e[3].half};
        const DoubleFour reciprocal = {e[0].reciprocal, e[1].reciprocal, e[2].reciprocal,
                                       e[3].reciprocal};
        decode(min, range, half, reciprocal, index, out);
    }
    OCTOBRICK_INLINE void values(const Ends& e, const UintFour& index, DoubleFour& out) const {
        const DoubleFour zero = {};
        decode(zero + e.min, zero + e.range, zero + e.half, zero + e.reciprocal, index, out);
    }

  private:
    OCTOBRICK_INLINE static void decode(const DoubleFour& min, const DoubleFour& range,
                                        const DoubleFour& half, const DoubleFour& reciprocal,
                                        const UintFour& index, DoubleFour& out) {
        DoubleFour number, whole;
        IntFour quotient;
        convert(reinterpret_cast<IntFour>(index), number);
        convert((range * number + half) * reciprocal, quotient);
        convert(quotient, whole);
        out = min + whole;
    }

    double half_[kRaw + 1] = {}, reciprocal_[kRaw + 1] = {};  // L div 2 + 1/2, and 1/L
};

// float32: see DequantiserFloat. A block without indices has its first level, so max is min there.
template <>
class AnyWidthDecoder<float> {
  public:
    struct Ends {
        float min, max;
        double range, divisor;
        std::uint32_t levels;
        std::int32_t raw;  // -1 where an index is the voxel itself, else 0
    };

    OCTOBRICK_INLINE Ends ends(float min, float max, unsigned width) const {
        if (width == kRaw) return {0, 0, 0, 1, 0, -1};
        const float last = width == 0 ? min : max;
        const std::uint32_t levels = (1u << width) - 1;
        return {min,
                last,
                static_cast<double>(last) - static_cast<double>(min),
                static_cast<double>(levels + (width == 0)),
                levels,
                0};
    }

    OCTOBRICK_INLINE static std::uint32_t index_of_raw(std::uint32_t bits) { return bits; }

    OCTOBRICK_INLINE double value(const Ends& e, std::uint32_t index) const {
        if (e.raw != 0) return static_cast<double>(std::bit_cast<float>(index));
        const double exact =
            static_cast<double>(e.min) + e.range * static_cast<double>(index) / e.divisor;
        float value = static_cast<float>(exact);
        value = value < e.min ? e.min : value;
        value = value > e.max ? e.max : value;
        return static_cast<double>(index == e.levels ? e.max : value);
    }

    OCTOBRICK_INLINE void values(const Ends (&e)[4], const UintFour& index, DoubleFour& out) const {
        const FloatFour min = {e[0].min, e[1].min, e[2].min, e[3].min};
        const FloatFour max = {e[0].max, e[1].max, e[2].max, e[3].max};
        const DoubleFour range = {e[0].range, e[1].range, e[2].range, e[3].range};
        const DoubleFour divisor = {e[0].divisor, e[1].divisor, e[2].divisor, e[3].divisor};
        const UintFour levels = {e[0].levels, e[1].levels, e[2].levels, e[3].levels};
        const IntFour raw = {e[0].raw, e[1].raw, e[2].raw, e[3].raw};
        DoubleFour low, number;
        FloatFour value;
        convert(min, low);
        convert(reinterpret_cast<IntFour>(index), number);
        convert(low + range * number / divisor, value);
        value = value < min ? min : value;
        value = value > max ? max : value;
        value = index == levels ? max : value;
        value = raw != 0 ? reinterpret_cast<FloatFour>(index) : value;
        convert(value, out);
    }
    OCTOBRICK_INLINE void values(const Ends& e, const UintFour& index, DoubleFour& out) const {
        const Ends four[4] = {e, e, e, e};
        values(four, index, out);
    }
};

}  // namespace octobrick::codec::detail
