// One block of a volume, gathered: its voxels, or their differences to a prediction.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "end_points.h"
#include "level_fit.h"
#include "rows.h"
#include "simd.h"

namespace octobrick::codec::detail {

// What a block is worked in: integers of every type as int32.
template <class T>
using Work = std::conditional_t<std::is_floating_point_v<T>, float, std::int32_t>;

// The voxels of a block, z slowest, without gaps where it is cut; and what they are coded as.
template <class T>
struct BlockVoxels {
    explicit BlockVoxels(std::size_t most)
        : values(most), differences(most), prediction(most), normalised(most) {}

    // Steps: gathers voxels, and with a prediction their differences.
    OCTOBRICK_INLINE void gather(const SlabRows<T, ConstVolume>& rows, std::size_t x,
                                 Zyx extent_of_block) {
        extent = extent_of_block;
        n = copy_rows(rows, x, values.data());
    }
    OCTOBRICK_INLINE void gather_prediction(const SlabRows<T, ConstVolume>& rows, std::size_t x) {
        copy_rows(rows, x, prediction.data());
        for (std::size_t i = 0; i < n; ++i) {
            if constexpr (std::is_floating_point_v<T>) {
                const double difference =
                    static_cast<double>(values[i]) - static_cast<double>(prediction[i]);
                differences[i] = static_cast<float>(difference);
            } else {
                differences[i] = values[i] - prediction[i];
            }
        }
    }

    const Work<T>* coded(bool as_difference) const {
        return as_difference ? differences.data() : values.data();
    }

    Zyx extent;
    std::size_t n = 0;
    Array<Work<T>> values, differences, prediction;
    Array<float> normalised;  // see Range::normalise

  private:
    OCTOBRICK_INLINE std::size_t copy_rows(const SlabRows<T, ConstVolume>& rows, std::size_t x,
                                           Work<T>* to) const {
        Work<T>* at = to;
        for (std::size_t z = 0; z < extent.z; ++z) {
            for (std::size_t y = 0; y < extent.y; ++y) {
                const T* row = rows.row(z, y) + x;
                for (std::size_t i = 0; i < extent.x; ++i) *at++ = row[i];
            }
        }
        return static_cast<std::size_t>(at - to);
    }
};

// Least and greatest of what is coded.
template <class T>
struct Range {
    using Value = Work<T>;
    Value min, max;

    OCTOBRICK_INLINE static Range of(const Value* values, std::size_t n) {
        Range range{std::numeric_limits<Value>::max(), std::numeric_limits<Value>::lowest()};
        for (std::size_t i = 0; i < n; ++i) {
            range.min = values[i] < range.min ? values[i] : range.min;
            range.max = values[i] > range.max ? values[i] : range.max;
        }
        return range;
    }

    // Whether end points of the samples' width can hold differences of this range.
    bool holds_differences() const {
        using Limits = std::numeric_limits<Difference<T>>;
        return min >= Limits::lowest() && max <= Limits::max();  // false for infinities
    }

    bool constant() const { return min == max; }

    // The greatest of the normalised values: integers keep their scale, floats get that of 16 bits,
    // so that their squares neither overflow nor vanish.
    float reach() const {
        if constexpr (std::is_floating_point_v<T>) return constant() ? 0.0f : 65535.0f;
        return static_cast<float>(max - min);
    }
    double unit() const {  // of the normalised values
        if constexpr (std::is_floating_point_v<T>) {
            return constant() ? 1.0
                              : (static_cast<double>(max) - static_cast<double>(min)) / 65535.0;
        }
        return 1.0;
    }
    OCTOBRICK_INLINE void normalise(const Value* values, std::size_t n, float* to) const {
        if constexpr (std::is_floating_point_v<T>) {
            const double low = static_cast<double>(min), scale = 1.0 / unit();
            for (std::size_t i = 0; i < n; ++i) {
                to[i] = static_cast<float>((static_cast<double>(values[i]) - low) * scale);
            }
        } else {
            for (std::size_t i = 0; i < n; ++i) to[i] = static_cast<float>(values[i] - min);
        }
    }
    // A level among the normalised values, as an end point.
    Value end_point(float level) const {
        if constexpr (std::is_floating_point_v<T>) {
            if (level >= reach()) return max + 0.0f;  // which the sum below may miss
            const double value = static_cast<double>(min) + static_cast<double>(level) * unit();
            return std::clamp(static_cast<float>(value), min, max) + 0.0f;  // −0 becomes +0
        } else {
            return min + static_cast<Value>(level);
        }
    }
};

// Where a value lies between least and greatest: 0 to 65535.
template <class T>
std::uint16_t position_of(Work<T> value, const Range<T>& range) {
    const double part = (static_cast<double>(value) - static_cast<double>(range.min)) /
                        (static_cast<double>(range.max) - static_cast<double>(range.min));
    return static_cast<std::uint16_t>(part * 65535 + 0.5);
}

// Levels for `width` bits among what is coded, least and greatest or fitted.
template <class T>
OCTOBRICK_INLINE Levels find_block_levels(FindLevels find_levels, BlockVoxels<T>& block,
                                          bool as_difference, const Range<T>& range, unsigned width,
                                          bool fitted) {
    float* normalised = block.normalised.data();
    range.normalise(block.coded(as_difference), block.n, normalised);
    return find_levels(normalised, block.n, range.reach(), width, fitted);
}

}  // namespace octobrick::codec::detail
