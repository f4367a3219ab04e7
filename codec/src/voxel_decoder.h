// One voxel of an S3Dc code, or four, from indices and end points: what quantise.h does for rows.
#pragma once

#include <cstddef>
#include <cstdint>

#include "four.h"
#include "simd.h"

namespace octobrick::codec::detail {

// Integers, as quantise.h has it: with R = max − min = L·whole + rest, rest < L,
//   min + (R·index + (L div 2)) div L = min + whole·index + (rest·index + (L div 2)) div L
//
// For 8-bit samples R itself may be the rest: n = rest·index + (L div 2) is at most 255·L + L/2
// either way. The division is (n·m) >> 23 with m = ceil(2^23/L): with e = m·L − 2^23 < L it is
// exact where n·e < 2^23, and for each of the eight L it is; the product is below 2^32.
template <class T>
class VoxelDecoder {
  public:
    // Unsigned, as they wrap: nothing overflows, whatever the bytes.
    struct Ends {
        std::uint32_t min, whole, rest;
    };

    explicit VoxelDecoder(unsigned bits)
        : levels_((1u << bits) - 1),
          reciprocal_(((1u << 23) + levels_ - 1) / levels_),
          wide_reciprocal_(((std::uint64_t{1} << 32) + levels_ - 1) / levels_) {}

    OCTOBRICK_INLINE Ends ends(T min, T max) const {
        const auto low = static_cast<std::uint32_t>(min);
        const std::uint32_t range = static_cast<std::uint32_t>(max) - low;
        if constexpr (sizeof(T) == 1) {
            return {low, 0, range};
        } else {
            // R div L: (R·m) >> 32 with m = ceil(2^32/L), exact as R·L < 2^32.
            const auto whole = static_cast<std::uint32_t>(range * wide_reciprocal_ >> 32);
            return {low, whole, range - whole * levels_};
        }
    }

    OCTOBRICK_INLINE double value(const Ends& e, std::uint32_t index) const {
        return static_cast<double>(
            static_cast<std::int32_t>(decode(e.min, e.whole, e.rest, index)));
    }

    // Four voxels with end points of their own, or with the same.
    OCTOBRICK_INLINE void values(const Ends (&e)[4], const UintFour& index, DoubleFour& out) const {
        const UintFour min = {e[0].min, e[1].min, e[2].min, e[3].min};
        const UintFour whole = {e[0].whole, e[1].whole, e[2].whole, e[3].whole};
        const UintFour rest = {e[0].rest, e[1].rest, e[2].rest, e[3].rest};
        convert(reinterpret_cast<IntFour>(decode(min, whole, rest, index)), out);
    }
    OCTOBRICK_INLINE void values(const Ends& e, const UintFour& index, DoubleFour& out) const {
        const UintFour zero = {};
        convert(
            reinterpret_cast<IntFour>(decode(zero + e.min, zero + e.whole, zero + e.rest, index)),
            out);
    }

  private:
    template <class U>
    OCTOBRICK_INLINE U decode(const U& min, const U& whole, const U& rest, const U& index) const {
        const U rounded = ((rest * index + levels_ / 2) * reciprocal_) >> 23;
        if constexpr (sizeof(T) == 1) {
            return min + rounded;
        } else {
            return min + whole * index + rounded;
        }
    }

    std::uint32_t levels_, reciprocal_;
    std::uint64_t wide_reciprocal_;
};

// float32: see DequantiserFloat.
template <>
class VoxelDecoder<float> {
  public:
    struct Ends {
        float min, max;
        double range;
    };

    explicit VoxelDecoder(unsigned bits) : levels_((1u << bits) - 1) {}

    OCTOBRICK_INLINE Ends ends(float min, float max) const {
        return {min, max, static_cast<double>(max) - static_cast<double>(min)};
    }

    OCTOBRICK_INLINE double value(const Ends& e, std::uint32_t index) const {
        const double exact = static_cast<double>(e.min) +
                             e.range * static_cast<double>(index) / static_cast<double>(levels_);
        float value = static_cast<float>(exact);
        value = value < e.min ? e.min : value;
        value = value > e.max ? e.max : value;
        return static_cast<double>(index == levels_ ? e.max : value);
    }

    OCTOBRICK_INLINE void values(const Ends (&e)[4], const UintFour& index, DoubleFour& out) const {
        const FloatFour min = {e[0].min, e[1].min, e[2].min, e[3].min};
        const FloatFour max = {e[0].max, e[1].max, e[2].max, e[3].max};
        const DoubleFour range = {e[0].range, e[1].range, e[2].range, e[3].range};
        DoubleFour low, number;
        FloatFour value;
        convert(min, low);
        convert(reinterpret_cast<IntFour>(index), number);
        convert(low + range * number / static_cast<double>(levels_), value);
        value = value < min ? min : value;
        value = value > max ? max : value;
        value = index == levels_ ? max : value;
        convert(value, out);
    }
    OCTOBRICK_INLINE void values(const Ends& e, const UintFour& index, DoubleFour& out) const {
        const Ends four[4] = {e, e, e, e};
        values(four, index, out);
    }

  private:
    std::uint32_t levels_;
};

}  // namespace octobrick::codec::detail
