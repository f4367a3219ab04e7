// S3Dc at a fixed rate (claims S9..S11). An invocation decodes RUN voxels along x, whose indices lie
// in at most two 32-bit words. RUN divides the block's edge, so that one pair of end points serves
// them all.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "stored.glsl"
#include "s3dc.glsl"
#include "s3dc_fixed.glsl"

const int RUN = ${RUN};

uint indices_of_run(int word, int bit) {
#if ${CROSSES_WORDS}
    return bits_at(word, bit, RUN * BITS);
#else
    return codes[word + (bit >> 5)] >> (bit & 31);
#endif
}

#if ${SCALED}
// Positions are 0 to 65535; those of the first and the last index are these.
SAMPLE value_of(int word, SAMPLE_PAIR ends, uint index, int scale) {
    uint position = bits_at(word, scale + 16 * int(index), 16);
#if ${IS_FLOAT}
    return between(ends, position, 65535u);
#else
    return ends.x + int((uint(ends.y - ends.x) * position + 32767u) / 65535u);
#endif
}
#else
SAMPLE value_of(int word, SAMPLE_PAIR ends, uint index, int scale) {
    return between(ends, index, LEVELS);
}
#endif

void main() {
    Work work = find_work();
    ivec3 voxel = work.first;
    int word = work.part.code_words.x;
    int bit = ROWS_BIT + (voxel.z * BRICK.y + voxel.y) * ROW_NBITS + voxel.x * BITS;
    int block_row = -1;
    int scale = 0;
    SAMPLE_PAIR ends;
    for (int row = 0; row < work.rows; ++row, ++voxel.y, bit += ROW_NBITS) {
        if (voxel.y / BLOCK.y != block_row) {
            block_row = voxel.y / BLOCK.y;
            int block = block_of(voxel, BLOCK, BLOCKS);
            ends = pair_at(word, block);
            scale = scale_bit(word, block);
        }
        uint run = indices_of_run(word, bit);
        for (int i = 0; i < RUN; ++i) {
            uint index = bitfieldExtract(run, i * BITS, BITS);
            put(work, voxel + ivec3(i, 0, 0), to_stored(value_of(word, ends, index, scale)));
        }
    }
}
