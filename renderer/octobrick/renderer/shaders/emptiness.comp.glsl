// For each cell: 0 where a sample can be visible, else how many cells it is, at least, to the
// nearest such cell (Chebyshev distance, up to REACH + 1). This pass finds the 0s.

layout(local_size_x = 8, local_size_y = 8) in;

layout(r8ui, binding = 0) uniform writeonly uimage3D emptiness;

const int CHANNELS = ${CHANNELS};

uniform sampler3D cell_range[CHANNELS];
uniform usampler3D sampled_bricks;  // 1 where the brick was selected
uniform ivec3 brick_origin;         // the brick at its texel (0, 0, 0)
uniform ivec3 cell_origin;
uniform ivec3 cell_count;
uniform float entries_per_stored[CHANNELS];
uniform float entry_of_stored_zero[CHANNELS];
uniform float entry_margin[CHANNELS];  // by which rounding can move a position, and 1 to be sure
uniform bool skip_nothing;          // where every sample counts; for tests and measurements too
uniform bvec2 widened;              // ranges count as if they reached to the least, the greatest
uniform bool by_surface;            // visible is what holds the surface's value
uniform vec2 surface_stored;

// How many entries of each channel's table before each have an opacity above 0.
layout(std430, binding = 0) readonly buffer Opacity { uint opaque_before[]; };

const ivec3 CELL = ivec3(${CELL_XYZ});
const ivec3 BRICK = ivec3(${BRICK_XYZ});
const float LAST_ENTRY = float(${ENTRIES} - 1);
const uint FAR = uint(${REACH} + 1);

bool can_be_visible(int channel, vec2 range) {
    if (by_surface) return range.x <= surface_stored.y && range.y >= surface_stored.x;
    vec2 entry = range * entries_per_stored[channel] + entry_of_stored_zero[channel];
    float margin = entry_margin[channel];
    // The table is interpolated: a range touches the entries around its ends.
    int first = widened.x ? 0 : int(clamp(floor(entry.x - margin), 0.0, LAST_ENTRY));
    int last = widened.y ? ${ENTRIES} - 1 : int(clamp(ceil(entry.y + margin), 0.0, LAST_ENTRY));
    int row = channel * (${ENTRIES} + 1);
    return opaque_before[row + last + 1] > opaque_before[row + first];
}

bool cell_is_visible(ivec3 at) {
#if ${RGB}
    // The opacity of colours is that of their luminance (Rec. 709).
    vec2 range = 0.2126 * texelFetch(cell_range[0], at, 0).rg
        + 0.7152 * texelFetch(cell_range[1], at, 0).rg + 0.0722 * texelFetch(cell_range[2], at, 0).rg;
    return can_be_visible(0, range);
#else
    // By constants, as in slab.glsl.
    bool visible = can_be_visible(0, texelFetch(cell_range[0], at, 0).rg);
#if ${CHANNELS} > 1
    visible = visible || can_be_visible(1, texelFetch(cell_range[1], at, 0).rg);
#endif
#if ${CHANNELS} > 2
    visible = visible || can_be_visible(2, texelFetch(cell_range[2], at, 0).rg);
#endif
#if ${CHANNELS} > 3
    visible = visible || can_be_visible(3, texelFetch(cell_range[3], at, 0).rg);
#endif
    return visible;
#endif
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, cell_count))) return;
    ivec3 brick = (cell_origin + at) * CELL / BRICK - brick_origin;
    // A brick that was not selected may not even be decoded: what the slab holds there is stale.
    bool occupied = texelFetch(sampled_bricks, brick, 0).r != 0u
        && (skip_nothing || cell_is_visible(at));
    imageStore(emptiness, at, uvec4(occupied ? 0u : FAR));
}
