// The error bound of every block of S3Dc with a width per block: half a step between its levels, 0
// where voxels are exact, and where a block has a single value what stands behind the code.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "bound.glsl"
#include "s3dc_variable.glsl"

uniform float bound_max;  // the codec's, or more than any

// The word behind the code: behind the last block's payload.
float flat_bound(int word) {
    int last = BLOCK_COUNT - 1, width = width_of(word, last);
    int units = width == RAW ? 8 * SAMPLE_NBYTES : width;
    return uintBitsToFloat(codes[payload_of(word, last) + UNIT * units]);
}

float bound_of(int word, int block) {
    int width = width_of(word, block);
    if (width == RAW) return 0.0;
    if (width == 0) return flat_bound(word);
    SAMPLE_PAIR ends = pair_at(word, block);
    double extent = double(ends.y) - double(ends.x);
    uint levels = (1u << width) - 1u;
    if (!bool(${IS_FLOAT}) && extent <= double(levels)) return 0.0;
    return min(float(extent / double(2u * levels)), bound_max);
}

void main() {
    Work work = find_work();
    if (work.rows == 0) return;
    ivec3 block = work.first;
    int number_of_block = (block.z * BLOCKS.y + block.y) * BLOCKS.x + block.x;
    put(work, block, filter_bound(bound_of(work.part.code_words.x, number_of_block)));
}
