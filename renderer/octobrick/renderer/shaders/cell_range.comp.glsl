// The smallest and largest voxel that samples of a cell are interpolated from.
//
// A sample belongs to the cell that holds its base voxel floor(p − ½); it touches that voxel and
// the next on each axis, so a cell's footprint is one voxel longer than the cell.

layout(local_size_x = 8, local_size_y = 8) in;

layout(${RANGE_FORMAT}, binding = 0) uniform writeonly image3D cell_range;

uniform sampler3D slab;
uniform ivec3 content_low;   // the voxel that the slab texture's texel (0, 0, 0) holds
uniform ivec3 content_size;
uniform ivec3 cell_origin;   // the cell at texel (0, 0, 0)
uniform ivec3 cell_count;

const ivec3 CELL = ivec3(${CELL_XYZ});

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, cell_count))) return;
    ivec3 first = (cell_origin + at) * CELL - content_low;
    ivec3 low = max(first, ivec3(0));
    ivec3 high = min(first + CELL, content_size - 1);
    vec2 range = vec2(1.0, 0.0);
    for (int z = low.z; z <= high.z; ++z)
        for (int y = low.y; y <= high.y; ++y)
            for (int x = low.x; x <= high.x; ++x) {
                float stored = texelFetch(slab, ivec3(x, y, z), 0).r;
                range = vec2(min(range.x, stored), max(range.y, stored));
            }
    imageStore(cell_range, at, vec4(range, 0.0, 0.0));
}
