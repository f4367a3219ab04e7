// How much each voxel weighs on the curves of the deblocking filter (docs/spec/deblocking.md): by
// its gradient in voxels, relative to the volume's range. Where weights would leave float32, the
// gradient's magnitude, of which curve.comp.glsl makes logarithms of weights.

layout(local_size_x = 8, local_size_y = 8) in;

layout(r32f, binding = 0) uniform writeonly image3D weights;
layout(r32f, binding = 1) uniform writeonly image3D change;

#include "filtered.glsl"

uniform ivec3 decoded_size;
uniform ivec3 level_size;
uniform ivec3 box_low;           // the box whose voxels are filtered
uniform ivec3 box_size;
uniform float gradient_scale;    // 1 / range
#if ${DIRECT}
uniform float strength;
#endif

// One-sided at the faces of the level. At the faces of what is decoded a weight is not used.
float difference(ivec3 texel, ivec3 axis) {
    ivec3 below = max(texel - axis, ivec3(0)), above = min(texel + axis, decoded_size - 1);
    ivec3 voxel = decoded_low + texel;
    bool at_face = any(lessThan(voxel - axis, ivec3(0))) ||
                   any(greaterThanEqual(voxel + axis, level_size));
    return (value_at(above) - value_at(below)) * (at_face ? 1.0 : 0.5);
}

void main() {
    ivec3 texel = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(texel, decoded_size))) return;
    vec3 gradient = vec3(difference(texel, ivec3(1, 0, 0)), difference(texel, ivec3(0, 1, 0)),
                         difference(texel, ivec3(0, 0, 1)));
    float magnitude = length(gradient * gradient_scale);
#if ${DIRECT}
    imageStore(weights, texel, vec4(exp(-strength * magnitude)));
#else
    imageStore(weights, texel, vec4(magnitude));
#endif
    ivec3 at = decoded_low + texel - box_low;
    if (all(greaterThanEqual(at, ivec3(0))) && all(lessThan(at, box_size)))
        imageStore(change, at, vec4(0.0));
}
