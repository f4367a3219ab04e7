// Whether a code is one: what all readers of S3Dc codes refuse.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>

#include "octobrick/codec/s3dc.h"
#include "simd.h"

namespace octobrick::codec::detail {

// Below, T is unsigned or float: signed samples come as unsigned ones of their width.

// Whether `encode` can have written these end points.
template <class T>
OCTOBRICK_INLINE bool plausible(T min, T max, SampleType type) {
    if constexpr (std::is_floating_point_v<T>) {
        return min <= max && min >= std::numeric_limits<T>::lowest() &&
               max <= std::numeric_limits<T>::max();  // false for NaN
    } else {
        // Flipping the sign bit orders signed samples as unsigned ones.
        const bool is_signed = type == SampleType::i8 || type == SampleType::i16;
        const T flip = is_signed ? static_cast<T>(T{1} << (8 * sizeof(T) - 1)) : T{0};
        return static_cast<T>(min ^ flip) <= static_cast<T>(max ^ flip);
    }
}

// As a number, whatever the sign of the sample type.
template <class T>
double as_number(T value, SampleType type) {
    if constexpr (std::is_integral_v<T>) {
        if (type == SampleType::i8 || type == SampleType::i16) {
            return static_cast<double>(static_cast<std::make_signed_t<T>>(value));
        }
    }
    return static_cast<double>(value);
}

template <class T>
Outcome bad_end_points(Zyx block, T min, T max, SampleType type) {
    return {Status::bad_end_points, block, as_number(min, type), as_number(max, type)};
}

// Finds in a code all that `decode` would refuse, without decoding it, and says the same of it.
// Sets `layout`.
Outcome check_code(const S3dc& codec, SampleType type, Zyx shape, std::span<const std::byte> code,
                   Layout& layout);

}  // namespace octobrick::codec::detail
