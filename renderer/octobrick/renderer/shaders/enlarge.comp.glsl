// Shows a brick by a coarser one that covers it: each voxel is the coarse voxel that holds it.

layout(local_size_x = 8, local_size_y = 8) in;

layout(${IMAGE_FORMAT}, binding = 0) uniform writeonly image3D slab;

uniform sampler3D coarse;     // the voxels of the coarser brick that are needed
uniform ivec3 coarse_origin;  // the voxel of the coarser level at its texel (0, 0, 0)
uniform ivec3 first_voxel;    // of the slab's level
uniform ivec3 voxel_count;
uniform ivec3 content_low;    // the voxel at the slab's texel (0, 0, 0)
uniform int levels_up;

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, voxel_count))) return;
    ivec3 voxel = first_voxel + at;
    ivec3 covering = (voxel >> levels_up) - coarse_origin;
    imageStore(slab, voxel - content_low, texelFetch(coarse, covering, 0));
}
