// The two numbers that a block keeps: least and greatest voxel, or difference to a prediction.
#pragma once

#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

namespace octobrick::codec::detail {

// Integers as unsigned ones of their width: two's complement wraps, so signed samples decode as
// unsigned ones.
template <class T>
struct UnsignedOf {
    using type = std::make_unsigned_t<T>;
};
template <>
struct UnsignedOf<float> {
    using type = float;
};
template <class T>
using Unsigned = typename UnsignedOf<T>::type;

// What a difference to a prediction is kept in: signed, and no wider than the samples.
template <class T>
struct DifferenceOf {
    using type = std::make_signed_t<T>;
};
template <>
struct DifferenceOf<float> {
    using type = float;
};
template <class T>
using Difference = typename DifferenceOf<T>::type;

// A voxel from its prediction. It cannot leave the sample type.
template <class T>
T predicted_plus(T prediction, Difference<T> difference) {
    using Limits = std::numeric_limits<T>;
    if constexpr (std::is_floating_point_v<T>) {
        const double sum = static_cast<double>(prediction) + static_cast<double>(difference);
        const float rounded = static_cast<float>(sum);
        const float above = rounded < Limits::lowest() ? Limits::lowest() : rounded;
        return above > Limits::max() ? Limits::max() : above;
    } else {
        const int sum = int{prediction} + int{difference};
        const int above = sum < int{Limits::lowest()} ? int{Limits::lowest()} : sum;
        return static_cast<T>(above > int{Limits::max()} ? int{Limits::max()} : above);
    }
}

// The end points of a block of samples T, or of differences.
template <class T>
class EndPoints {
  public:
    EndPoints(const std::uint8_t* from, bool differences) : differences_(differences) {
        std::memcpy(bytes_, from, sizeof bytes_);
    }

    // As another type of the same width.
    template <class As>
    As min() const {
        return load<As>(bytes_);
    }
    template <class As>
    As max() const {
        return load<As>(bytes_ + sizeof(T));
    }
    double min_number() const { return number(bytes_); }
    double max_number() const { return number(bytes_ + sizeof(T)); }

    // Whether an encoder can have written them: in order, and finite.
    bool plausible() const { return differences_ ? in_order<Difference<T>>() : in_order<T>(); }

  private:
    template <class As>
    static As load(const std::uint8_t* from) {
        static_assert(sizeof(As) == sizeof(T));
        As value;
        std::memcpy(&value, from, sizeof value);
        return value;
    }
    template <class As>
    bool in_order() const {  // false for NaN
        return min<As>() <= max<As>() && min<As>() >= std::numeric_limits<As>::lowest() &&
               max<As>() <= std::numeric_limits<As>::max();
    }
    double number(const std::uint8_t* from) const {
        return differences_ ? static_cast<double>(load<Difference<T>>(from))
                            : static_cast<double>(load<T>(from));
    }

    bool differences_;
    std::uint8_t bytes_[2 * sizeof(T)];
};

}  // namespace octobrick::codec::detail
