// S3Dc (claims S1, S2, S9..S11): a block of voxels shares its minimum and maximum (the end points);
// each voxel has an index of BITS bits, packed along x, lowest bits first, rows of 16-bit words.
//
//     integers  v = min + (2·R·index + L) div (2·L)        R = max − min, L = 2^BITS − 1
//     float32   v = min + R·index / L                       in double, rounded once; max at L
//
// An invocation decodes RUN voxels along x, whose indices lie in at most two words. RUN divides
// the block's edge, so that one pair of end points serves them all.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "stored.glsl"

uniform usampler3D indices;
uniform ${SAMPLER_PREFIX}sampler3D end_points;

const int BITS = ${BITS};
const int RUN = ${RUN};
const int LEVELS = (1 << BITS) - 1;
const ivec3 BLOCK = ivec3(${BLOCK_XYZ});

#if ${IS_FLOAT}
float decode(vec2 pair, int index) {
    precise double low = double(pair.x);
    precise double high = double(pair.y);
    precise double value = low + (high - low) * double(index) / double(LEVELS);
    return index == LEVELS ? pair.y : clamp(float(value), pair.x, pair.y);
}
#else
int decode(ivec2 pair, int index) {
    return pair.x + (2 * (pair.y - pair.x) * index + LEVELS) / (2 * LEVELS);
}
#endif

uint indices_of_run(ivec3 word_at, int shift) {
    uint words = texelFetch(indices, word_at, 0).r;
#if ${CROSSES_WORDS}
    words |= texelFetch(indices, word_at + ivec3(1, 0, 0), 0).r << 16;
#endif
    return words >> shift;
}

void main() {
    Work work = find_work();
    ivec3 voxel = work.first;
    ivec3 word_at = work.part.code_texel.xyz + ivec3(voxel.x * BITS >> 4, voxel.yz);
    int shift = voxel.x * BITS & 15;
    int block_row = -1;
    ${PAIR} pair;
    for (int row = 0; row < work.rows; ++row, ++voxel.y, ++word_at.y) {
        if (voxel.y / BLOCK.y != block_row) {
            block_row = voxel.y / BLOCK.y;
            ivec3 block = ivec3(voxel.x / BLOCK.x, block_row, voxel.z / BLOCK.z);
            pair = ${PAIR}(texelFetch(end_points, work.part.end_points_texel.xyz + block, 0).rg);
        }
        uint run = indices_of_run(word_at, shift);
        for (int i = 0; i < RUN; ++i, run >>= BITS)
            put(work, voxel + ivec3(i, 0, 0), to_stored(decode(pair, int(run & uint(LEVELS)))));
    }
}
