// Where to put the levels of a block: end points, and the squared error that they leave.
//
// Works on a block's voxels less their minimum as floats in [0, reach]: integers are themselves,
// and exact; floats are scaled to [0, 65535]. What comes out is a choice of the encoder, so float
// sums do; they are kept in a fixed number of lanes, so that every instruction set adds alike.
#pragma once

#include <cstddef>

#include "octobrick/codec/view.h"

namespace octobrick::codec::detail {

// With more bits than this, levels lie so close that fitting them gains nothing.
inline constexpr unsigned kMostFitted = 6;

// First and last level of a block, and the sum of squared errors with them.
struct Levels {
    float first = 0, last = 0;
    double squares = 0;
};

// How far inside of a block's range the outer of 2^width levels lie where its voxels are spread
// evenly: half a step on each side.
inline float even_margin(unsigned width, float reach) {
    return reach / static_cast<float>(2u << width);
}

// The levels of a block of n voxels for `width` bits: least and greatest voxel, or fitted from
// there and, where levels are few, from half a step inside. `reach` is the greatest voxel.
using FindLevels = Levels (*)(const float* voxels, std::size_t n, float reach, unsigned width,
                              bool fitted);

// That function for integers, whose decoded values are rounded, or floats. It is compiled for every
// set of instructions, and called through a pointer: inlined into each of its many callers it would
// take minutes to compile.
FindLevels find_levels_for(bool integer, Execution execution) noexcept;

// The squared error with levels at least and greatest voxel, for a width whose steps are so fine
// that voxels lie evenly within one: from the error at a narrower width.
template <bool kInteger>
double fine_squares(double squares, unsigned width, unsigned wider, float reach) {
    const auto variance = [reach](unsigned w) {  // of a step, times 12
        const double step = static_cast<double>(reach) / ((1u << w) - 1);
        return step * step - (kInteger ? 1 : 0);  // between whole numbers, decoded to whole numbers
    };
    return squares * variance(wider) / variance(width);
}

}  // namespace octobrick::codec::detail
