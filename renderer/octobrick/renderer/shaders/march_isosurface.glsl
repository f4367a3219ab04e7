// The surface of one value: where it lies between the values of two samples that follow each other.
//
// Such a pair belongs to the slab of its second sample. At least one of the two lies in a cell whose
// values reach from below the surface's to above it, so leaping over the others misses none.

uniform float surface_stored;

const int HALVINGS = 8;  // 1/512 of a step: less than a pixel's worth of shading

// Where between samples k - 1 and k the surface lies, in steps from the start of the ray.
float crossing(Ray ray, int k, bool rising) {
    float near = float(k) - 0.5, far = float(k) + 0.5;
    for (int i = 0; i < HALVINGS; ++i) {
        float middle = 0.5 * (near + far);
        bool above = stored_at(0, ray.start_voxel + ray.step_voxel * middle) >= surface_stored;
        if (above == rising) far = middle;
        else near = middle;
    }
    return 0.5 * (near + far);
}

bool is_above(Ray ray, int k) { return stored_at(0, sample_voxel(ray, k)) >= surface_stored; }

vec4 march(Ray ray, Span span, ivec2 samples, vec4 gathered, ivec2 pixel) {
    vec3 per_voxel = samples_per_voxel(ray);
    int k = samples.x;
    int known = -1;  // the sample of which `above` tells
    bool above = false;
    while (k < samples.y) {
        vec3 p = sample_voxel(ray, k);
        ivec3 cell = cell_of(p);
        int empty = emptiness_at(cell);
        // The one before may lie in another slab, or have been leapt over.
        bool first = k == span.samples.x;
        bool before_counts = !first && known != k - 1
            && (empty == 0 || emptiness_at(cell_of(sample_voxel(ray, k - 1))) == 0);
        if (before_counts) {
            above = is_above(ray, k - 1);
            known = k - 1;
        }
        if (empty > 0 && known != k - 1) {
            k = leave(ray, per_voxel, cell, empty - 1, k);
            continue;
        }
        bool here = is_above(ray, k);
        if (known == k - 1 && !first && here != above) {
            float at = crossing(ray, k, here);
            vec3 surface = ray.start_voxel + ray.step_voxel * at;
            vec4 color = color_of(0, surface_stored);
#if ${SHADED}
            color = shade(color, gradient_at(0, surface), ray.direction_world);
#endif
            if (gathered.a < 0.5 && gathered.a + (1.0 - gathered.a) * color.a >= 0.5)
                put_depth(ray, at, pixel);
            gathered += (1.0 - gathered.a) * color;
            if (gathered.a >= SATURATED) break;
        }
        above = here;
        known = k;
        if (empty > 0) {  // what comes next may not even be decoded
            known = -1;
            k = leave(ray, per_voxel, cell, empty - 1, k);
            continue;
        }
        ++k;
    }
    return gathered;
}
