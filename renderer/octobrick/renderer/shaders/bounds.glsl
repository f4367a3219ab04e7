// Which part of a ray lies in the volume and in what is not clipped away.

uniform vec3 box_low_voxel;         // all samples that can be visible lie in this box
uniform vec3 box_high_voxel;
uniform int clip_count;
uniform vec4 clip_planes_voxel[12]; // kept is where dot(plane.xyz, p) + plane.w >= 0

struct Span {
    ivec2 samples;  // [first, end) of the ray within the volume and all clip planes
    vec2 ends;      // where it enters and leaves, in steps from the start of the ray
};

// Narrows a span to where `start + advance·k` lies between two planes.
void narrow(float start, float advance, float low, float high, inout Span span) {
    clip_to(start, advance, low, high, span.samples);
    if (abs(advance) < PARALLEL) {
        if (start < low || start >= high) span.ends = vec2(0);
        return;
    }
    vec2 planes = (vec2(low, high) - start) / advance;
    span.ends = vec2(max(span.ends.x, min(planes.x, planes.y)), min(span.ends.y, max(planes.x, planes.y)));
}

Span span_of(Ray ray, vec3 volume_size) {
    Span span = Span(ivec2(0, SAMPLES_MAX), vec2(0, SAMPLES_MAX));
    for (int axis = 0; axis < 3; ++axis)
        narrow(ray.start_voxel[axis], ray.step_voxel[axis], 0.0, volume_size[axis], span);
    for (int i = 0; i < clip_count; ++i) {
        vec4 plane = clip_planes_voxel[i];
        narrow(dot(plane.xyz, ray.start_voxel) + plane.w, dot(plane.xyz, ray.step_voxel), 0.0, FAR, span);
    }
    span.samples.y = min(span.samples.y, span.samples.x + samples_longest);
    return span;
}

// How many steps a sample stands for. The first and the last also take what lies between them and
// the surface, so that the length of matter is right at any step.
float steps_of(Span span, int k) {
    float first = k == span.samples.x ? span.ends.x : float(k);
    float last = k == span.samples.y - 1 ? span.ends.y : float(k + 1);
    return clamp(last - first, 0.0, 2.0);
}
