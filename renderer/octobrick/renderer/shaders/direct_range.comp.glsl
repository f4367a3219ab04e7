// The range of values that samples of a cell can have, from the end points of the blocks that they
// are interpolated from: conservative, without decoding a voxel.

layout(local_size_x = 8, local_size_y = 8) in;

layout(${RANGE_FORMAT}, binding = 0) uniform writeonly image3D cell_range;

#include "codes.glsl"
#include "samples.glsl"
#include "stored.glsl"
#include "s3dc.glsl"

uniform usampler3D brick_table;
uniform ivec3 table_origin;
uniform float fill_stored;
uniform ivec3 last_voxel;
uniform ivec3 cell_origin;
uniform ivec3 cell_count;

const ivec3 CELL = ivec3(${CELL_XYZ});
const ivec3 BRICK = ivec3(${BRICK_XYZ});
const ivec3 BLOCK = ivec3(${BLOCK_XYZ});
const ivec3 BLOCKS = (BRICK + BLOCK - 1) / BLOCK;

vec2 range_of_block_at(ivec3 voxel) {
    ivec3 brick = voxel / BRICK;
    int word = int(texelFetch(brick_table, brick - table_origin, 0).r) - 1;
    if (word < 0) return vec2(fill_stored);
    SAMPLE_PAIR ends = pair_at(word, block_of(voxel - brick * BRICK, BLOCK, BLOCKS));
    return vec2(to_stored(ends.x), to_stored(ends.y));
}

// The first voxel after `at` on an axis that lies in another block.
int next_block(int at, int block, int brick) {
    int in_brick = at % brick;
    return at - in_brick + min((in_brick / block + 1) * block, brick);
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, cell_count))) return;
    ivec3 low = (cell_origin + at) * CELL;
    ivec3 high = min(low + CELL, last_voxel);
    vec2 range = vec2(1.0, 0.0);
    for (int z = low.z; z <= high.z; z = next_block(z, BLOCK.z, BRICK.z))
        for (int y = low.y; y <= high.y; y = next_block(y, BLOCK.y, BRICK.y))
            for (int x = low.x; x <= high.x; x = next_block(x, BLOCK.x, BRICK.x)) {
                vec2 found = range_of_block_at(ivec3(x, y, z));
                range = vec2(min(range.x, found.x), max(range.y, found.y));
            }
    imageStore(cell_range, at, vec4(range, 0.0, 0.0));
}
