#include "faults.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rows.h"

namespace octobrick::codec::detail {

Outcome find_not_finite(const ConstVolume& voxels) {
    const RowReader<float> reader(voxels);
    for (std::size_t z = 0; z < voxels.shape.z; ++z) {
        for (std::size_t y = 0; y < voxels.shape.y; ++y) {
            const float* row = reader.row(z, y);
            int infinite = 0;  // so, and with this comparison, the loop is vectorised
            for (std::size_t x = 0; x < voxels.shape.x; ++x) {
                infinite |= !(std::fabs(row[x]) <= std::numeric_limits<float>::max());
            }
            if (infinite == 0) continue;
            const float* at = std::find_if_not(row, row + voxels.shape.x,
                                               [](float v) { return std::isfinite(v); });
            return {Status::not_finite, {z, y, static_cast<std::size_t>(at - row)}, *at, *at};
        }
    }
    return {};
}

}  // namespace octobrick::codec::detail
