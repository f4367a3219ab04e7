// From values at points to pixels: the same for slabs and for bricks that stay compressed.

#include "classify.glsl"
#include "skip.glsl"
#if ${GRADIENTS} == 1 || ${EDGES}
#include "gradient.glsl"
#endif
#if ${EDGES}
#include "edges.glsl"
#endif
#if ${GRADIENTS} == 2
#include "directions.glsl"
vec3 gradient_at(int channel, vec3 p) { return direction_at(channel, p); }
#elif ${GRADIENTS} == 1
vec3 gradient_at(int channel, vec3 p) { return difference_at(channel, p); }
#endif
#if ${SHADED}
#include "shading.glsl"
#endif
#if ${MODE} == 0
#include "march_dvr.glsl"
#elif ${MODE} == 1
#include "march_projection.glsl"
#elif ${MODE} == 2
#include "march_isosurface.glsl"
#else
#include "march_slice.glsl"
#endif

ivec2 pixel_of_invocation() {
    uint i = gl_LocalInvocationIndex;  // its bits are y2 y1 x2 y0 x1 x0
    uint x = (i & 3u) | ((i >> 1) & 4u);
    uint y = ((i >> 2) & 1u) | ((i >> 3) & 6u);
    return ivec2(gl_WorkGroupID.xy) * 8 + ivec2(x, y);
}

void main() {
    ivec2 pixel = pixel_of_invocation();
    if (any(greaterThanEqual(pixel, picture_size))) return;
    vec4 gathered = imageLoad(picture, pixel);
#if ${MODE} != 1
    if (gathered.a >= SATURATED) return;
#endif
    Ray ray = ray_of_pixel(pixel);
    Span span = span_of(ray, volume_voxels);
#if ${MODE} == 3
    gathered = march(ray, span, span.samples, gathered, pixel);
    imageStore(picture, pixel, gathered);
    bool more = true;
#else
    ivec2 samples = span.samples;
    clip_to_box(ray, box_low_voxel, box_high_voxel, samples);
    if (samples.x >= samples.y) return;
    int end_of_ray = samples.y;
    clip_to(ray.start_voxel[slab_axis], ray.step_voxel[slab_axis], slab_low_voxel, slab_high_voxel,
            samples);
    if (samples.x < samples.y) {
        gathered = march(ray, span, samples, gathered, pixel);
        imageStore(picture, pixel, gathered);
    }
    bool more = samples.y < end_of_ray;
#endif
    // Every writer writes the same value.
    bool done = ${MODE} != 1 && gathered.a >= SATURATED;
    if (!done && more)
        unfinished[gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x] = 1u;
}
