// The error bound of every block of S3Dc at a fixed rate, half a step between its levels; 0 where
// an integer block has no more values than indices. With trained scales, half of the widest step.
//
// It is negative where the limit is a clamp: where the range of a block's voxels is at most ten
// bounds. The range is that of the end points, unless the encoder was free to put these elsewhere.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "bound.glsl"
#include "s3dc_fixed.glsl"

double extent_of(SAMPLE_PAIR ends) { return double(ends.y) - double(ends.x); }

float bound_of(int word, int block) {
    double extent = extent_of(pair_at(word, block));
#if ${SCALED}
    int scale = scale_bit(word, block);
    uint widest = 0u, before = 0u;
    for (int i = 1; i < 1 << BITS; ++i) {
        uint position = bits_at(word, scale + 16 * i, 16);
        widest = max(widest, position - before);
        before = position;
    }
    return float(extent * (double(widest) / 65535.0LF) / 2.0LF);
#else
    if (!bool(${IS_FLOAT}) && extent <= double(LEVELS)) return 0.0;
    return float(extent / double(2u * LEVELS));
#endif
}

#if ${RANGED}
#include "filtered.glsl"

uniform ivec3 first_block;  // the block that the first texel of the bounds is for
uniform ivec3 level_size;

bool is_coarse(ivec3 block, float bound) {
    ivec3 low = (first_block + block) * BLOCK;
    ivec3 stop = min(low + BLOCK, level_size) - decoded_low;
    low -= decoded_low;
    float least = value_at(low), greatest = least;
    for (int z = low.z; z < stop.z; ++z)
        for (int y = low.y; y < stop.y; ++y)
            for (int x = low.x; x < stop.x; ++x) {
                float value = value_at(ivec3(x, y, z));
                least = min(least, value);
                greatest = max(greatest, value);
            }
    return double(greatest) - double(least) <= 10.0LF * double(bound);
}
#else
bool is_coarse(ivec3 block, float bound) { return bool(${IS_COARSE}); }
#endif

void main() {
    Work work = find_work();
    if (work.rows == 0) return;
    ivec3 block = work.first;
    int number_of_block = (block.z * BLOCKS.y + block.y) * BLOCKS.x + block.x;
    float bound = filter_bound(bound_of(work.part.code_words.x, number_of_block));
    put(work, block, is_coarse(work.part.brick_in_slab.xyz + block, bound) ? -bound : bound);
}
