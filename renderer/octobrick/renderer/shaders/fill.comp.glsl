// Bricks that are absent because every voxel has the fill value.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"

uniform float fill_stored;

void main() {
    Work work = find_work();
    for (int row = 0; row < work.rows; ++row)
        for (int i = 0; i < ${RUN}; ++i) put(work, work.first + ivec3(i, row, 0), fill_stored);
}
