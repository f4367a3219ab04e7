// The greatest, least or mean value of a ray's samples, by channel. What the picture holds between
// slabs is the statistic so far; project.comp.glsl makes colours of it in the end.

#define MAXIMUM 0
#define MINIMUM 1
#define MEAN 2

#if ${STATISTIC} == MAXIMUM
uniform sampler3D cell_range;
#endif

vec4 values_at(vec3 p) {
    vec4 values = vec4(0);
    for (int channel = 0; channel < CHANNELS; ++channel) values[channel] = stored_at(channel, p);
    return values;
}

vec4 march(Ray ray, Span span, ivec2 samples, vec4 gathered, ivec2 pixel) {
    vec3 per_voxel = samples_per_voxel(ray);
    int k = samples.x;
    while (k < samples.y) {
        vec3 p = sample_voxel(ray, k);
        ivec3 cell = cell_of(p);
        int empty = emptiness_at(cell);
#if ${STATISTIC} == MAXIMUM
        if (CHANNELS == 1 && empty == 0
            && texelFetch(cell_range, cell - cell_origin, 0).g <= gathered.r) empty = 1;
#endif
        if (empty > 0) {
            k = leave(ray, per_voxel, cell, empty - 1, k);
            continue;
        }
        vec4 values = values_at(p);
#if ${STATISTIC} == MAXIMUM
        if (values.r > gathered.r) put_depth(ray, float(k) + 0.5, pixel);
        gathered = max(gathered, values);
#elif ${STATISTIC} == MINIMUM
        if (values.r < gathered.r) put_depth(ray, float(k) + 0.5, pixel);
        gathered = min(gathered, values);
#else
        gathered += values;
#endif
        ++k;
    }
    return gathered;
}
