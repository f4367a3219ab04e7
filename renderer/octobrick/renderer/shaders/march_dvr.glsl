// Direct volume rendering: every sample emits and absorbs, front to back.

vec4 sample_color(Ray ray, vec3 p) {
#if ${RGB}
    vec4 color = color_of_rgb(vec3(stored_at(0, p), stored_at(1, p), stored_at(2, p)));
#if ${SHADED}
    if (color.a > 0.0) {
        vec3 gradient = LUMINANCE.r * gradient_at(0, p) + LUMINANCE.g * gradient_at(1, p)
            + LUMINANCE.b * gradient_at(2, p);
        color = shade(color, gradient, ray.direction_world);
    }
#endif
    return color;
#else
    Mixture mixture = NOTHING;
    for (int channel = 0; channel < CHANNELS; ++channel) {
        vec4 color = color_of(channel, stored_at(channel, p));
#if ${EDGES}
        if (color.a > 0.0) color *= edge_at(channel, p);
#endif
#if ${SHADED}
        if (color.a > 0.0) color = shade(color, gradient_at(channel, p), ray.direction_world);
#endif
        if (CHANNELS == 1) return color;
        mix_in(mixture, color);
    }
    return color_of_mixture(mixture);
#endif
}

// The colour of a sample that stands for some other length than one step.
vec4 lengthened(vec4 color, float steps) {
    // 1 - (1 - a)^steps; of a thin sample the series, as 1 - a has few digits of a.
    float a = min(color.a, 1.0);
    float alpha = a > 0.05
        ? 1.0 - pow(1.0 - a, steps)
        : a * steps * (1.0 - a * (steps - 1.0) / 2.0
            * (1.0 - a * (steps - 2.0) / 3.0 * (1.0 - a * (steps - 3.0) / 4.0)));
    return color.a > 0.0 ? vec4(color.rgb * (alpha / color.a), alpha) : color;
}

vec4 march(Ray ray, Span span, ivec2 samples, vec4 gathered, ivec2 pixel) {
    vec3 per_voxel = samples_per_voxel(ray);
    int k = samples.x;
    while (k < samples.y) {
        vec3 p = sample_voxel(ray, k);
        ivec3 cell = cell_of(p);
        int empty = emptiness_at(cell);
        if (empty > 0) {
            k = leave(ray, per_voxel, cell, empty - 1, k);
            continue;
        }
        vec4 color = sample_color(ray, p);
        if (k == span.samples.x || k == span.samples.y - 1)
            color = lengthened(color, steps_of(span, k));
        float before = gathered.a;
        gathered += (1.0 - gathered.a) * color;
        if (before < 0.5 && gathered.a >= 0.5) put_depth(ray, float(k) + 0.5, pixel);
        if (gathered.a >= SATURATED) break;
        ++k;
    }
    return gathered;
}
