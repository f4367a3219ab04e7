// How far two volumes are apart. The promises at the top of s3dc.h hold here too.
#pragma once

#include <cstdint>

#include "octobrick/codec/view.h"

namespace octobrick::codec {

struct ErrorStats {
    std::uint64_t count = 0;
    // Integers: exact; squares_high counts multiples of 2^64.
    std::uint64_t max_abs = 0, squares = 0, squares_high = 0;
    // f32: computed in double; NaN if any difference is NaN.
    double max_abs_f = 0, squares_f = 0;
};

// Compares two volumes voxel by voxel, in the calling thread alone. Returns false unless types and
// shapes are equal.
bool compare(const ConstVolume& a, const ConstVolume& b, ErrorStats& stats,
             Execution execution = {});

}  // namespace octobrick::codec
