// Stored directions of gradients: three bytes that are interpolated, then decoded
// (docs/spec/gradient-code.md).
//
// Surfaces are lit from both sides, so a direction and its opposite are one: they are turned to the
// same side before they are mixed. Where the two sides of something thin meet they would cancel.

uniform sampler3D directions[CHANNELS];

// A vector along the gradient; (0, 0, 0) where there is none. Not of unit length. A component of 1
// is 255 of the code.
vec3 decode_direction(vec3 components) {
    vec3 at = 255.0 * components;
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

// By constants, as in slab.glsl. Components are odd numbers of 1/255, of which a texel has the half.
vec3 code_at(int channel, ivec3 texel) {
    vec3 code;
#if ${CHANNELS} > 1
    if (channel == 1) code = texelFetch(directions[1], texel, 0).rgb;
#endif
#if ${CHANNELS} > 2
    if (channel == 2) code = texelFetch(directions[2], texel, 0).rgb;
#endif
#if ${CHANNELS} > 3
    if (channel == 3) code = texelFetch(directions[3], texel, 0).rgb;
#endif
    if (channel == 0) code = texelFetch(directions[0], texel, 0).rgb;
    return 2.0 * code - 1.0;
}

vec3 direction_at(int channel, vec3 p_voxel) {
    vec3 size = content_high_voxel - content_low_voxel;
    vec3 p = clamp(p_voxel - content_low_voxel, vec3(0.5), size - 0.5) - 0.5;
    ivec3 base = ivec3(p), last = ivec3(size) - 1;
    vec3 part = p - vec3(base);
    vec3 side = code_at(channel, min(base + ivec3(greaterThan(part, vec3(0.5))), last));
    vec3 sum = vec3(0);
    for (int i = 0; i < 8; ++i) {
        ivec3 corner = ivec3(i & 1, i >> 1 & 1, i >> 2);
        vec3 code = code_at(channel, min(base + corner, last));
        vec3 weight = mix(1.0 - part, part, vec3(corner));
        sum += weight.x * weight.y * weight.z * (dot(code, side) < 0.0 ? -code : code);
    }
    return decode_direction(sum);
}
