// Directions of gradients, as they are stored: three bytes a voxel, which the ray-caster decodes
// after it has interpolated them (docs/spec/gradient-code.md).

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"

const ivec3 BRICK = ivec3(${BRICK_XYZ});

void main() {
    Work work = find_work();
    ivec3 voxel = work.first;
    for (int row = 0; row < work.rows; ++row, ++voxel.y) {
        int index = (voxel.z * BRICK.y + voxel.y) * BRICK.x + voxel.x;
        for (int i = 0; i < ${RUN}; ++i) {
            int x = voxel.x + i;
            if (x < work.part.x_range.x || x >= work.part.x_range.y) continue;
            uint code = bits_at(work.part.code_words.x, 24 * (index + i), 24);
            imageStore(slab, work.part.brick_in_slab.xyz + voxel + ivec3(i, 0, 0),
                       unpackUnorm4x8(code));
        }
    }
}
