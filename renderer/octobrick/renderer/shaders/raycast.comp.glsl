// Samples one slab along every ray that still has light left, front to back, and adds what it
// finds to the picture: premultiplied, in float.
//
// A work group takes 8x8 pixels, in such an order that the invocations that run in lockstep
// (8 on a CPU: 4x2 pixels; 32 or 64 on a GPU) follow rays close together.

layout(local_size_x = 64) in;

layout(rgba32f, binding = 0) uniform image2D picture;
layout(std430, binding = 0) buffer Progress { uint rays_unfinished; };

#include "ray.glsl"
#include "slab.glsl"
#if ${SHADED}
#include "shading.glsl"
#endif

uniform ivec2 picture_size;
uniform vec3 volume_voxels;         // size of the level
uniform vec3 box_low_voxel;         // all samples that can be visible lie in this box
uniform vec3 box_high_voxel;
uniform int slab_axis;
uniform float slab_low_voxel;       // samples between these planes belong to this slab
uniform float slab_high_voxel;

uniform usampler3D emptiness;       // per cell: 0, or cells to the nearest that is not empty
uniform ivec3 cell_origin;

uniform sampler2D transfer;         // premultiplied colour of one step
uniform float entries_per_stored;
uniform float entry_of_stored_zero;

const ivec3 CELL = ivec3(${CELL_XYZ});
const float SATURATED = 1.0 - 1.0 / 1024.0;  // what is behind cannot change an 8-bit picture
const float SHY = 0.0625;  // samples by which skipping stops early rather than late

vec4 classify(float stored) {
    float entry = stored * entries_per_stored + entry_of_stored_zero;
    return textureLod(transfer, vec2((entry + 0.5) / float(${ENTRIES}), 0.5), 0.0);
}

// The first sample that may lie outside the cells within `reach` of a cell.
int leave(Ray ray, vec3 per_step, ivec3 cell, int reach, int k) {
    vec3 low = vec3((cell - reach) * CELL) + 0.5;
    vec3 high = vec3((cell + reach + 1) * CELL) + 0.5;
    vec3 exit = (mix(low, high, greaterThan(per_step, vec3(0))) - ray.start_voxel) * per_step;
    float nearest = min(min(exit.x, exit.y), exit.z) - 0.5 - SHY;
    return max(k + 1, int(ceil(min(nearest, float(SAMPLES_MAX)))));
}

vec4 march(Ray ray, ivec2 samples, vec4 gathered) {
    // Axes that the ray does not move along get a huge value of finite products.
    vec3 moving = max(abs(ray.step_voxel), vec3(PARALLEL));
    vec3 per_step = mix(vec3(1), vec3(-1), lessThan(ray.step_voxel, vec3(0))) / moving;
    ivec3 last_voxel = ivec3(volume_voxels) - 1;
    int k = samples.x;
    while (k < samples.y) {
        vec3 p = sample_voxel(ray, k);
        ivec3 cell = clamp(ivec3(floor(p - 0.5)), ivec3(0), last_voxel) / CELL;
        int empty = int(texelFetch(emptiness, cell - cell_origin, 0).r);
        if (empty > 0) {
            k = leave(ray, per_step, cell, empty - 1, k);
            continue;
        }
        vec4 color = classify(stored_at(p));
#if ${SHADED}
        if (color.a > 0.0) color = shade(color, gradient_at(p), ray.direction_world);
#endif
        gathered += (1.0 - gathered.a) * color;
        if (gathered.a >= SATURATED) break;
        ++k;
    }
    return gathered;
}

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
    if (gathered.a >= SATURATED) return;

    Ray ray = ray_of_pixel(pixel);
    ivec2 samples = ivec2(0, SAMPLES_MAX);
    clip_to_box(ray, vec3(0), volume_voxels, samples);
    samples.y = min(samples.y, samples.x + samples_longest);
    clip_to_box(ray, box_low_voxel, box_high_voxel, samples);
    if (samples.x >= samples.y) return;
    int end_of_ray = samples.y;
    clip_to(ray.start_voxel[slab_axis], ray.step_voxel[slab_axis], slab_low_voxel, slab_high_voxel,
            samples);

    if (samples.x < samples.y) {
        gathered = march(ray, samples, gathered);
        imageStore(picture, pixel, gathered);
    }
    // Every writer writes the same value.
    if (gathered.a < SATURATED && samples.y < end_of_ray) rays_unfinished = 1u;
}
