// S3Dc with a width per block, 0 to 14 bits, or raw samples. An invocation decodes RUN voxels along
// x in some rows. RUN divides the block's edge, so that they share a width and end points.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "stored.glsl"
#include "s3dc.glsl"
#include "s3dc_variable.glsl"

const int RUN = ${RUN};

struct Block {
    int payload;  // its first word
    int width;
    SAMPLE_PAIR ends;
};

Block find_block(int word, int number) {
    return Block(payload_of(word, number), width_of(word, number), pair_at(word, number));
}

void put_raw(Work work, ivec3 voxel, Block block, int index) {
    for (int i = 0; i < RUN; ++i)
        put(work, voxel + ivec3(i, 0, 0), to_stored(sample_at(block.payload, index + i)));
}

void put_run(Work work, ivec3 voxel, Block block, int index) {
    int low_width = min(block.width, 8), high_width = block.width - low_width;
    uint low = bits_at(block.payload, index * low_width, RUN * low_width);
    int high_plane = block.payload + 8 * UNIT;
    uint high = 0u;
    if (high_width > 0) high = bits_at(high_plane, index * high_width, RUN * high_width);
    uint levels = max((1u << block.width) - 1u, 1u);  // of no bits, one value: the first
    for (int i = 0; i < RUN; ++i) {
        uint number = bitfieldExtract(low, i * low_width, low_width) |
                      bitfieldExtract(high, i * high_width, high_width) << 8;
        put(work, voxel + ivec3(i, 0, 0), to_stored(between(block.ends, number, levels)));
    }
}

void main() {
    Work work = find_work();
    ivec3 voxel = work.first;
    int word = work.part.code_words.x;
    int block_row = -1;
    Block block;
    for (int row = 0; row < work.rows; ++row, ++voxel.y) {
        if (voxel.y / BLOCK.y != block_row) {
            block_row = voxel.y / BLOCK.y;
            block = find_block(word, block_of(voxel, BLOCK, BLOCKS));
        }
        ivec3 within = voxel % BLOCK;
        int index = (within.z * BLOCK.y + within.y) * BLOCK.x + within.x;
        if (block.width == RAW)
            put_raw(work, voxel, block, index);
        else
            put_run(work, voxel, block, index);
    }
}
