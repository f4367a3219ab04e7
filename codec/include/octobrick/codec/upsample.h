// Volumes at twice the resolution, as predictions of finer levels. The promises at the top of
// s3dc.h hold here too.
#pragma once

#include "octobrick/codec/view.h"

namespace octobrick::codec {

// Writes to `fine` the linear interpolation of `coarse`, whose voxels lie in the middle of 2×2×2
// fine ones: along each axis fine voxel 2k is (3 c[k] + c[k − 1]) / 4 and 2k + 1 is
// (3 c[k] + c[k + 1]) / 4, with the outermost voxel repeated beyond the faces.
//   integers  floor((sum of 8, with weights 27, 9, 3 and 1, + 32) / 64): rounded half up
//   f32       in double, 3a + b along y, then along z, then along x, then / 64, rounded to float.
//             NaN and ±Inf spread.
// Returns false, and writes nothing, unless the types are equal, no axis is empty and
// coarse.shape == half_shape(fine.shape).
bool upsample2(const ConstVolume& coarse, const Volume& fine, Execution execution = {});

}  // namespace octobrick::codec
