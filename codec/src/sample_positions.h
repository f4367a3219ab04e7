// From points to voxels and weights: the part of sampling that knows nothing of codes.
#pragma once

#include <cstddef>
#include <cstdint>

#include "four.h"
#include "octobrick/codec/view.h"
#include "simd.h"

namespace octobrick::codec::detail {

// Lanes are x, y, z and one that is not used.
struct Position {
    IntFour low;        // a voxel
    DoubleFour weight;  // of the next voxel on each axis: 0 to 1, or NaN where a coordinate is
};

// A volume, the axes of which have at most INT32_MAX voxels.
class SampleAxes {
  public:
    explicit SampleAxes(Zyx shape) {
        const std::size_t n[4] = {shape.x, shape.y, shape.z, 1};
        for (int axis = 0; axis < 4; ++axis) {
            last_[axis] = static_cast<double>(n[axis] - 1);
            last_low_[axis] = static_cast<std::int32_t>(n[axis] > 1 ? n[axis] - 2 : 0);
        }
    }

    // The voxel that a point lies in; its next ones weigh nothing.
    OCTOBRICK_INLINE void nearest(const DoubleFour& point, Position& at) const {
        DoubleFour u;
        clamp(point, u);
        convert(u, at.low);
        at.weight = point == point ? DoubleFour{} : point;
    }

    // The first of the eight voxels around a point. At the last centre the last voxel weighs 1, so
    // that there is always a next one.
    OCTOBRICK_INLINE void between(const DoubleFour& point, Position& at) const {
        DoubleFour u, low;
        clamp(point - 0.5, u);
        convert(u, at.low);
        at.low = at.low < last_low_ ? at.low : last_low_;
        convert(at.low, low);
        at.weight = point == point ? u - low : point;
    }

  private:
    // To the centres of voxels, less 0.5. NaN becomes 0, as no comparison holds for it.
    OCTOBRICK_INLINE void clamp(const DoubleFour& u, DoubleFour& clamped) const {
        const DoubleFour above = u > 0 ? u : DoubleFour{};
        clamped = above < last_ ? above : last_;
    }

    DoubleFour last_;
    IntFour last_low_;
};

}  // namespace octobrick::codec::detail
