// Half-resolution volumes. The promises at the top of s3dc.h hold here too.
#pragma once

#include "octobrick/codec/view.h"

namespace octobrick::codec {

// The shape of the next coarser level: half of each axis, rounded up.
constexpr Zyx half_shape(Zyx shape) {
    return {shape.z / 2 + shape.z % 2, shape.y / 2 + shape.y % 2, shape.x / 2 + shape.x % 2};
}

// Writes to `coarse` the mean of every 2×2×2 voxels of `fine`; on an axis of odd length the last
// voxel counts twice, so that each mean is over the voxels that exist.
//   integers  floor((sum of 8 + 4) / 8): rounded half up
//   f32       in double, c[x] = (v[0][0][x] + v[0][1][x]) + (v[1][0][x] + v[1][1][x]) with
//             [z][y][x], then (c[0] + c[1]) / 8, rounded to float. NaN and ±Inf spread.
// Returns false, and writes nothing, unless the types are equal, no axis is empty and
// coarse.shape == half_shape(fine.shape).
bool mean2(const ConstVolume& fine, const Volume& coarse, Execution execution = {});

}  // namespace octobrick::codec
