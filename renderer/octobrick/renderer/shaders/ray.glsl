// Rays and their samples. Voxel space: voxel i spans [i, i + 1], its centre at i + 0.5.
//
//     sample k of a ray lies at  start + (k + ½)·step,  k = 0, 1, 2 …
//
// with the same start and step in every slab. Which samples lie between two planes is decided by
// one function, so that neighbouring slabs share their samples out without gap or overlap.

uniform vec3 start_at00_voxel;      // where rays start, linear in the pixel
uniform vec3 start_by_column_voxel;
uniform vec3 start_by_row_voxel;
uniform vec3 toward_at00_world;     // their direction, likewise; not of unit length
uniform vec3 toward_by_column_world;
uniform vec3 toward_by_row_world;
uniform vec3 voxels_per_step;       // of a step along each axis
uniform int samples_longest;        // no ray has more samples within the volume

const int SAMPLES_MAX = 1 << 22;    // float(k) + 0.5 is exact below 2^23
const float PARALLEL = 1e-12;       // voxels a step: less than this never leaves a plane
const float FAR = 1e30;             // a plane beyond every sample

struct Ray {
    vec3 start_voxel;
    vec3 step_voxel;
    vec3 direction_world;  // unit length
};

Ray ray_of_pixel(ivec2 pixel) {
    vec2 at = vec2(pixel) + 0.5;
    Ray ray;
    ray.start_voxel = start_at00_voxel + at.x * start_by_column_voxel + at.y * start_by_row_voxel;
    ray.direction_world = normalize(
        toward_at00_world + at.x * toward_by_column_world + at.y * toward_by_row_world);
    ray.step_voxel = ray.direction_world * voxels_per_step;
    return ray;
}

vec3 sample_voxel(Ray ray, int k) {
    precise vec3 at = ray.start_voxel + ray.step_voxel * (float(k) + 0.5);
    return at;
}

// The first sample on the far side of a plane across one axis, seen along the ray.
int first_beyond(float start, float advance, float plane) {
    precise float k = (plane - start) / advance - 0.5;
    return int(clamp(ceil(k), 0.0, float(SAMPLES_MAX)));
}

// Narrows samples [x, y) to those between two planes across one axis.
void clip_to(float start, float advance, float low, float high, inout ivec2 samples) {
    if (abs(advance) < PARALLEL) {  // all or none; a division would give 0/0
        if (start < low || start >= high) samples = ivec2(0);
        return;
    }
    bool ascending = advance > 0.0;
    samples.x = max(samples.x, first_beyond(start, advance, ascending ? low : high));
    samples.y = min(samples.y, first_beyond(start, advance, ascending ? high : low));
}

void clip_to_box(Ray ray, vec3 low, vec3 high, inout ivec2 samples) {
    for (int axis = 0; axis < 3; ++axis)
        clip_to(ray.start_voxel[axis], ray.step_voxel[axis], low[axis], high[axis], samples);
}
