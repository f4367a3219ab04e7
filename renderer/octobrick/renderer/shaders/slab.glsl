// The decoded slab: interpolated values of each channel and their gradients.

const int CHANNELS = ${CHANNELS};

uniform sampler3D slab[CHANNELS];  // stored values; linear filter
uniform vec3 content_low_voxel;    // the corner that the texture's corner holds
uniform vec3 content_high_voxel;
uniform vec3 per_texel;            // 1 / size of the texture

// Where in the texture a position lies. Clamping matters only at the border of the volume, whose
// last voxels are repeated; everywhere else the slab has a margin. The texture's sides are powers
// of two, so that the coordinate is exact and the same voxels give the same value in every slab.
vec3 texture_position(vec3 p_voxel) {
    vec3 p = clamp(p_voxel, content_low_voxel + 0.5, content_high_voxel - 0.5);
    return (p - content_low_voxel) * per_texel;
}

// Textures are chosen by constants. An index that varies in a loop is uniform among the invocations
// that still run it, but llvmpipe takes that of one which may have left.
float stored_at(int channel, vec3 p_voxel) {
    vec3 at = texture_position(p_voxel);
#if ${CHANNELS} > 1
    if (channel == 1) return textureLod(slab[1], at, 0.0).r;
#endif
#if ${CHANNELS} > 2
    if (channel == 2) return textureLod(slab[2], at, 0.0).r;
#endif
#if ${CHANNELS} > 3
    if (channel == 3) return textureLod(slab[3], at, 0.0).r;
#endif
    return textureLod(slab[0], at, 0.0).r;
}
