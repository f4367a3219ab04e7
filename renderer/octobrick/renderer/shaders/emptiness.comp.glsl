// For each cell: 0 where a sample can be visible, else how many cells it is, at least, to the
// nearest such cell (Chebyshev distance, up to REACH + 1). This pass finds the 0s.

layout(local_size_x = 8, local_size_y = 8) in;

layout(r8ui, binding = 0) uniform writeonly uimage3D emptiness;

uniform sampler3D cell_range;
uniform usampler3D sampled_bricks;  // 1 where the brick was selected
uniform ivec3 brick_origin;         // the brick at its texel (0, 0, 0)
uniform ivec3 cell_origin;
uniform ivec3 cell_count;
uniform float entries_per_stored;
uniform float entry_of_stored_zero;
uniform float entry_margin;         // by which rounding can move a position, and 1 to be sure
uniform bool skip_nothing;          // for tests and measurements

// How many entries of the transfer function before each have an opacity above 0.
layout(std430, binding = 0) readonly buffer Opacity { uint opaque_before[]; };

const ivec3 CELL = ivec3(${CELL_XYZ});
const ivec3 BRICK = ivec3(${BRICK_XYZ});
const float LAST_ENTRY = float(${ENTRIES} - 1);
const uint FAR = uint(${REACH} + 1);

bool can_be_visible(vec2 range) {
    vec2 entry = range * entries_per_stored + entry_of_stored_zero;
    // The table is interpolated: a range touches the entries around its ends.
    int first = int(clamp(floor(entry.x - entry_margin), 0.0, LAST_ENTRY));
    int last = int(clamp(ceil(entry.y + entry_margin), 0.0, LAST_ENTRY));
    return opaque_before[last + 1] > opaque_before[first];
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, cell_count))) return;
    ivec3 brick = (cell_origin + at) * CELL / BRICK - brick_origin;
    // A brick that was not selected may not even be decoded: what the slab holds there is stale.
    bool occupied = texelFetch(sampled_bricks, brick, 0).r != 0u
        && (skip_nothing || can_be_visible(texelFetch(cell_range, at, 0).rg));
    imageStore(emptiness, at, uvec4(occupied ? 0u : FAR));
}
