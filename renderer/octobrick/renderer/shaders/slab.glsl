// The decoded slab: interpolated values and their gradient.

uniform sampler3D slab;            // stored values; linear filter
uniform vec3 content_low_voxel;    // the corner that the texture's corner holds
uniform vec3 content_high_voxel;
uniform vec3 per_texel;            // 1 / size of the texture
uniform vec3 difference_weight;    // smallest spacing / spacing: differences per world length

// Trilinear. Clamping matters only at the border of the volume, whose last voxels are repeated;
// everywhere else the slab has a margin. The texture's sides are powers of two, so that the
// coordinate is exact and the same voxels give the same value in every slab.
float stored_at(vec3 p_voxel) {
    vec3 p = clamp(p_voxel, content_low_voxel + 0.5, content_high_voxel - 0.5);
    return textureLod(slab, (p - content_low_voxel) * per_texel, 0.0).r;
}

// Central differences, in stored values per smallest spacing.
vec3 gradient_at(vec3 p) {
    return 0.5 * difference_weight * vec3(
        stored_at(p + vec3(1, 0, 0)) - stored_at(p - vec3(1, 0, 0)),
        stored_at(p + vec3(0, 1, 0)) - stored_at(p - vec3(0, 1, 0)),
        stored_at(p + vec3(0, 0, 1)) - stored_at(p - vec3(0, 0, 1)));
}
