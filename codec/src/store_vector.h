// A gradient in double, as three floats.
#pragma once

#include <algorithm>
#include <cfloat>
#include <cmath>

namespace octobrick::codec::detail {

inline void store_vector(double x, double y, double z, float* out) {
    const double greatest = std::max({std::fabs(x), std::fabs(y), std::fabs(z)});
    if (greatest > FLT_MAX) {  // as a whole, or the direction would turn
        const double scale = FLT_MAX / greatest;
        x *= scale, y *= scale, z *= scale;
    }
    out[0] = static_cast<float>(x);
    out[1] = static_cast<float>(y);
    out[2] = static_cast<float>(z);
}

}  // namespace octobrick::codec::detail
