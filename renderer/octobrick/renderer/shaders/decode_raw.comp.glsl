// Lossless bricks: the bytes are the voxels themselves.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "stored.glsl"

const ivec3 BRICK = ivec3(${BRICK_XYZ});

void main() {
    Work work = find_work();
    ivec3 voxel = work.first;
    for (int row = 0; row < work.rows; ++row, ++voxel.y) {
        int index = (voxel.z * BRICK.y + voxel.y) * BRICK.x + voxel.x;
#if ${RUN} > 1
        for (int i = 0; i < ${RUN}; i += 2) {  // where a run has two, rows have an even number
            SAMPLE_PAIR pair = pair_at(work.part.code_words.x, (index + i) >> 1);
            put(work, voxel + ivec3(i, 0, 0), to_stored(pair.x));
            put(work, voxel + ivec3(i + 1, 0, 0), to_stored(pair.y));
        }
#else
        put(work, voxel, to_stored(sample_at(work.part.code_words.x, index)));
#endif
    }
}
