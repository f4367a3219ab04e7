// Where decoders put voxels. The slab texture holds *stored* values, 0..1: integers as normalised
// offset-binary (lowest value of the type = 0), floats relative to the volume's range.

layout(${IMAGE_FORMAT}, binding = 0) uniform writeonly image3D slab;

// One brick's part of the slab.
struct Part {
    ivec4 code_words;      // the first words of the brick's code and of its codebook
    ivec4 yz_range;        // the part's voxels of the brick along y and z, as x_range
    ivec4 brick_in_slab;   // where the brick's voxel (0, 0, 0) lies in the slab texture
    ivec4 first_in_brick;  // where decoding begins: a multiple of what an invocation decodes
    ivec4 x_range;         // the part's voxels of the brick along x: first and end
};
layout(std430, binding = 0) readonly buffer Parts { Part parts[]; };

uniform ivec3 part_size;  // voxels, in whole invocations. The same for all parts of a dispatch.

// What one invocation decodes: a run of voxels along x in each of some rows along y. Finding out
// which costs as much as decoding a few voxels, so it should be several.
struct Work {
    Part part;
    ivec3 first;  // voxel of the brick
    int rows;
};

// Parts lie behind each other along z.
Work find_work() {
    ivec3 at = ivec3(gl_GlobalInvocationID) * ivec3(${RUN}, ${ROWS}, 1);
    Work work;
    work.part = parts[at.z / part_size.z];
    work.first = work.part.first_in_brick.xyz + ivec3(at.xy, at.z % part_size.z);
    work.rows = at.x < part_size.x ? clamp(part_size.y - at.y, 0, ${ROWS}) : 0;
    return work;
}

void put(Work work, ivec3 voxel, float stored) {
    if (voxel.x >= work.part.x_range.x && voxel.x < work.part.x_range.y)
        imageStore(slab, work.part.brick_in_slab.xyz + voxel, vec4(stored));
}
