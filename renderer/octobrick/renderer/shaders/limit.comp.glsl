// What remains of a voxel's change where its code can be wrong by no more than a bound, and the
// filtered voxel (docs/spec/deblocking.md, "The limit"). A negative bound means that the change is
// clamped to a part of it.

layout(local_size_x = 8, local_size_y = 8) in;

layout(${IMAGE_FORMAT}, binding = 0) uniform writeonly image3D slab;
layout(r32f, binding = 1) uniform readonly image3D change;

#include "filtered.glsl"

uniform ivec3 box_low;
uniform ivec3 box_size;
uniform sampler3D bounds;
uniform ivec3 first_block;  // the block that the first texel of the bounds is for

const float COARSE_SHARE = 0.4;

float limited(float moved, float bound) {
    if (bound == 0.0) return 0.0;
    if (bound < 0.0) return clamp(moved, COARSE_SHARE * bound, -COARSE_SHARE * bound);
    float ratio = abs(moved / bound);
#if ${IS_RAMP}
    return moved * max(0.0, 1.0 - ratio * ratio);
#else
    return moved * max(0.0, 1.0 - ratio);
#endif
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, box_size))) return;
    ivec3 voxel = box_low + at;
    float bound = texelFetch(bounds, voxel / ivec3(${BLOCK_XYZ}) - first_block, 0).r;
    float value = value_at(voxel - decoded_low) + limited(imageLoad(change, at).r / 3.0, bound);
    imageStore(slab, at, vec4(clamp(value / float(${HIGHEST_STORED}), 0.0, 1.0)));
}
