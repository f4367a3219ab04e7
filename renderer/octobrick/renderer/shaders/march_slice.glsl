// One plane through the volume: at most one sample a ray, where it meets the plane.

uniform vec4 slice_voxel;  // on the plane dot(slice.xyz, p) + slice.w is 0

vec4 march(Ray ray, Span span, ivec2 samples, vec4 gathered, ivec2 pixel) {
    float advance = dot(slice_voxel.xyz, ray.step_voxel);
    if (abs(advance) < PARALLEL) return gathered;
    float at = -(dot(slice_voxel.xyz, ray.start_voxel) + slice_voxel.w) / advance;
    vec3 p = ray.start_voxel + ray.step_voxel * at;
    bool in_slab = p[slab_axis] >= slab_low_voxel && p[slab_axis] < slab_high_voxel;
    if (!in_slab || at < span.ends.x || at > span.ends.y || emptiness_at(cell_of(p)) > 0)
        return gathered;
    put_depth(ray, at, pixel);
#if ${RGB}
    return color_of_rgb(vec3(stored_at(0, p), stored_at(1, p), stored_at(2, p)));
#else
    Mixture mixture = NOTHING;
    for (int channel = 0; channel < CHANNELS; ++channel)
        mix_in(mixture, color_of(channel, stored_at(channel, p)));
    return color_of_mixture(mixture);
#endif
}
