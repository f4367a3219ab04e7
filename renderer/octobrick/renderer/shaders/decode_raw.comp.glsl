// Lossless bricks: the texture holds the voxels themselves.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "stored.glsl"

uniform ${SAMPLER_PREFIX}sampler3D voxels;

void main() {
    Work work = find_work();
    ivec3 voxel = work.first;
    for (int row = 0; row < work.rows; ++row, ++voxel.y)
        for (int i = 0; i < ${RUN}; ++i) {
            ivec3 at = voxel + ivec3(i, 0, 0);
            put(work, at, to_stored(${VALUE}(texelFetch(voxels, work.part.code_texel.xyz + at, 0).r)));
        }
}
