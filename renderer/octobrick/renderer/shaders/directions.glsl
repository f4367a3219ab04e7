// Stored directions of gradients: three bytes that are interpolated as they are, then decoded
// (docs/spec/gradient-code.md).

uniform sampler3D directions[CHANNELS];  // linear filter

// A vector along the gradient; (0, 0, 0) where there is none. Not of unit length.
vec3 decode_direction(vec3 code) {
    vec3 at = 255.0 * (2.0 * code - 1.0);
    vec3 size = abs(at);
    float a = max(max(size.x, size.y), size.z);
    if (a <= 1.5) return vec3(0);  // codes of zero are 1 away from the middle
    float c = min(min(size.x, size.y), size.z);
    float b = size.x + size.y + size.z - a - c;
    vec3 corner = vec3(a - b, b - c, c) / a;  // barycentric coordinates in the triangle
    corner *= 0.61 * corner + 0.39;
    float middle = corner.y + corner.z;
    vec3 found = mix(vec3(middle), vec3(corner.z), lessThanEqual(size, vec3(c)));
    found = mix(found, vec3(corner.x + middle), greaterThanEqual(size, vec3(a)));
    return found * sign(at);
}

// By constants, as in slab.glsl.
vec3 direction_at(int channel, vec3 p_voxel) {
    vec3 at = texture_position(p_voxel);
#if ${CHANNELS} > 1
    if (channel == 1) return decode_direction(textureLod(directions[1], at, 0.0).rgb);
#endif
#if ${CHANNELS} > 2
    if (channel == 2) return decode_direction(textureLod(directions[2], at, 0.0).rgb);
#endif
#if ${CHANNELS} > 3
    if (channel == 3) return decode_direction(textureLod(directions[3], at, 0.0).rgb);
#endif
    return decode_direction(textureLod(directions[0], at, 0.0).rgb);
}
