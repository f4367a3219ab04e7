// Values straight from S3Dc code at a fixed rate, without a slab: the three ways of the S3Dc paper
// (claims S13 to S16). Indices of different blocks cannot be interpolated: voxels are decoded first.

const int CHANNELS = ${CHANNELS};  // 1

#include "codes.glsl"
#include "samples.glsl"
#include "stored.glsl"
#include "s3dc.glsl"

uniform usampler3D brick_table;     // by brick: 1 + the first word of its code; 0 where it has none
uniform ivec3 table_origin;         // the brick at its texel (0, 0, 0)
uniform float fill_stored;          // of bricks without code
uniform ivec3 last_voxel;           // of the level

const int BITS = ${BITS};
const uint LEVELS = (1u << BITS) - 1u;
const ivec3 BRICK = ivec3(${BRICK_XYZ});
const ivec3 BLOCK = ivec3(${BLOCK_XYZ});
const ivec3 BLOCKS = (BRICK + BLOCK - 1) / BLOCK;
const int ROW_NBITS = (BRICK.x * BITS + 15) / 16 * 16;
const int ROWS_BIT = 16 * SAMPLE_NBYTES * BLOCKS.x * BLOCKS.y * BLOCKS.z;

// The first word of a brick's code, or -1.
int code_of(ivec3 brick) { return int(texelFetch(brick_table, brick - table_origin, 0).r) - 1; }

int bit_of(ivec3 voxel) { return ROWS_BIT + (voxel.z * BRICK.y + voxel.y) * ROW_NBITS + voxel.x * BITS; }

// Two fetches beside the table: end points and index.
float voxel_stored(ivec3 voxel) {
    ivec3 brick = voxel / BRICK;
    int word = code_of(brick);
    if (word < 0) return fill_stored;
    voxel -= brick * BRICK;
    SAMPLE_PAIR ends = pair_at(word, block_of(voxel, BLOCK, BLOCKS));
    return to_stored(between(ends, bits_at(word, bit_of(voxel), BITS), LEVELS));
}

float mixed(float corners[8], vec3 part) {
    vec4 front = vec4(corners[0], corners[2], corners[4], corners[6]);
    vec4 back = vec4(corners[1], corners[3], corners[5], corners[7]);
    vec4 along_x = mix(front, back, part.x);
    vec2 along_y = mix(along_x.xz, along_x.yw, part.y);
    return mix(along_y.x, along_y.y, part.z);
}

// 16 fetches: eight voxels, each by itself.
float by_voxels(ivec3 base, vec3 part) {
    float corners[8];
    for (int i = 0; i < 8; ++i)
        corners[i] = voxel_stored(min(base + ivec3(i & 1, i >> 1 & 1, i >> 2), last_voxel));
    return mixed(corners, part);
}

#if ${SAMPLING} == 2
// The same with what neighbours have in common fetched once: end points where all eight lie in one
// block, and two indices that follow each other along x.
float with_shared(ivec3 base, vec3 part) {
    ivec3 brick = base / BRICK;
    ivec3 voxel = base - brick * BRICK;
    bool in_one_block = all(lessThan(voxel % BLOCK, BLOCK - 1)) && all(lessThan(voxel, BRICK - 1))
        && all(lessThan(base, last_voxel));
    if (!in_one_block) return by_voxels(base, part);
    int word = code_of(brick);
    if (word < 0) return fill_stored;
    SAMPLE_PAIR ends = pair_at(word, block_of(voxel, BLOCK, BLOCKS));
    float corners[8];
    for (int row = 0; row < 4; ++row) {
        uint both = bits_at(word, bit_of(voxel + ivec3(0, row & 1, row >> 1)), 2 * BITS);
        corners[2 * row] = to_stored(between(ends, bitfieldExtract(both, 0, BITS), LEVELS));
        corners[2 * row + 1] = to_stored(between(ends, bitfieldExtract(both, BITS, BITS), LEVELS));
    }
    return mixed(corners, part);
}
#endif

float stored_at(int channel, vec3 p_voxel) {
    vec3 p = clamp(p_voxel, vec3(0.5), vec3(last_voxel) + 0.5);
#if ${SAMPLING} == 0
    return voxel_stored(min(ivec3(p), last_voxel));
#else
    vec3 low = floor(p - 0.5);
#if ${SAMPLING} == 1
    return by_voxels(ivec3(low), p - 0.5 - low);
#else
    return with_shared(ivec3(low), p - 0.5 - low);
#endif
#endif
}
